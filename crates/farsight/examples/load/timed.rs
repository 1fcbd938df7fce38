//! Phases that are timed.

use std::net::SocketAddr;
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, channel};
use std::thread::{scope, sleep};
use std::time::{Duration, Instant};

use crate::client::{Client, IMAGE};

const ASK: &str = "POST /v1/range?hfov=65";

/// Connections of a phase with arrivals: more than the queue has places.
const CONNECTIONS: usize = 96;

/// When requests come.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Arrivals {
    Even,
    /// Independent of each other (Poisson).
    Random,
}

/// What came of a phase.
pub(crate) struct Figures {
    /// Requests a second that were sent.
    pub(crate) offered: f64,
    /// Answers with an image's objects a second.
    pub(crate) goodput: f64,
    /// Median, 99th percentile and longest, milliseconds.
    pub(crate) good_ms: [f64; 3],
    pub(crate) refused: usize,
    pub(crate) refused_ms: [f64; 3],
    /// Share of the refusals that were there within 10 ms.
    pub(crate) refused_in_time: f64,
}

/// One answer: its status, and how long it took.
type Answer = (u16, f64);

fn figures(answers: &[Answer], time: Duration) -> Figures {
    let of = |status: u16| {
        let mut times: Vec<f64> = answers.iter().filter(|answer| answer.0 == status).map(|answer| answer.1).collect();
        times.sort_by(f64::total_cmp);
        times
    };
    let [good, refused] = [of(200), of(429)];
    let place = |times: &[f64], share: f64| {
        let last = times.len().saturating_sub(1);
        times.get((share * last as f64).round() as usize).copied().unwrap_or(f64::NAN)
    };
    let three = |times: &[f64]| [0.5, 0.99, 1.0].map(|share| place(times, share));
    let in_time = refused.iter().filter(|time_ms| **time_ms <= 10.0).count();
    Figures {
        offered: answers.len() as f64 / time.as_secs_f64(),
        goodput: good.len() as f64 / time.as_secs_f64(),
        good_ms: three(&good),
        refused: refused.len(),
        refused_ms: three(&refused),
        refused_in_time: in_time as f64 / refused.len().max(1) as f64,
    }
}

/// So many clients that ask again as soon as they are answered.
pub(crate) fn closed(address: SocketAddr, clients: usize, time: Duration) -> Figures {
    let begun = Instant::now();
    let answers = Mutex::new(Vec::new());
    scope(|threads| {
        for _ in 0..clients {
            threads.spawn(|| {
                let (mut client, mut own) = (Client::new(address), Vec::new());
                while begun.elapsed() < time {
                    own.push(ask(&mut client));
                }
                put(&answers, own);
            });
        }
    });
    let time = begun.elapsed();
    figures(&taken(answers), time)
}

/// So many requests a second, whatever becomes of them.
pub(crate) fn open(address: SocketAddr, rate: f64, arrivals: Arrivals, time: Duration) -> Figures {
    let begun = Instant::now();
    let answers = Mutex::new(Vec::new());
    let (send, todo) = channel::<()>();
    let todo = Mutex::new(todo);
    scope(|threads| {
        for _ in 0..CONNECTIONS {
            threads.spawn(|| {
                let (mut client, mut own) = (Client::new(address), Vec::new());
                while next(&todo) {
                    own.push(ask(&mut client));
                }
                put(&answers, own);
            });
        }
        let (mut due_s, mut random) = (0.0, 1_u64);
        while due_s < time.as_secs_f64() {
            if let Some(left) = Duration::from_secs_f64(due_s).checked_sub(begun.elapsed()) {
                sleep(left);
            }
            if send.send(()).is_err() {
                break;
            }
            due_s += match arrivals {
                Arrivals::Even => 1.0 / rate,
                Arrivals::Random => -(1.0 - unit(&mut random)).ln() / rate,
            };
        }
        drop(send);
    });
    let time = begun.elapsed();
    figures(&taken(answers), time)
}

fn next(todo: &Mutex<Receiver<()>>) -> bool {
    todo.lock().is_ok_and(|todo| todo.recv().is_ok())
}

fn ask(client: &mut Client) -> Answer {
    let begun = Instant::now();
    // 0 is no answer.
    let status = client.ask(ASK, IMAGE.len(), &IMAGE).unwrap_or(0);
    (status, begun.elapsed().as_secs_f64() * 1e3)
}

fn put(answers: &Mutex<Vec<Answer>>, own: Vec<Answer>) {
    if let Ok(mut answers) = answers.lock() {
        answers.extend(own);
    }
}

fn taken(answers: Mutex<Vec<Answer>>) -> Vec<Answer> {
    answers.into_inner().unwrap_or_default()
}

/// A number from 0 to 1 (the generator of Knuth's MMIX).
pub(crate) fn unit(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1_u64 << 53) as f64
}
