//! `farsight serve`: over the loopback, with the pipeline and with stand-ins for it.

#![allow(clippy::unwrap_used, reason = "the helpers of a test may panic")]

#[path = "../it/program.rs"]
#[allow(dead_code, reason = "each test uses a part of it")]
mod program;

mod client;
mod page;
mod program_itself;
mod promises;
mod protocol;
mod security;
mod videos;
