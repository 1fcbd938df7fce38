//! The two source pixels of one axis that an output pixel is made of.

use std::ops::Range;

use farsight_core::input::Sampling;

/// Two neighbours and how far the sample lies from the first towards the second.
///
/// Indices count from 1; 0 and the one after the last pixel are black. So nothing needs to be asked in the inner loops.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Taps {
    pub(super) first: usize,
    pub(super) second: usize,
    pub(super) weight: f32,
}

/// The neighbours of `position` (pixels) on an axis of `len` pixels; `None` when the position is outside.
///
/// Pixel-exact samples fade to black within a pixel of the border (OpenCV); half-pixel samples repeat the border up to
/// its outer edge and are black beyond (Pillow).
pub(super) fn taps(position: f64, len: usize, sampling: Sampling) -> Option<Taps> {
    let end = len as f64;
    let floor = position.floor();
    let weight = (position - floor) as f32;
    match sampling {
        Sampling::PixelExact | Sampling::Antialias => (position > -1.0 && position < end).then(|| {
            let first = (floor + 1.0) as usize;
            Taps { first, second: first + 1, weight }
        }),
        Sampling::HalfPixel => (position >= -0.5 && position < end - 0.5).then(|| {
            let inside = |pixel: f64| pixel.clamp(0.0, end - 1.0) as usize + 1;
            Taps { first: inside(floor), second: inside(floor + 1.0), weight }
        }),
    }
}

/// Makes `found` the taps of `count` output pixels, the first at `start` and each `step` further; the range of those
/// that see the source.
pub(super) fn axis_taps(
    found: &mut Vec<Taps>,
    start: f64,
    step: f64,
    count: usize,
    len: usize,
    sampling: Sampling,
) -> Range<usize> {
    let at = |i: usize| taps(start + step * i as f64, len, sampling);
    found.clear();
    found.extend((0..count).map(|i| at(i).unwrap_or_default()));
    covered_range((0..count).map(|i| at(i).is_some()))
}

/// From the first to the last `true`; the source is convex, so there is no gap between.
pub(super) fn covered_range(covered: impl DoubleEndedIterator<Item = bool> + ExactSizeIterator) -> Range<usize> {
    let mut covered = covered.enumerate().filter_map(|(i, inside)| inside.then_some(i));
    let first = covered.next();
    let last = covered.next_back().or(first);
    first.zip(last).map_or(0..0, |(first, last)| first..last + 1)
}
