//! The load test of the service: `load [--table FILE] [--workers N] [--batch N]`; docs/service.md has its figures and
//! how to run it.
//!
//! The service runs in a process of its own, around a stand-in for the pipeline that takes 1 ms. What is measured is
//! the service: its queue, its refusals, its memory.

#![allow(clippy::print_stdout, reason = "it tells its figures")]

mod client;
mod mixed;
mod stand_in;
mod timed;

use std::error::Error;
use std::io::{BufRead, BufReader};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use farsight_files::MeasuredTable;
use timed::{Arrivals, Figures};

/// How long each phase lasts.
const PHASE: Duration = Duration::from_secs(10);

/// Requests of the mixed phase, and those before its memory is first looked at.
const MIXED: usize = 50_000;
const WARM_UP: usize = 5_000;

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    if let Some(("serve", words)) = words.split_first().map(|(first, rest)| (first.as_str(), rest)) {
        return stand_in::serve(words);
    }
    let (table_file, words) = match &words[..] {
        [option, file, rest @ ..] if option == "--table" => (Some(PathBuf::from(file)), rest),
        words => (None, words),
    };
    let service = Service::start(words)?;
    let address = service.address;
    let command = ["load".to_owned()].iter().chain(words).cloned().collect::<Vec<_>>().join(" ");
    let mut table = MeasuredTable::new(&command, ["what", "figures"]);
    let mut tell = |what: String, figures: String| {
        println!("{what}: {figures}");
        table.put([what, figures]);
    };
    let peak = timed::closed(address, 16, PHASE).goodput;
    tell("peak, 16 clients that ask again as soon as they are answered".into(), format!("{peak:.0} images/s"));
    for (name, arrivals) in [("even", Arrivals::Even), ("random", Arrivals::Random)] {
        let Figures { good_ms: [p50, p99, _], refused, .. } = timed::open(address, 0.8 * peak, arrivals, PHASE);
        let figures = format!("p50 {p50:.2} ms, p99 {p99:.2} ms: {:.1} times; {refused} refused", p99 / p50);
        tell(format!("80% of the peak, {name} arrivals"), figures);
    }
    let over = timed::open(address, 5.0 * peak, Arrivals::Even, PHASE);
    let [p50, p99, most] = over.refused_ms;
    let (goodput, share) = (over.goodput, 100.0 * over.goodput / peak);
    let figures = format!("goodput {goodput:.0} images/s, {share:.0}% of the peak; {} refused", over.refused);
    tell(format!("5 times the peak ({:.0} requests/s)", over.offered), figures);
    let in_time = 100.0 * over.refused_in_time;
    let figures = format!("p50 {p50:.2} ms, p99 {p99:.2} ms, longest {most:.1} ms; {in_time:.2}% within 10 ms");
    tell("the refusals".into(), figures);
    mixed::run(address, WARM_UP)?;
    let before = service.memory_kb()?;
    let outcomes = mixed::run(address, MIXED)?;
    let after = service.memory_kb()?;
    let growth = 100.0 * (after / before - 1.0);
    tell(format!("{MIXED} mixed requests, a fifth of them bad"), outcomes);
    let figures = format!("{:.1} MB before, {:.1} MB after ({growth:+.1}%)", before / 1024.0, after / 1024.0);
    tell("memory of the service during those".into(), figures);
    if let Some(file) = table_file {
        table.write(&file)?;
    }
    Ok(())
}

/// The service in its process.
struct Service {
    child: Child,
    address: SocketAddr,
}

impl Service {
    fn start(words: &[String]) -> Result<Self, Box<dyn Error>> {
        let mut command = Command::new(std::env::current_exe()?);
        let mut child = command.arg("serve").args(words).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let out = child.stdout.take().ok_or("the service has no output")?;
        let mut line = String::new();
        BufReader::new(out).read_line(&mut line)?;
        Ok(Self { address: line.trim().parse()?, child })
    }

    /// Memory of the process that is not swapped out, kB; of Linux.
    fn memory_kb(&self) -> Result<f64, Box<dyn Error>> {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id()))?;
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).ok_or("no VmRSS")?;
        Ok(line.trim().trim_end_matches(" kB").parse()?)
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        // It ends when nobody writes to it any more.
        drop(self.child.stdin.take());
        let _ = self.child.wait();
    }
}
