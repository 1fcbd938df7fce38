//! Worlds without regions are drawn as they always were.
//!
//! A trained model belongs to its world file and seed: these hashes may change only where a change of the renderer is
//! meant to change every scene.

use farsight_core::{Box3d, Camera, Dimensions, Label, ObjectClass};
use farsight_data::Frame;
use farsight_synth::{SceneConfig, SceneStream, WeatherWeights, frame_from_labels};

/// Fowler, Noll and Vo's hash of an image and of what its labels say.
fn hash(frame: &Frame) -> u64 {
    let labels = frame.labels.iter().map(|label| format!("{:?} {:.6?} {:.4?}", label.class, label.box3d, label.box2d));
    let text = labels.collect::<String>();
    let bytes = frame.image.as_raw().iter().copied().chain(text.bytes());
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

fn small(mut config: SceneConfig) -> SceneConfig {
    for camera in &mut config.cameras {
        camera.image_sizes = vec![[320, 160]];
    }
    config
}

#[test]
fn random_scenes_have_the_bytes_that_they_always_had() {
    let busy = SceneConfig { clutter: 4.0, textured_share: 0.5, left_hand_share: 0.5, ..SceneConfig::generic() };
    let found = [SceneConfig::default(), SceneConfig::generic(), busy].map(|config| {
        let stream = SceneStream { config: small(config), seed: 41 };
        (0..6).fold(0u64, |sum, index| sum.wrapping_mul(31) ^ hash(&stream.frame(index)))
    });
    assert_eq!(found, [14_942_211_420_033_905_772, 14_276_656_112_349_311_269, 6_599_092_731_516_512_032]);
}

#[test]
fn photographed_skies_change_pictures_and_no_labels() {
    let stream = |photographed_sky_share: f64| {
        let weather = WeatherWeights { night: 0.0, ..WeatherWeights::default() };
        let config = SceneConfig { photographed_sky_share, weather, unusual_share: 0.0, ..SceneConfig::default() };
        SceneStream { config: small(config), seed: 43 }
    };
    let (drawn, photographed) = (stream(0.0), stream(1.0));
    for index in 0..4 {
        let (drawn, photographed) = (drawn.frame(index), photographed.frame(index));
        assert_eq!(drawn.labels, photographed.labels);
        assert_ne!(drawn.image, photographed.image);
    }
}

#[test]
fn twins_have_the_bytes_that_they_always_had() {
    let label = |class: ObjectClass, x: f64, z: f64, yaw: f64| {
        let dimensions = Dimensions { height: 1.6, width: 1.7, length: 4.0 };
        let box3d = Box3d { dimensions, location: [x, 1.65, z], yaw };
        let camera = Camera::from_intrinsics(185.0, 185.0, 160.0, 70.0).unwrap();
        let box2d = box3d.projected(&camera).unwrap();
        Label { class, truncation: 0.0, occlusion: 0, alpha: box3d.alpha(), box2d, box3d }
    };
    let labels = [
        label(ObjectClass::Car, 2.0, 14.0, -1.57),
        label(ObjectClass::Van, -3.5, 22.0, 1.5),
        label(ObjectClass::Pedestrian, 5.0, 12.0, 0.3),
    ];
    let camera = Camera::from_intrinsics(185.0, 185.0, 160.0, 70.0).unwrap();
    let found = ["000000", "000017"].map(|id| hash(&frame_from_labels(&labels, &camera, [320, 160], 5, id)));
    assert_eq!(found, [3_600_201_433_669_459_065, 10_874_430_330_391_432_625]);
}
