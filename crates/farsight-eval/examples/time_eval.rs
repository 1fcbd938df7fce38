//! Times the evaluation of a result set: `time_eval LABELS RESULTS [REPEATS]`, seconds, reading included, without
//! intervals.
#![allow(clippy::print_stdout)] // An example is its own command line.

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use farsight_eval::FrameFiles;
use farsight_eval::ranging::RangingOptions;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<_> = std::env::args().skip(1).collect();
    let [labels, results, repeats @ ..] = arguments.as_slice() else {
        return Err("usage: time_eval LABELS RESULTS [REPEATS]".into());
    };
    let repeats: usize = repeats.first().map_or(Ok(3), |word| word.parse())?;
    let options = RangingOptions { bootstrap: None, ..RangingOptions::default() };
    for _ in 0..repeats {
        let start = Instant::now();
        let files = FrameFiles::open(Path::new(labels), Path::new(results), None)?;
        let (evaluation, _) = files.evaluate(&options)?;
        let read = start.elapsed();
        let report = evaluation.report();
        let ap = report.ap.ap(
            farsight_eval::ap::OverlapSet::Strict,
            farsight_eval::ap::Metric::Box3d,
            farsight_eval::EvaluatedClass::Car,
        );
        let all = start.elapsed();
        println!(
            "{} frames: {:.3} s (reading and overlaps {:.3} s); car 3d {ap:?}",
            report.frames,
            all.as_secs_f64(),
            read.as_secs_f64()
        );
    }
    Ok(())
}
