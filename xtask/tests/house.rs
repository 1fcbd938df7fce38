//! The laws of ARCHITECTURE.md that can be read off the sources: floors of crates, and no circles between modules; and
//! what can be read off them besides.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "the helpers of a test may panic")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// A path of names: that of a module within its crate, or of something in it.
type Names = Vec<String>;

/// The modules of a crate with their texts, without comments and tests.
fn modules(folder: &Path, place: &Names, found: &mut BTreeMap<Names, String>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let inner = [place.clone(), vec![name.clone()]].concat();
        if path.is_dir() {
            modules(&path, &inner, found);
        } else if path.extension().is_some_and(|end| end == "rs") {
            let module = if ["lib", "main", "mod"].contains(&name.as_str()) { place.clone() } else { inner };
            let text = fs::read_to_string(&path).unwrap();
            let text = text.split("#[cfg(test)]\nmod ").next().unwrap();
            let lines = text.lines().map(|line| line.split("//").next().unwrap().to_owned() + "\n");
            found.entry(module).or_default().extend(lines);
        }
    }
}

fn names(path: &str) -> Names {
    path.split("::").map(str::trim).filter(|name| !name.is_empty()).map(str::to_owned).collect()
}

/// What a tree of a `use` names: `a::{b, c::d}` is `a::b` and `a::c::d`.
fn leaves(tree: &str, before: &Names, found: &mut Vec<Names>) {
    let Some(open) = tree.find('{') else {
        let path = tree.split(" as ").next().unwrap();
        found.push([before.clone(), names(path)].concat());
        return;
    };
    let before = [before.clone(), names(&tree[..open])].concat();
    let (mut depth, mut start) = (0, open + 1);
    for (at, character) in tree.char_indices().skip(open + 1) {
        match character {
            '{' => depth += 1,
            '}' if depth > 0 => depth -= 1,
            ',' | '}' if depth == 0 => {
                if !tree[start..at].trim().is_empty() {
                    leaves(&tree[start..at], &before, found);
                }
                start = at + 1;
            }
            _ => {}
        }
    }
}

/// Paths that a text names, those that it hands on by `pub use` first.
fn paths(text: &str) -> [Vec<Names>; 2] {
    let (mut handed_on, mut used, mut rest) = (Vec::new(), Vec::new(), String::new());
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        let words = line.trim_start();
        let start =
            ["use ", "pub use ", "pub(crate) use ", "pub(super) use "].into_iter().find(|s| words.starts_with(s));
        let Some(start) = start else {
            rest += line;
            rest.push('\n');
            continue;
        };
        let mut tree = words[start.len()..].to_owned();
        while !tree.contains(';') {
            tree += lines.next().unwrap();
        }
        let list = if start == "use " { &mut used } else { &mut handed_on };
        leaves(tree.split(';').next().unwrap(), &Vec::new(), list);
    }
    for start in ["crate::", "super::"] {
        for (at, _) in rest.match_indices(start) {
            let is_name = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
            if rest[..at].ends_with(is_name) {
                continue;
            }
            let end = rest[at..].find(|c| !is_name(c)).map_or(rest.len(), |length| at + length);
            leaves(&rest[at..end], &Vec::new(), &mut used);
        }
    }
    [handed_on, used]
}

/// A crate's modules and what they name.
struct House {
    modules: BTreeSet<Names>,
    /// What `pub use` calls by another path, by module and name.
    handed_on: BTreeMap<Names, Names>,
    used: Vec<(Names, Names)>,
}

impl House {
    fn new(source: &Path) -> Self {
        let mut texts = BTreeMap::new();
        modules(source, &Vec::new(), &mut texts);
        let modules: BTreeSet<Names> = texts.keys().cloned().collect();
        let mut house = Self { modules, handed_on: BTreeMap::new(), used: Vec::new() };
        for (module, text) in &texts {
            let [handed_on, used] = paths(text);
            for path in handed_on {
                let Some(full) = house.full(module, &path) else { continue };
                let name = [module.clone(), path[path.len() - 1..].to_vec()].concat();
                house.handed_on.insert(name, full.clone());
                house.used.push((module.clone(), full));
            }
            let full = used.iter().filter_map(|path| house.full(module, path)).collect::<Vec<_>>();
            house.used.extend(full.into_iter().map(|path| (module.clone(), path)));
        }
        house
    }

    /// A path from the crate's top; none when it leads to another crate.
    fn full(&self, module: &Names, path: &Names) -> Option<Names> {
        let ups = path.iter().take_while(|name| *name == "super").count();
        let (from, rest) = match path[0].as_str() {
            "crate" => (&[][..], &path[1..]),
            "self" => (&module[..], &path[1..]),
            "super" => (&module[..module.len().checked_sub(ups)?], &path[ups..]),
            first if self.modules.contains(&[module.clone(), vec![first.to_owned()]].concat()) => {
                (&module[..], &path[..])
            }
            _ => return None,
        };
        Some([from, rest].concat())
    }

    /// The module in which something lies.
    fn module_of(&self, path: &[String], steps: usize) -> Names {
        let length = (0..=path.len()).rev().find(|length| self.modules.contains(&path[..*length])).unwrap_or(0);
        match self.handed_on.get(&path[..path.len().min(length + 1)]) {
            Some(other) if length < path.len() && steps < 8 => {
                self.module_of(&[other, &path[length + 1..]].concat(), steps + 1)
            }
            _ => path[..length].to_vec(),
        }
    }

    /// Which module uses which: of two modules their different ancestors under the same parent. A parent and its
    /// children are one thing.
    fn edges(&self) -> BTreeMap<Names, BTreeSet<Names>> {
        let mut edges: BTreeMap<Names, BTreeSet<Names>> = BTreeMap::new();
        for (user, path) in &self.used {
            let used = self.module_of(path, 0);
            let same = user.iter().zip(&used).take_while(|(a, b)| a == b).count();
            if same < user.len() && same < used.len() {
                edges.entry(user[..=same].to_vec()).or_default().insert(used[..=same].to_vec());
            }
        }
        edges
    }
}

/// Everything that can be reached from `start`.
fn reached(edges: &BTreeMap<Names, BTreeSet<Names>>, start: &Names) -> BTreeSet<Names> {
    let (mut met, mut open) = (BTreeSet::new(), vec![start]);
    while let Some(next) = open.pop() {
        open.extend(edges.get(next).into_iter().flatten().filter(|module| met.insert((*module).clone())));
    }
    met
}

/// The crates, by name.
fn crates() -> Vec<(String, PathBuf)> {
    let folders = fs::read_dir(root().join("crates")).unwrap().map(|entry| entry.unwrap().path());
    let mut crates: Vec<_> =
        folders.map(|path| (path.file_name().unwrap().to_str().unwrap().to_owned(), path)).collect();
    crates.sort();
    crates
}

#[test]
fn no_two_modules_use_each_other() {
    let mut circles = Vec::new();
    let mut seen = 0;
    for (name, folder) in crates() {
        let edges = House::new(&folder.join("src")).edges();
        seen += edges.values().map(BTreeSet::len).sum::<usize>();
        let circle = edges.keys().filter(|module| reached(&edges, module).contains(*module));
        circles.extend(circle.map(|module| format!("{name}: {}", module.join("::"))));
    }
    assert!(seen > 300, "{seen} uses prove little");
    assert!(circles.is_empty(), "in circles: {circles:#?}");
}

/// Rooms of one floor that know each other, as ARCHITECTURE.md says.
const SAME_FLOOR: [(&str, &str); 3] =
    [("farsight-eval", "farsight-data"), ("farsight-viz", "farsight-data"), ("farsight-testing", "farsight-files")];

#[test]
fn rooms_use_rooms_of_lower_floors() {
    let plan = fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    let mut floors = BTreeMap::new();
    let mut floor = None;
    for line in plan.lines().skip_while(|line| !line.starts_with(" floor")).take_while(|line| !line.starts_with("```"))
    {
        floor = line.split_whitespace().next().and_then(|word| word.parse::<u32>().ok()).or(floor);
        let rooms = line.split_whitespace().filter(|word| word.starts_with("farsight"));
        floors.extend(rooms.filter_map(|room| Some((room.to_owned(), floor?))));
    }
    assert!(floors.len() > 10, "{floors:?}");
    let unplaced: Vec<_> =
        crates().into_iter().map(|(name, _)| name).filter(|name| !floors.contains_key(name)).collect();
    assert!(unplaced.is_empty(), "not in the picture of ARCHITECTURE.md: {unplaced:?}");
    for (name, folder) in crates() {
        let floor = &floors[&name];
        let manifest = fs::read_to_string(folder.join("Cargo.toml")).unwrap();
        let section = manifest.split("[dependencies]").nth(1).unwrap_or_default().split("\n[").next().unwrap();
        for used in section.lines().filter_map(|line| line.split(['=', '.', ' ']).next()) {
            let Some(below) = floors.get(used) else { continue };
            let is_known = SAME_FLOOR.contains(&(name.as_str(), used));
            assert!(below < floor || is_known, "{name} on floor {floor} uses {used} on floor {below}");
        }
    }
}

/// Lines of comments, of prose, of configs and of scripts have at most so many characters. Code in Rust is rustfmt's.
const COLUMNS: usize = 120;

/// Endings of files of which every line counts.
const WHOLE: [&str; 5] = ["md", "toml", "js", "mjs", "sh"];

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        // What is built, run or installed here is no source.
        let is_other = ["target", "node_modules", "corpus", "artifacts"].iter().any(|name| path.ends_with(name));
        if path.is_dir() && !is_other {
            sources(&path, found);
        } else if ending(&path) == "rs" || WHOLE.contains(&ending(&path)) {
            found.push(path);
        }
    }
}

fn ending(path: &Path) -> &str {
    path.extension().and_then(|end| end.to_str()).unwrap_or_default()
}

/// Whether a long line is one that cannot be broken: a row of a table, or what `farsight measure` reads.
fn is_one_piece(line: &str) -> bool {
    line.starts_with('|') || line.starts_with("<!--")
}

#[test]
fn comments_prose_configs_and_scripts_have_at_most_120_columns() {
    let mut files: Vec<PathBuf> = Vec::new();
    for folder in ["crates", "xtask", "docs", "models", "configs", "scripts", "fuzz", "tests", "assets"] {
        sources(&root().join(folder), &mut files);
    }
    let top = fs::read_dir(root()).unwrap().map(|entry| entry.unwrap().path());
    files.extend(top.filter(|path| path.is_file() && WHOLE.contains(&ending(path))));
    assert!(files.len() > 600, "{}", files.len());
    let mut long = Vec::new();
    for file in files {
        let text = fs::read_to_string(&file).unwrap();
        let is_whole = WHOLE.contains(&ending(&file));
        for (line, number) in text.lines().zip(1..) {
            let is_told = is_whole || line.trim_start().starts_with("//");
            let is_table = ending(&file) == "md" && is_one_piece(line);
            if is_told && !is_table && line.chars().count() > COLUMNS {
                long.push(format!("{}:{number}", file.display()));
            }
        }
    }
    assert!(long.is_empty(), "longer than {COLUMNS} columns: {long:#?}");
}

/// Whether a name is like a pattern, in which a `*` stands for anything.
fn is_like(name: &str, pattern: &str) -> bool {
    let Some((start, rest)) = pattern.split_once('*') else { return name == pattern };
    let Some(name) = name.strip_prefix(start) else { return false };
    name.char_indices().map(|(at, _)| at).chain([name.len()]).any(|at| is_like(&name[at..], rest))
}

/// Whether docker gets a file to build from: of the rules of `.dockerignore` that are about it, or about a folder above
/// it, the last one counts.
fn is_kept(rules: &str, file: &Path) -> bool {
    let names: Vec<&str> = file.iter().map(|name| name.to_str().unwrap()).collect();
    let is_about = |rule: &str| {
        let patterns: Vec<&str> = rule.split('/').collect();
        patterns.len() <= names.len() && patterns.iter().zip(&names).all(|(pattern, name)| is_like(name, pattern))
    };
    let rules = rules.lines().map(str::trim).filter(|rule| !rule.is_empty() && !rule.starts_with('#'));
    rules.fold(true, |is_kept, rule| match rule.strip_prefix('!') {
        Some(kept) => is_kept || is_about(kept),
        None => is_kept && !is_about(rule),
    })
}

/// The links below a folder of the workspace and what they lead to, both from its top.
fn links(top: &Path, folder: &Path, found: &mut Vec<[PathBuf; 2]>) {
    for entry in fs::read_dir(top.join(folder)).unwrap() {
        let path = folder.join(entry.unwrap().file_name());
        let kind = fs::symlink_metadata(top.join(&path)).unwrap().file_type();
        if kind.is_symlink() {
            let leads_to =
                fs::canonicalize(top.join(&path)).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
            let leads_to = leads_to.strip_prefix(top).unwrap().to_owned();
            found.push([path, leads_to]);
        } else if kind.is_dir() {
            links(top, &path, found);
        }
    }
}

#[test]
fn docker_gets_whatever_links_lead_to() {
    let top = fs::canonicalize(root()).unwrap();
    let rules = fs::read_to_string(top.join(".dockerignore")).unwrap();
    let mut found = Vec::new();
    links(&top, Path::new("crates"), &mut found);
    assert!(found.iter().any(|[link, _]| link.ends_with("farsight-w.safetensors")), "{found:?}");
    let lost: Vec<_> = found.iter().filter(|[_, leads_to]| !is_kept(&rules, leads_to)).collect();
    assert!(lost.is_empty(), "docker builds without what these lead to: {lost:?}");
    // A start of a training is not for the program.
    for left_out in ["target/debug/farsight", "docs/demo.png", "models/claim-start.safetensors"] {
        assert!(!is_kept(&rules, Path::new(left_out)), "{left_out}");
    }
}
