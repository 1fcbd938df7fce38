//! Counts and times, in the text format of Prometheus (0.0.4).

use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Upper ends of the bins of times, seconds.
const BINS_S: [f64; 10] = [0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0];

/// What has happened since the service began.
#[derive(Default)]
pub(super) struct Metrics {
    counts: Mutex<Counts>,
}

#[derive(Default)]
struct Counts {
    /// By status and reason.
    requests: BTreeMap<(u16, &'static str), u64>,
    /// From the head of a request to its answer.
    answered: Times,
    /// Of the work alone.
    worked: Times,
}

#[derive(Default)]
struct Times {
    bins: [u64; BINS_S.len()],
    count: u64,
    sum_s: f64,
}

impl Times {
    fn add(&mut self, time: Duration) {
        let time_s = time.as_secs_f64();
        for (bin, end_s) in self.bins.iter_mut().zip(BINS_S) {
            *bin += u64::from(time_s <= end_s);
        }
        self.count += 1;
        self.sum_s += time_s;
    }

    fn write(&self, name: &str, help: &str, text: &mut String) {
        let Self { bins, count, sum_s } = self;
        let mut line = |line: String| {
            text.push_str(&line);
            text.push('\n');
        };
        line(format!("# HELP {name} {help}"));
        line(format!("# TYPE {name} histogram"));
        for (bin, end_s) in bins.iter().zip(BINS_S) {
            line(format!("{name}_bucket{{le=\"{end_s}\"}} {bin}"));
        }
        line(format!("{name}_bucket{{le=\"+Inf\"}} {count}"));
        line(format!("{name}_sum {sum_s}"));
        line(format!("{name}_count {count}"));
    }
}

impl Metrics {
    fn counts(&self) -> MutexGuard<'_, Counts> {
        self.counts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// An image that was asked about, with the status of its response.
    pub(super) fn answered(&self, status: u16, reason: &'static str, time: Duration) {
        let mut counts = self.counts();
        *counts.requests.entry((status, reason)).or_insert(0) += 1;
        counts.answered.add(time);
    }

    /// An image that was looked at.
    pub(super) fn worked(&self, time: Duration) {
        self.counts().worked.add(time);
    }

    /// Mean time of the work, seconds; zero before there was some.
    pub(super) fn mean_work_s(&self) -> f64 {
        let Times { count, sum_s, .. } = self.counts().worked;
        if count == 0 { 0.0 } else { sum_s / count as f64 }
    }

    /// The page of metrics.
    pub(super) fn text(&self, inside: usize) -> String {
        let counts = self.counts();
        let mut text = String::new();
        text.push_str("# HELP farsight_requests_total Images that were asked about, by status and reason.\n");
        text.push_str("# TYPE farsight_requests_total counter\n");
        for ((status, reason), count) in &counts.requests {
            let labels = format!("status=\"{status}\",reason=\"{reason}\"");
            // Writing to a string cannot fail.
            let _ = writeln!(text, "farsight_requests_total{{{labels}}} {count}");
        }
        text.push_str("# HELP farsight_requests_inside Images that wait or are looked at.\n");
        text.push_str("# TYPE farsight_requests_inside gauge\n");
        let _ = writeln!(text, "farsight_requests_inside {inside}");
        let help = "From the head of a request to its answer.";
        counts.answered.write("farsight_request_seconds", help, &mut text);
        counts.worked.write("farsight_work_seconds", "Decoding and looking.", &mut text);
        text
    }
}
