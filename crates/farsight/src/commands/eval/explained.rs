//! `farsight eval --explain`: the fate of everything in one frame.

use anyhow::{Result, bail};
use farsight_core::{Detection, Label};
use farsight_eval::ap::OverlapSet;
use farsight_eval::explain::{Explanation, View, explain};
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
    let view = View { metric: args.metric.metric(), overlaps, min_score: args.min_score };
    printer.line(&view_line(id, &view));
    for line in explanation_lines(&frame, &explain(&frame, &view)) {
        printer.line(&line);
    }
    Ok(Outcome::Done)
}

fn view_line(id: &str, view: &View) -> String {
    let limits = EvaluatedClass::ALL.map(|class| format!("{class} {}", view.overlaps.min_overlap(class, view.metric)));
    let scores = view.min_score.map_or("all scores".to_owned(), |score| format!("scores from {score}"));
    format!("frame {id}: {} overlap above {}; {scores}", view.metric.name(), limits.join(", "))
}

fn explanation_lines(frame: &Frame, explanation: &Explanation) -> Vec<String> {
    let row = |name: &str, what: &str, fates: [String; 3]| {
        let [easy, moderate, hard] = fates;
        format!("{name:<5}{what:<36}{easy:<32}{moderate:<32}{hard}").trim_end().to_owned()
    };
    let heading = |what: &str| row("", what, ["easy", "moderate", "hard"].map(str::to_owned));
    let mut lines = vec![heading("ground truth")];
    for (i, (label, fates)) in frame.labels.iter().zip(&explanation.objects).enumerate() {
        let Label { class, box2d, box3d, .. } = label;
        let what = format!("{class} {:.1} px, z {:.1} m", box2d.height(), box3d.depth_m());
        lines.push(row(&format!("g{i}"), &what, fates.map(|fate| fate.to_string())));
    }
    lines.push(heading("detections"));
    for (i, (claim, fates)) in frame.claims.iter().zip(&explanation.claims).enumerate() {
        let Detection { class, score, box2d, box3d, .. } = &claim.detection;
        let what = format!("{class} {score:.3}, {:.1} px, z {:.1} m", box2d.height(), box3d.depth_m());
        lines.push(row(&format!("d{i}"), &what, fates.map(|fate| fate.to_string())));
    }
    lines
}
