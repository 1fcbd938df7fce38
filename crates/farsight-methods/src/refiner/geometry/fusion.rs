//! One answer from two stages: how far to trust each, fitted on labelled frames.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::kinds::{likeliest, log_odds};
use super::{Evidence, FusedScores, Refinement, kind_of};
use farsight_core::overlap::iou_2d;
use farsight_core::scale::is_scaled;
use farsight_core::score::SCORE_LIMITS;
use farsight_core::{Box2d, Camera, DepthFusion, Detection, MeasuredDepth, ObjectClass, Region, ScalePrior};

/// Boxes in the image that overlap less are of two different things.
const MIN_OVERLAP: f64 = 0.3;

/// A box of which an edge is nearer to the image's, as a share of the image's side, shows an object that may go on
/// beyond it.
const BORDER: f64 = 0.01;

/// How the two stages go together, fitted on labelled frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StageFusion {
    /// One depth from both. Neither stage knows how large a car is, so they err alike.
    pub depths: DepthFusion,
    /// Factor on the error bars of people and cyclists, whose heights spread otherwise than those of vehicles.
    #[serde(skip_serializing_if = "is_one")]
    pub people_error_factor: f64,
    /// How likely a detection is right after both; unfitted, the detector's scores stay.
    pub scores: FusedScores,
    /// The same for what the refiner takes for another class than the detector, by that class; others are scored by the
    /// detector's. A detector that is sure of cars may be unsure of lorries, which it takes for cars.
    #[serde(skip_serializing_if = "FusedScores::is_empty")]
    pub renamed_scores: FusedScores,
    /// How much of the sides of a vehicle's box in the image is the detector's, 0 to 1; the rest is the projection of
    /// the 3D box. None where that is the box, as in files of before there was a choice.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub side_share: Option<f64>,
    /// What the distances of an image's vehicles have in common, by region; empty where that was not fitted.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub scales: BTreeMap<Region, ScalePrior>,
}

impl Default for StageFusion {
    /// Unfitted.
    fn default() -> Self {
        let scores = FusedScores::default();
        let (depths, renamed_scores) = (DepthFusion::default(), scores.clone());
        let scales = BTreeMap::new();
        Self { depths, people_error_factor: 1.0, scores, renamed_scores, side_share: None, scales }
    }
}

/// Files of before there was such a factor do not name it.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_one(factor: &f64) -> bool {
    factor.to_bits() == 1.0_f64.to_bits()
}

impl StageFusion {
    /// The factors that people's error bars may have.
    pub const PEOPLE_ERROR_FACTORS: [f64; 2] = [0.1, 10.0];

    /// Whether these are numbers that a fit could have given: files from strangers may hold others.
    pub fn is_usable(&self) -> bool {
        let [least, most] = Self::PEOPLE_ERROR_FACTORS;
        let are_people = (least..=most).contains(&self.people_error_factor);
        let are_scales = self.scales.values().all(ScalePrior::is_usable);
        let are_scores = self.scores.is_usable() && self.renamed_scores.is_usable();
        let is_share = self.side_share.is_none_or(|share| (0.0..=1.0).contains(&share));
        are_people && are_scales && are_scores && is_share && self.depths.is_usable()
    }

    /// `first`, found in an image of this size (width, height) that `camera` takes, with what the refiner says of it,
    /// if it says anything.
    ///
    /// Direction, heading and proportions are the refiner's; its box is moved along its rays, growing with the
    /// distance, to the depth on which both agree best. A detector without error bar has no say in that. Where the
    /// refiner sees something else than the detector, or something that is not in the image, the place of `first`
    /// stays. The score is that of both, the class the likeliest of those that are easily taken for that of `first`.
    ///
    /// A vehicle's box in the image is the projection of the 3D box, whose sides move towards those of the detector's
    /// box ([`Self::side_share`]); where the image's edge cuts it, of which the refiner sees too little then, it is the
    /// smallest box around both.
    pub fn fused(
        &self,
        first: &Detection,
        second: Option<&Refinement>,
        camera: &Camera,
        image_size: [usize; 2],
    ) -> Detection {
        let Some(second) = second else { return first.clone() };
        let placed = self.placed(first, second, camera, image_size);
        let evidence = evidence(first, second, placed.as_ref());
        let (least, most) = SCORE_LIMITS;
        let class = likeliest(&second.kinds, &first.class);
        let score = self.score(&first.class, &class, &evidence).clamp(least, most);
        let agreed = placed.filter(|_| evidence.overlap >= MIN_OVERLAP);
        let agreed = agreed.unwrap_or_else(|| first.clone());
        let box2d = match self.side_share.filter(|_| is_scaled(&first.class)) {
            Some(_) if is_cut(&first.box2d, image_size) => agreed.box2d.union(&first.box2d),
            Some(share) => {
                let side = |refined: f64, detected: f64| refined + share * (detected - refined);
                let (x1, x2) = (side(agreed.box2d.x1, first.box2d.x1), side(agreed.box2d.x2, first.box2d.x2));
                Box2d { x1, x2, ..agreed.box2d }
            }
            None => agreed.box2d,
        };
        Detection { class, score, box2d, ..agreed }
    }

    /// How likely it is that what the detector takes for `first` and the refiner for `second` is there; unfitted, the
    /// detector's score.
    fn score(&self, first: &ObjectClass, second: &ObjectClass, evidence: &Evidence) -> f64 {
        let renamed = (first != second).then(|| self.renamed_scores.probability(second, evidence)).flatten();
        renamed.or_else(|| self.scores.probability(first, evidence)).unwrap_or(evidence.score)
    }

    /// What speaks for `first` once it was refined.
    pub fn evidence(
        &self,
        first: &Detection,
        second: &Refinement,
        camera: &Camera,
        image_size: [usize; 2],
    ) -> Evidence {
        evidence(first, second, self.placed(first, second, camera, image_size).as_ref())
    }

    /// The depth of `first` by both stages.
    pub fn depth(&self, first: &Detection, second: MeasuredDepth) -> MeasuredDepth {
        let MeasuredDepth { depth_m, log_sigma } = self.depths.joint(MeasuredDepth::of(first), second);
        let factor = if is_scaled(&first.class) { 1.0 } else { self.people_error_factor };
        MeasuredDepth { depth_m, log_sigma: factor * log_sigma }
    }

    /// `first` where the refiner has it, at the depth of both; none when that is not in front of the camera.
    fn placed(
        &self,
        first: &Detection,
        second: &Refinement,
        camera: &Camera,
        image_size: [usize; 2],
    ) -> Option<Detection> {
        let MeasuredDepth { depth_m, log_sigma } = self.depth(first, second.depth());
        let box3d = second.box3d.scaled(depth_m / second.box3d.depth_m());
        let [width, height] = image_size.map(|side| side as f64);
        let box2d = box3d.projected(camera)?.clamped(width, height);
        Some(Detection { box2d, box3d, range_sigma_m: Some(log_sigma * depth_m), ..first.clone() })
    }
}

/// Whether the edge of an image of this size (width, height) may cut what a detector found in `box2d`.
fn is_cut(box2d: &Box2d, image_size: [usize; 2]) -> bool {
    let [width, height] = image_size.map(|side| side as f64);
    let [x, y] = [BORDER * width, BORDER * height];
    let Box2d { x1, y1, x2, y2 } = *box2d;
    Box2d::new(x1 - x, y1 - y, x2 + x, y2 + y).reaches_border(width, height)
}

/// What speaks for `first`, which the refiner places so, or nowhere.
fn evidence(first: &Detection, second: &Refinement, placed: Option<&Detection>) -> Evidence {
    let (least, most) = SCORE_LIMITS;
    Evidence {
        score: first.score.clamp(least, most),
        kind: kind_of(&first.class).map_or(0.0, |kind| log_odds(&second.kinds, kind)),
        overlap: placed.map_or(0.0, |placed| iou_2d(&placed.box2d, &first.box2d)),
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::SQRT_2;

    use super::super::tests::{camera, car};
    use super::super::{FusedScoreExample, KINDS, NOTHING};
    use super::*;
    use farsight_core::Box3d;

    const IMAGE: [usize; 2] = [1242, 375];

    fn detection(box3d: Box3d, range_sigma_m: Option<f64>) -> Detection {
        let box2d = box3d.projected(&camera()).expect("in front").clamped(1242.0, 375.0);
        Detection { class: ObjectClass::Car, score: 0.7, box2d, box3d, range_sigma_m }
    }

    fn refinement(location: [f64; 3], yaw: f64, depth_sigma: f64) -> Refinement {
        Refinement { box3d: car(location, yaw), depth_sigma, kinds: [0.0; KINDS] }
    }

    #[test]
    fn a_fused_box_looks_like_the_second_at_the_depth_of_both() {
        let first = detection(car([2.0, 1.6, 20.0], 0.4), Some(1.0));
        let second = refinement([2.2, 1.65, 22.0], 0.5, 0.05);
        let depths = DepthFusion { correlation: 0.0, ..DepthFusion::default() };
        let fusion = StageFusion { depths, ..StageFusion::default() };
        let fused = fusion.fused(&first, Some(&second), &camera(), IMAGE);
        let depth_m = fused.box3d.depth_m();
        assert!((depth_m - (20.0_f64 * 22.0).sqrt()).abs() < 1e-9, "as sure as each other: {depth_m}");
        assert!((fused.box3d.dimensions.height - 1.5 * depth_m / 22.0).abs() < 1e-9);
        assert!((fused.box3d.yaw - 0.5).abs() < 1e-12);
        let sigma_m = fused.range_sigma_m.expect("both have one");
        assert!((sigma_m - 0.05 / SQRT_2 * depth_m).abs() < 1e-9, "{sigma_m}");
        // Without an error bar the detector has no say.
        let unsure = detection(first.box3d, None);
        let alone = fusion.fused(&unsure, Some(&second), &camera(), IMAGE);
        assert!((alone.box3d.depth_m() - 22.0).abs() < 1e-9);
    }

    #[test]
    fn sides_in_the_image_are_means_and_what_the_image_cuts_has_a_box_around_both() {
        let second = refinement([-14.0, 1.6, 20.0], 0.4, 0.05);
        let projected = second.box3d.projected(&camera()).expect("in front");
        let fused = |class: ObjectClass, box2d: Box2d| {
            let first = Detection { class, box2d, ..detection(second.box3d, None) };
            let fusion = StageFusion { side_share: Some(0.3), ..StageFusion::default() };
            fusion.fused(&first, Some(&second), &camera(), IMAGE).box2d
        };
        let beside = Box2d::new(projected.x1 - 10.0, projected.y1 + 4.0, projected.x2 + 5.0, projected.y2 - 1.0);
        let is_near = |found: Box2d, expected: Box2d| {
            let edges = |b: Box2d| [b.x1, b.y1, b.x2, b.y2];
            edges(found).into_iter().zip(edges(expected)).all(|(found, expected)| (found - expected).abs() < 1e-9)
        };
        let mean = Box2d { x1: projected.x1 - 3.0, x2: projected.x2 + 1.5, ..projected };
        assert!(is_near(fused(ObjectClass::Car, beside), mean));
        assert!(is_near(fused(ObjectClass::Pedestrian, beside), projected));
        // A hundredth of the width from the left edge.
        let cut = Box2d { x1: 12.0, ..beside };
        assert!(is_near(fused(ObjectClass::Car, cut), projected.union(&cut)));
        assert!(is_near(fused(ObjectClass::Pedestrian, cut), projected));
        assert!(fused(ObjectClass::Car, Box2d { x1: 13.0, ..beside }).x1 > 13.0);
        assert!(!StageFusion { side_share: Some(-0.1), ..StageFusion::default() }.is_usable());
    }

    #[test]
    fn error_bars_of_people_have_a_factor_of_their_own() {
        let car = detection(car([2.0, 1.6, 20.0], 0.4), Some(1.0));
        let cyclist = Detection { class: ObjectClass::Cyclist, ..car.clone() };
        let second = MeasuredDepth { depth_m: 22.0, log_sigma: 0.05 };
        let fusion = StageFusion { people_error_factor: 1.5, ..StageFusion::default() };
        let [plain, wider] = [&car, &cyclist].map(|first| fusion.depth(first, second));
        assert_eq!(plain, StageFusion::default().depth(&car, second));
        assert!(
            (wider.log_sigma - 1.5 * plain.log_sigma).abs() < 1e-12
                && wider.depth_m.to_bits() == plain.depth_m.to_bits()
        );
        assert!(!StageFusion { people_error_factor: f64::NAN, ..fusion }.is_usable());
    }

    #[test]
    fn a_refinement_of_something_else_moves_nothing() {
        let first = detection(car([2.0, 1.6, 20.0], 0.4), Some(1.0));
        for location in [[7.0, 1.6, 20.0], [2.0, 1.6, -20.0]] {
            let second = refinement(location, 0.4, 0.01);
            assert_eq!(StageFusion::default().fused(&first, Some(&second), &camera(), IMAGE), first);
        }
        assert_eq!(StageFusion::default().fused(&first, None, &camera(), IMAGE), first);
    }

    #[test]
    fn what_the_refiner_renames_is_scored_by_its_new_class_where_that_was_fitted() {
        let [car, van, truck] = [ObjectClass::Car, ObjectClass::Van, ObjectClass::Truck];
        let examples = |class: &ObjectClass, right: u32| -> Vec<FusedScoreExample> {
            let evidence = |i: u32| Evidence { score: 0.3 + 0.001 * f64::from(i), kind: 1.0, overlap: 0.8 };
            let example =
                |i| FusedScoreExample { class: class.clone(), evidence: evidence(i), is_right: i % 10 < right };
            (0..200).map(example).collect()
        };
        let scores = FusedScores::fit(&examples(&car, 3), &[car.clone(), van, truck.clone()]).expect("enough");
        let renamed_scores = FusedScores::fit_where_enough(&examples(&truck, 7));
        let fusion = StageFusion { scores, renamed_scores, ..StageFusion::default() };
        let first = detection(self::car([2.0, 1.6, 20.0], 0.4), Some(1.0));
        let score = |class: &ObjectClass| {
            let kind = kind_of(class).expect("a kind");
            let kinds = std::array::from_fn(|other| if other == kind { 1.0 } else { 0.0 });
            let second = Refinement { kinds, ..refinement([2.0, 1.6, 20.0], 0.4, 0.05) };
            fusion.fused(&first, Some(&second), &camera(), IMAGE).score
        };
        let [as_car, as_van, as_truck] = [ObjectClass::Car, ObjectClass::Van, truck].map(|class| score(&class));
        assert!(as_truck > as_car + 0.2, "{as_truck} and {as_car}");
        assert!((as_van - as_car).abs() < 1e-12, "no van was renamed when it was fitted");
        let bad = r#"{"Truck": {"score": 1e9, "kind": 0.0, "overlap": 0.0, "bias": 0.0}}"#;
        let bad: FusedScores = serde_json::from_str(bad).expect("numbers");
        assert!(!StageFusion { renamed_scores: bad, ..fusion }.is_usable());
    }

    #[test]
    fn a_score_falls_where_the_refiner_sees_nothing_or_something_else() {
        let first = detection(car([2.0, 1.6, 20.0], 0.4), Some(1.0));
        let right_of = |kind: f64, overlap: f64| kind > 0.0 && overlap > 0.5;
        let examples: Vec<FusedScoreExample> = (0..400)
            .map(|i| {
                let (kind, overlap) = (f64::from(i % 20) - 9.5, f64::from(i / 20) / 20.0);
                let evidence = Evidence { score: 0.5, kind, overlap };
                FusedScoreExample { class: ObjectClass::Car, evidence, is_right: right_of(kind, overlap) }
            })
            .collect();
        let scores = FusedScores::fit(&examples, &[ObjectClass::Car]).expect("enough examples");
        let fusion = StageFusion { scores, ..StageFusion::default() };
        let score = |second: &Refinement| fusion.fused(&first, Some(second), &camera(), IMAGE).score;
        let seen_as = |kind: usize, second: Refinement| {
            let kinds = std::array::from_fn(|other| if other == kind { 5.0 } else { 0.0 });
            Refinement { kinds, ..second }
        };
        let here = refinement([2.0, 1.6, 20.0], 0.4, 0.05);
        let elsewhere = refinement([7.0, 1.6, 20.0], 0.4, 0.05);
        let car = kind_of(&first.class).expect("a kind");
        let [agreed, nothing, moved] =
            [seen_as(car, here), seen_as(NOTHING, here), seen_as(car, elsewhere)].map(|second| score(&second));
        assert!(agreed > first.score, "{agreed}");
        assert!(nothing < first.score && moved < first.score, "{nothing}, {moved}");
    }
}
