//! `farsight serve`: the pipeline over HTTP.

mod videos;

use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io::{self, Write};
use std::net::{SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use farsight::service::{Config, Infer, Log, Server, Tls, Token};
use farsight::video::is_video;
use farsight::{CameraSource, Lens, LensError, ViewSource};
use farsight_files::read_text;

use super::Outcome;
use crate::pipeline_args::{self, PipelineArgs};
use crate::printer::Printer;

/// Where the token may be, instead of a file.
const TOKEN_VARIABLE: &str = "FARSIGHT_TOKEN";

/// Arguments of `farsight serve`.
#[derive(Debug, Args)]
pub(crate) struct ServeArgs {
    /// Where to listen; anywhere but on this machine itself needs a token and a certificate
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:8080")]
    listen: SocketAddr,
    /// Answer HTTPS with the certificate in FILE (PEM, those that signed it after it)
    #[arg(long, value_name = "FILE", requires = "tls_key")]
    tls_cert: Option<PathBuf>,
    /// The certificate's private key (PEM)
    #[arg(long, value_name = "FILE", requires = "tls_cert")]
    tls_key: Option<PathBuf>,
    /// Answer HTTP elsewhere, too: a proxy in front speaks TLS
    #[arg(long, conflicts_with = "tls_cert")]
    plain_http: bool,
    /// A NAME that requests may call this machine by, beside localhost and addresses; any where there is a token
    #[arg(long = "host", value_name = "NAME")]
    hosts: Vec<String>,
    /// Append a line of JSON for each request to FILE; "-" writes to standard error
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// FILE with the word that requests must bring (Authorization: Bearer TOKEN) [default: what `FARSIGHT_TOKEN` says]
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// A camera that requests may name: its horizontal field of view in degrees, "auto" to estimate that, or its
    /// calibration file, with its road where `farsight calibrate` wrote it
    #[arg(long = "camera", value_name = "NAME=HFOV|FILE", value_parser = camera)]
    cameras: Vec<(String, CameraSource)>,
    /// The lens of a camera, as `farsight range --lens` takes it
    #[arg(long = "lens", value_name = "NAME=LENS", value_parser = lens)]
    lenses: Vec<(String, Lens)>,
    /// A film, an address (rtsp, http) or a camera device that may be watched by its NAME, read by ffmpeg; the camera
    /// of the same name took it
    #[arg(long = "video", value_name = "NAME=INPUT", value_parser = video)]
    videos: Vec<(String, PathBuf)>,
    /// The ffmpeg program, for videos
    #[arg(long, value_name = "FILE", default_value = "ffmpeg")]
    ffmpeg: PathBuf,
    /// Images that are looked at at once
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = count)]
    workers: usize,
    /// Images that are looked at together; the first waits at most 5 ms for others
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = count)]
    batch: usize,
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
const MAX_DEADLINE_MS: u64 = 600_000;

fn deadline(text: &str) -> Result<u64, String> {
    let deadline_ms = text.parse().ok().filter(|deadline_ms| (1..=MAX_DEADLINE_MS).contains(deadline_ms));
    deadline_ms.ok_or_else(|| format!("expected a number from 1 to {MAX_DEADLINE_MS}"))
}

fn camera(text: &str) -> Result<(String, CameraSource), String> {
    let (name, value) = text.split_once('=').ok_or("expected NAME=HFOV, NAME=auto or NAME=FILE")?;
    if name.is_empty() {
        return Err("expected a name before the =".to_owned());
    }
    let source = match value.parse::<f64>() {
        Err(_) if value == "auto" => CameraSource::Estimated,
        Ok(degrees) if degrees > 0.0 && degrees < 180.0 => CameraSource::FieldOfView(degrees),
        Ok(_) => return Err("expected a field of view of more than 0 and less than 180 degrees".to_owned()),
        // Names of uploads say nothing about cameras.
        Err(_) if Path::new(value).is_dir() => return Err("a folder; expected a calibration file".to_owned()),
        Err(_) => CameraSource::from_calibration(Path::new(value)).map_err(|error| error.to_string())?,
    };
    Ok((name.to_owned(), source))
}

fn lens(text: &str) -> Result<(String, Lens), String> {
    let (name, lens) = text.split_once('=').ok_or("expected NAME=LENS")?;
    Ok((name.to_owned(), lens.parse().map_err(|error: LensError| error.to_string())?))
}

fn video(text: &str) -> Result<(String, PathBuf), String> {
    let parts = text.split_once('=').filter(|(name, input)| !name.is_empty() && !input.is_empty());
    let (name, input) = parts.ok_or("expected NAME=INPUT")?;
    let input = PathBuf::from(input);
    let is_address = input.to_string_lossy().contains("://");
    if !is_video(&input) || !(is_address || input.exists()) {
        return Err(format!("{}: no such film; expected a video file, an address or a camera device", input.display()));
    }
    Ok((name.to_owned(), input))
}

/// Runs the command.
pub(crate) fn run(args: &ServeArgs, printer: &mut Printer) -> Result<Outcome> {
    let token = token(args)?;
    ensure!(
        token.is_some() || args.listen.ip().is_loopback(),
        "{}: not this machine alone, so requests must bring a token; expected --token-file FILE or {TOKEN_VARIABLE}",
        args.listen
    );
    ensure!(
        args.tls_cert.is_some() || args.plain_http || args.listen.ip().is_loopback(),
        "{}: not this machine alone, so tokens and images need TLS; expected --tls-cert FILE and --tls-key FILE, or --plain-http behind a proxy that has it",
        args.listen
    );
    let tls = tls(args)?;
    let log = args.log.as_deref().map(log_to).transpose()?.unwrap_or_default();
    let cameras = cameras(args)?;
    for (name, _) in &args.videos {
        let expected = format!("expected --camera {name}=HFOV or --camera {name}=FILE beside it");
        // Not the address: there may be a password in it.
        ensure!(cameras.contains_key(name), "--video {name}: no camera of this name; {expected}");
    }
    let listener = TcpListener::bind(args.listen).with_context(|| format!("{}: cannot listen here", args.listen))?;
    let builder = args.pipeline.builder(printer)?;
    let pipeline = pipeline_args::open_and_tell(&builder, printer)?;
    let videos = videos::open(args, &builder, &cameras)?;
    let deadline = Duration::from_millis(args.deadline);
    let scheme = if tls.is_some() { "https" } else { "http" };
    let config = Config {
        workers: args.workers,
        batch: args.batch,
        queue: args.queue,
        deadline,
        token,
        cameras,
        videos,
        hosts: args.hosts.clone(),
        tls,
        log,
        ..Config::default()
    };
    let infer: Arc<dyn Infer> = Arc::new(pipeline);
    let server = Server::start(listener, &infer, config).context("the service cannot begin")?;
    printer.line(&format!("listening on {scheme}://{}", server.address()));
    printer.flush();
    server.run_until_signal().context("the system tells of no signals")?;
    printer.status("ended");
    Ok(Outcome::Done)
}

/// The stored cameras by their names, with their lenses.
fn cameras(args: &ServeArgs) -> Result<BTreeMap<String, ViewSource>> {
    let mut cameras = BTreeMap::new();
    for (name, source) in &args.cameras {
        if cameras.insert(name.clone(), ViewSource::from(source.clone())).is_some() {
            bail!("--camera {name}: named twice; expected another name");
        }
    }
    for (name, lens) in &args.lenses {
        let Some(camera) = cameras.get_mut(name) else {
            bail!("--lens {name}: no camera of this name; expected --camera {name}=HFOV or --camera {name}=FILE");
        };
        if camera.lens().is_some() {
            bail!("--lens {name}: named twice; expected one lens a camera");
        }
        *camera = camera.clone().with_lens(Some(*lens));
    }
    Ok(cameras)
}

fn tls(args: &ServeArgs) -> Result<Option<Tls>> {
    let Some((cert, key)) = args.tls_cert.as_ref().zip(args.tls_key.as_ref()) else { return Ok(None) };
    let [certificates, private] = [cert, key].map(|path| {
        let text = read_text(path).with_context(|| format!("{}: cannot be read", path.display()))?;
        Ok::<_, anyhow::Error>(text)
    });
    let tls = Tls::from_pem(certificates?.as_bytes(), private?.as_bytes());
    Ok(Some(tls.with_context(|| format!("{}, {}", cert.display(), key.display()))?))
}

/// A log of JSON, one object a line.
fn log_to(path: &Path) -> Result<Log> {
    let write: Box<dyn Write + Send> = if path == Path::new("-") {
        Box::new(io::stderr())
    } else {
        let file = OpenOptions::new().append(true).create(true).open(path);
        Box::new(file.with_context(|| format!("{}: cannot be written", path.display()))?)
    };
    let write = Mutex::new(write);
    Ok(Log::new(move |record| {
        let Ok(line) = serde_json::to_string(record) else { return };
        // A full disk does not end the service. In one write, so that a reader sees whole lines.
        let _ = write.lock().unwrap_or_else(PoisonError::into_inner).write_all((line + "\n").as_bytes());
    }))
}

fn token(args: &ServeArgs) -> Result<Option<Token>> {
    let Some(path) = &args.token_file else {
        let Some(text) = std::env::var_os(TOKEN_VARIABLE) else { return Ok(None) };
        return Ok(Some(Token::new(&text.to_string_lossy()).context(TOKEN_VARIABLE)?));
    };
    let text = read_text(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    Ok(Some(Token::new(&text).with_context(|| path.display().to_string())?))
}
