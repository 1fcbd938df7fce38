//! From EXIF data to a focal length in pixels.
//!
//! **Which convention.** A "35 mm equivalent" can compare widths (36 mm) or diagonals (43.27 mm). CIPA's DCG-001, which
//! the makers follow, compares diagonals, and phones do: a sensor of 4032 x 3024 pixels of 1.4 micrometres behind 4.25
//! mm has 26.1 mm by its diagonal and 27.1 mm by its width, and iPhones with it write 26. So a focal length in pixels
//! is `F * diagonal / 43.27`, which holds for any side ratio and does not depend on how the picture is turned.
//!
//! **Which diagonal.** It is that of the sensor's own picture. Phones, whose sensors are 4:3, make 16:9 pictures by
//! cutting strips off and keep the number, so the diagonal is that of the smallest 4:3 picture which holds this one;
//! cameras with 3:2 sensors likewise.
//!
//! **What is not believed.** A picture whose sides no longer have the ratio that the camera stored was cropped, and
//! EXIF no longer tells what it sees. Two sources that contradict each other, and a digital zoom of which nobody knows
//! whether the equivalent includes it, are refused as well: a wrong focal length makes every distance wrong, by the
//! same factor.

use std::fmt;

use thiserror::Error;

use super::phones::sensor_mm;
use super::{CameraName, Exif};

/// Diagonal of 35 mm film, 36 x 24 mm.
const FILM_DIAGONAL_MM: f64 = 43.266_615_305_567_87;

/// Views along the diagonal that a lens without strong distortion can have, degrees.
const DIAGONAL_DEG: std::ops::RangeInclusive<f64> = 2.0..=135.0;

/// Two sources agree up to this factor: equivalents are whole millimetres, and lenses are not what is printed on them.
const AGREEMENT: f64 = 1.15;

/// Pictures of which the longer side has more than this many of the shorter were put together from several.
const MAX_SIDE_RATIO: f64 = 2.6;

/// Side ratios differ by less than this when a picture was only made smaller: sides are rounded.
const SIDE_RATIO_TOLERANCE: f64 = 0.02;

/// Below it, a digital zoom changes nothing that matters.
const MIN_ZOOM: f64 = 1.02;

/// No camera enlarges more.
const MAX_ZOOM: f64 = 100.0;

/// A focal length that EXIF data tell.
#[derive(Debug, Clone, PartialEq)]
pub struct FocalFromExif {
    /// Focal length, pixels of this picture, in both directions.
    pub focal_px: f64,
    /// Horizontal field of view of the upright picture, degrees.
    pub hfov_deg: f64,
    /// From what it was made, and what was not believed, for people to read.
    pub how: String,
}

/// Why EXIF data tell no focal length.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum FocalProblem {
    /// There is none.
    #[error("no focal length in its EXIF data")]
    Missing,
    /// There is only one that no lens has.
    #[error("its EXIF data are not to be believed: {0}")]
    Absurd(String),
    /// Two of them differ.
    #[error("its EXIF data contradict themselves: {first}, but {second}")]
    Contradiction {
        /// What one says.
        first: String,
        /// What the other says.
        second: String,
    },
    /// The picture is a part of what the camera stored.
    #[error(
        "cropped from {}x{} to {}x{} pixels: its EXIF data tell what the whole picture saw", stored[0], stored[1], found[0], found[1]
    )]
    Cropped {
        /// What the camera stored, width and height in pixels.
        stored: [u32; 2],
        /// What is there, width and height in pixels.
        found: [u32; 2],
    },
    /// A digital zoom that the equivalent may include or not.
    #[error(
        "a digital zoom of {zoom:.1} by {camera}: its EXIF data do not tell whether the equivalent of {focal_35mm:.0} mm includes it"
    )]
    Zoom {
        /// The zoom.
        zoom: f64,
        /// The equivalent focal length, millimetres.
        focal_35mm: f64,
        /// The camera's name.
        camera: String,
    },
    /// The sides say that it was put together from several pictures.
    #[error("{}x{} pixels look like a panorama, which is no picture of one camera", .0[0], .0[1])]
    Panorama([u32; 2]),
}

/// One source of a focal length.
struct Candidate {
    focal_px: f64,
    told: String,
}

/// The focal length of a picture of `size` (width and height of the upright picture, pixels; it may have been made
/// smaller).
///
/// In this order: the 35 mm equivalent; the lens's focal length with the sensor's resolution; the same with the sensor
/// of a known phone.
///
/// # Errors
/// When there is none, none that can be believed, or several that contradict one another.
pub fn focal(exif: &Exif, size: [u32; 2]) -> Result<FocalFromExif, FocalProblem> {
    let mut doubts = Vec::new();
    let zoom = zoom(exif, &mut doubts);
    let measured = [focal_plane(exif, size, zoom), known_phone(exif, size, zoom)];
    let mut candidates: Vec<Candidate> = measured.into_iter().flatten().collect();
    candidates.retain(|candidate| believable(candidate, size, &mut doubts));
    if let Some(film) = exif.focal_35mm {
        let equivalent = equivalents(exif, film, size, zoom, &candidates)?;
        if believable(&equivalent, size, &mut doubts) {
            candidates.insert(0, equivalent);
        }
    }
    let chosen = agreed(&candidates)?;
    let Some(chosen) = chosen else {
        return Err(if doubts.is_empty() { FocalProblem::Missing } else { FocalProblem::Absurd(doubts.join("; ")) });
    };
    check_picture(exif, size)?;
    let ignored = doubts.iter().fold(String::new(), |text, doubt| format!("{text}; {doubt}: ignored"));
    Ok(FocalFromExif {
        focal_px: chosen.focal_px,
        hfov_deg: view_deg(f64::from(size[0]), chosen.focal_px),
        how: format!("{}{ignored}", chosen.told),
    })
}

/// What a side or diagonal of this length sees, degrees.
fn view_deg(length_px: f64, focal_px: f64) -> f64 {
    2.0 * (length_px / 2.0 / focal_px).atan().to_degrees()
}

fn diagonal_px(size: [u32; 2]) -> f64 {
    f64::from(size[0]).hypot(f64::from(size[1]))
}

/// Longer and shorter side.
fn long_and_short(size: [u32; 2]) -> [f64; 2] {
    [size[0].max(size[1]), size[0].min(size[1])].map(f64::from)
}

/// The digital zoom, 1 without.
fn zoom(exif: &Exif, doubts: &mut Vec<String>) -> f64 {
    let Some(zoom) = exif.digital_zoom else { return 1.0 };
    if (1.0..=MAX_ZOOM).contains(&zoom) {
        return zoom;
    }
    doubts.push(format!("a digital zoom of {zoom}"));
    1.0
}

/// Whether a lens can have that focal length; a doubt when not.
fn believable(candidate: &Candidate, size: [u32; 2], doubts: &mut Vec<String>) -> bool {
    let possible = candidate.focal_px.is_finite()
        && candidate.focal_px > 0.0
        && DIAGONAL_DEG.contains(&view_deg(diagonal_px(size), candidate.focal_px));
    if !possible {
        doubts.push(candidate.told.clone());
    }
    possible
}

/// From the 35 mm equivalent, with what the digital zoom means for it.
fn equivalents(
    exif: &Exif,
    film_mm: f64,
    size: [u32; 2],
    zoom: f64,
    others: &[Candidate],
) -> Result<Candidate, FocalProblem> {
    let native = native_ratio(exif, size);
    let [long, short] = long_and_short(size);
    // The smallest picture with the sensor's side ratio that holds this one.
    let columns = long.max(short * native);
    let focal_px = film_mm * columns.hypot(columns / native) / FILM_DIAGONAL_MM;
    let told = format!("35 mm equivalent of {film_mm:.0} mm");
    let with_zoom = Candidate { focal_px, told: told.clone() };
    if zoom < MIN_ZOOM {
        return Ok(with_zoom);
    }
    let without_zoom = Candidate { focal_px: focal_px * zoom, told: format!("{told}, digital zoom {zoom:.1}") };
    let with_zoom = Candidate { told: format!("{told}, which includes the digital zoom of {zoom:.1}"), ..with_zoom };
    // iPhones write 52 for 26 mm at a zoom of 2.
    if exif.make.as_deref().is_some_and(|make| make.eq_ignore_ascii_case("apple")) {
        return Ok(with_zoom);
    }
    for candidate in [with_zoom, without_zoom] {
        if others.first().is_some_and(|other| agree(&candidate, other)) {
            return Ok(candidate);
        }
    }
    Err(FocalProblem::Zoom { zoom, focal_35mm: film_mm, camera: CameraName(exif).to_string() })
}

/// Makers of phones, whose sensors are 4:3.
const PHONE_MAKERS: [&str; 17] = [
    "apple",
    "google",
    "honor",
    "htc",
    "huawei",
    "lenovo",
    "lge",
    "motorola",
    "nokia",
    "nothing",
    "oneplus",
    "oppo",
    "realme",
    "samsung",
    "sony mobile",
    "vivo",
    "xiaomi",
];

/// Side ratio of the camera's sensor.
fn native_ratio(exif: &Exif, size: [u32; 2]) -> f64 {
    const PHONE: f64 = 4.0 / 3.0;
    const FILM: f64 = 1.5;
    let [long, short] = long_and_short(size);
    let make = exif.make.as_deref().unwrap_or_default().to_lowercase();
    if PHONE_MAKERS.iter().any(|maker| make.starts_with(maker)) {
        return PHONE;
    }
    // Others have sensors of both kinds, and a picture of neither kind is more often from the wider one.
    if (long / short / PHONE - 1.0).abs() < SIDE_RATIO_TOLERANCE { PHONE } else { FILM }
}

/// From the lens's focal length and the sensor's pixels per millimetre.
fn focal_plane(exif: &Exif, size: [u32; 2], zoom: f64) -> Option<Candidate> {
    let (focal_mm, [x, y]) = (exif.focal_mm?, exif.focal_plane_px_per_mm?);
    let [long, _] = long_and_short(size);
    let made_smaller = exif.stored_size.map_or(1.0, |stored| long / long_and_short(stored)[0]);
    let px_per_mm = (x * y).sqrt();
    let told = format!("{focal_mm:.2} mm at {px_per_mm:.0} pixels per millimetre of the sensor{}", zoomed(zoom));
    Some(Candidate { focal_px: focal_mm * px_per_mm * made_smaller * zoom, told })
}

/// From the lens's focal length and the sensor of a phone that is known.
fn known_phone(exif: &Exif, size: [u32; 2], zoom: f64) -> Option<Candidate> {
    let (focal_mm, model) = (exif.focal_mm?, exif.model.as_deref()?);
    let sensor = sensor_mm(model, focal_mm)?;
    let [long, short] = long_and_short(size);
    // A picture that is wider than the sensor has its whole width, one that is narrower its whole height.
    let px_per_mm = (long / sensor[0]).max(short / sensor[1]);
    let told = format!("{focal_mm:.2} mm and the sensor of {}{}", CameraName(exif), zoomed(zoom));
    Some(Candidate { focal_px: focal_mm * px_per_mm * zoom, told })
}

fn zoomed(zoom: f64) -> String {
    if zoom < MIN_ZOOM { String::new() } else { format!(", digital zoom {zoom:.1}") }
}

fn agree(one: &Candidate, other: &Candidate) -> bool {
    (1.0 / AGREEMENT..=AGREEMENT).contains(&(one.focal_px / other.focal_px))
}

/// The first candidate with which the others agree; of three, two decide.
fn agreed(candidates: &[Candidate]) -> Result<Option<&Candidate>, FocalProblem> {
    let [first, rest @ ..] = candidates else { return Ok(None) };
    let Some(other) = rest.iter().find(|other| !agree(first, other)) else { return Ok(Some(first)) };
    for (position, candidate) in candidates.iter().enumerate() {
        if candidates[position + 1..].iter().any(|later| agree(candidate, later)) {
            return Ok(Some(candidate));
        }
    }
    let told = |candidate: &Candidate| format!("{} is {}", candidate.told, Pixels(candidate.focal_px));
    Err(FocalProblem::Contradiction { first: told(first), second: told(other) })
}

/// A focal length as people read it.
struct Pixels(f64);

impl fmt::Display for Pixels {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a focal length of {:.0} pixels", self.0)
    }
}

/// Whether the picture is still the one that the camera stored, and of one view.
fn check_picture(exif: &Exif, size: [u32; 2]) -> Result<(), FocalProblem> {
    let [long, short] = long_and_short(size);
    if long > MAX_SIDE_RATIO * short {
        return Err(FocalProblem::Panorama(size));
    }
    let Some(stored) = exif.stored_size else { return Ok(()) };
    // Turned by a program that left the rest as it was, the sides have changed places.
    let [stored_long, stored_short] = long_and_short(stored);
    let change = (long / short) / (stored_long / stored_short);
    let same = (1.0 - SIDE_RATIO_TOLERANCE..=1.0 + SIDE_RATIO_TOLERANCE).contains(&change);
    if same { Ok(()) } else { Err(FocalProblem::Cropped { stored, found: size }) }
}

#[cfg(test)]
mod tests {
    use super::{FocalProblem, focal};
    use crate::exif::Exif;

    const SIZE: [u32; 2] = [4032, 3024];

    fn phone(make: &str, film: f64) -> Exif {
        Exif { make: Some(make.to_owned()), focal_35mm: Some(film), ..Exif::default() }
    }

    fn hfov(exif: &Exif, size: [u32; 2]) -> f64 {
        focal(exif, size).unwrap().hfov_deg
    }

    #[test]
    fn a_phones_equivalent_is_along_the_diagonal() {
        // 5040 pixels of diagonal are 43.27 mm, so 26 mm are 3028.6 pixels.
        let found = focal(&phone("Apple", 26.0), SIZE).unwrap();
        assert!((found.focal_px - 3028.6).abs() < 0.1, "{found:?}");
        assert!((found.hfov_deg - 67.3).abs() < 0.05, "{found:?}");
        assert_eq!(found.how, "35 mm equivalent of 26 mm");
        // 3:2 of a camera: the width is 36 mm.
        let found = focal(&phone("Canon", 36.0), [6000, 4000]).unwrap();
        assert!((found.focal_px - 6000.0).abs() < 1.0, "{found:?}");
    }

    #[test]
    fn turned_and_smaller_pictures_see_the_same() {
        let exif = Exif { stored_size: Some(SIZE), ..phone("Apple", 26.0) };
        let wide = focal(&exif, SIZE).unwrap();
        let upright = focal(&exif, [3024, 4032]).unwrap();
        assert!((wide.focal_px - upright.focal_px).abs() < 1e-9);
        assert!((upright.hfov_deg - 53.06).abs() < 0.01, "{upright:?}");
        assert!((hfov(&exif, [1000, 750]) - wide.hfov_deg).abs() < 1e-9);
        // 16:9 keeps the width of the sensor, and so does the field of view.
        let strip = Exif { stored_size: None, ..exif };
        assert!((hfov(&strip, [4032, 2268]) - wide.hfov_deg).abs() < 1e-9);
    }

    #[test]
    fn lens_and_sensor_do_without_an_equivalent() {
        let plane = Exif {
            focal_mm: Some(50.0),
            focal_plane_px_per_mm: Some([6000.0 / 36.0; 2]),
            stored_size: Some([6000, 4000]),
            ..Exif::default()
        };
        assert!((hfov(&plane, [6000, 4000]) - 39.6).abs() < 0.01);
        assert!((hfov(&plane, [600, 400]) - 39.6).abs() < 0.01);
        let known = Exif { focal_mm: Some(4.25), model: Some("iPhone 11".to_owned()), ..Exif::default() };
        assert!((hfov(&known, SIZE) - 67.2).abs() < 0.05);
        assert!((hfov(&known, [4032, 2268]) - 67.2).abs() < 0.05);
        // A square has the whole height: 4.23 mm.
        assert!((hfov(&known, [3024, 3024]) - 52.9).abs() < 0.1);
    }

    #[test]
    fn a_digital_zoom_counts_once() {
        let zoomed = |make, film, zoom| Exif { digital_zoom: Some(zoom), ..phone(make, film) };
        assert!((hfov(&zoomed("Apple", 52.0, 2.0), SIZE) - 36.8).abs() < 0.05);
        let unsure = focal(&zoomed("samsung", 26.0, 2.0), SIZE).unwrap_err();
        assert!(matches!(unsure, FocalProblem::Zoom { .. }), "{unsure}");
        assert!(focal(&zoomed("samsung", 26.0, 1.0), SIZE).is_ok());
        // The known sensor decides.
        for film in [26.0, 52.0] {
            let known =
                Exif { model: Some("SM-G960F".to_owned()), focal_mm: Some(4.3), ..zoomed("samsung", film, 2.0) };
            let found = focal(&known, SIZE).unwrap();
            assert!((found.hfov_deg - 36.8).abs() < 0.1, "{found:?}");
        }
        let found = focal(&zoomed("samsung", 26.0, f64::INFINITY), SIZE).unwrap();
        assert_eq!(found.how, "35 mm equivalent of 26 mm; a digital zoom of inf: ignored");
    }

    #[test]
    fn lies_are_told() {
        let plane = |film, resolution: f64| Exif {
            focal_mm: Some(4.25),
            focal_plane_px_per_mm: Some([resolution; 2]),
            ..phone("samsung", film)
        };
        // 714 pixels a millimetre are pixels of 1.4 micrometres.
        let found = focal(&plane(26.0, 714.0), SIZE).unwrap();
        assert_eq!(found.how, "35 mm equivalent of 26 mm");
        let found = focal(&plane(26.0, f64::INFINITY), SIZE).unwrap();
        let doubt = "4.25 mm at inf pixels per millimetre of the sensor: ignored";
        assert_eq!(found.how, format!("35 mm equivalent of 26 mm; {doubt}"));
        let told = focal(&plane(26.0, 350.0), SIZE).unwrap_err().to_string();
        let expected = "its EXIF data contradict themselves: 35 mm equivalent of 26 mm is a focal length of 3029 pixels, but \
                        4.25 mm at 350 pixels per millimetre of the sensor is a focal length of 1488 pixels";
        assert_eq!(told, expected);
        // Of three, two decide: the equivalent is the liar.
        let outvoted = Exif { model: Some("iPhone 11".to_owned()), ..plane(80.0, 714.0) };
        assert!((hfov(&outvoted, SIZE) - 67.2).abs() < 0.1);

        for absurd in [f64::INFINITY, f64::NAN, -26.0, 1.0, 60_000.0] {
            let told = focal(&phone("Apple", absurd), SIZE).unwrap_err();
            assert!(matches!(told, FocalProblem::Absurd(_)), "{absurd}: {told}");
        }
        assert_eq!(focal(&Exif::default(), SIZE), Err(FocalProblem::Missing));
        let stored = Exif { stored_size: Some(SIZE), ..phone("Apple", 26.0) };
        let cropped = FocalProblem::Cropped { stored: SIZE, found: [2000, 1000] };
        assert_eq!(focal(&stored, [2000, 1000]), Err(cropped));
        assert_eq!(focal(&phone("Apple", 26.0), [9000, 3000]), Err(FocalProblem::Panorama([9000, 3000])));
    }
}
