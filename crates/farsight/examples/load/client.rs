//! A client that keeps its connection.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

/// Size of an image in most requests, bytes: a small JPEG.
const IMAGE_BYTES: usize = 20_000;

/// That image. The stand-in does not look into it.
pub(crate) static IMAGE: [u8; IMAGE_BYTES] = [0; IMAGE_BYTES];

/// One connection at a time.
pub(crate) struct Client {
    address: SocketAddr,
    stream: Option<BufReader<TcpStream>>,
}

impl Client {
    pub(crate) fn new(address: SocketAddr) -> Self {
        Self { address, stream: None }
    }

    /// Sends a request and reads its answer: the status.
    pub(crate) fn ask(&mut self, first_line: &str, length: usize, body: &[u8]) -> io::Result<u16> {
        let mut stream = if let Some(stream) = self.stream.take() {
            stream
        } else {
            let stream = TcpStream::connect(self.address)?;
            stream.set_nodelay(true)?;
            stream.set_read_timeout(Some(Duration::from_secs(30)))?;
            BufReader::new(stream)
        };
        let mut request =
            format!("{first_line} HTTP/1.1\r\nHost: localhost\r\nContent-Length: {length}\r\n\r\n").into_bytes();
        request.extend_from_slice(body);
        stream.get_mut().write_all(&request)?;
        let (status, is_kept) = read_answer(&mut stream)?;
        // What was announced and not sent would be taken from the next request.
        if is_kept && length == body.len() {
            self.stream = Some(stream);
        }
        Ok(status)
    }

    /// Sends half a request and goes away.
    pub(crate) fn go_away(&mut self) -> io::Result<()> {
        let mut stream = TcpStream::connect(self.address)?;
        stream.write_all(b"POST /v1/range?hfov=65 HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\nhalf")
    }
}

/// The status, and whether the connection stays.
fn read_answer(stream: &mut BufReader<TcpStream>) -> io::Result<(u16, bool)> {
    let bad = || io::Error::new(io::ErrorKind::InvalidData, "no answer");
    let (mut line, mut length, mut is_kept) = (String::new(), 0, true);
    stream.read_line(&mut line)?;
    let status = line.split(' ').nth(1).and_then(|status| status.parse().ok()).ok_or_else(bad)?;
    loop {
        line.clear();
        stream.read_line(&mut line)?;
        let (name, value) = match line.trim_end().split_once(": ") {
            Some(field) => field,
            None if line == "\r\n" => break,
            None => return Err(bad()),
        };
        if name.eq_ignore_ascii_case("content-length") {
            length = value.parse().map_err(|_| bad())?;
        } else if name.eq_ignore_ascii_case("connection") {
            is_kept = value != "close";
        }
    }
    io::copy(&mut stream.take(length), &mut io::sink())?;
    Ok((status, is_kept))
}
