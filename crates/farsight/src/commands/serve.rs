//! `farsight serve`: the pipeline over HTTP.

use std::collections::BTreeMap;
use std::net::{SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use farsight::CameraSource;
use farsight::service::{Config, Look, Server, Token};
use farsight_files::read_text;

use super::Outcome;
use crate::pipeline_args::{self, PipelineArgs};
use crate::printer::Printer;

/// Where the token may be, instead of a file.
const TOKEN_VARIABLE: &str = "FARSIGHT_TOKEN";

/// Arguments of `farsight serve`.
#[derive(Debug, Args)]
pub(crate) struct ServeArgs {
    /// Where to listen; anywhere but on this machine itself needs a token
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:8080")]
    listen: SocketAddr,
    /// FILE with the word that requests must bring (Authorization: Bearer TOKEN) [default: what `FARSIGHT_TOKEN` says]
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// A camera that requests may name: its horizontal field of view in degrees, or its calibration file
    #[arg(long = "camera", value_name = "NAME=HFOV|FILE", value_parser = camera)]
    cameras: Vec<(String, CameraSource)>,
    /// Images that are looked at at once
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = count)]
    workers: usize,
    /// Images that wait; one more is refused
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = count)]
    queue: usize,
    /// How long an image may wait, milliseconds
    #[arg(long, value_name = "MS", default_value_t = 10_000, value_parser = deadline)]
    deadline: u64,
    #[command(flatten)]
    pipeline: PipelineArgs,
}

/// More are a mistake: each holds an image in memory.
const MOST: usize = 1024;

fn count(text: &str) -> Result<usize, String> {
    let count = text.parse().ok().filter(|count| (1..=MOST).contains(count));
    count.ok_or_else(|| format!("expected a number from 1 to {MOST}"))
}

/// Longer than this nobody waits, milliseconds.
const LONGEST_DEADLINE_MS: u64 = 600_000;

fn deadline(text: &str) -> Result<u64, String> {
    let deadline_ms = text.parse().ok().filter(|deadline_ms| (1..=LONGEST_DEADLINE_MS).contains(deadline_ms));
    deadline_ms.ok_or_else(|| format!("expected a number from 1 to {LONGEST_DEADLINE_MS}"))
}

fn camera(text: &str) -> Result<(String, CameraSource), String> {
    let (name, value) = text.split_once('=').ok_or("expected NAME=HFOV or NAME=FILE")?;
    if name.is_empty() {
        return Err("expected a name before the =".to_owned());
    }
    let source = match value.parse::<f64>() {
        Ok(degrees) if degrees > 0.0 && degrees < 180.0 => CameraSource::FieldOfView(degrees),
        Ok(_) => return Err("expected a field of view of more than 0 and less than 180 degrees".to_owned()),
        // Names of uploads say nothing about cameras.
        Err(_) if Path::new(value).is_dir() => return Err("a folder; expected a calibration file".to_owned()),
        Err(_) => CameraSource::from_calibration(Path::new(value)).map_err(|error| error.to_string())?,
    };
    Ok((name.to_owned(), source))
}

/// Runs the command.
pub(crate) fn run(args: &ServeArgs, printer: &mut Printer) -> Result<Outcome> {
    let token = token(args)?;
    ensure!(
        token.is_some() || args.listen.ip().is_loopback(),
        "{}: not this machine alone, so requests must bring a token; expected --token-file FILE or {TOKEN_VARIABLE}",
        args.listen
    );
    let mut cameras = BTreeMap::new();
    for (name, source) in &args.cameras {
        if cameras.insert(name.clone(), source.clone()).is_some() {
            bail!("--camera {name}: named twice; expected another name");
        }
    }
    let listener = TcpListener::bind(args.listen).with_context(|| format!("{}: cannot listen here", args.listen))?;
    let pipeline = pipeline_args::open_and_tell(&args.pipeline.builder(printer)?, printer)?;
    let deadline = Duration::from_millis(args.deadline);
    let config = Config { workers: args.workers, queue: args.queue, deadline, token, cameras };
    let look: Arc<dyn Look> = Arc::new(pipeline);
    let server = Server::start(listener, &look, config).context("the service cannot begin")?;
    printer.line(&format!("listening on http://{}", server.address()));
    printer.flush();
    server.run_until_signal().context("the system tells of no signals")?;
    printer.status("ended");
    Ok(Outcome::Done)
}

fn token(args: &ServeArgs) -> Result<Option<Token>> {
    let Some(path) = &args.token_file else {
        let Some(text) = std::env::var_os(TOKEN_VARIABLE) else { return Ok(None) };
        return Ok(Some(Token::new(&text.to_string_lossy()).context(TOKEN_VARIABLE)?));
    };
    let text = read_text(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    Ok(Some(Token::new(&text).with_context(|| path.display().to_string())?))
}
