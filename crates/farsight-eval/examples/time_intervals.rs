//! Times the intervals of AP of a result set: `time_intervals LABELS RESULTS [SPLIT]`, seconds a metric for 1,000
//! resamples, by class; a metric has three difficulties and two overlaps.
#![allow(clippy::print_stdout)] // An example is its own command line.

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use farsight_data::kitti::read_split;
use farsight_eval::ap::{CurveSpec, Metric, OverlapSet};
use farsight_eval::ranging::RangingOptions;
use farsight_eval::{Bootstrap, Difficulty, EvaluatedClass, FrameFiles};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<_> = std::env::args().skip(1).collect();
    let [labels, results, split @ ..] = arguments.as_slice() else {
        return Err("usage: time_intervals LABELS RESULTS [SPLIT]".into());
    };
    let ids = split.first().map(|split| read_split(Path::new(split))).transpose()?;
    let options = RangingOptions { bootstrap: None, ..RangingOptions::default() };
    let (evaluation, _) = FrameFiles::open(Path::new(labels), Path::new(results), ids)?.evaluate(&options)?;
    for class in EvaluatedClass::ALL {
        for metric in Metric::ALL {
            for overlaps in OverlapSet::ALL {
                let curves = Difficulty::ALL.map(|level| CurveSpec::new(overlaps, metric, class, level));
                let start = Instant::now();
                let intervals = evaluation.ap_intervals(&curves, &Bootstrap::default());
                let seconds = start.elapsed().as_secs_f64();
                let moderate = intervals[1].map(|interval| interval.r40);
                println!("{class} {} {overlaps:?}: {seconds:.3} s, moderate {moderate:?}", metric.name());
            }
        }
    }
    Ok(())
}
