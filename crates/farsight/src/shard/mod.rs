//! A job divided among processes and machines: `--shard I/N --parts DIR`, and `farsight merge`.
//!
//! The items of a job (images, frames, films) have an order. Part I of N does a block of neighbours, so parts joined in
//! their order are the whole. A part is a folder `DIR/003-of-016` that holds the outputs by the names that the command
//! line gives them, and a [`manifest`] that says what it was made from. It appears whole or not at all: what a killed
//! worker leaves is hidden, and made anew. A part that is there is left as it is.
//!
//! Nobody hands out work. Any process may do any part at any time, and the same part twice gives the same bytes.

pub(crate) mod manifest;
pub(crate) mod merged;
mod part;

use std::ops::Range;
use std::path::{Component, Path, PathBuf};
use std::str::FromStr;

use anyhow::{Result, ensure};
use clap::Args;

pub(crate) use part::Part;

/// More parts than this are a slip of the finger.
const MAX_PARTS: usize = 99_999;

/// The options that divide a job.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Many machines")]
pub(crate) struct ShardArgs {
    /// Do part I of N only. Outputs go to a folder of the part, so their paths must be relative; `farsight merge` puts
    /// the parts together
    #[arg(long, value_name = "I/N", requires = "parts")]
    pub(crate) shard: Option<Shard>,
    /// Folder for the parts; those that are there are skipped
    #[arg(long, value_name = "DIR", requires = "shard")]
    pub(crate) parts: Option<PathBuf>,
}

impl ShardArgs {
    /// Which part is asked for, and in which folder.
    pub(crate) fn asked(&self) -> Option<(Shard, &Path)> {
        self.shard.zip(self.parts.as_deref())
    }
}

/// Part `number` (from 1) of `count`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Shard {
    pub(crate) number: usize,
    pub(crate) count: usize,
}

impl Shard {
    /// The items of this part. All parts together have each item once, and differ by one item at most.
    pub(crate) fn block(self, items: usize) -> Range<usize> {
        let start = |number: usize| (items as u128 * number as u128 / self.count as u128) as usize;
        start(self.number - 1)..start(self.number)
    }

    /// The name of its folder; names sort as parts do.
    fn folder_name(self) -> String {
        let Self { number, count } = self;
        format!("{number:03}-of-{count:03}")
    }
}

impl std::fmt::Display for Shard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.number, self.count)
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').map(|(number, count)| (number.parse(), count.parse()));
        match numbers {
            Some((Ok(number), Ok(count))) if (1..=count).contains(&number) && count <= MAX_PARTS => {
                Ok(Self { number, count })
            }
            _ => Err(format!("expected I/N with I from 1 to N, such as 3/16, and N at most {MAX_PARTS}")),
        }
    }
}

/// Options that do not change what comes out, with the number of words that follow them.
const OF_NO_EFFECT: [(&str, usize); 6] =
    [("--shard", 1), ("--parts", 1), ("-q", 0), ("--quiet", 0), ("--log-level", 1), ("--threads", 1)];

/// The words of this process's command line that decide about the results.
pub(crate) fn words() -> Vec<String> {
    deciding(std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned()))
}

fn deciding(all: impl IntoIterator<Item = String>) -> Vec<String> {
    let mut left_out = 0;
    let decides = |word: &String| {
        if left_out > 0 {
            left_out -= 1;
            return false;
        }
        let (name, has_value) = word.split_once('=').map_or((word.as_str(), false), |(name, _)| (name, true));
        let Some((_, values)) = OF_NO_EFFECT.iter().find(|(option, _)| *option == name) else { return true };
        left_out = if has_value { 0 } else { *values };
        false
    };
    all.into_iter().filter(decides).collect()
}

/// Checks that an output can lie within the folder of a part: a relative path that does not lead out of it.
pub(crate) fn check_relative(option: &str, path: &Path) -> Result<()> {
    let names = path.components().all(|component| matches!(component, Component::Normal(_)));
    ensure!(
        names && path != Path::new("") && path != Path::new("-") && path != Path::new(manifest::FILE),
        "{option} {}: with --shard outputs go to the folder of the part; expected a relative path, such as {option} out",
        path.display()
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::{Shard, check_relative, deciding};

    #[test]
    fn blocks_have_each_item_once_and_are_equally_long() {
        for items in [0, 1, 5, 16, 17, 1000] {
            for count in [1, 2, 3, 16, 40] {
                let blocks: Vec<_> = (1..=count).map(|number| Shard { number, count }.block(items)).collect();
                let joined: Vec<usize> = blocks.iter().cloned().flatten().collect();
                assert_eq!(joined, (0..items).collect::<Vec<_>>(), "{items} in {count}");
                let lengths = || blocks.iter().map(ExactSizeIterator::len);
                assert!(lengths().max().unwrap() - lengths().min().unwrap() <= 1, "{items} in {count}");
            }
        }
    }

    #[test]
    fn parts_are_numbered_from_1() {
        assert_eq!("3/16".parse(), Ok(Shard { number: 3, count: 16 }));
        for text in ["", "3", "0/16", "17/16", "1/0", "-1/2", "a/b", "1/2/3", "1/100000"] {
            assert!(text.parse::<Shard>().is_err_and(|told| told.starts_with("expected I/N")), "{text}");
        }
    }

    #[test]
    fn words_of_no_effect_are_left_out() {
        let line = "-q range in --shard 1/3 --json a.json --parts=p --log-level=warn --hfov 80 --threads 2";
        let left = deciding(line.split(' ').map(str::to_owned));
        assert_eq!(left, ["range", "in", "--json", "a.json", "--hfov", "80"]);
    }

    #[test]
    fn outputs_stay_within_the_part() {
        for path in ["a.json", "rows/mine", "rows/"] {
            check_relative("--json", path.as_ref()).unwrap();
        }
        for path in ["/a.json", "../a.json", "a/../../b", "-", "", ".", "manifest.json"] {
            let told = check_relative("--json", path.as_ref()).unwrap_err().to_string();
            assert!(told.contains("expected a relative path, such as --json out"), "{path}: {told}");
        }
    }
}
