use super::*;
use crate::scene::Atmosphere;

fn gradient(size: [usize; 2], factor: f32) -> Rendered {
    let [width, height] = size;
    let color = (0..width * height).map(|i| [(i % width) as f32 / width as f32 * factor, 0.4 * factor, 0.2 * factor]);
    Rendered {
        size,
        color: color.collect(),
        depth_m: vec![f32::INFINITY; width * height],
        instance: vec![0; width * height],
        visible: vec![0],
        amodal: vec![0],
    }
}

fn mean(image: &RgbImage) -> f64 {
    image.as_raw().iter().map(|&v| f64::from(v)).sum::<f64>() / image.as_raw().len() as f64 / 255.0
}

#[test]
fn automatic_exposure_reaches_its_target_in_any_light_it_can_raise() {
    for factor in [0.1, 1.0, 20.0] {
        let image = SensorModel { most_exposure: 64.0, ..SensorModel::IDEAL }.capture(&gradient([160, 90], factor));
        assert!((mean(&image) - 0.4).abs() < 0.02, "mean {} in light {factor}", mean(&image));
    }
    let night = SensorModel { most_exposure: 2.0, ..SensorModel::IDEAL }.capture(&gradient([160, 90], 0.01));
    assert!(mean(&night) < 0.2, "the night stays dark: {}", mean(&night));
}

#[test]
fn the_same_settings_give_the_same_picture_and_others_another() {
    let settings = SensorModel { read_noise: 0.02, rain: 0.5, jpeg_quality: Some(70), ..SensorModel::IDEAL };
    let scene = gradient([97, 61], 1.0);
    assert_eq!(settings.capture(&scene), settings.capture(&scene));
    assert_ne!(settings.capture(&scene), SensorModel { seed: 1, ..settings }.capture(&scene));
}

#[test]
fn corners_are_darker_with_vignetting() {
    let mut scene = gradient([101, 51], 1.0);
    scene.color.fill([0.3; 3]);
    let image = SensorModel { vignetting: 0.5, ..SensorModel::IDEAL }.capture(&scene);
    assert!(image.get_pixel(0, 0)[0] + 20 < image.get_pixel(50, 25)[0]);
}

#[test]
fn drawn_settings_lie_in_their_ranges() {
    use rand::SeedableRng;
    let atmosphere = Atmosphere { fog_color: [0.5; 3], fog_density: 0.0, wetness: 0.0, rain: 0.7 };
    for seed in 0..500 {
        let drawn = SensorModel::sample(&atmosphere, &mut rand_pcg::Pcg64Mcg::seed_from_u64(seed));
        assert!((0.3..=0.46).contains(&drawn.target_mean) && (drawn.rain - atmosphere.rain).abs() < 1e-6, "{drawn:?}");
        assert!(drawn.jpeg_quality.is_none_or(|q| (40..=98).contains(&q)), "{drawn:?}");
        assert!((0.0..=1.2).contains(&drawn.blur_sigma_px) && drawn.motion_px[0] <= 3.0, "{drawn:?}");
    }
}
