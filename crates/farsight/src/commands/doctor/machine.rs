//! The CPU.

use std::env::consts::{ARCH, OS};
use std::thread::available_parallelism;

use serde::Serialize;

/// What there is to compute with.
#[derive(Debug, Serialize)]
pub(super) struct Machine {
    /// Operating system.
    pub(super) os: &'static str,
    /// Architecture of the CPU.
    pub(super) architecture: &'static str,
    /// Threads that run at the same time.
    pub(super) threads: usize,
    /// Instruction sets that matter to the engines.
    pub(super) instruction_sets: Vec<&'static str>,
}

impl Machine {
    /// This machine.
    pub(super) fn here() -> Self {
        let threads = available_parallelism().map_or(1, usize::from);
        Self { os: OS, architecture: ARCH, threads, instruction_sets: instruction_sets() }
    }

    /// Whether it has an instruction set.
    pub(super) fn has(&self, name: &str) -> bool {
        self.instruction_sets.contains(&name)
    }
}

/// The names of those that are there.
fn present(sets: &[(&'static str, bool)]) -> Vec<&'static str> {
    sets.iter().filter(|(_, there)| *there).map(|(name, _)| *name).collect()
}

#[cfg(target_arch = "x86_64")]
fn instruction_sets() -> Vec<&'static str> {
    present(&[
        ("sse4.2", is_x86_feature_detected!("sse4.2")),
        ("avx", is_x86_feature_detected!("avx")),
        ("avx2", is_x86_feature_detected!("avx2")),
        ("fma", is_x86_feature_detected!("fma")),
        ("f16c", is_x86_feature_detected!("f16c")),
        ("avxvnni", is_x86_feature_detected!("avxvnni")),
        ("avx512f", is_x86_feature_detected!("avx512f")),
        ("avx512bw", is_x86_feature_detected!("avx512bw")),
        ("avx512vnni", is_x86_feature_detected!("avx512vnni")),
        ("avx512bf16", is_x86_feature_detected!("avx512bf16")),
    ])
}

#[cfg(target_arch = "aarch64")]
fn instruction_sets() -> Vec<&'static str> {
    use std::arch::is_aarch64_feature_detected;
    present(&[
        ("neon", is_aarch64_feature_detected!("neon")),
        ("dotprod", is_aarch64_feature_detected!("dotprod")),
        ("i8mm", is_aarch64_feature_detected!("i8mm")),
        ("bf16", is_aarch64_feature_detected!("bf16")),
    ])
}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
fn instruction_sets() -> Vec<&'static str> {
    present(&[])
}
