//! Frames in, report out.

use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

use crate::Frame;
use crate::ap::{ApAccumulator, ApIntervals, ApReport, CurveOutcomes, CurveSpec, OverlapSet};
use crate::bootstrap::{Bootstrap, Interval};
use crate::ranging::{FalseAlarm, OperatingPoints, RangingOptions, RangingReport, Target, match_frame};

/// An evaluation under way: hand in frames one by one, then ask for the [`Report`].
///
/// A frame is reduced at once and need not be kept. Two evaluations join into one, so frames can be evaluated on many
/// threads: the report depends on the order of the frames only. It holds about 6 kB a frame of 7 objects and 53
/// detections (docs/evaluation.md has the measurement).
///
/// ```
/// use farsight_eval::{Evaluation, Frame, ranging::RangingOptions};
/// # let validation_frames: Vec<Frame> = vec![];
/// let mut evaluation = Evaluation::new(RangingOptions { bootstrap: None, ..RangingOptions::default() });
/// for frame in &validation_frames {
///     evaluation.add(frame);
/// }
/// let report = evaluation.report();
/// ```
#[derive(Debug, Clone, Default)]
pub struct Evaluation {
    options: RangingOptions,
    frames: usize,
    ap: ApAccumulator,
    targets: Vec<Target>,
    false_alarms: Vec<FalseAlarm>,
}

/// What an evaluation finds; in JSON as the command line promises it.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Average precision, all curves.
    pub ap: ApReport,
    /// Errors of distance.
    pub ranging: RangingReport,
    /// What is found and what is made up, by the lowest score that takes part.
    pub operating: OperatingPoints,
    /// How many frames were evaluated.
    pub frames: usize,
}

impl Evaluation {
    /// An evaluation without frames.
    pub fn new(options: RangingOptions) -> Self {
        Self { options, ..Self::default() }
    }

    /// Evaluates one more frame.
    pub fn add(&mut self, frame: &Frame) {
        self.ap.append(ApAccumulator::of_frame(frame));
        let (targets, false_alarms) = match_frame(frame, self.frames as u32, &self.options);
        self.targets.extend(targets);
        self.false_alarms.extend(false_alarms);
        self.frames += 1;
    }

    /// Adds the frames of `later` after those that are here.
    pub fn append(&mut self, later: Self) {
        let first = self.frames as u32;
        self.targets.extend(later.targets.into_iter().map(|target| Target { frame: first + target.frame, ..target }));
        let alarms = later.false_alarms.into_iter();
        self.false_alarms.extend(alarms.map(|alarm| FalseAlarm { frame: first + alarm.frame, ..alarm }));
        self.ap.append(later.ap);
        self.frames += later.frames;
    }

    /// How many frames there are.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Every object of an evaluated class, with how it was ranged.
    pub fn targets(&self) -> &[Target] {
        &self.targets
    }

    /// Every detection that is none of anything.
    pub(crate) fn false_alarms(&self) -> &[FalseAlarm] {
        &self.false_alarms
    }

    /// The outcomes of these curves, in their order; `None` where the devkit would not evaluate one.
    pub fn curve_outcomes(&self, curves: &[CurveSpec]) -> Vec<Option<CurveOutcomes>> {
        self.ap.outcomes(curves)
    }

    /// 95% intervals over frames of the AP of these curves, in their order; `None` where the devkit would not evaluate
    /// one.
    pub fn ap_intervals(
        &self,
        curves: &[CurveSpec],
        bootstrap: &Bootstrap,
    ) -> Vec<Option<ApIntervals<Option<Interval>>>> {
        CurveOutcomes::intervals(&self.ap.outcomes(curves), self.frames, bootstrap)
    }

    /// Whether everything that figures are made of is the same, but for the targets.
    pub(crate) fn says_the_same_as(&self, others: &Self) -> bool {
        self.ap == others.ap && self.false_alarms == others.false_alarms
    }

    /// The report on the frames so far.
    pub fn report(&self) -> Report {
        Report {
            ap: self.ap.report(self.options.bootstrap.as_ref()),
            ranging: RangingReport::new(&self.targets, self.frames, &self.options),
            operating: OperatingPoints::new(&self.targets, &self.false_alarms, self.frames),
            frames: self.frames,
        }
    }
}

impl Serialize for Report {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(5))?;
        map.serialize_entry("ap", &self.ap.table(OverlapSet::Strict))?;
        map.serialize_entry("ap_loose", &self.ap.table(OverlapSet::Loose))?;
        map.serialize_entry("ranging", &self.ranging)?;
        map.serialize_entry("operating", &self.operating)?;
        map.serialize_entry("frames", &self.frames)?;
        map.end()
    }
}
