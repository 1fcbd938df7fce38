//! Feeds the laws with mutants of good files: `fuzz [--minutes N] [--table FILE] [TARGET...]`. The minutes are of each
//! target, and of its process's processor time, where the system tells it: a busy machine takes longer and tries as
//! much. What breaks a law, takes too long or ends the process is kept in `fuzz/artifacts/TARGET`, where the tests
//! replay it. The table says what was tried and is brought up to date every minute; runs of one version add up in it.
//!
//! Each target runs in a process of its own, so that one that ends the process (no memory, a deep recursion) ends no
//! other.

#![allow(clippy::print_stdout, reason = "a program that reports")]

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::{Duration, Instant};

use farsight_files::{MeasuredTable, today};
use farsight_laws::mutate::{Random, mutated};
use farsight_laws::{TARGETS, Target, named};

/// An input that takes longer is kept, too: of processor time, and by the clock.
const SLOW: Duration = Duration::from_secs(5);
const WAITED: Duration = Duration::from_mins(1);

/// Address space of a target, KiB: what asks for more is a finding.
const MEMORY_KIB: u64 = 6 << 20;

/// Of processor time, between two updates of the table.
const KEPT_EVERY: Duration = Duration::from_mins(1);

/// Findings of a target after which it stops.
const MAX_FINDINGS: usize = 20;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    if let ["--one", name, seconds, seed, table] = &words[..] {
        return one(name, seconds, seed, Some(*table).filter(|table| !table.is_empty()).map(Path::new));
    }
    let (mut minutes, mut table, mut names) = (1.0, "", &words[..]);
    loop {
        match names {
            ["--minutes", value, rest @ ..] => (minutes, names) = (value.parse().unwrap_or(1.0), rest),
            ["--table", value, rest @ ..] => (table, names) = (value, rest),
            _ => break,
        }
    }
    if let Some(unknown) = names.iter().find(|name| named(name).is_none()) {
        let known: Vec<&str> = TARGETS.iter().map(|target| target.name).collect();
        println!("no target {unknown}; expected some of {}", known.join(", "));
        return ExitCode::FAILURE;
    }
    let mut broken = false;
    for target in TARGETS.iter().filter(|target| names.is_empty() || names.contains(&target.name)) {
        broken |= !process(target, minutes * 60.0, table);
    }
    if broken { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}

/// Whether a target ran to its end in a process of its own, and broke nothing.
fn process(target: &Target, seconds: f64, table: &str) -> bool {
    let Ok(program) = std::env::current_exe() else { return false };
    let seed = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).map_or(0, |now| now.as_secs());
    let mut command = if cfg!(unix) {
        let mut shell = Command::new("sh");
        shell.arg("-c").arg(format!("ulimit -v {MEMORY_KIB}; exec \"$0\" \"$@\"")).arg(program);
        shell
    } else {
        Command::new(program)
    };
    command.env("TMPDIR", scratch());
    command.args(["--one", target.name, &seconds.to_string(), &seed.to_string(), table]);
    let status = command.status();
    if status.as_ref().is_ok_and(|status| status.code().is_some_and(|code| code <= 1)) {
        return status.is_ok_and(|status| status.success());
    }
    // It was ended: the input that it had then is the finding.
    let kept = kept(target.name, &fs::read(current(target.name)).unwrap_or_default());
    println!("{}: the process ended ({status:?}); {}", target.name, kept.display());
    false
}

fn folder(kind: &str, name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz").join(kind).join(name)
}

/// Where the input lies that a target has now.
fn current(name: &str) -> PathBuf {
    scratch().join(format!("farsight-fuzz-{name}"))
}

/// Where files are written for a moment: in memory where the system has a place for that, as a disk would be most of
/// the work.
fn scratch() -> PathBuf {
    let in_memory = PathBuf::from("/dev/shm");
    let is_told = std::env::var_os("TMPDIR").is_some();
    if !is_told && in_memory.is_dir() { in_memory } else { std::env::temp_dir() }
}

/// Keeps an input for the tests.
fn kept(name: &str, bytes: &[u8]) -> PathBuf {
    let hash = bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3));
    let path = folder("artifacts", name).join(format!("{hash:016x}"));
    let written = fs::create_dir_all(folder("artifacts", name)).and_then(|()| fs::write(&path, bytes));
    if let Err(error) = written {
        println!("{}: cannot be written: {error}", path.display());
    }
    path
}

/// Feeds one target for so long, and tells it in the table.
fn one(name: &str, seconds: &str, seed: &str, table: Option<&Path>) -> ExitCode {
    let (Some(target), Ok(seconds), Ok(seed)) = (named(name), seconds.parse(), seed.parse()) else {
        println!("no target {name}");
        return ExitCode::FAILURE;
    };
    let (start, first, end) = (Instant::now(), processor_time(), Duration::from_secs_f64(seconds));
    let spent = || match (first, processor_time()) {
        (Some(first), Some(now)) => now.saturating_sub(first),
        _ => start.elapsed(),
    };
    let mut paths: Vec<PathBuf> = fs::read_dir(folder("corpus", name))
        .into_iter()
        .flatten()
        .filter_map(|entry| Some(entry.ok()?.path()))
        .collect();
    paths.sort();
    let mut inputs: Vec<Vec<u8>> = paths.iter().filter_map(|path| fs::read(path).ok()).collect();
    inputs.extend((target.seeds)());
    set_hook(Box::new(|_| {}));
    let (mut random, mut tried, mut findings, mut slowest) = (Random::new(seed), 0_u64, 0, Duration::ZERO);
    // What the table has of this run.
    let mut written = Tried::default();
    while spent() < end && findings < MAX_FINDINGS {
        if let Some(table) = table.filter(|_| spent() >= written.spent + KEPT_EVERY) {
            let now = Tried { spent: spent(), mutants: tried, slowest, findings };
            if let Err(error) = keep(table, name, now.since(written)) {
                println!("{error}");
                return ExitCode::FAILURE;
            }
            written = now;
        }
        let input = mutated(&inputs, &mut random);
        drop(fs::write(current(name), &input));
        let (begun, before) = (Instant::now(), spent());
        let panicked = catch_unwind(AssertUnwindSafe(|| (target.law)(&input))).err();
        // The system counts in hundredths of a second; the clock knows better of what is quick.
        let (waited, worked) = (begun.elapsed(), spent().saturating_sub(before));
        let taken = if waited < SLOW { waited } else { worked };
        slowest = slowest.max(taken);
        tried += 1;
        if panicked.is_some() || taken > SLOW || waited > WAITED {
            findings += 1;
            let why = panicked.map_or_else(|| format!("took {worked:.1?} in {waited:.1?}"), |panic| told(&*panic));
            println!("{name}: {why}; {}", kept(name, &input).display());
        }
    }
    drop(fs::remove_file(current(name)));
    let (inputs, seconds, clock) = (inputs.len(), spent().as_secs(), start.elapsed().as_secs());
    println!(
        "{name:14} {tried:>9} mutants of {inputs:>3} files in {seconds:>5} s of processor time ({clock:>5} s), slowest {slowest:>8.1?}, {findings} findings"
    );
    let rest = Tried { spent: spent(), mutants: tried, slowest, findings }.since(written);
    if let Some(Err(error)) = table.map(|table| keep(table, name, rest)) {
        println!("{error}");
        return ExitCode::FAILURE;
    }
    if findings == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// What was tried of a target.
#[derive(Debug, Clone, Copy, Default)]
struct Tried {
    /// Of processor time.
    spent: Duration,
    mutants: u64,
    slowest: Duration,
    findings: usize,
}

impl Tried {
    /// What came after `earlier` of the same run.
    fn since(self, earlier: Self) -> Self {
        Self {
            spent: self.spent.saturating_sub(earlier.spent),
            mutants: self.mutants - earlier.mutants,
            slowest: self.slowest,
            findings: self.findings - earlier.findings,
        }
    }

    /// What a row of the table says; none of a row of another version.
    fn of_row(row: &[String]) -> Option<Self> {
        let [_, minutes, mutants, slowest, findings, version, _] = row else { return None };
        (version == env!("CARGO_PKG_VERSION")).then_some(())?;
        Some(Self {
            spent: Duration::try_from_secs_f64(60.0 * minutes.parse::<f64>().ok()?).ok()?,
            mutants: mutants.parse().ok()?,
            slowest: Duration::try_from_secs_f64(slowest.parse::<f64>().ok()? / 1000.0).ok()?,
            findings: findings.parse().ok()?,
        })
    }
}

/// Adds to what the table at `path`, which need not be there yet, says of a target.
fn keep(path: &Path, name: &str, more: Tried) -> Result<(), Box<dyn std::error::Error>> {
    let columns = ["target", "minutes of processor time", "mutants", "slowest, ms", "findings", "version", "date"];
    let command = "cargo xtask fuzz --minutes 30 --table docs/results/fuzz.json";
    let mut table = MeasuredTable::read_or_new(path, command, columns)?;
    let name = format!("`{name}`");
    let known = table.rows.iter().find(|row| row.first() == Some(&name)).and_then(|row| Tried::of_row(row));
    let known = known.unwrap_or_default();
    table.put([
        name,
        format!("{:.2}", (known.spent + more.spent).as_secs_f64() / 60.0),
        (known.mutants + more.mutants).to_string(),
        format!("{:.1}", 1000.0 * known.slowest.max(more.slowest).as_secs_f64()),
        (known.findings + more.findings).to_string(),
        env!("CARGO_PKG_VERSION").to_owned(),
        today(),
    ]);
    Ok(table.write(path)?)
}

/// Processor time of this process so far; none where the system does not tell.
fn processor_time() -> Option<Duration> {
    let stat = fs::read_to_string("/proc/self/stat").ok()?;
    // The name of the program may have any character in it; what follows it is numbers.
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_ascii_whitespace().collect();
    let ticks = |place: usize| fields.get(place)?.parse::<u64>().ok();
    // Time in the program and in the system, in hundredths of a second (proc(5), utime and stime).
    Some(Duration::from_millis(10 * (ticks(11)? + ticks(12)?)))
}

fn told(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
    text.unwrap_or("a panic").chars().take(300).collect()
}
