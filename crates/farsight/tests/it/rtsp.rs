//! A camera: an RTSP server in few words (RFC 2326), which sends a film as MPEG-TS over RTP (RFC 2250) inside its TCP
//! connection.

use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;

/// Whether there is an ffmpeg.
pub(crate) fn has_ffmpeg() -> bool {
    Command::new("ffmpeg").arg("-version").output().is_ok_and(|output| output.status.success())
}

/// Frames a second of the film, and how long it is, seconds.
const FPS: u32 = 10;
const FILM_S: u32 = 30;

/// How much faster than it was taken the film is sent, so that nobody waits long for it.
const HASTE: u32 = 4;

/// Packets of MPEG-TS that fit into one of RTP.
const CHUNK: usize = 7 * 188;

/// A camera that is on.
pub(crate) struct Camera {
    pub(crate) address: SocketAddr,
    /// How often somebody began to watch.
    pub(crate) plays: Arc<AtomicUsize>,
}

impl Camera {
    /// Serves a film that ffmpeg makes in `folder`. The first time, it falls silent after `silent_after_s` of the film;
    /// the connection stays.
    pub(crate) fn start(folder: &Path, silent_after_s: u32) -> Self {
        let film = folder.join("film.ts");
        let source = format!("testsrc=size=320x180:rate={FPS}:duration={FILM_S}");
        let mut make = Command::new("ffmpeg");
        make.args(["-nostdin", "-loglevel", "error", "-f", "lavfi", "-i", &source]);
        make.args(["-codec:v", "mpeg2video", "-g", "5", "-bf", "0", "-f", "mpegts"]).arg(&film);
        assert!(make.status().unwrap().success());
        let film: Arc<[u8]> = std::fs::read(film).unwrap().into();
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let plays = Arc::new(AtomicUsize::new(0));
        let counted = Arc::clone(&plays);
        thread::spawn(move || {
            for stream in listener.incoming() {
                let (film, plays) = (Arc::clone(&film), Arc::clone(&counted));
                // Who hangs up has seen enough.
                thread::spawn(move || serve(&stream.unwrap(), &film, &plays, silent_after_s));
            }
        });
        Self { address, plays }
    }
}

fn serve(stream: &TcpStream, film: &[u8], plays: &AtomicUsize, silent_after_s: u32) -> std::io::Result<()> {
    let (mut requests, mut answers) = (BufReader::new(stream), stream);
    loop {
        let mut head = String::new();
        while !head.ends_with("\r\n\r\n") {
            if requests.read_line(&mut head)? == 0 {
                return Ok(());
            }
        }
        let method = head.split(' ').next().unwrap_or_default();
        let number = head.lines().find_map(|line| line.strip_prefix("CSeq: ")).unwrap_or("0");
        let (lines, body) = match method {
            "OPTIONS" => ("Public: DESCRIBE, SETUP, PLAY, TEARDOWN\r\n", ""),
            "DESCRIBE" => (
                "Content-Type: application/sdp\r\n",
                "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=camera\r\nt=0 0\r\nm=video 0 RTP/AVP 33\r\na=control:video\r\n",
            ),
            "SETUP" => ("Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\nSession: 1\r\n", ""),
            _ => ("Session: 1\r\n", ""),
        };
        let length = body.len();
        write!(answers, "RTSP/1.0 200 OK\r\nCSeq: {number}\r\nContent-Length: {length}\r\n{lines}\r\n{body}")?;
        if method == "PLAY" {
            let is_first = plays.fetch_add(1, Ordering::SeqCst) == 0;
            return send(answers, film, if is_first { silent_after_s } else { FILM_S });
        }
    }
}

/// Sends so much of the film, then nothing until the other side hangs up.
fn send(mut stream: &TcpStream, film: &[u8], seconds: u32) -> std::io::Result<()> {
    let packets = film.chunks(CHUNK);
    let count = packets.len() as u32;
    let pause = Duration::from_secs(u64::from(FILM_S)) / count / HASTE;
    for (packet, number) in packets.zip(0_u32..).take((count * seconds / FILM_S) as usize) {
        let time = number * (90_000 * FILM_S / count);
        // In the connection: channel 0 and length; of RTP: version 2, MPEG-TS, number, time, source.
        let mut bytes = vec![b'$', 0];
        bytes.extend((packet.len() as u16 + 12).to_be_bytes());
        bytes.extend([0x80, 33]);
        bytes.extend((number as u16).to_be_bytes());
        bytes.extend(time.to_be_bytes());
        bytes.extend(7_u32.to_be_bytes());
        bytes.extend(packet);
        stream.write_all(&bytes)?;
        thread::sleep(pause);
    }
    let mut ignored = [0; 512];
    while match stream.read(&mut ignored) {
        Ok(read) => read > 0,
        Err(error) => error.kind() == ErrorKind::Interrupted,
    } {}
    Ok(())
}
