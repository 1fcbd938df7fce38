//! Scenes to look at, chosen by their labels alone, so that no result has a say in it.

use std::cmp::Reverse;
use std::fmt;

use image::RgbImage;

use super::worst::FrameErrors;
use crate::ranging::Target;

/// Scenes of each kind on the page.
const SHOWN: usize = 3;

/// Objects are distant from here, metres of z.
pub(super) const DISTANT_M: f64 = 40.0;

/// The least score of detections that found nothing and are drawn where two results lie side by side: that from which
/// `farsight range` shows what it finds.
pub const SHOWN_SCORE: f64 = 0.25;

/// KITTI's occlusion of what is largely hidden.
const LARGELY_HIDDEN: i32 = 2;

/// Why a scene is shown. The order in which kinds choose: a frame is shown once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SceneKind {
    /// The most objects from 40 m on.
    Distant,
    /// The most objects that are largely hidden.
    Occluded,
    /// The most objects.
    Crowded,
}

impl SceneKind {
    const ALL: [Self; 3] = [Self::Distant, Self::Occluded, Self::Crowded];

    fn has(self, target: &Target) -> bool {
        match self {
            Self::Distant => target.depth_m >= DISTANT_M,
            Self::Occluded => target.occlusion == LARGELY_HIDDEN,
            Self::Crowded => true,
        }
    }
}

impl fmt::Display for SceneKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Distant => "distant",
            Self::Occluded => "largely hidden",
            Self::Crowded => "crowded",
        })
    }
}

/// A scene that is worth a look.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ChosenScene {
    /// Why.
    pub kind: SceneKind,
    /// Position of its frame in the set.
    pub frame: usize,
    /// Objects of the kind in it.
    pub objects: usize,
}

/// A scene as two results have it.
#[derive(Debug, Clone)]
pub struct ShownScene {
    /// Why it is shown.
    pub scene: ChosenScene,
    /// Its objects and what the results found of them, ours and the others.
    pub results: [FrameErrors; 2],
    /// Its image with detections and labels, likewise.
    pub images: [Option<RgbImage>; 2],
}

/// Up to three scenes of each kind, those with the most objects of it that count at some difficulty; of equal ones the
/// first.
pub fn chosen_scenes(targets: &[Target]) -> Vec<ChosenScene> {
    let mut chosen: Vec<ChosenScene> = Vec::new();
    for kind in SceneKind::ALL {
        let of_frame = |targets: &[Target]| {
            let counted = targets.iter().filter(|target| target.difficulty.is_some() && kind.has(target)).count();
            Some(ChosenScene { kind, frame: targets.first()?.frame as usize, objects: counted })
        };
        let is_new = |scene: &ChosenScene| chosen.iter().all(|other| other.frame != scene.frame);
        let frames = targets.chunk_by(|a, b| a.frame == b.frame).filter_map(of_frame);
        let mut frames: Vec<_> = frames.filter(|scene| scene.objects > 0 && is_new(scene)).collect();
        // A stable sort: of equal ones the first stays the first.
        frames.sort_by_key(|scene| Reverse(scene.objects));
        frames.truncate(SHOWN);
        chosen.extend(frames);
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::SceneKind::{Crowded, Distant, Occluded};
    use super::*;
    use crate::{Difficulty, EvaluatedClass};

    fn target(frame: u32, depth_m: f64, occlusion: i32, difficulty: Option<Difficulty>) -> Target {
        let class = EvaluatedClass::Car;
        let (ground_m, found) = (depth_m, None);
        Target {
            frame,
            label: 0,
            class,
            difficulty,
            height_px: 50.0,
            occlusion,
            truncation: 0.0,
            depth_m,
            ground_m,
            found,
        }
    }

    #[test]
    fn scenes_have_the_most_objects_of_their_kind_and_come_once() {
        let counts = Some(Difficulty::Hard);
        let mut targets = Vec::new();
        // Frame 0: near and free. 1: two far ones. 2: one far one. 3: far ones that do not count. 4: a hidden one. 5: a
        // crowd.
        targets.extend([target(0, 10.0, 0, counts)]);
        targets.extend([target(1, 40.0, 0, counts), target(1, 55.0, 0, counts)]);
        targets.extend([target(2, 39.9, 0, counts), target(2, 41.0, 2, counts)]);
        targets.extend(vec![target(3, 50.0, 0, None); 9]);
        targets.extend([target(4, 12.0, 2, counts), target(4, 12.0, 1, counts)]);
        targets.extend(vec![target(5, 12.0, 0, counts); 4]);
        let chosen: Vec<_> = chosen_scenes(&targets).iter().map(|s| (s.kind, s.frame, s.objects)).collect();
        assert_eq!(chosen, [(Distant, 1, 2), (Distant, 2, 1), (Occluded, 4, 1), (Crowded, 5, 4), (Crowded, 0, 1)]);
        assert!(chosen_scenes(&[]).is_empty());
    }

    #[test]
    fn of_equal_ones_the_first_are_shown_and_at_most_three() {
        let targets: Vec<_> = (0..9).map(|frame| target(frame, 10.0, 0, Some(Difficulty::Easy))).collect();
        let frames: Vec<_> = chosen_scenes(&targets).iter().map(|scene| scene.frame).collect();
        assert_eq!(frames, [0, 1, 2]);
    }
}
