//! Who is in a frame and how they move, without its picture: a thousand times as fast.

use farsight_core::{Box2d, Box3d, Camera, ObjectClass};

use super::frame::{relative, tilted_label};
use super::{EgoTruth, Sequence, TrackTruth};
use crate::generator::view::tilted;
use crate::labels::LabelRules;
use crate::scene::LabelledObject;

/// What is seen of a box is counted at so many points in each direction.
const POINTS: usize = 8;

/// Somebody by their identity, and what [`relative`] says of them.
type Found = (u32, LabelledObject, [[f64; 3]; 2]);

/// A frame that nobody drew.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct UnrenderedFrame {
    /// Its time, seconds; the first has 0.
    pub time_s: f64,
    /// The camera as it is mounted, as in [`super::SequenceFrame`].
    pub camera: Camera,
    /// Width and height that the image would have, pixels.
    pub image_size: [usize; 2],
    /// Who would be labelled, by their identities.
    pub tracks: Vec<TrackTruth>,
    /// How the camera moves.
    pub ego: EgoTruth,
}

impl Sequence {
    /// Frame number `index` without its picture. Boxes, velocities and the camera's motion are those of
    /// [`Sequence::frame`]; how much is seen of somebody is not, because it comes from boxes alone: nearer ones hide
    /// what lies behind them, scenery hides nothing.
    ///
    /// # Panics
    /// When there are not so many.
    pub fn unrendered_frame(&self, index: usize) -> UnrenderedFrame {
        let step = &self.steps[index];
        let placement = self.placement(step);
        let ego = self.ego(step);
        let [width, height] = self.street.scene.image_size;
        let mut seen_by = tilted(&self.street.scene.camera, step.ego.pitch, step.ego.roll);
        let mut camera = self.street.scene.camera;
        if self.is_mirrored {
            (seen_by, camera) = (seen_by.mirrored(width), camera.mirrored(width));
        }
        let standing = self.street.objects.iter().map(|object| (&object.class, object.box3d, [0.0; 2]));
        let moving = self.bodies.iter().zip(&step.movers);
        let moving = moving.map(|(body, moment)| moment.map(|moment| (body.class(), moment.box3d, moment.velocity)));
        let mut found: Vec<Found> = Vec::new();
        for (id, one) in self.ids.iter().zip(standing.map(Some).chain(moving)) {
            let Some((class, in_street, velocity)) = one else { continue };
            let mut box3d = placement.box3d(&in_street);
            let mut moved = relative(step, &placement, &box3d, velocity);
            if self.is_mirrored {
                box3d = box3d.mirrored();
                moved[0][0] = -moved[0][0];
            }
            found.push((*id, LabelledObject { class: class.clone(), box3d, instance: 0, plate: None }, moved));
        }
        let outlines: Vec<Option<(Box2d, f64)>> =
            found.iter().map(|(_, object, _)| outline(&object.box3d, &seen_by)).collect();
        let rules = LabelRules::for_width(width);
        let [right, bottom] = [width as f64 - 1.0, height as f64 - 1.0];
        let track = |(found, outline): (&Found, &Option<(Box2d, f64)>)| {
            let ((id, object, [velocity_mps, [speed_mps, ..]]), (whole, near_m)) = (found, (*outline)?);
            let box2d = whole.clamped(right, bottom);
            let nearer = outlines.iter().flatten().filter(|(_, other_m)| *other_m < near_m).map(|(other, _)| other);
            let visible = share_in_sight(&box2d, &nearer.collect::<Vec<_>>());
            let truncation = if whole.area() > 0.0 { 1.0 - box2d.area() / whole.area() } else { 1.0 };
            let label = rules.label(object, box2d, truncation, visible)?;
            if label.class == ObjectClass::DontCare {
                return None;
            }
            let label = tilted_label(label, ego.pitch_rad, ego.roll_rad);
            Some(TrackTruth { id: *id, label, velocity_mps: *velocity_mps, speed_mps: *speed_mps })
        };
        let tracks = found.iter().zip(&outlines).filter_map(track).collect();
        UnrenderedFrame { time_s: index as f64 / self.fps, camera, image_size: [width, height], tracks, ego }
    }
}

/// The box around somebody in the image, not clipped to it, and how far away they are, metres.
fn outline(box3d: &Box3d, camera: &Camera) -> Option<(Box2d, f64)> {
    Some((box3d.projected(camera)?, box3d.depth_m()))
}

/// The share of a box that none of the others covers.
fn share_in_sight(box2d: &Box2d, others: &[&Box2d]) -> f64 {
    let at = |k: usize| (k as f64 + 0.5) / POINTS as f64;
    let is_seen = |(column, row): (usize, usize)| {
        let [x, y] = [box2d.x1 + at(column) * box2d.width(), box2d.y1 + at(row) * box2d.height()];
        others.iter().all(|other| x < other.x1 || x > other.x2 || y < other.y1 || y > other.y2)
    };
    let points = (0..POINTS).flat_map(|column| (0..POINTS).map(move |row| (column, row)));
    points.filter(|point| is_seen(*point)).count() as f64 / (POINTS * POINTS) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generator::{CameraRanges, SceneConfig};
    use crate::sequence::SequenceStream;

    #[test]
    fn what_is_there_is_what_a_picture_shows() {
        let camera = CameraRanges { image_sizes: vec![[310, 94]], ..CameraRanges::varied() };
        let config = SceneConfig { cameras: vec![camera], left_hand_share: 0.5, ..SceneConfig::default() };
        let stream = SequenceStream { config, seed: 3, frames: 3, fps: 5.0 };
        let mut shared = 0;
        for index in 0..6 {
            let sequence = stream.sequence(index);
            let (drawn, not_drawn) = (sequence.frame(2), sequence.unrendered_frame(2));
            assert_eq!((drawn.time_s, drawn.camera, drawn.ego), (not_drawn.time_s, not_drawn.camera, not_drawn.ego));
            for track in &drawn.tracks {
                let Some(other) = not_drawn.tracks.iter().find(|other| other.id == track.id) else { continue };
                let (label, expected) = (&other.label, &track.label);
                assert_eq!((other.velocity_mps, other.speed_mps), (track.velocity_mps, track.speed_mps));
                assert_eq!((&label.class, label.box2d, label.box3d), (&expected.class, expected.box2d, expected.box3d));
                shared += 1;
            }
        }
        assert!(shared > 20, "{shared}");
    }

    #[test]
    fn what_lies_behind_a_nearer_box_is_not_seen() {
        let behind = Box2d::new(0.0, 0.0, 8.0, 8.0);
        let (left, top) = (Box2d::new(-1.0, -1.0, 4.0, 9.0), Box2d::new(-1.0, -1.0, 9.0, 4.0));
        for (others, expected) in [(vec![], 1.0), (vec![&left], 0.5), (vec![&left, &top], 0.25), (vec![&behind], 0.0)] {
            assert!((share_in_sight(&behind, &others) - expected).abs() < 1e-9, "{others:?}");
        }
    }
}
