//! Laws of the world file with all regions, and of each region.

use crate::laws;
use std::path::Path;

use farsight_core::{Box2d, Box3d, Camera, Dimensions, Label, ObjectClass};
use farsight_data::annotations::Plates;
use farsight_synth::labels::LabelRules;
use farsight_synth::render::render;
use farsight_synth::sensor::SensorModel;
use farsight_synth::{LabelledScene, RegionWeights, SceneConfig, SceneStream, WeatherWeights, generate_scene};

/// Nobody tuned anything to scenes of this seed.
const HELD_OUT: u64 = 90_210;
const SCENES: u64 = 48;
const REGIONS: [&str; 5] = ["europe", "north-america", "china", "japan", "india"];

/// The world that the project ships.
fn world() -> SceneConfig {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/worlds/world.toml");
    let mut config: SceneConfig = toml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    assert_eq!(config.problem(), None);
    // Half as large images tell as much, in a third of the time.
    for size in config.cameras.iter_mut().flat_map(|camera| &mut camera.image_sizes) {
        *size = size.map(|side| side / 2);
    }
    config
}

/// The same, all in one region.
fn world_in(region: &str) -> SceneConfig {
    let regions: RegionWeights = toml::from_str(&format!("{region} = 1.0")).unwrap();
    SceneConfig { regions, ..world() }
}

fn scenes() -> impl Iterator<Item = (String, LabelledScene)> {
    let config = world();
    (0..SCENES).map(move |index| (format!("scene {index}"), generate_scene(&config, HELD_OUT, index)))
}

#[test]
fn scenes_obey_the_laws() {
    for (what, generated) in scenes() {
        laws::assert_fills_its_box(&generated, &what);
        laws::assert_nobody_touches(&generated, &what);
        laws::assert_sound(&generated, &what);
    }
}

#[test]
fn scenes_stay_within_their_budget() {
    let counts: Vec<usize> =
        scenes().map(|(_, d)| d.scene.objects.iter().map(|o| o.mesh.triangles.len()).sum()).collect();
    let mean = counts.iter().sum::<usize>() / counts.len();
    assert!(mean < 80_000, "{mean} triangles on average");
    assert!(counts.iter().all(|&c| c < 180_000), "{:?} triangles", counts.iter().max());
}

#[test]
fn labels_project_onto_what_was_drawn() {
    let mut whole = 0;
    for (what, generated) in scenes() {
        let LabelledScene { scene, objects } = &generated;
        let rendered = render(scene);
        let labels = LabelRules::for_width(scene.image_size[0]).labels(scene, objects, &rendered);
        for label in labels.iter().filter(|label| label.class != ObjectClass::DontCare) {
            let labelled = objects.iter().find(|labelled| labelled.box3d == label.box3d).unwrap();
            let pixels = rendered.instance.iter().enumerate().filter(|(_, i)| **i == labelled.instance);
            let width = rendered.size[0];
            let Some(seen) = Box2d::bounding(pixels.map(|(at, _)| [(at % width) as f64, (at / width) as f64])) else {
                continue;
            };
            let Box2d { x1, y1, x2, y2 } = label.box2d;
            let is_inside = seen.x1 > x1 - 2.0 && seen.x2 < x2 + 2.0 && seen.y1 > y1 - 2.0 && seen.y2 < y2 + 2.0;
            assert!(is_inside, "{what}: {:?} is seen in {seen:?}, its label says {:?}", label.class, label.box2d);
            if label.truncation < 0.01 && label.occlusion == 0 && label.box2d.height() > 25.0 {
                whole += 1;
                // A shape touches the six sides of its box, but not its corners; a fifth may be hidden.
                let filled = seen.area() / label.box2d.area();
                let least = if label.box3d.dimensions.length > 2.4 { 0.5 } else { 0.3 };
                assert!(filled > least, "{what}: {:?} fills {filled} of {:?}", label.class, label.box2d);
            }
        }
    }
    assert!(whole > 60, "{whole} objects in full view");
}

#[test]
fn vehicles_are_cut_by_the_edge_and_near_as_a_street_camera_sees_them() {
    let stream = SceneStream { config: world(), seed: HELD_OUT };
    let labels: Vec<Label> = (0..SCENES).flat_map(|index| stream.frame(index).labels).collect();
    let vehicles: Vec<&Label> =
        labels.iter().filter(|l| l.box3d.dimensions.length > 2.4 && l.class != ObjectClass::DontCare).collect();
    let share = |count: usize| count as f64 / vehicles.len() as f64;
    let cut = share(vehicles.iter().filter(|label| label.truncation > 0.15).count());
    // In 84 frames of KITTI a tenth of the labelled vehicles are.
    assert!((0.06..0.3).contains(&cut), "{cut} of {} vehicles are cut by an edge", vehicles.len());
    let near = vehicles.iter().filter(|label| label.box3d.nearest_distance_m() < 5.0).count();
    assert!(near as f64 > 0.1 * SCENES as f64, "{near} vehicles within 5 m");
}

#[test]
fn number_plates_have_the_widths_of_their_region() {
    // A mesh's fit to its box stretches its plates.
    const STRETCH: f64 = 0.035;
    let formats: [&[f64]; 5] = [&[0.52, 0.34], &[0.305], &[0.44, 0.48], &[0.33, 0.44], &[0.5, 0.34]];
    for (region, formats) in REGIONS.into_iter().zip(formats) {
        let stream = SceneStream { config: world_in(region), seed: HELD_OUT };
        let mut found = vec![0; formats.len()];
        for index in 0..24 {
            let frame = stream.frame(index);
            for plate in &frame.annotation::<Plates>().unwrap().0 {
                let [right, left] = plate.ends;
                let width = (0..3).map(|axis| (right[axis] - left[axis]).powi(2)).sum::<f64>().sqrt();
                let format = formats.iter().position(|format| (width / format - 1.0).abs() < STRETCH);
                let class = &frame.labels[plate.label].class;
                assert!(format.is_some(), "{region}: a plate of a {class:?} is {width} m wide");
                found[format.unwrap()] += 1;
            }
        }
        assert!(found.iter().all(|&count| count > 0), "{region}: {found:?} plates of {formats:?} m");
    }
}

#[test]
fn regions_drive_on_their_side() {
    for (region, expected) in [("north-america", -1.0), ("china", -1.0), ("japan", 1.0), ("india", 1.0)] {
        let mut config = world_in(region);
        config.cameras.truncate(1);
        let scenes = (0..40).map(|index| generate_scene(&config, HELD_OUT, index));
        let boxes: Vec<Box3d> = scenes.flat_map(|scene| scene.objects).map(|labelled| labelled.box3d).collect();
        // Oncoming, moving along the road; parked cars stand either way.
        let oncoming = boxes.iter().filter(|b| b.yaw.sin() > 0.95 && b.location[2] < 40.0);
        let sides: Vec<f64> = oncoming.map(|b| b.location[0].signum() * expected).collect();
        let right = sides.iter().filter(|side| **side > 0.0).count();
        assert!(sides.len() > 40 && right as f64 > 0.75 * sides.len() as f64, "{region}: {right} of {}", sides.len());
    }
}

#[test]
fn scenes_of_other_weather_and_severity_have_the_same_objects() {
    let in_weather = |name: &str, severity: u8, index: u64| {
        let mut weather =
            WeatherWeights { clear: 0.0, cloudy: 0.0, overcast: 0.0, dusk: 0.0, night: 0.0, rain: 0.0, fog: 0.0 };
        match name {
            "fog" => weather.fog = 1.0,
            "night" => weather.night = 1.0,
            "rain" => weather.rain = 1.0,
            _ => weather.clear = 1.0,
        }
        generate_scene(&SceneConfig { weather, severity: Some(severity), ..world() }, HELD_OUT, index)
    };
    for index in 0..6 {
        let clear = in_weather("clear", 1, index);
        let mut density = 0.0;
        for severity in 1..=5 {
            let fog = in_weather("fog", severity, index);
            let places = |scene: &LabelledScene| {
                scene.objects.iter().map(|o| (o.class.clone(), o.box3d)).collect::<Vec<(ObjectClass, Box3d)>>()
            };
            for other in [&fog, &in_weather("night", severity, index), &in_weather("rain", severity, index)] {
                assert_eq!(places(&clear), places(other), "scene {index}, severity {severity}");
                assert_eq!(clear.scene.camera, other.scene.camera);
            }
            assert!(fog.scene.atmosphere.fog_density > density, "thicker with severity");
            density = fog.scene.atmosphere.fog_density;
        }
    }
}

#[test]
fn fog_takes_contrast_and_night_takes_light_step_by_step() {
    let light = |weather: &str, severity: u8| {
        let text = format!(
            "severity = {severity}\nweather = {{ clear = 0, cloudy = 0, overcast = 0, dusk = 0, night = 0, rain = 0, \
             fog = 0, {weather} = 1 }}",
        );
        let text = text.replacen(&format!("{weather} = 0, "), "", 1).replacen(&format!("{weather} = 0,"), "", 1);
        let config: SceneConfig = toml::from_str(&text).unwrap();
        let scenes = (0..4).map(|index| render(&generate_scene(&config, HELD_OUT, index).scene));
        let greys: Vec<f64> = scenes.flat_map(|r| r.color).map(|c| f64::from(c[1]).min(4.0)).collect();
        let mean = greys.iter().sum::<f64>() / greys.len() as f64;
        let variance = greys.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / greys.len() as f64;
        (mean, variance.sqrt() / mean)
    };
    let [fog, night] = ["fog", "night"].map(|weather| (1..=5).map(|s| light(weather, s)).collect::<Vec<_>>());
    assert!(fog.windows(2).all(|pair| pair[1].1 < pair[0].1), "contrasts in fog: {fog:?}");
    assert!(night.windows(2).all(|pair| pair[1].0 < pair[0].0), "light at night: {night:?}");
}

/// A camera as the world's and a label for each class.
fn street() -> (Camera, Vec<Label>) {
    let camera = Camera::from_intrinsics(721.5, 721.5, 609.6, 172.9).unwrap();
    let sizes = [
        (ObjectClass::Car, [1.45, 1.8, 4.6]),
        (ObjectClass::Van, [1.95, 2.0, 5.8]),
        (ObjectClass::Truck, [4.0, 2.6, 21.0]),
        (ObjectClass::Cyclist, [1.6, 0.8, 2.1]),
        (ObjectClass::Pedestrian, [1.75, 0.6, 0.8]),
    ];
    let labels = sizes.into_iter().enumerate().map(|(k, (class, [height, width, length]))| {
        let location = [-8.0 + 4.5 * k as f64, 1.65, 22.0 + 3.0 * k as f64];
        let box3d = Box3d { dimensions: Dimensions { height, width, length }, location, yaw: -1.5 };
        let box2d = box3d.projected(&camera).unwrap();
        Label { class, truncation: 0.0, occlusion: 0, alpha: box3d.alpha(), box2d, box3d }
    });
    (camera, labels.collect())
}

#[test]
fn twins_keep_their_boxes_in_every_region_and_weather() {
    let (camera, labels) = street();
    let mut pictures = Vec::new();
    for region in REGIONS {
        let stream = SceneStream { config: SceneConfig { severity: Some(2), ..world_in(region) }, seed: 3 };
        let frame = stream.twin(&labels, &camera, [1242, 375], "000000");
        assert_eq!(frame.camera, camera);
        let boxes: Vec<Box3d> = labels.iter().map(|label| label.box3d).collect();
        let kept = frame.labels.iter().filter(|label| boxes.contains(&label.box3d)).count();
        assert!(kept >= 4, "{region}: {kept} of the objects have labels");
        pictures.push(frame.image);
    }
    pictures.dedup();
    assert_eq!(pictures.len(), REGIONS.len(), "each region has its own look");
}

#[test]
fn devices_take_different_pictures_of_one_scene() {
    let generated = generate_scene(&world(), HELD_OUT, 0);
    let rendered = render(&generated.scene);
    let plain = SensorModel::IDEAL.capture(&rendered);
    let sharp = SensorModel { sharpening: 1.5, ..SensorModel::IDEAL }.capture(&rendered);
    let detail = |image: &image::RgbImage| {
        let rows = image.rows().map(|row| {
            let greens: Vec<i64> = row.map(|pixel| i64::from(pixel[1])).collect();
            greens.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum::<i64>()
        });
        rows.sum::<i64>()
    };
    assert!(detail(&sharp) > detail(&plain) * 11 / 10, "{} and {}", detail(&sharp), detail(&plain));
}

#[test]
fn worlds_that_cannot_be_drawn_say_why() {
    let problem = |text: &str| toml::from_str::<SceneConfig>(text).unwrap().problem();
    assert_eq!(problem("regions = {}").as_deref(), Some("regions has no weight above 0; nothing could be drawn"));
    assert_eq!(problem("severity = 6").as_deref(), Some("severity is 6; expected a whole number from 1 to 5"));
    assert_eq!(
        problem("[[cameras]]\nheading_deg = [20, -20]").as_deref(),
        Some("cameras[0].heading_deg is [20, -20]; expected two numbers from -360 to 360 in rising order")
    );
    let unknown = toml::from_str::<SceneConfig>("regions = { atlantis = 1 }").unwrap_err().to_string();
    assert!(unknown.contains("unknown field `atlantis`"), "{unknown}");
}
