//! What is odd about the files, gathered by kind: one line a kind, counted, with the first place.

use std::fmt;

use serde::Serialize;

/// Places kept of each kind; the rest is counted.
const PLACES_KEPT: usize = 20;

/// Everything odd about a set of files, in the order in which the kinds first came up.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Findings {
    kinds: Vec<Finding>,
}

/// One kind of diagnostic.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// What all of them have in common.
    pub kind: &'static str,
    /// How many there are.
    pub count: usize,
    /// Where the first ones are and what is there.
    pub places: Vec<String>,
    /// Whether they are whole files that lack their counterpart: one line says enough of any number of them.
    #[serde(skip)]
    pub is_of_files: bool,
}

impl Findings {
    /// Adds one.
    pub fn add(&mut self, kind: &'static str, place: impl FnOnce() -> String) {
        let finding = self.entry(kind);
        finding.count += 1;
        if finding.places.len() < PLACES_KEPT {
            finding.places.push(place());
        }
    }

    /// Adds a file that lacks its counterpart.
    pub fn add_file(&mut self, kind: &'static str, place: impl FnOnce() -> String) {
        self.add(kind, place);
        self.entry(kind).is_of_files = true;
    }

    /// Adds those of files that come later.
    pub fn append(&mut self, later: Self) {
        for Finding { kind, count, places, is_of_files } in later.kinds {
            let finding = self.entry(kind);
            finding.is_of_files = is_of_files;
            finding.count += count;
            let room = PLACES_KEPT.saturating_sub(finding.places.len());
            finding.places.extend(places.into_iter().take(room));
        }
    }

    /// The kinds that came up.
    pub fn iter(&self) -> impl Iterator<Item = &Finding> {
        self.kinds.iter()
    }

    /// Whether nothing is odd.
    pub fn is_empty(&self) -> bool {
        self.kinds.is_empty()
    }

    fn entry(&mut self, kind: &'static str) -> &mut Finding {
        let position = self.kinds.iter().position(|finding| finding.kind == kind).unwrap_or_else(|| {
            self.kinds.push(Finding { kind, count: 0, places: Vec::new(), is_of_files: false });
            self.kinds.len() - 1
        });
        &mut self.kinds[position]
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.kind, self.count)?;
        self.places.first().map_or(Ok(()), |place| write!(f, "; first {place}"))
    }
}
