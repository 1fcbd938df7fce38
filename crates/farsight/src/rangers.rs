//! Rangers: what distance a detection would have by its 2D box and the camera, without a look at the image. What the
//! distances of a network have to beat.

use farsight_core::geometric_baseline::{depth_from_ground, depth_from_height, horizon_from_boxes, level_horizon};
#[cfg(feature = "train")]
use farsight_core::statistics::{quantile, sorted};
#[cfg(feature = "train")]
use farsight_core::{Box2d, Label};
use farsight_core::{Camera, Detection, ObjectClass};
#[cfg(feature = "train")]
use farsight_data::{ItemKey, annotations::DepthMap};
#[cfg(feature = "train")]
use farsight_methods::box_mlp::Example;
use farsight_methods::box_mlp::{BoxMlp, features};
use farsight_methods::gs3d::guidance::guidance;
use farsight_synth::sizes::SizeStatistics;

pub(crate) use crate::experiment::RangerName;

/// Height of KITTI's camera above the road, metres (Geiger et al. 2013).
pub(crate) const CAMERA_HEIGHT_M: f64 = 1.65;

/// A ranger, ready to range.
#[derive(Debug, Clone)]
pub(crate) enum Ranger {
    /// Of the four that learn nothing.
    Geometric {
        name: RangerName,
        /// Height of the camera above the ground, metres.
        camera_height_m: f64,
    },
    /// The one that learns.
    #[cfg_attr(not(feature = "train"), allow(dead_code, reason = "experiments alone fit it"))]
    BoxMlp(BoxMlp),
}

impl Ranger {
    /// One that needs nothing but the height of the camera; none of the others.
    pub(crate) fn geometric(name: RangerName, camera_height_m: f64) -> Option<Self> {
        let is_geometric = !matches!(name, RangerName::BoxMlp | RangerName::MedianDepth);
        is_geometric.then_some(Self::Geometric { name, camera_height_m })
    }

    /// The one that learns, from labelled objects of which at least half is seen: each frame's camera and labels. None
    /// without such an object. The seed is that of its weights and of the order of examples.
    #[cfg(feature = "train")]
    pub(crate) fn fitted(frames: &[(Camera, Vec<Label>)], seed: u64) -> Option<Self> {
        let examples = frames.iter().flat_map(|(camera, labels)| {
            let seen = labels.iter().filter(|label| (0..=1).contains(&label.occlusion) && label.truncation < 0.5);
            seen.filter_map(move |label| example(label, camera))
        });
        let mut rng = ItemKey { epoch: 0, index: 0, seed }.rng();
        Some(Self::BoxMlp(BoxMlp::fit(&examples.collect::<Vec<_>>(), &mut rng)?))
    }

    /// The detections of an image with the distances that they have by this ranger. Those that it can say nothing about
    /// are left out. Boxes in space keep size and heading and go along their centre's ray; a guidance has its own size.
    pub(crate) fn ranged(&self, detections: Vec<Detection>, camera: &Camera) -> Vec<Detection> {
        let depth: DepthOf<'_> = match self {
            Self::BoxMlp(network) => Box::new(|one| {
                let features = features(&one.box2d, camera, mean_hwl(&one.class))?;
                Some(network.depth_m(&features))
            }),
            Self::Geometric { name: RangerName::Guidance, .. } => {
                return detections.into_iter().filter_map(|one| guided(one, camera)).collect();
            }
            Self::Geometric { name: RangerName::SimilarTriangles, .. } => Box::new(|one| by_height(one, camera)),
            Self::Geometric { name, camera_height_m } => {
                let estimated = (*name == RangerName::EstimatedHorizon)
                    .then(|| estimated_horizon(&detections, camera, *camera_height_m))
                    .flatten();
                let horizon = estimated.unwrap_or_else(|| level_horizon(camera));
                Box::new(move |one| {
                    depth_from_ground(&one.box2d, camera, horizon, *camera_height_m, half_length_m(&one.class))
                })
            }
        };
        let depths: Vec<Option<f64>> = detections.iter().map(&depth).collect();
        detections.into_iter().zip(depths).filter_map(|(one, depth)| moved(one, camera, depth?)).collect()
    }
}

/// Depth of a detection, metres; none where nothing can be said.
type DepthOf<'a> = Box<dyn Fn(&Detection) -> Option<f64> + 'a>;

/// Mean height, width and length of a class, metres.
fn mean_hwl(class: &ObjectClass) -> [f64; 3] {
    let SizeStatistics { height, width, length, .. } = SizeStatistics::of(class);
    [height.mean, width.mean, length.mean]
}

/// Edges of boxes are where an object is nearest, so much before its centre.
fn half_length_m(class: &ObjectClass) -> f64 {
    SizeStatistics::of(class).length.mean / 2.0
}

fn by_height(detection: &Detection, camera: &Camera) -> Option<f64> {
    let [height, ..] = mean_hwl(&detection.class);
    depth_from_height(&detection.box2d, camera, height, half_length_m(&detection.class))
}

fn estimated_horizon(detections: &[Detection], camera: &Camera, camera_height_m: f64) -> Option<f64> {
    let nearest = |one: &Detection| Some((one.box2d, by_height(one, camera)? - half_length_m(&one.class)));
    let objects: Vec<_> = detections.iter().filter_map(nearest).collect();
    horizon_from_boxes(&objects, camera, camera_height_m)
}

/// The detections of an image with the median depth of the pixels in their 2D boxes, as a sensor of depth (laser,
/// stereo) would see it: of what is seen, so half a mean length is added. The sky has no depth. Those without a pixel
/// that has one are left out.
#[cfg(feature = "train")]
pub(crate) fn ranged_by_median(
    detections: Vec<Detection>,
    camera: &Camera,
    depth: &DepthMap,
    [width, height]: [usize; 2],
) -> Vec<Detection> {
    let range = |low: f64, high: f64, size: usize| {
        let inside = |value: f64| (value.clamp(0.0, size as f64)) as usize;
        inside(low.floor())..inside(high.ceil())
    };
    let median_m = |one: &Detection| {
        let Box2d { x1, y1, x2, y2 } = one.box2d;
        let (columns, rows) = (range(x1, x2, width), range(y1, y2, height));
        let row = |y: usize| depth.depth_m.get(y * width + columns.start..y * width + columns.end).unwrap_or_default();
        let depths = rows.flat_map(row).map(|depth_m| f64::from(*depth_m)).filter(|depth_m| depth_m.is_finite());
        let depths = sorted(depths);
        (!depths.is_empty()).then(|| quantile(&depths, 0.5))
    };
    let ranged = |one: Detection| {
        let depth_m = median_m(&one)? + half_length_m(&one.class);
        moved(one, camera, depth_m)
    };
    detections.into_iter().filter_map(ranged).collect()
}

#[cfg(feature = "train")]
fn example(label: &Label, camera: &Camera) -> Option<Example> {
    let depth_m = label.box3d.depth_m();
    let features = features(&label.box2d, camera, mean_hwl(&label.class))?;
    (depth_m > 0.0).then_some(Example { features, depth_m })
}

fn guided(mut detection: Detection, camera: &Camera) -> Option<Detection> {
    detection.box3d = guidance(&detection.box2d, detection.alpha(), mean_hwl(&detection.class), camera)?;
    detection.range_sigma_m = None;
    Some(detection)
}

/// The detection at this depth, its centre on the same ray.
fn moved(mut detection: Detection, camera: &Camera, depth_m: f64) -> Option<Detection> {
    let pixel = camera.pixel_from_point(detection.box3d.center())?;
    let [x, y, z] = camera.point_from_pixel(pixel, depth_m);
    detection.box3d.location = [x, y + detection.box3d.dimensions.height / 2.0, z];
    detection.range_sigma_m = None;
    Some(detection)
}

#[cfg(all(test, feature = "train"))]
mod tests {
    use farsight_core::{Box3d, Dimensions};

    use super::*;

    fn detection(box2d: [f64; 4]) -> Detection {
        let [x1, y1, x2, y2] = box2d;
        Detection {
            class: ObjectClass::Car,
            box2d: Box2d { x1, y1, x2, y2 },
            box3d: Box3d {
                dimensions: Dimensions { length: 4.0, height: 1.5, width: 1.6 },
                location: [1.0, 1.6, 10.0],
                yaw: 0.0,
            },
            score: 0.9,
            range_sigma_m: Some(1.0),
        }
    }

    #[test]
    fn the_median_is_of_the_pixels_in_the_box_that_have_a_depth() {
        let camera = Camera::from_hfov(65.0, 8, 4).unwrap();
        // Columns are 10, 20, ... metres away; the upper row is sky.
        let depth_m = (0..32).map(|i| if i < 8 { f32::INFINITY } else { 10.0 * (i % 8 + 1) as f32 }).collect();
        let depth = DepthMap { depth_m };
        let boxes = [
            ([1.0, 0.0, 4.0, 4.0], Some(30.0)),
            // Beyond the image, and of parts of pixels.
            ([-5.0, -5.0, 2.5, 9.0], Some(20.0)),
            ([6.5, 1.0, 99.0, 99.0], Some(75.0)),
            // Nothing but sky, nothing of the image.
            ([0.0, 0.0, 8.0, 1.0], None),
            ([20.0, 1.0, 30.0, 3.0], None),
        ];
        for (box2d, expected) in boxes {
            let found = ranged_by_median(vec![detection(box2d)], &camera, &depth, [8, 4]);
            let found = found.first().map(|one| one.box3d.depth_m() - half_length_m(&ObjectClass::Car));
            match (found, expected) {
                (Some(found), Some(expected)) => assert!((found - expected).abs() < 1e-9, "{box2d:?}: {found}"),
                (found, expected) => assert_eq!(found, expected, "{box2d:?}"),
            }
        }
    }
}
