//! Running the program, for the tests that do so.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The top of the workspace.
pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

pub(crate) fn farsight(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_farsight")).args(arguments).current_dir(folder).output().unwrap()
}

/// Standard output of a command that must work.
pub(crate) fn done(folder: &Path, arguments: &[&str]) -> String {
    let output = farsight(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// The world of one camera over European traffic in clear weather, for `synth --scene-config`: its focal length over
/// the width of its images, how high it is and how far down it looks. `density` is the range of a factor on the
/// traffic.
pub(crate) fn one_camera(density: [f64; 2], focal_width: f64, height_m: f64, pitch_deg: f64) -> String {
    format!(
        "regions = {{ europe = 1.0 }}
weather = {{ clear = 1.0 }}
density = {density:?}

[[cameras]]
share = 1.0
image_sizes = [[960, 540]]
focal_widths = [{focal_width:?}, {focal_width:?}]
center = [0.5, 0.5]
center_reach = 0.0
height_m = [{height_m:?}, {height_m:?}]
pitch_deg = [{pitch_deg:?}, {pitch_deg:?}]
roll_deg = 0.0
lateral_m = 0.0
offset_m = 0.0
"
    )
}
