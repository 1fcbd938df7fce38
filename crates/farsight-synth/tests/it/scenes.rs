//! Laws of random scenes and rebuilt frames.

use crate::laws;
use farsight_core::{Box2d, Box3d, Camera, Dimensions, Label, ObjectClass};
use farsight_synth::scene::Mesh;
use farsight_synth::sizes::{Distribution, SizeStatistics};
use farsight_synth::{CameraRanges, LabelledScene, PlaceWeights, SceneConfig, generate_scene, scene_from_labels};

const SCENES: u64 = 60;

fn scenes() -> impl Iterator<Item = (u64, LabelledScene)> {
    let config = SceneConfig::generic();
    (0..SCENES).map(move |index| (index, generate_scene(&config, 11, index)))
}

#[test]
fn meshes_fill_their_boxes() {
    for (index, generated) in scenes() {
        laws::assert_fills_its_box(&generated, &format!("scene {index}"));
    }
}

#[test]
fn objects_do_not_touch_each_other() {
    for (index, generated) in scenes() {
        laws::assert_nobody_touches(&generated, &format!("scene {index}"));
    }
}

#[test]
fn nobody_stands_around_the_camera() {
    for (index, generated) in scenes() {
        for labelled in &generated.objects {
            let distance = labelled.box3d.ground_distance_m();
            let reach = labelled.box3d.dimensions.length.hypot(labelled.box3d.dimensions.width) / 2.0;
            let nearest =
                Box3d { location: [labelled.box3d.location[0], 0.0, labelled.box3d.location[2]], ..labelled.box3d };
            let level = Box3d { dimensions: Dimensions { height: 1e-9, ..nearest.dimensions }, ..nearest };
            assert!(level.nearest_distance_m() > 0.9, "scene {index}: {distance} m away, {reach} m large");
        }
    }
}

#[test]
fn the_camera_is_above_the_ground() {
    for (index, generated) in scenes() {
        let ground = &generated.scene.objects[0].mesh;
        let near = ground.vertices.iter().filter(|v| v.position[0].abs() < 4.0 && v.position[2].abs() < 4.0);
        let highest = near.map(|v| v.position[1]).fold(f32::INFINITY, f32::min);
        assert!(highest > 0.9, "scene {index}: ground {highest} m below the camera");
    }
}

#[test]
fn the_same_seed_draws_the_same_scene_and_another_draws_another() {
    let config = SceneConfig::default();
    assert_eq!(generate_scene(&config, 5, 7), generate_scene(&config, 5, 7));
    assert_ne!(generate_scene(&config, 5, 7), generate_scene(&config, 5, 8));
    assert_ne!(generate_scene(&config, 5, 7), generate_scene(&config, 6, 7));
}

#[test]
fn oncoming_traffic_keeps_to_its_side() {
    for (left_hand_share, sign) in [(0.0, -1.0), (1.0, 1.0)] {
        let mut config = SceneConfig { left_hand_share, ..SceneConfig::default() };
        config.places =
            PlaceWeights { city: 0.0, residential: 0.0, suburban: 0.0, rural: 0.0, motorway: 1.0, car_park: 0.0 };
        let generated: Vec<LabelledScene> = (0..40).map(|index| generate_scene(&config, 2, index)).collect();
        let near = generated.iter().flat_map(|d| &d.objects).map(|a| a.box3d).filter(|b| b.location[2] < 30.0);
        let oncoming: Vec<f64> = near.filter(|b| b.yaw.sin() > 0.9).map(|b| b.location[0] * sign).collect();
        assert!(oncoming.len() > 10 && oncoming.iter().all(|&x| x > 0.0), "{oncoming:?}");
    }
}

#[test]
fn factors_make_more_of_whom_they_are_for_and_none_at_0() {
    use ObjectClass::{Cyclist, Pedestrian, Tram, Truck};
    let count = |[people_factor, heavy_factor]: [f64; 2], classes: &[ObjectClass]| {
        let config = SceneConfig { people_factor, heavy_factor, ..SceneConfig::default() };
        let generated = (0..SCENES).map(|index| generate_scene(&config, 4, index));
        generated.map(|d| d.objects.iter().filter(|a| classes.contains(&a.class)).count()).sum::<usize>()
    };
    let (people, heavy) = ([Pedestrian, Cyclist], [Truck, Tram]);
    assert_eq!([count([0.0, 1.0], &people), count([1.0, 0.0], &heavy)], [0, 0]);
    assert!(count([5.0, 1.0], &people) > 3 * count([1.0, 1.0], &people));
    assert!(count([1.0, 5.0], &heavy) > 2 * count([1.0, 1.0], &heavy));
}

#[test]
fn clutter_stands_beside_the_objects_and_moves_none() {
    let generated = |clutter: f64, index: u64| {
        generate_scene(&SceneConfig { clutter, people_factor: 4.0, ..SceneConfig::default() }, 6, index)
    };
    let mut more = 0;
    for index in 0..SCENES {
        let (plain, cluttered) = (generated(0.0, index), generated(8.0, index));
        assert_eq!(plain.objects, cluttered.objects, "scene {index}");
        let [before, after] = [&plain, &cluttered].map(|d| &d.scene.objects[1].mesh);
        // Crowns of trees may hang over someone, whatever stands about.
        assert_eq!(inside_objects(&plain, before), inside_objects(&cluttered, after), "scene {index}");
        more += usize::from(after.vertices.len() > before.vertices.len() + 100);
    }
    assert!(more as u64 > SCENES / 2, "{more} of {SCENES} scenes have clutter");
}

/// Corners of a mesh in the boxes of objects, a little smaller than they are.
fn inside_objects(generated: &LabelledScene, mesh: &Mesh) -> usize {
    let is_inside = |position: [f32; 3], box3d: &Box3d| {
        let (sin, cos) = box3d.yaw.sin_cos();
        let [x, y, z] = [0, 1, 2].map(|i| f64::from(position[i]) - box3d.location[i]);
        let Dimensions { height, width, length } = box3d.dimensions;
        (cos * x - sin * z).abs() < 0.48 * length
            && (sin * x + cos * z).abs() < 0.48 * width
            && (-0.98 * height..-0.1).contains(&y)
    };
    mesh.vertices.iter().filter(|v| generated.objects.iter().any(|a| is_inside(v.position, &a.box3d))).count()
}

#[test]
fn everything_in_a_scene_is_finite_and_names_what_is_there() {
    for (index, generated) in scenes() {
        laws::assert_sound(&generated, &format!("scene {index}"));
    }
}

#[test]
fn scenes_stay_within_their_budget() {
    let counts: Vec<usize> =
        scenes().map(|(_, d)| d.scene.objects.iter().map(|o| o.mesh.triangles.len()).sum()).collect();
    let mean = counts.iter().sum::<usize>() / counts.len();
    assert!(mean < 70_000, "{mean} triangles on average");
    assert!(counts.iter().all(|&c| c < 160_000), "{:?} triangles", counts.iter().max());
}

#[test]
fn sizes_stay_within_their_limits() {
    for (index, generated) in scenes() {
        for labelled in &generated.objects {
            let sizes = SizeStatistics::of(&labelled.class);
            let size = labelled.box3d.dimensions;
            let within = |value: f64, spread: &Distribution| {
                let [low, high] = spread.limits();
                (low..=high).contains(&value)
            };
            let fits = within(size.height, &sizes.height) && within(size.width, &sizes.width);
            assert!(fits && within(size.length, &sizes.length), "scene {index}: {:?} of {size:?}", labelled.class);
        }
    }
}

fn label(class: ObjectClass, location: [f64; 3], dimensions_hwl: [f64; 3], yaw: f64, occlusion: i32) -> Label {
    let [height, width, length] = dimensions_hwl;
    let box3d = Box3d { dimensions: Dimensions { height, width, length }, location, yaw };
    Label { class, truncation: 0.0, occlusion, alpha: box3d.alpha(), box2d: Box2d::new(0.0, 0.0, 1.0, 1.0), box3d }
}

fn street() -> Vec<Label> {
    let classes = ObjectClass::KITTI;
    let mut labels: Vec<Label> = classes
        .iter()
        .enumerate()
        .map(|(k, class)| {
            let at = [-6.0 + 2.5 * k as f64, 1.5 + 0.05 * k as f64, 10.0 + 4.0 * k as f64];
            label(
                class.clone(),
                at,
                [1.5, 0.8 + 0.1 * k as f64, 1.7 + 0.4 * k as f64],
                0.7 * k as f64 - 3.0,
                k as i32 % 4,
            )
        })
        .collect();
    labels.push(label(ObjectClass::Other("Kiosk".into()), [9.0, 1.7, 30.0], [2.5, 2.0, 2.0], 0.1, 0));
    labels
}

fn kitti_camera() -> Camera {
    Camera::from_intrinsics(721.5, 721.5, 609.6, 172.9).unwrap()
}

#[test]
fn rebuilt_frames_keep_camera_classes_and_boxes() {
    let labels = street();
    let generated = scene_from_labels(&SceneConfig::default(), &labels, &kitti_camera(), [1242, 375], 3);
    assert_eq!(generated.scene.camera, kitti_camera());
    assert_eq!(generated.scene.image_size, [1242, 375]);
    let kept: Vec<&Label> = labels.iter().filter(|l| l.class != ObjectClass::DontCare).collect();
    assert_eq!(generated.objects.len(), kept.len());
    for (k, (labelled, label)) in generated.objects.iter().zip(kept).enumerate() {
        assert_eq!((&labelled.class, labelled.box3d), (&label.class, label.box3d));
        assert_eq!(usize::from(labelled.instance), k + 1);
    }
    laws::assert_fills_its_box(&generated, "rebuilt");
}

#[test]
fn a_frame_without_labels_can_be_rebuilt() {
    let generated = scene_from_labels(&SceneConfig::default(), &[], &kitti_camera(), [1242, 375], 4);
    assert!(generated.objects.is_empty());
    assert!(generated.scene.objects.iter().any(|object| !object.mesh.triangles.is_empty()));
}

#[test]
fn nothing_is_built_in_front_of_what_must_be_seen() {
    let mut label = label(ObjectClass::Car, [0.5, 1.65, 30.0], [1.5, 1.7, 4.0], -1.57, 0);
    for seed in 0..20 {
        label.box3d.location[0] = seed as f64 - 10.0;
        let generated = scene_from_labels(
            &SceneConfig::default(),
            std::slice::from_ref(&label),
            &kitti_camera(),
            [1242, 375],
            seed,
        );
        let rendered = farsight_synth::render::render(&generated.scene);
        let share = f64::from(rendered.visible[1]) / f64::from(rendered.amodal[1]);
        assert!(share > 0.9, "seed {seed}: {share} of the car is seen");
    }
}

#[test]
fn real_label_files_can_be_rebuilt() {
    let Some(labels) = farsight_testing::kitti("frames/training/label_2") else { return };
    for entry in std::fs::read_dir(labels).unwrap() {
        let path = entry.unwrap().path();
        let labels = farsight_data::kitti::read_labels(&path).unwrap();
        let generated = scene_from_labels(&SceneConfig::default(), &labels, &kitti_camera(), [1242, 375], 1);
        laws::assert_fills_its_box(&generated, &path.display().to_string());
    }
}

/// A change that makes a configuration unusable.
type Change<'a> = &'a dyn Fn(&mut SceneConfig);

#[test]
fn unusable_configurations_say_why() {
    let changed = |change: &dyn Fn(&mut SceneConfig)| {
        let mut config = SceneConfig::generic();
        change(&mut config);
        config.problem()
    };
    assert_eq!(changed(&|_| ()), None);
    let cases: [(Change, &str); 13] = [
        (&|c| c.unusual_share = 1.5, "unusual_share is 1.5; expected a number from 0 to 1"),
        (&|c| c.density = [2.0, 1.0], "density is [2, 1]; expected two numbers from 0 to 10 in rising order"),
        (&|c| c.people_factor = -1.0, "people_factor is -1; expected a number from 0 to 20"),
        (&|c| c.heavy_factor = f64::INFINITY, "heavy_factor is inf; expected a number from 0 to 20"),
        (&|c| c.clutter = 21.0, "clutter is 21; expected a number from 0 to 20"),
        (&|c| c.farthest_m = f64::NAN, "farthest_m is NaN; expected metres from 10 to 300"),
        (&|c| c.cameras.clear(), "cameras has no weight above 0; nothing could be drawn"),
        (&|c| c.places.city = -1.0, "places has the weight -1; expected a number that is not negative"),
        (
            &|c| c.cameras[1].image_sizes.clear(),
            "cameras[1].image_sizes is empty; expected at least one width and height",
        ),
        (
            &|c| c.cameras[2].focal_widths = [0.0, 1.0],
            "cameras[2].focal_widths is [0, 1]; expected two numbers from 0.1 to 20 in rising order",
        ),
        (
            &|c| c.cameras[0].height_m = [0.1, 1.0],
            "cameras[0].height_m is [0.1, 1]; expected two numbers from 0.5 to 20 in rising order",
        ),
        // Each side is one that a camera may have.
        (
            &|c| c.cameras[0].image_sizes.push([13_000, 13_000]),
            "cameras[0].image_sizes has [13000, 13000]; expected at most 16000000 pixels in all",
        ),
        (&|c| c.cameras[3].share = -1.0, "cameras[3].share is -1; expected a number from 0 to 1000000000"),
    ];
    for (change, expected) in cases {
        assert_eq!(changed(change).as_deref(), Some(expected));
    }
}

#[test]
fn configurations_are_read_and_written_and_unknown_words_refused() {
    let text = toml::to_string(&SceneConfig::generic()).unwrap();
    assert_eq!(toml::from_str::<SceneConfig>(&text).unwrap(), SceneConfig::generic());
    assert_eq!(toml::from_str::<SceneConfig>("").unwrap(), SceneConfig::default());
    let error = toml::from_str::<SceneConfig>("[weather]\nsnow = 1.0").unwrap_err().to_string();
    assert!(error.contains("unknown field `snow`"), "{error}");
    assert_eq!(CameraRanges::default(), CameraRanges::kitti());
}
