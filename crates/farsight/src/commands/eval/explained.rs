//! `farsight eval --explain`: the outcome of everything in one frame.

use anyhow::{Result, bail};
use farsight_core::{Detection, Label};
use farsight_eval::ap::OverlapSet;
use farsight_eval::explain::{ExplainOptions, Explanation, explain};
use farsight_eval::{EvaluatedClass, Frame, FrameFiles};

use super::{EvalArgs, Outcome, tell};
use crate::printer::Printer;

/// Explains the frame `id`.
pub(super) fn run(args: &EvalArgs, files: &FrameFiles, id: &str, printer: &mut Printer) -> Result<Outcome> {
    let ids = files.ids();
    if !ids.iter().any(|known| known == id) {
        bail!("frame {id} is not evaluated; expected one of {} ... {}", ids[0], ids[ids.len() - 1]);
    }
    let (frame, findings) = files.read(id)?;
    if tell(&findings, args, printer) == Outcome::Told {
        return Ok(Outcome::Told);
    }
    let overlaps = if args.loose { OverlapSet::Loose } else { OverlapSet::Strict };
    let options = ExplainOptions { metric: args.metric.metric(), overlaps, min_score: args.min_score };
    printer.line(&view_line(id, &options));
    for line in explanation_lines(&frame, &explain(&frame, &options)) {
        printer.line(&line);
    }
    Ok(Outcome::Done)
}

fn view_line(id: &str, options: &ExplainOptions) -> String {
    let limits =
        EvaluatedClass::ALL.map(|class| format!("{class} {}", options.overlaps.min_overlap(class, options.metric)));
    let scores = options.min_score.map_or("all scores".to_owned(), |score| format!("scores from {score}"));
    format!("frame {id}: {} overlap above {}; {scores}", options.metric.name(), limits.join(", "))
}

fn explanation_lines(frame: &Frame, explanation: &Explanation) -> Vec<String> {
    let row = |name: &str, what: &str, outcomes: [String; 3]| {
        let [easy, moderate, hard] = outcomes;
        format!("{name:<5}{what:<36}{easy:<32}{moderate:<32}{hard}").trim_end().to_owned()
    };
    let heading = |what: &str| row("", what, ["easy", "moderate", "hard"].map(str::to_owned));
    let mut lines = vec![heading("ground truth")];
    for (i, (label, outcomes)) in frame.labels.iter().zip(&explanation.objects).enumerate() {
        let Label { class, box2d, box3d, .. } = label;
        let what = format!("{class} {:.1} px, z {:.1} m", box2d.height(), box3d.depth_m());
        lines.push(row(&format!("g{i}"), &what, outcomes.map(|outcome| outcome.to_string())));
    }
    lines.push(heading("detections"));
    for (i, (prediction, outcomes)) in frame.predictions.iter().zip(&explanation.predictions).enumerate() {
        let Detection { class, score, box2d, box3d, .. } = &prediction.detection;
        let what = format!("{class} {score:.3}, {:.1} px, z {:.1} m", box2d.height(), box3d.depth_m());
        lines.push(row(&format!("d{i}"), &what, outcomes.map(|outcome| outcome.to_string())));
    }
    lines
}
