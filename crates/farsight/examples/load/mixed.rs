//! Good requests and bad ones, in a random order: each must get the answer that it should.

use std::error::Error;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::scope;

use crate::client::{Client, IMAGE};
use crate::stand_in::{NO_IMAGE, PANIC};
use crate::timed::unit;

/// Fewer than the queue has places, so that none is refused for want of one.
const CLIENTS: usize = 16;

/// The share of bad requests.
const BAD: f64 = 0.2;

/// What is wrong with a request: first line, body, how long it says that it is, status of the answer.
const WRONG: [(&str, &[u8], Option<usize>, u16); 8] = [
    ("POST /v1/range?hfov=65", b"", None, 400),
    ("POST /v1/range?hfov=wide", b"image", None, 400),
    ("POST /v1/range?camera=none", b"image", None, 404),
    ("POST /v1/range?hfov=65", NO_IMAGE, None, 400),
    ("POST /v1/range?hfov=65", PANIC, None, 500),
    ("POST /v1/range?hfov=65", b"", Some(17 << 20), 413),
    ("GET /v1/range", b"", None, 405),
    ("POST /v1/none", b"image", None, 404),
];

/// Sends `count` requests and says what came of them.
pub(crate) fn run(address: SocketAddr, count: usize) -> Result<String, Box<dyn Error>> {
    let [right, wrong, gone, lost, sent] = [const { AtomicUsize::new(0) }; 5];
    scope(|threads| {
        for number in 0..CLIENTS {
            let (right, wrong, gone, lost, sent) = (&right, &wrong, &gone, &lost, &sent);
            threads.spawn(move || {
                let (mut client, mut random) = (Client::new(address), number as u64);
                while sent.fetch_add(1, Ordering::Relaxed) < count {
                    let is_bad = unit(&mut random) < BAD;
                    let kind = (unit(&mut random) * (WRONG.len() + 1) as f64) as usize;
                    let (answer, expected, place) = match WRONG.get(kind) {
                        _ if !is_bad => (client.ask("POST /v1/range?hfov=65", IMAGE.len(), &IMAGE), 200, right),
                        Some((line, body, length, status)) => {
                            (client.ask(line, length.unwrap_or(body.len()), body), *status, wrong)
                        }
                        // Who goes away in the middle expects nothing.
                        None => (client.go_away().map(|()| 0), 0, gone),
                    };
                    let place = if answer.is_ok_and(|status| status == expected) { place } else { lost };
                    place.fetch_add(1, Ordering::Relaxed);
                }
            });
        }
    });
    let [right, wrong, gone, lost] = [right, wrong, gone, lost].map(AtomicUsize::into_inner);
    let told = format!("{right} answered, {wrong} bad ones refused as they should be, {gone} went away, {lost} lost");
    if lost > 0 { Err(told.into()) } else { Ok(told) }
}
