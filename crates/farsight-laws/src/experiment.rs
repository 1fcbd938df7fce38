//! The law of plans of experiments.

// They are the program's, not the library's.
#[path = "../../farsight/src/experiment/metrics.rs"]
#[allow(dead_code, reason = "the program uses the rest")]
mod metrics;
#[path = "../../farsight/src/experiment/plan.rs"]
#[allow(dead_code, reason = "the program uses the rest")]
pub(crate) mod plan;
#[path = "../../farsight/src/experiment/ranger_name.rs"]
#[allow(dead_code, reason = "the program uses the rest")]
mod ranger_name;
#[path = "../../farsight/src/experiment/results.rs"]
#[allow(dead_code, reason = "the program uses the rest")]
pub(crate) mod results;

use metrics::Metric;
use plan::Experiment;
use ranger_name::RangerName;

/// The plan that others of ours extend.
const EXTENDED: &str = include_str!("../../../configs/experiments/claim.toml");

/// A plan, through a file as users have it, with another beside it that it may extend: of what is accepted every cell
/// has a config, which says the same when it is printed and read again.
pub(crate) fn experiment(bytes: &[u8]) -> bool {
    let folder = tempfile::tempdir().expect("a folder for the file");
    let path = folder.path().join("input.toml");
    std::fs::write(&path, bytes).expect("a file for the bytes");
    std::fs::write(folder.path().join("claim.toml"), EXTENDED).expect("a file for the other plan");
    match Experiment::read(&path) {
        Ok(plan) => {
            drop(plan.start_files());
            let (arms, cells) = (plan.arms(), plan.cells());
            for cell in &cells {
                assert!(arms.contains(&cell.arm), "{cell:?} is of no arm");
                assert!(!cell.name().contains(['/', '.']), "{cell:?} is no name of a folder");
            }
            for arm in &arms {
                let Some(cell) = cells.iter().find(|cell| cell.arm == *arm) else { continue };
                let text = toml::to_string(&plan.config(cell)).expect("a table");
                let again: toml::Table = toml::from_str(&text).expect("what was printed");
                assert_eq!(toml::to_string(&again).expect("what was printed once"), text);
            }
        }
        Err(error) => {
            assert!(format!("{error:#}").contains("input.toml"), "no file in: {error:#}");
            return false;
        }
    }
    true
}
