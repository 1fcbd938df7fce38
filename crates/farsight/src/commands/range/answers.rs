//! The file of `--json`: an array, or a line for each image where its name ends in .jsonl.
//!
//! What is found is on the disk image by image, so that hours of work are not lost: an array grows as lines in a file
//! beside it, `FILE.partial`, which becomes the array at the end.

use std::collections::HashMap;
use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use farsight::json::{ImageRecord, ModelRecord};
use farsight_files::{text_up_to, write_atomically};

use crate::json_array::{ArrayWriter, MAX_ANSWERS, each_element};

/// Answers by the paths of their images.
pub(super) type Answered = HashMap<String, Answer>;

/// What was found in one image, as text: answers that stay keep every digit.
pub(super) struct Answer {
    pub(super) image: String,
    json: String,
}

/// The file that answers go to.
pub(super) struct AnswerFile {
    path: PathBuf,
    /// Where lines go while the work lasts; none for what is no regular file and gets its array in one piece.
    lines: Option<(PathBuf, File)>,
    answers: Vec<Answer>,
}

impl AnswerFile {
    /// The answers that an earlier run left, the latest for each image; those of other models are refused.
    pub(super) fn left_by_earlier_run(path: &Path, model: &ModelRecord) -> Result<Answered> {
        let mut left = Answered::new();
        let growing = growing(path);
        for file in [Some(path), growing.as_deref()].into_iter().flatten() {
            for (record, json) in read(file)? {
                if record.model.as_ref() != Some(model) {
                    bail!("{}: answers of another model; leave out --resume to begin anew", file.display());
                }
                left.insert(record.image.clone(), Answer { image: record.image, json });
            }
        }
        Ok(left)
    }

    /// Begins the file with answers that stay.
    pub(super) fn begin(path: &Path, kept: Vec<Answer>) -> Result<Self> {
        let mut lines = None;
        if let Some(growing) = growing(path) {
            // A line that was cut when the earlier run ended is not among them.
            let text: String = kept.iter().map(|answer| one_line(&answer.json)).collect();
            write_atomically(&growing, |file| file.write_all(text.as_bytes()))?;
            let file = OpenOptions::new().append(true).open(&growing).with_context(|| unwritable(&growing))?;
            lines = Some((growing, file));
        }
        Ok(Self { path: path.to_owned(), lines, answers: kept })
    }

    /// Adds an image.
    pub(super) fn add(&mut self, record: ImageRecord) -> Result<()> {
        if let Some((path, file)) = &mut self.lines {
            // In one write, so that a reader sees whole lines.
            let line = serde_json::to_string(&record)? + "\n";
            file.write_all(line.as_bytes()).with_context(|| unwritable(path))?;
        }
        let json = serde_json::to_string_pretty(&record)?;
        self.answers.push(Answer { image: record.image, json });
        Ok(())
    }

    /// Makes the array of all answers, in the order of `images`; those of other images come first.
    pub(super) fn finish(mut self, images: &[PathBuf]) -> Result<()> {
        if is_lines(&self.path) {
            return Ok(());
        }
        let places: HashMap<String, usize> =
            images.iter().enumerate().map(|(place, image)| (shown(image), place + 1)).collect();
        self.answers.sort_by_key(|answer| places.get(&answer.image).copied().unwrap_or(0));
        write_atomically(&self.path, |out| {
            let mut array = ArrayWriter::new(out);
            self.answers.iter().try_for_each(|answer| array.add(&answer.json))?;
            array.finish()
        })?;
        self.discard();
        Ok(())
    }

    /// Removes the lines beside an array, which are in it or were none.
    pub(super) fn discard(self) {
        if let Some((path, file)) = self.lines
            && path != self.path
        {
            drop(file);
            // What is left of it does no harm.
            let _ = fs::remove_file(path);
        }
    }
}

/// The path of an image as records have it.
pub(super) fn shown(image: &Path) -> String {
    image.to_string_lossy().into_owned()
}

/// Whether the name asks for lines.
pub(super) fn is_lines(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("jsonl"))
}

/// The file that lines go to; none of what is no regular file and wants an array.
fn growing(path: &Path) -> Option<PathBuf> {
    if is_lines(path) {
        return Some(path.to_owned());
    }
    if path.exists() && !path.is_file() {
        return None;
    }
    let mut name = OsString::from(path);
    name.push(".partial");
    Some(PathBuf::from(name))
}

/// JSON that may be spread over lines, in one; there are no line breaks in its strings.
fn one_line(json: &str) -> String {
    json.lines().map(str::trim_start).collect::<String>() + "\n"
}

fn unwritable(path: &Path) -> String {
    format!("{}: cannot be written", path.display())
}

/// The records in an array or in lines, and as they stand there; none where there is no file. A last line that was cut
/// is left out.
pub(super) fn read(path: &Path) -> Result<Vec<(ImageRecord, String)>> {
    let text = match text_up_to(path, MAX_ANSWERS) {
        Ok(text) => text,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(error).with_context(|| format!("{}: cannot be read", path.display())),
    };
    if text.trim_start().starts_with('[') {
        let failed = || format!("{}: no answers of `farsight range`", path.display());
        let mut records = Vec::new();
        let mut wrong = None;
        let array = each_element(text.as_bytes(), |element| {
            let record = serde_json::from_str(&element).map_err(|error| wrong = Some(error))?;
            records.push((record, element));
            Ok::<_, ()>(())
        });
        wrong.map_or(array, Err).with_context(failed)?;
        return Ok(records);
    }
    let whole = text.rfind('\n').map_or("", |end| &text[..end]);
    let numbered = whole.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let record = |(number, line): (usize, &str)| {
        let failed = || format!("{}:{}: no answer of `farsight range`", path.display(), number + 1);
        Ok((serde_json::from_str(line).with_context(failed)?, line.to_owned()))
    };
    numbered.map(record).collect()
}
