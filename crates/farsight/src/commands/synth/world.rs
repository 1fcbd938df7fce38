//! The file of `--world`.

use std::path::Path;

use anyhow::{Context, Result, bail};
use farsight_synth::SceneConfig;

/// What scenes look like by the file at `path`.
pub(crate) fn read_config(path: &Path) -> Result<SceneConfig> {
    let text = farsight_files::read_config(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    let config: SceneConfig = toml::from_str(&text).with_context(|| path.display().to_string())?;
    match config.problem() {
        Some(problem) => bail!("{}: {problem}", path.display()),
        None => Ok(config),
    }
}
