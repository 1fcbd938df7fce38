//! `farsight export` of a refiner: how it and the shipped detector go together, fitted on labelled frames.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use farsight::ModelSource;
use farsight::detector::open_detector;
use farsight::second_stage::refiner;
use farsight_core::depth_fusion::DepthPair;
use farsight_core::detection::DecodeOptions;
use farsight_core::scale::is_scaled;
use farsight_core::score::{MIN_EXAMPLES, MIN_PEAK};
use farsight_core::{Camera, DepthFusion, Detection, Label, MeasuredDepth, ObjectClass, Region, ScalePrior};
use farsight_data::kitti::read_split;
use farsight_data::{Dataset, open_labelled};
use farsight_eval::Frame;
use farsight_eval::ranging::Target;
use farsight_methods::Detector;
use farsight_methods::refiner::Refiner;
use farsight_methods::refiner::RefinerModel;
use farsight_methods::refiner::geometry::{FusedScoreExample, FusedScores, Refinement, StageFusion};

use super::fit::{detected, fitted_depths, is_plain, told};
use super::{ExportArgs, Outcome};
use crate::printer::{Printer, progress_bar};

/// How much of the sides of a vehicle's box in the image is the detector's: by least squares on 400 rendered scenes
/// with farsight-w, where sides err by 0.116 of a box's size after the refiner and by 0.142 before it. Of top and
/// bottom, which err by 0.05 and 0.085, it would be less than 0.15; the height of a box that is the refiner's alone is
/// steadier from frame to frame.
const SIDE_SHARE: f64 = 0.3;

/// Fits the refiner to `data` and writes it.
pub(super) fn run(mut model: RefinerModel, args: &ExportArgs, data: &Path, printer: &mut Printer) -> Result<Outcome> {
    if let Some(path) = &args.average_with {
        let mean = model.weights.mean_with(&RefinerModel::read(path)?.weights);
        let of_another = || format!("{}: the weights of another network than {}", path.display(), args.model.display());
        model.weights = mean.with_context(of_another)?;
    }
    let engine = args.int8.engine.options()?;
    let mut detector = open_detector(&ModelSource::from_word(&args.detector), &engine)?;
    ensure!(
        detector.has_error_bars(),
        "the detector has no error bars; expected a model after `farsight export --fit-on`"
    );
    let is_second_alone = !detector.measures_distances();
    // Where an object is looked at again follows from these.
    model.config.fusion.depths.is_second_alone = is_second_alone;
    model.config.fusion.side_share = Some(SIDE_SHARE);
    let mut refiner = refiner(&model, &engine)?;
    let seen = two_stage_frames(&mut *detector, &mut refiner, data)?;
    let classes: Vec<ObjectClass> = detector.classes().iter().map(|class| class.class.clone()).collect();
    let pairs: Vec<Vec<ClassifiedPair>> = seen.iter().map(TwoStageFrame::depth_pairs).collect();
    let flat: Vec<DepthPair> = pairs.iter().flatten().map(|classified| classified.pair).collect();
    let depths =
        fitted_depths(&flat, "refiner", is_second_alone, printer).with_context(|| data.display().to_string())?;
    let (depths, scales) = fitted_scales(depths, &pairs, &seen, printer);
    let people_error_factor = fitted_people(&depths, &pairs, printer);
    let side_share = model.config.fusion.side_share;
    model.config.fusion = StageFusion { depths, people_error_factor, side_share, scales, ..StageFusion::default() };
    let scores = fitted_scores(&model.config.fusion, &seen, &classes, printer);
    let (scores, renamed_scores) = scores.with_context(|| data.display().to_string())?;
    model.config.fusion = StageFusion { scores, renamed_scores, ..model.config.fusion };
    let dataset = open_labelled(data, None)?;
    let read = |index: usize| Ok((dataset.image(index)?, dataset.camera(index)?));
    let cascade = super::cascade::fitted(&model, &mut *detector, &engine, dataset.len(), printer, read)?;
    model.config.cascade = cascade.unwrap_or_default();
    model.write_half(&args.out)?;
    printer.line(&format!("{}: half-precision numbers", args.out.display()));
    Ok(Outcome::Done)
}

/// What makes the error bars of people hold two thirds of them; 1 where they are too few.
fn fitted_people(depths: &DepthFusion, pairs: &[Vec<ClassifiedPair>], printer: &mut Printer) -> f64 {
    let people = pairs.iter().flatten().filter(|classified| !classified.is_scaled);
    let people: Vec<DepthPair> = people.map(|classified| classified.pair).collect();
    let [least, most] = StageFusion::PEOPLE_ERROR_FACTORS;
    let Some(factor) = depths.missing_error_factor(&people) else { return 1.0 };
    let factor = factor.clamp(least, most);
    printer.status(&format!("error bars of people: {factor:.2} times, fitted on {} of them", people.len()));
    factor
}

/// Scores by the detector's class, and those of what the refiner renames, by the refiner's.
fn fitted_scores(
    fusion: &StageFusion,
    seen: &[TwoStageFrame],
    classes: &[ObjectClass],
    printer: &mut Printer,
) -> Result<(FusedScores, FusedScores)> {
    let examples: Vec<NamedExample> = seen.iter().flat_map(|frame| frame.score_examples(fusion)).collect();
    let renamed = examples.iter().filter(|example| example.second != example.first.class);
    let renamed: Vec<FusedScoreExample> = renamed.map(NamedExample::by_the_refiner).collect();
    let renamed_scores = FusedScores::fit_where_enough(&renamed);
    // What is renamed to a class of which there is too little counts as what the detector takes it for.
    let is_kept = |example: &&NamedExample| {
        example.second == example.first.class || !renamed_scores.classes().any(|class| *class == example.second)
    };
    let kept: Vec<FusedScoreExample> = examples.iter().filter(is_kept).map(|example| example.first.clone()).collect();
    let [right, wrong] = counts(&kept);
    let Some(scores) = FusedScores::fit(&kept, classes) else {
        bail!("{right} right and {wrong} wrong detections; expected at least {MIN_EXAMPLES} of each to fit scores on");
    };
    printer.status(&format!("scores: fitted on {right} right and {wrong} wrong detections"));
    let mut names: Vec<&ObjectClass> = renamed.iter().map(|example| &example.class).collect();
    names.sort();
    names.dedup();
    for class in names {
        let those: Vec<FusedScoreExample> = renamed.iter().filter(|example| example.class == *class).cloned().collect();
        let [right, wrong] = counts(&those);
        let fitted = if renamed_scores.classes().any(|fitted| fitted == class) { "fitted on them" } else { "too few" };
        printer.status(&format!("renamed to {class}: {right} right and {wrong} wrong detections: {fitted}"));
    }
    Ok((scores, renamed_scores))
}

/// How many of `examples` are right, and how many wrong.
fn counts(examples: &[FusedScoreExample]) -> [usize; 2] {
    let right = examples.iter().filter(|example| example.is_right).count();
    [right, examples.len() - right]
}

/// How far the vehicles of a place may be from the mean size of their region, as a standard deviation of the logarithm:
/// an old town has smaller cars than its country, and photographs are not rendered scenes. By so much are the mean
/// distances of vehicles off in photographs of Karlsruhe, California and Shenzhen (root mean square of +7, +2 and -6%).
const PLACE_SIGMA: f64 = 0.055;

/// What the distances of an image's vehicles have in common, by region, and error bars without it: where the frames are
/// those of regions.
fn fitted_scales(
    depths: DepthFusion,
    pairs: &[Vec<ClassifiedPair>],
    seen: &[TwoStageFrame],
    printer: &mut Printer,
) -> (DepthFusion, BTreeMap<Region, ScalePrior>) {
    let error = |classified: &ClassifiedPair| {
        let DepthPair { true_m, first, second } = classified.pair;
        (depths.joint(Some(first), second).depth_m / true_m).ln()
    };
    let errors_of = |region: Option<Region>| -> Vec<Vec<f64>> {
        let there =
            pairs.iter().zip(seen).filter(|(_, frame)| region.is_none_or(|region| frame.region == Some(region)));
        there.map(|(pairs, _)| pairs.iter().filter(|pair| pair.is_scaled).map(error).collect()).collect()
    };
    let is_regional = seen.iter().any(|frame| frame.region.is_some());
    let Some(world) = ScalePrior::fit(&errors_of(None)).filter(|_| is_regional) else {
        return (depths, BTreeMap::new());
    };
    let vehicles = pairs.iter().flatten().filter(|classified| classified.is_scaled);
    let vehicles: Vec<DepthPair> = vehicles.map(|classified| classified.pair).collect();
    let fitted = depths.with_shared_error(&vehicles, &vec![world.log_sigma; vehicles.len()]);
    let world = ScalePrior { factor: 1.0, ..world };
    let regional = Region::ALL.into_iter().filter(|region| *region != Region::World);
    let found = regional.filter_map(|region| Some((region, ScalePrior::fit(&errors_of(Some(region)))?)));
    let scales: BTreeMap<Region, ScalePrior> = found
        .chain([(Region::World, world)])
        .map(|(region, scale)| {
            printer.status(&format!(
                "{region}: distances of vehicles times {:.3}; an image's have an error of {:.3} in common",
                scale.factor, scale.log_sigma
            ));
            (region, scale.widened(PLACE_SIGMA))
        })
        .collect();
    printer.status(&format!(
        "error bars beside that: {:.2} times, to the power of {:.1}",
        fitted.joint_error_factor, fitted.joint_error_power
    ));
    (fitted, scales)
}

/// What both stages say of an object's depth, and whether its class is one whose sizes differ by region.
struct ClassifiedPair {
    pair: DepthPair,
    is_scaled: bool,
}

/// A detection of which is known whether it is right, by what the detector takes it for.
struct NamedExample {
    first: FusedScoreExample,
    /// What the refiner takes it for.
    second: ObjectClass,
}

impl NamedExample {
    fn by_the_refiner(&self) -> FusedScoreExample {
        FusedScoreExample { class: self.second.clone(), ..self.first.clone() }
    }
}

/// A frame with the answers of both stages.
struct TwoStageFrame {
    region: Option<Region>,
    camera: Camera,
    image_size: [usize; 2],
    labels: Vec<Label>,
    first: Vec<Detection>,
    second: Vec<Option<Refinement>>,
}

impl TwoStageFrame {
    /// What both stages say of the Moderate objects that the first one finds, whatever it takes them for.
    fn depth_pairs(&self) -> Vec<ClassifiedPair> {
        let example = |(place, target): (usize, Option<Target>)| {
            let target = target.filter(is_plain)?;
            let first = MeasuredDepth::of(&self.first[place])?;
            let pair = DepthPair { true_m: target.depth_m, first, second: self.second[place].as_ref()?.depth() };
            Some(ClassifiedPair { pair, is_scaled: is_scaled(&self.first[place].class) })
        };
        let fusion = StageFusion::default();
        let named = |(first, second): (&Detection, &Option<Refinement>)| {
            let class = fusion.fused(first, second.as_ref(), &self.camera, self.image_size).class;
            Detection { class, ..first.clone() }
        };
        let named: Vec<Detection> = self.first.iter().zip(&self.second).map(named).collect();
        told(&self.judged_by(&named)).filter_map(example).collect()
    }

    /// What speaks for each detection after both stages, and whether it is right where they place it: what the refiner
    /// renames, whether any vehicle is there, as car, van and truck are easily taken for one another.
    fn score_examples(&self, fusion: &StageFusion) -> Vec<NamedExample> {
        let both = self.first.iter().zip(&self.second);
        let joined: Vec<Detection> =
            both.map(|(first, second)| fusion.fused(first, second.as_ref(), &self.camera, self.image_size)).collect();
        let example = |(place, target): (usize, Option<Target>)| {
            let (first, second) = (&self.first[place], self.second[place].as_ref()?);
            let evidence = fusion.evidence(first, second, &self.camera, self.image_size);
            let first = FusedScoreExample { class: first.class.clone(), evidence, is_right: target.is_some() };
            Some(NamedExample { first, second: joined[place].class.clone() })
        };
        let is_renamed = |place: usize| joined[place].class != self.first[place].class;
        let frame = self.judged_by(&joined);
        let kept: Vec<_> = told(&frame).filter(|(place, _)| !is_renamed(*place)).collect();
        let frame = frame.with_vehicles_as_cars();
        let renamed = told(&frame).filter(|(place, _)| is_renamed(*place));
        kept.into_iter().chain(renamed).filter_map(example).collect()
    }

    fn judged_by(&self, detections: &[Detection]) -> Frame {
        Frame::new(String::new(), self.labels.clone(), detections.to_vec())
    }
}

/// All frames of `data` as the detector and the refiner see them.
fn two_stage_frames(detector: &mut dyn Detector, refiner: &mut Refiner, data: &Path) -> Result<Vec<TwoStageFrame>> {
    let dataset = open_labelled(data, None)?;
    let options = DecodeOptions { min_score: Some(MIN_PEAK), ..DecodeOptions::default() };
    let bar = progress_bar(dataset.len());
    let regions = regions(data)?;
    let mut seen = Vec::with_capacity(dataset.len());
    for index in 0..dataset.len() {
        let mut frame = two_stage_frame(detector, &options, refiner, &*dataset, index)?;
        frame.region = regions.get(&dataset.id(index)).copied();
        seen.push(frame);
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(seen)
}

/// The regions of the frames of `data`, where its splits tell: `farsight synth --scene-config` writes one for each
/// region.
fn regions(data: &Path) -> Result<BTreeMap<String, Region>> {
    let mut regions = BTreeMap::new();
    for region in Region::ALL {
        let split = data.join("ImageSets").join(format!("{region}.txt"));
        if split.is_file() {
            regions.extend(read_split(&split)?.into_iter().map(|id| (id, region)));
        }
    }
    Ok(regions)
}

fn two_stage_frame(
    detector: &mut dyn Detector,
    options: &DecodeOptions,
    refiner: &mut Refiner,
    dataset: &dyn Dataset,
    index: usize,
) -> Result<TwoStageFrame> {
    let (camera, image) = (dataset.camera(index)?, dataset.image(index)?);
    let first = detected(detector, options, &image, &camera).with_context(|| dataset.origin(index))?;
    let second = refiner.refinements(&image, &camera, &first, 0.0)?;
    let image_size = [image.width(), image.height()].map(|side| side as usize);
    Ok(TwoStageFrame { region: None, camera, image_size, labels: dataset.labels(index)?, first, second })
}
