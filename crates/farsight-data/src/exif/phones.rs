//! Sensors of common phones, for pictures whose EXIF data lack the 35 mm equivalent, or have one beside a digital zoom.

/// The main camera of a phone.
pub(super) struct Phone {
    /// What `Model` says, or how it begins where `prefix` is set.
    model: &'static str,
    /// Variants for countries and networks add letters behind the model.
    prefix: bool,
    /// Focal length of this lens, millimetres; other lenses of the phone have other sensors.
    focal_mm: f64,
    /// Size of a pixel of the full picture, micrometres, and the columns of the full picture.
    pixel: (f64, f64),
}

/// A focal length is written with two digits after the point at most.
const FOCAL_TOLERANCE_MM: f64 = 0.06;

/// All of these sensors are 4:3.
const ROWS_PER_COLUMN: f64 = 0.75;

const fn exact(model: &'static str, focal_mm: f64, pixel: (f64, f64)) -> Phone {
    Phone { model, prefix: false, focal_mm, pixel }
}

const fn prefix(model: &'static str, focal_mm: f64, pixel: (f64, f64)) -> Phone {
    Phone { model, prefix: true, focal_mm, pixel }
}

/// Pixel sizes and counts are those that the makers publish (Apple's and Google's pages of technical data, Samsung's
/// pages of each phone and of its ISOCELL sensors, Sony's of the IMX sensors). A test compares each with the equivalent
/// focal length that the maker publishes.
const PHONES: [Phone; 28] = [
    exact("iPhone 7", 3.99, (1.22, 4032.0)),
    exact("iPhone 7 Plus", 3.99, (1.22, 4032.0)),
    exact("iPhone 8", 3.99, (1.22, 4032.0)),
    exact("iPhone X", 4.0, (1.22, 4032.0)),
    exact("iPhone XR", 4.25, (1.4, 4032.0)),
    exact("iPhone XS", 4.25, (1.4, 4032.0)),
    exact("iPhone 11", 4.25, (1.4, 4032.0)),
    exact("iPhone 11 Pro", 4.25, (1.4, 4032.0)),
    exact("iPhone SE (2nd generation)", 3.99, (1.22, 4032.0)),
    exact("iPhone 12", 4.2, (1.4, 4032.0)),
    exact("iPhone 12 Pro", 4.2, (1.4, 4032.0)),
    exact("iPhone 12 Pro Max", 5.1, (1.7, 4032.0)),
    exact("iPhone 13", 5.1, (1.7, 4032.0)),
    exact("iPhone 13 Pro", 5.7, (1.9, 4032.0)),
    exact("iPhone 14", 5.7, (1.9, 4032.0)),
    exact("iPhone 14 Pro", 6.86, (1.22, 8064.0)),
    exact("iPhone 15 Pro", 6.765, (1.22, 8064.0)),
    exact("Pixel 2", 4.442, (1.4, 4032.0)),
    exact("Pixel 3", 4.44, (1.4, 4032.0)),
    exact("Pixel 4", 4.38, (1.4, 4032.0)),
    exact("Pixel 5", 4.38, (1.4, 4032.0)),
    exact("Pixel 6", 6.81, (1.2, 8160.0)),
    exact("Pixel 7", 6.81, (1.2, 8160.0)),
    // Galaxy S7, S8, S9, S20 and S21.
    prefix("SM-G930", 4.2, (1.4, 4032.0)),
    prefix("SM-G950", 4.25, (1.4, 4032.0)),
    prefix("SM-G960", 4.3, (1.4, 4032.0)),
    prefix("SM-G981", 5.4, (1.8, 4032.0)),
    prefix("SM-G991", 5.4, (1.8, 4032.0)),
];

/// Width and height of the sensor behind this lens of this camera, millimetres, the longer side first.
pub(super) fn sensor_mm(model: &str, focal_mm: f64) -> Option<[f64; 2]> {
    PHONES
        .iter()
        .find(|phone| {
            let named = if phone.prefix { model.starts_with(phone.model) } else { model == phone.model };
            named && (phone.focal_mm - focal_mm).abs() <= FOCAL_TOLERANCE_MM
        })
        .map(Phone::sensor_mm)
}

impl Phone {
    fn sensor_mm(&self) -> [f64; 2] {
        let (micrometres, columns) = self.pixel;
        let width = micrometres * columns / 1000.0;
        [width, width * ROWS_PER_COLUMN]
    }
}

#[cfg(test)]
mod tests {
    use super::{PHONES, sensor_mm};

    /// 35 mm equivalents that the makers publish, in the order of the table.
    const PUBLISHED_MM: [f64; 28] = [
        28.0, 28.0, 28.0, 28.0, 26.0, 26.0, 26.0, 26.0, 28.0, 26.0, 26.0, 26.0, 26.0, 26.0, 26.0, 24.0, 24.0, 27.0,
        27.0, 27.0, 27.0, 24.0, 24.0, 26.0, 26.0, 26.0, 26.0, 26.0,
    ];

    #[test]
    fn sensors_agree_with_the_published_equivalents_by_their_diagonals() {
        for (phone, published) in PHONES.iter().zip(PUBLISHED_MM) {
            let [width, height] = phone.sensor_mm();
            let equivalent = phone.focal_mm * 43.27 / width.hypot(height);
            // Published ones are whole millimetres, and focal lengths have two or three digits.
            assert!((equivalent - published).abs() < 0.65, "{}: {equivalent:.2} and {published}", phone.model);
        }
    }

    #[test]
    fn another_lens_of_the_phone_is_not_taken_for_the_main_one() {
        assert!(sensor_mm("SM-G960F", 4.3).is_some());
        assert!(sensor_mm("iPhone 11", 4.25).is_some() && sensor_mm("iPhone 11", 1.54).is_none());
        assert!(sensor_mm("iPhone 1", 4.25).is_none());
    }
}
