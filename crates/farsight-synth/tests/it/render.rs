//! What is rendered is where geometry says, and the same every time.

use crate::support::{CAMERA_HEIGHT_M, block, camera, empty, flat, ground, joined, object, plain, quad, street};
use farsight_core::Camera;
use farsight_synth::render::{Rendered, render};
use farsight_synth::scene::{Canopy, Lamp, Material, Pattern, Scene, Triangle};
use farsight_synth::sensor::SensorModel;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

/// Bounds in a test's image are met to this many pixels.
const PIXEL: f32 = 1.0;

fn small() -> Camera {
    Camera::from_intrinsics(200.0, 200.0, 159.5, 79.5).expect("a camera")
}

fn scene_of(objects: Vec<farsight_synth::scene::Object>) -> Scene {
    Scene { objects, ..empty(small(), [320, 160]) }
}

fn brightness(rendered: &Rendered, x: usize, y: usize) -> f32 {
    rendered.color[y * rendered.size[0] + x].iter().sum()
}

#[test]
fn the_same_scene_gives_the_same_bytes_alone_and_beside_others() {
    let mut scene = street();
    scene.image_size = [621, 200];
    let first = render(&scene);
    let others = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..3).map(|_| scope.spawn(|| render(&scene))).collect();
        threads.into_iter().map(|t| t.join().expect("a frame")).collect::<Vec<_>>()
    });
    let bits = |r: &Rendered| r.color.iter().flatten().chain(&r.depth_m).map(|v| v.to_bits()).collect::<Vec<_>>();
    for other in others {
        assert!(bits(&first) == bits(&other) && first.instance == other.instance && first.visible == other.visible);
    }
}

/// A hash of many bytes (FNV-1a), the same everywhere.
fn hash_of(bytes: impl Iterator<Item = u8>) -> u64 {
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

/// Made once, on x86-64 Linux. Another number on another machine or with other optimisations is a bug; after a change
/// of the looks it has to be new.
#[test]
fn the_bytes_are_those_of_other_machines() {
    let mut scene = street();
    scene.camera = Camera::from_intrinsics(180.0, 180.0, 155.0, 43.0).expect("a camera");
    scene.image_size = [310, 94];
    scene.atmosphere.wetness = 0.5;
    scene.sun.canopy = Some(Canopy { open: 0.6, scale_m: 3.0, seed: 9 });
    scene.lamps.push(Lamp {
        position: [3.0, -3.0, 14.0],
        direction: [0.0, 1.0, 0.0],
        cone_cos: 0.5,
        color: [30.0, 25.0, 15.0],
        reach_m: 15.0,
    });
    let rendered = render(&scene);
    let light = hash_of(rendered.color.iter().flatten().chain(&rendered.depth_m).flat_map(|v| v.to_le_bytes()));
    let drawn = SensorModel::sample(&scene.atmosphere, &mut Pcg64Mcg::seed_from_u64(3));
    let settings = SensorModel { rain: 0.5, glare: 0.2, jpeg_quality: Some(70), ..drawn };
    let photo = hash_of(settings.capture(&rendered).into_raw().into_iter());
    assert_eq!([light, photo], [LIGHT_HASH, PHOTO_HASH], "{light:#x}, {photo:#x}");
}

const LIGHT_HASH: u64 = 0x9d5c_a5c1_a5e1_d095;
const PHOTO_HASH: u64 = 0x2e20_1e79_2ed2_bfd9;

#[test]
fn a_canopy_lets_its_share_of_the_sun_through() {
    let light = |open: Option<f32>| {
        let mut scene = street();
        scene.sun.canopy = open.map(|open| Canopy { open, scale_m: 1.0, seed: 4 });
        render(&scene).color.iter().flatten().map(|&value| f64::from(value)).sum::<f64>()
    };
    let (dark, bright) = (light(Some(0.0)), light(None));
    for open in [0.3, 0.7] {
        let share = (light(Some(open)) - dark) / (bright - dark);
        assert!(
            (share - f64::from(open)).abs() < 0.1,
            "{open} of the canopy is open, {share} of the light comes through"
        );
    }
}

#[test]
fn every_value_is_a_number() {
    let rendered = render(&street());
    assert!(rendered.color.iter().flatten().all(|v| v.is_finite() && *v >= 0.0));
    assert!(rendered.depth_m.iter().all(|d| *d > 0.0));
}

#[test]
fn the_ground_has_the_depth_that_its_plane_has() {
    // In one piece, and in pieces smaller than pixels, whose depth is that of some point within the pixel.
    for (step, within_px) in [(200.0, 0.0), (1.0, 0.376)] {
        let rendered = render(&scene_of(vec![flat(ground(200.0, step, 0))]));
        for y in 90..160 {
            let depth_at = |row: f32| CAMERA_HEIGHT_M * 200.0 / (row - 79.5);
            let nearest = depth_at(y as f32 + within_px) * (1.0 - 1e-4);
            let farthest = depth_at(y as f32 - within_px) * (1.0 + 1e-4);
            for x in [3, 100, 300] {
                let depth = rendered.depth_m[y * 320 + x];
                assert!(
                    (nearest..=farthest).contains(&depth),
                    "row {y}, column {x}: {depth} m, not {nearest} to {farthest} m"
                );
            }
        }
        assert!(rendered.depth_m[5 * 320 + 5].is_infinite());
    }
}

#[test]
fn a_pitched_and_shifted_camera_sees_the_same_depth() {
    // Pitched down by a tenth of a radian, and 6 cm beside the origin.
    let (sin, cos) = (0.1_f64.sin(), 0.1_f64.cos());
    let [fx, cx, cy] = [200.0, 159.5, 79.5];
    let forward = [0.0, sin, cos, 0.01];
    let right = [1.0, 0.0, 0.0, 0.06];
    let down = [0.0, cos, -sin, 0.0];
    let row = |axis: [f64; 4], centre: f64| [0, 1, 2, 3].map(|j| fx * axis[j] + centre * forward[j]);
    let camera = Camera::from_projection([row(right, cx), row(down, cy), forward]).expect("a camera");
    let scene =
        Scene { objects: vec![object(block([1.0, 1.65, 12.0], [2.0, 1.5, 4.0], 0), 1)], ..empty(camera, [320, 160]) };
    let rendered = render(&scene);
    // The middle of the block's front face.
    let [u, v] = camera.pixel_from_point([1.0, 0.9, 10.0]).expect("in front");
    let at = v.round() as usize * 320 + u.round() as usize;
    assert!((rendered.depth_m[at] - 10.0).abs() < 1e-3, "{} m", rendered.depth_m[at]);
    assert_eq!(rendered.instance[at], 1);
}

#[test]
fn a_block_covers_exactly_its_projection() {
    let rendered = render(&scene_of(vec![object(block([0.5, 1.0, 10.0], [2.0, 1.5, 4.0], 0), 1)]));
    // The front face at z = 8: x from -0.5 to 1.5, y from -0.5 to 1.
    let pixels = (0..320 * 160).filter(|&i| rendered.instance[i] == 1);
    let (mut least, mut most) = ([f32::MAX; 2], [f32::MIN; 2]);
    for i in pixels {
        let at = [(i % 320) as f32, (i / 320) as f32];
        assert!((rendered.depth_m[i] - 8.0).abs() < 1e-3 || rendered.depth_m[i] > 8.0);
        least = [least[0].min(at[0]), least[1].min(at[1])];
        most = [most[0].max(at[0]), most[1].max(at[1])];
    }
    let expected = [159.5 - 200.0 * 0.5 / 8.0, 79.5 - 200.0 * 0.5 / 8.0, 159.5 + 200.0 * 1.5 / 8.0, 79.5 + 200.0 / 8.0];
    for (found, expected) in [least[0], least[1], most[0], most[1]].iter().zip(expected) {
        assert!((found - expected).abs() <= PIXEL, "edge at {found}, expected {expected}");
    }
    let area = 200.0 * 2.0 / 8.0 * (200.0 * 1.5 / 8.0) * 4.0;
    assert!((rendered.visible[1] as f32 / area - 1.0).abs() < 0.01, "{} samples, expected {area}", rendered.visible[1]);
    assert_eq!(rendered.visible[1], rendered.amodal[1]);
    assert_eq!(rendered.visible.iter().sum::<u32>(), 320 * 160 * 4);
}

#[test]
fn a_triangle_covers_its_area() {
    let mut mesh = quad([[-1.3, -0.7, 5.0], [1.1, -0.4, 5.0], [0.2, 0.9, 5.0], [0.0, 0.0, 5.0]], 0, 0);
    mesh.triangles = vec![Triangle { vertices: [0, 1, 2], material: 0, layer: 0 }];
    let rendered = render(&scene_of(vec![object(mesh, 1)]));
    let area = 0.5 * (2.4 * 1.6 - 1.5 * 0.3) * 40.0 * 40.0 * 4.0;
    assert!(
        (rendered.visible[1] as f32 / area - 1.0).abs() < 0.005,
        "{} samples, expected {area}",
        rendered.visible[1]
    );
}

#[test]
fn slanted_edges_have_middle_tones() {
    let mut scene =
        scene_of(vec![object(quad([[-9.0, -4.0, 5.0], [0.0, -4.0, 5.0], [1.0, 4.0, 5.0], [-9.0, 4.0, 5.0]], 0, 0), 1)]);
    scene.materials = vec![plain([0.0; 3])];
    scene.sky.clouds = 0.0;
    let rendered = render(&scene);
    let row = (0..320).map(|x| brightness(&rendered, x, 60)).collect::<Vec<_>>();
    let middle = row.iter().filter(|&&b| b > 0.05 && b < 0.9 * row[319]).count();
    assert_eq!(middle, 1, "one pixel of the row lies on the edge");
}

#[test]
fn neighbouring_triangles_leave_no_cracks() {
    let mut bumpy = ground(60.0, 0.7, 0);
    for (i, vertex) in bumpy.vertices.iter_mut().enumerate() {
        vertex.position[0] += (i * 7919 % 13) as f32 * 0.02;
        vertex.position[1] += (i * 104_729 % 11) as f32 * 0.005;
        vertex.position[2] += (i * 1_299_709 % 17) as f32 * 0.02;
    }
    let rendered = render(&scene_of(vec![object(bumpy, 1)]));
    // Below the far edge of the ground every sample is ground.
    let below: Vec<_> = rendered.instance[100 * 320..].iter().filter(|&&i| i != 1).collect();
    assert!(below.is_empty(), "{} pixels show the sky through the ground", below.len());
    let hit = rendered.color[100 * 320..].iter().filter(|c| c[2] > c[0] * 1.3).count();
    assert_eq!(hit, 0, "pixels with some sky in them");
}

#[test]
fn higher_layers_lie_on_lower_ones_in_any_order() {
    let y = CAMERA_HEIGHT_M;
    let road = || flat(ground(100.0, 1.3, 0));
    let marking = || object(quad([[-0.2, y, 3.0], [0.2, y, 3.0], [0.2, y, 80.0], [-0.2, y, 80.0]], 0, 1), 1);
    let samples = [vec![road(), marking()], vec![marking(), road()]].map(|objects| {
        let rendered = render(&scene_of(objects));
        assert_eq!(rendered.visible[1], rendered.amodal[1], "the whole marking is seen");
        rendered.visible[1]
    });
    assert_eq!(samples[0], samples[1]);
}

#[test]
fn the_shadow_falls_where_the_sun_sends_it() {
    let mut scene = scene_of(vec![flat(ground(60.0, 2.0, 0)), object(block([0.0, 1.65, 12.0], [0.5, 2.0, 0.5], 0), 1)]);
    // From the left: the shadow lies to the right, as long as the pole is high.
    scene.sun.direction = [-0.5_f32.sqrt(), -0.5_f32.sqrt(), 0.0];
    let rendered = render(&scene);
    let at = |x: f64, z: f64| {
        let [u, v] = small().pixel_from_point([x, 1.65, z]).expect("in front");
        brightness(&rendered, u.round() as usize, v.round() as usize)
    };
    let lit = at(-2.0, 12.0);
    for x in [1.0, 1.5, 1.9] {
        assert!(at(x, 12.0) < 0.7 * lit, "in shadow {x} m to the right");
    }
    for (x, z) in [(2.8, 12.0), (1.2, 10.5), (1.2, 13.5)] {
        assert!((at(x, z) / lit - 1.0).abs() < 0.12, "lit at {x}, {z}");
    }
    scene.objects[1].casts_shadow = false;
    let free = render(&scene);
    let [u, v] = small().pixel_from_point([1.5, 1.65, 12.0]).expect("in front");
    assert!(brightness(&free, u.round() as usize, v.round() as usize) > 0.9 * lit, "nothing casts a shadow");
}

#[test]
fn it_is_dark_beneath_a_car_under_an_overcast_sky() {
    let body = object(block([0.0, 1.4, 10.0], [1.8, 1.2, 4.0], 0), 1);
    let mut scene = scene_of(vec![flat(ground(60.0, 2.0, 0)), body]);
    scene.sun.shadow = 0.0;
    scene.sun.color = [0.0; 3];
    let rendered = render(&scene);
    let at = |x: f64, z: f64| {
        let [u, v] = small().pixel_from_point([x, 1.65, z]).expect("in front");
        brightness(&rendered, u.round() as usize, v.round() as usize)
    };
    assert!(at(0.0, 8.6) < 0.45 * at(5.0, 8.6), "{} beneath, {} in the open", at(0.0, 8.6), at(5.0, 8.6));
}

#[test]
fn one_sees_through_the_holes_of_leaves() {
    let mut scene =
        scene_of(vec![object(quad([[-5.0, -3.0, 6.0], [5.0, -3.0, 6.0], [5.0, 3.0, 6.0], [-5.0, 3.0, 6.0]], 1, 0), 1)]);
    let leaves = Pattern::Leaves { other: [0.0; 3], scale: 0.4, density: 0.6, seed: 9 };
    scene.materials.push(Material { pattern: leaves, ..plain([0.0, 0.2, 0.0]) });
    let rendered = render(&scene);
    let share = rendered.visible[1] as f32 / (320.0 * 160.0 * 4.0);
    assert!((share - 0.6).abs() < 0.08, "{share} of the samples see leaves");
    assert_eq!(rendered.visible[1], rendered.amodal[1]);
}

#[test]
fn glass_shows_itself_and_what_is_behind_it_in_their_shares() {
    let wall = |z: f32, material| quad([[-6.0, -3.0, z], [6.0, -3.0, z], [6.0, 3.0, z], [-6.0, 3.0, z]], material, 0);
    let glowing = |emission| Material { emission, ..plain([0.0; 3]) };
    for share in [0.25, 0.5, 0.75] {
        let mut scene = scene_of(vec![object(wall(6.0, 1), 1), object(wall(6.5, 2), 2)]);
        let pane = Material { pattern: Pattern::Transparent { share }, ..glowing([1.0, 0.0, 0.0]) };
        scene.materials.extend([pane, glowing([0.0, 0.0, 1.0])]);
        scene.atmosphere.fog_density = 0.0;
        let rendered = render(&scene);
        for color in &rendered.color {
            assert!((color[0] - share).abs() < 1e-3 && (color[2] - (1.0 - share)).abs() < 1e-3, "{color:?} of {share}");
        }
        // A pixel is the pane's also where it shows as much of what is behind.
        let expected = if share < 0.5 { 2 } else { 1 };
        assert!(rendered.instance.iter().all(|&instance| instance == expected), "the instances with {share}");
        assert_eq!(rendered.visible[2] + rendered.visible[1], 320 * 160 * 4);
        assert_eq!(rendered.visible[1], rendered.amodal[1]);
    }
}

#[test]
fn a_mirror_shows_the_sky_above_the_skyline_and_what_stands_below_it() {
    // It leans back by 45 degrees and shows what is overhead.
    let shares_of_sky = [-1.0, 0.9, 2.0].map(|skyline| {
        let leaning = [[-40.0, 9.0, 6.0], [40.0, 9.0, 6.0], [40.0, -29.0, 44.0], [-40.0, -29.0, 44.0]];
        let mut scene = scene_of(vec![object(quad(leaning, 0, 0), 0)]);
        scene.materials = vec![Material { reflectivity: 1.0, ..plain([0.0; 3]) }];
        scene.sky.skyline = skyline;
        let rendered = render(&scene);
        let is_sky = |[red, _, blue]: &[f32; 3]| *blue > 1.1 * red;
        rendered.color.iter().filter(|color| is_sky(color)).count() as f32 / rendered.color.len() as f32
    });
    let [open, street, forest] = shares_of_sky;
    assert!(open > 0.99 && (0.1..0.9).contains(&street) && forest < 0.01, "{shares_of_sky:?} of the mirror is sky");
}

#[test]
fn what_lies_behind_the_camera_is_not_drawn() {
    let both = joined(block([0.0, 1.65, -9.0], [2.0, 2.0, 2.0], 0), block([0.0, 1.65, 0.0], [0.1, 0.1, 0.1], 0));
    let rendered = render(&Scene { objects: vec![object(both, 1)], ..empty(camera(), [1242, 375]) });
    assert_eq!(rendered.visible[1], 0);
    assert_eq!(rendered.amodal[1], 0);
}

#[test]
fn awkward_scenes_are_rendered_too() {
    let photo = SensorModel {
        blur_sigma_px: 1.0,
        motion_px: [3.0, 2.0],
        glare: 0.3,
        rain: 1.0,
        jpeg_quality: Some(50),
        ..SensorModel::IDEAL
    };
    for size in [[1, 1], [3, 2], [17, 1], [1, 33]] {
        let mut scene = street();
        scene.image_size = size;
        let rendered = render(&scene);
        assert_eq!((rendered.color.len(), rendered.depth_m.len()), (size[0] * size[1], size[0] * size[1]));
        assert_eq!(photo.capture(&rendered).dimensions(), (size[0] as u32, size[1] as u32));
    }
    // Vertices that are nowhere, flat triangles, and triangles that pass through the camera.
    for strange in [f32::NAN, f32::INFINITY, 0.0, 1e30] {
        let mut mesh = block([0.0, 1.0, 4.0], [1.0, 1.0, 1.0], 0);
        mesh.vertices[0].position = [strange; 3];
        mesh.vertices[5].position[2] = strange;
        let rendered = render(&scene_of(vec![object(mesh, 1), object(block([0.0; 3], [2.0; 3], 0), 2)]));
        assert_eq!(rendered.visible.iter().sum::<u32>(), 320 * 160 * 4, "with {strange}");
    }
    let nothing = render(&scene_of(Vec::new()));
    assert!(nothing.depth_m.iter().all(|d| d.is_infinite()) && nothing.visible == [320 * 160 * 4]);
}
