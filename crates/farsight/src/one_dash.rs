//! Long options with one dash: `-hfov 65` would be taken for `-h` and answered by help.

use std::ffi::OsString;

use clap::Command;

/// The first argument that is a long option of the subcommand with one dash instead of two, as it was meant.
pub(crate) fn meant(program: &Command, arguments: impl IntoIterator<Item = OsString>) -> Option<(String, String)> {
    let arguments = arguments.into_iter().skip(1).map(|argument| argument.to_string_lossy().into_owned());
    let mut command = program;
    for argument in arguments.take_while(|argument| argument != "--") {
        if let Some(subcommand) = command.find_subcommand(&argument) {
            command = subcommand;
        }
        let name = argument.strip_prefix('-').filter(|name| name.len() > 1 && !name.starts_with('-'));
        let Some(name) = name.and_then(|name| name.split('=').next()) else { continue };
        if command.get_arguments().any(|known| known.get_long() == Some(name)) {
            return Some((format!("-{name}"), format!("--{name}")));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use clap::{Arg, Command};

    use super::meant;

    #[test]
    fn one_dash_before_a_long_option_is_found() {
        let program = Command::new("p").subcommand(Command::new("range").arg(Arg::new("hfov").long("hfov")));
        let meant = |words: &[&str]| meant(&program, words.iter().map(Into::into));
        let expected = Some(("-hfov".to_owned(), "--hfov".to_owned()));
        assert_eq!(meant(&["p", "range", "-hfov", "65"]), expected);
        assert_eq!(meant(&["p", "range", "a.png", "-hfov=65"]), expected);
        for words in [&["p", "range", "--hfov", "-65"][..], &["p", "range", "-h"], &["p", "range", "--", "-hfov"]] {
            assert_eq!(meant(words), None, "{words:?}");
        }
    }
}
