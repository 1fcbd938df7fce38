//! The plan of an experiment: a TOML file.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use farsight::shipped::Family;
use farsight_files::read_config;
use farsight_methods::patch::lay_over;
use serde::Deserialize;
use toml::{Table, Value};

use super::{Metric, RangerName};

/// No plan has more cells: a few days of a machine each.
const MAX_CELLS: usize = 10_000;

/// More resamples than anybody waits for.
const MAX_RESAMPLES: usize = 1_000_000;

/// In a plan: another one, relative to its folder, over which this one is laid. Lists are replaced as a whole.
const EXTENDS: &str = "extends";

/// An experiment as its file has it.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Experiment {
    /// Name, which its folder and result file have.
    pub(crate) name: String,
    pub(crate) data: Data,
    /// The training config that all arms share.
    base: Table,
    /// By their names.
    arms: BTreeMap<String, Arm>,
    /// What is run, one block after the other.
    blocks: Vec<Block>,
    pub(crate) endpoints: Endpoints,
    pub(crate) comparisons: Vec<PlannedComparison>,
}

/// Where the frames come from. Splits are names under `ImageSets`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Data {
    /// What arms learn from.
    pub(crate) train: String,
    /// What they are judged on.
    pub(crate) evaluate: String,
    /// Seed of the worlds around rendered twins.
    #[serde(default)]
    pub(crate) twin_seed: u64,
    /// Take the last so many frames of `train` away from learning, and judge on these instead of another split;
    /// `evaluate` then is `train`, too.
    #[serde(default)]
    pub(crate) held_out: usize,
    /// Judge on so many frames, evenly over those of the split, instead of all.
    pub(crate) evaluate_frames: Option<usize>,
}

/// What makes an arm differ from the base.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Arm {
    /// What tables call it.
    title: String,
    /// Laid over the base, table by table.
    #[serde(default)]
    patch: Table,
    /// Go on from the model that this arm's cell of the same seed ends with.
    after: Option<String>,
    /// With `ranger`, instead of a training: the arm whose answers of the same seed get other distances.
    of: Option<String>,
    /// What these distances are by.
    ranger: Option<RangerName>,
    /// Instead of a training: the name of a shipped model, which answers with all that follows it.
    shipped: Option<String>,
    /// Answers with a lower score are not kept, as records grow by them.
    min_score: Option<f64>,
}

impl Arm {
    fn is_trained(&self) -> bool {
        self.ranger.is_none() && self.shipped.is_none()
    }

    fn shipped(&self) -> Option<Family> {
        Family::ALL.into_iter().find(|family| Some(family.name()) == self.shipped.as_deref())
    }
}

/// Where the answers of a cell come from.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(not(feature = "train"), allow(dead_code, reason = "cells are run by a build that can train"))]
pub(crate) enum Work {
    /// A training.
    Training,
    /// The answers of another cell, with the distances of a ranger.
    Ranging { of: Cell, by: RangerName },
    /// A shipped model.
    Shipped(Family),
}

/// Arms that are run with the same seeds.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Block {
    arms: Vec<String>,
    seeds: Vec<u64>,
}

/// By what arms are judged. Fixed before the first cell.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Endpoints {
    pub(crate) primary: Vec<Metric>,
    #[serde(default)]
    pub(crate) secondary: Vec<Metric>,
    /// With fewer seeds there is an interval but no verdict.
    pub(crate) least_seeds: usize,
    #[serde(default = "default_resamples")]
    pub(crate) resamples: usize,
}

impl Endpoints {
    /// The primary ones, then the others.
    pub(crate) fn all(&self) -> impl Iterator<Item = Metric> {
        self.primary.iter().chain(&self.secondary).copied()
    }
}

fn default_resamples() -> usize {
    2000
}

/// One arm against another.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PlannedComparison {
    pub(crate) arm: String,
    pub(crate) against: String,
    /// By how much the paper says that the arm is better, in the units of the metric.
    #[serde(default)]
    pub(crate) claims: BTreeMap<Metric, f64>,
    /// The same as shares of what the other arm has.
    #[serde(default)]
    pub(crate) relative_claims: BTreeMap<Metric, f64>,
}

/// One arm with one seed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Cell {
    pub(crate) arm: String,
    pub(crate) seed: u64,
}

impl Cell {
    /// Name of its folder.
    pub(crate) fn name(&self) -> String {
        format!("{}-{}", self.arm, self.seed)
    }
}

impl Experiment {
    /// The plan in the file at `path`.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let shown = path.display();
        let mut plan = table(path)?;
        if let Some(other) = plan.remove(EXTENDS) {
            let other = other.as_str().with_context(|| format!("{shown}: {EXTENDS} is {other}; expected a file"))?;
            let other = path.parent().unwrap_or(Path::new("")).join(other);
            let mut whole = table(&other).with_context(|| format!("{shown}: {EXTENDS}"))?;
            ensure!(!whole.contains_key(EXTENDS), "{shown}: {EXTENDS} is {}, which extends another", other.display());
            lay_over(&mut whole, &plan);
            plan = whole;
        }
        let experiment: Self = plan.try_into().with_context(|| format!("{shown}: no plan of an experiment"))?;
        experiment.check().with_context(|| shown.to_string())?;
        Ok(experiment)
    }

    fn check(&self) -> Result<()> {
        let is_name = |text: &str| !text.is_empty() && text.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
        ensure!(is_name(&self.name), "name is \"{}\"; expected letters, digits and _", self.name);
        if let Some(name) = self.arms.keys().find(|name| !is_name(name)) {
            bail!("an arm is called \"{name}\"; expected letters, digits and _");
        }
        self.arms.iter().try_for_each(|(name, arm)| self.check_arm(name, arm))?;
        let known = |arm: &String, place: &str| {
            ensure!(self.arms.contains_key(arm), "{place} names the arm \"{arm}\"; expected one of [arms]");
            Ok(())
        };
        for block in &self.blocks {
            ensure!(!block.arms.is_empty() && !block.seeds.is_empty(), "a block has no arms or no seeds");
            block.arms.iter().try_for_each(|arm| known(arm, "blocks"))?;
        }
        // Counted before they are made: a short file can ask for any number.
        let count = self
            .blocks
            .iter()
            .fold(0_usize, |sum, block| sum.saturating_add(block.arms.len().saturating_mul(block.seeds.len())));
        ensure!(count > 0, "blocks is empty; expected at least one");
        ensure!(count <= MAX_CELLS, "blocks has {count} cells; expected at most {MAX_CELLS}");
        let mut met = BTreeSet::new();
        for cell in self.cells() {
            let needs = match self.work(&cell) {
                Work::Ranging { of, .. } => Some((of, "whose answers it ranges")),
                _ => self.before(&cell).map(|before| (before, "after which it goes on")),
            };
            if let Some((other, why)) = needs {
                let is_there = met.contains(&(other.arm.clone(), other.seed));
                let (cell, other) = (cell.name(), other.name());
                ensure!(is_there, "blocks has the cell {cell} and not {other} before it, {why}");
            }
            ensure!(met.insert((cell.arm.clone(), cell.seed)), "blocks has the cell {} twice", cell.name());
        }
        for comparison in &self.comparisons {
            known(&comparison.arm, "comparisons")?;
            known(&comparison.against, "comparisons")?;
            ensure!(comparison.arm != comparison.against, "comparisons compares {} with itself", comparison.arm);
        }
        ensure!(self.endpoints.least_seeds > 0, "endpoints.least_seeds is 0; expected at least 1");
        let resamples = self.endpoints.resamples;
        ensure!(
            (1..=MAX_RESAMPLES).contains(&resamples),
            "endpoints.resamples is {resamples}; expected 1 to {MAX_RESAMPLES}"
        );
        let Data { train, evaluate, held_out, .. } = &self.data;
        for (field, split) in [("train", train), ("evaluate", evaluate)] {
            let is_file_name = !split.is_empty() && !split.contains(['/', '\\']);
            ensure!(is_file_name, "data.{field} is \"{split}\"; expected the name of a split in ImageSets");
        }
        ensure!(
            *held_out == 0 || train == evaluate,
            "data.held_out needs evaluate to be the split that is learnt from"
        );
        for (table, field) in
            [("data", "root"), ("data", "split"), ("data", "limit"), ("data", "rendered"), ("train", "seed")]
        {
            let is_there = |config: &Table| config.get(table).and_then(|table| table.get(field)).is_some();
            let is_there = is_there(&self.base) || self.arms.values().any(|arm| is_there(&arm.patch));
            ensure!(!is_there, "{table}.{field} is the experiment's to say; expected none in base and arms");
        }
        let in_parts = |config: &Table| config.contains_key("parts");
        let in_parts = in_parts(&self.base) || self.arms.values().any(|arm| in_parts(&arm.patch));
        ensure!(!in_parts, "parts in base or an arm; a cell of an experiment is one training, expected none");
        Ok(())
    }

    /// An arm is a training, or one of the two other kinds and nothing of a training.
    fn check_arm(&self, name: &str, arm: &Arm) -> Result<()> {
        let Arm { patch, after, of, ranger, shipped, min_score, .. } = arm;
        if let Some(score) = min_score {
            ensure!((0.0..=1.0).contains(score), "arms.{name}.min_score is {score}; expected 0 to 1");
            ensure!(
                ranger.is_none(),
                "arms.{name} has min_score and ranger; expected the score at the arm that it is of"
            );
        }
        if let Some(shipped) = shipped {
            let known = Family::ALL.map(Family::name).join(", ");
            ensure!(arm.shipped().is_some(), "arms.{name}.shipped is \"{shipped}\"; expected one of {known}");
        }
        ensure!(
            of.is_some() == ranger.is_some(),
            "arms.{name} has one of of and ranger; expected both, or none of them"
        );
        if let Some(of) = of {
            let is_trained = self.arms.get(of).is_some_and(Arm::is_trained);
            ensure!(is_trained, "arms.{name}.of is \"{of}\"; expected an arm that is trained");
        }
        if let Some(after) = after {
            ensure!(arm.is_trained(), "arms.{name} has after and is not trained; expected none");
            let before = self.arms.get(after).filter(|before| before.is_trained() && before.after.is_none());
            ensure!(
                before.is_some(),
                "arms.{name}.after is \"{after}\"; expected an arm that is trained, and after no other one"
            );
        }
        let kinds = [!patch.is_empty(), ranger.is_some(), shipped.is_some()];
        let kinds = kinds.into_iter().filter(|is_it| *is_it).count();
        ensure!(kinds <= 1, "arms.{name} has more than one of patch, ranger and shipped; expected one");
        if arm.is_trained() { self.check_method(name, arm) } else { Ok(()) }
    }

    /// Arms may be of several methods, but no arm may inherit the fields of another one's.
    fn check_method(&self, name: &str, arm: &Arm) -> Result<()> {
        let method = |config: &Table| config.get("method").and_then(Value::as_str).map(str::to_owned);
        let (base, own) = (method(&self.base), method(&arm.patch));
        let Some(found) = own.as_ref().or(base.as_ref()) else {
            bail!("arms.{name} has no method; expected one in its patch or in [base]");
        };
        // Without a method in the base, what its tables are of is anybody's guess.
        let is_other = base.as_ref() != Some(found);
        if let Some(table) = ["model", "task"].into_iter().find(|table| is_other && self.base.contains_key(*table)) {
            let base = base.as_ref().map_or("no method".to_owned(), |base| format!("\"{base}\""));
            let expected = "expected that table in the arms";
            bail!("arms.{name} is of \"{found}\" and inherits base.{table}, which is of {base}; {expected}");
        }
        Ok(())
    }

    /// Every cell in the order in which they are run: block by block, by seed, then arm, so that after any seed all
    /// arms of a block have as many.
    pub(crate) fn cells(&self) -> Vec<Cell> {
        let of_block = |block: &Block| {
            let cell = |seed: u64| block.arms.iter().map(move |arm| Cell { arm: arm.clone(), seed });
            block.seeds.iter().flat_map(|seed| cell(*seed)).collect::<Vec<_>>()
        };
        self.blocks.iter().flat_map(of_block).collect()
    }

    /// What tables call an arm.
    pub(crate) fn title<'a>(&'a self, arm: &'a str) -> &'a str {
        self.arms.get(arm).map_or(arm, |arm| &arm.title)
    }

    /// The names of arms in the order in which they are first run.
    pub(crate) fn arms(&self) -> Vec<String> {
        let mut arms: Vec<String> = Vec::new();
        for cell in self.cells() {
            if !arms.contains(&cell.arm) {
                arms.push(cell.arm);
            }
        }
        arms
    }

    /// Where the answers of a cell come from.
    pub(crate) fn work(&self, cell: &Cell) -> Work {
        let Some(arm) = self.arms.get(&cell.arm) else { return Work::Training };
        if let Some(family) = arm.shipped() {
            return Work::Shipped(family);
        }
        match (&arm.of, arm.ranger) {
            (Some(of), Some(by)) => Work::Ranging { of: Cell { arm: of.clone(), seed: cell.seed }, by },
            _ => Work::Training,
        }
    }

    /// The cell with whose model the training of `cell` begins, if it goes on from one.
    pub(crate) fn before(&self, cell: &Cell) -> Option<Cell> {
        let after = self.arms.get(&cell.arm)?.after.as_ref()?;
        Some(Cell { arm: after.clone(), seed: cell.seed })
    }

    /// The least score of a cell's answers, where the plan says it.
    pub(crate) fn min_score(&self, cell: &Cell) -> Option<f64> {
        self.arms.get(&cell.arm)?.min_score
    }

    /// The training config of a cell, without its data.
    pub(crate) fn config(&self, cell: &Cell) -> Table {
        let mut config = self.base.clone();
        if let Some(arm) = self.arms.get(&cell.arm) {
            lay_over(&mut config, &arm.patch);
        }
        set(&mut config, "train", "seed", Value::Integer(i64::try_from(cell.seed).unwrap_or(i64::MAX)));
        config
    }

    /// The weights of other programs that the arms start from, where they do.
    pub(crate) fn start_files(&self) -> Vec<PathBuf> {
        let cells = self.cells().into_iter();
        let begun = cells.filter(|cell| self.work(cell) == Work::Training && self.before(cell).is_none());
        let mut files: Vec<PathBuf> =
            begun.filter_map(|cell| start_of(&self.config(&cell)).map(PathBuf::from)).collect();
        files.sort();
        files.dedup();
        files
    }
}

/// The file that a training config starts from, if it starts from any.
pub(crate) fn start_of(config: &Table) -> Option<&str> {
    config.get("train")?.get("start_from")?.as_str()
}

/// What stands in the TOML file at `path`.
fn table(path: &Path) -> Result<Table> {
    let shown = path.display();
    let text = read_config(path).with_context(|| format!("{shown}: cannot be read"))?;
    toml::from_str(&text).with_context(|| format!("{shown}: no plan of an experiment"))
}

/// Puts `value` into a table of `config`, which is made when it is missing.
pub(crate) fn set(config: &mut Table, table: &str, field: &str, value: Value) {
    let table = config.entry(table).or_insert_with(|| Value::Table(Table::new()));
    if let Value::Table(table) = table {
        table.insert(field.to_owned(), value);
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use farsight_graph::count::{count, total};
    use farsight_graph::init::initial_weights;
    use farsight_graph::model::NetworkConfig;
    use farsight_methods::description::Description;
    use farsight_methods::smoke::SmokeConfig;

    use super::*;

    const PLAN: &str = r#"
name = "two"
data = { train = "train", evaluate = "val" }
endpoints = { primary = ["ap3d"], least_seeds = 2, resamples = 9 }

[base]
method = "smoke"
model = { width = 0.5, heatmap = { rule = "corner_net", min_overlap = 0.7 } }

[arms.a]
title = "plain"

[arms.b]
title = "other"
patch.model = { heatmap = { rule = "fixed", radius = 1.0 }, msfe = "a" }

[[blocks]]
arms = ["a", "b"]
seeds = [1, 2]

[[blocks]]
arms = ["b"]
seeds = [3]

[[comparisons]]
arm = "b"
against = "a"
claims = { ap3d = 0.56 }
"#;

    fn read(text: &str) -> Result<Experiment> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plan.toml");
        fs::write(&path, text).unwrap();
        Experiment::read(&path)
    }

    #[test]
    fn cells_come_by_block_seed_and_arm() {
        let names: Vec<String> = read(PLAN).unwrap().cells().iter().map(Cell::name).collect();
        assert_eq!(names, ["a-1", "b-1", "a-2", "b-2", "b-3"]);
    }

    #[test]
    fn a_patch_joins_tables_and_replaces_rules() {
        let plan = read(PLAN).unwrap();
        let config = |arm: &str| plan.config(&Cell { arm: arm.to_owned(), seed: 7 });
        assert_eq!(config("a")["model"]["heatmap"]["rule"].as_str(), Some("corner_net"));
        let patched = config("b");
        assert_eq!(patched["model"]["width"].as_float(), Some(0.5));
        assert_eq!(patched["model"]["msfe"].as_str(), Some("a"));
        assert_eq!(patched["model"]["heatmap"].as_table().unwrap().len(), 2, "nothing is left of the other rule");
        assert_eq!(patched["train"]["seed"].as_integer(), Some(7));
    }

    #[test]
    fn a_plan_is_laid_over_the_one_that_it_extends() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| {
            let path = folder.path().join(name);
            fs::write(&path, text).unwrap();
            path
        };
        write("first.toml", PLAN);
        let path = write(
            "second.toml",
            "name = \"longer\"\nextends = \"first.toml\"\nbase.train.epochs = 4\n\
             [[blocks]]\narms = [\"a\"]\nseeds = [9]\n",
        );
        let plan = Experiment::read(&path).unwrap();
        let cells: Vec<String> = plan.cells().iter().map(Cell::name).collect();
        assert_eq!((plan.name.as_str(), cells), ("longer", vec!["a-9".to_owned()]));
        let config = plan.config(&plan.cells()[0]);
        assert_eq!(config["train"]["epochs"].as_integer(), Some(4));
        assert_eq!(config["model"]["width"].as_float(), Some(0.5), "what is not replaced stays");

        let third = write("third.toml", "extends = \"second.toml\"\n");
        let error = format!("{:#}", Experiment::read(&third).unwrap_err());
        assert!(error.contains("third.toml") && error.contains("which extends another"), "{error}");
        let error = format!("{:#}", Experiment::read(&write("none.toml", "extends = \"missing.toml\"\n")).unwrap_err());
        assert!(error.contains("missing.toml: cannot be read"), "{error}");
        let error = format!("{:#}", Experiment::read(&write("number.toml", "extends = 3\n")).unwrap_err());
        assert!(error.contains("extends is 3; expected a file"), "{error}");
    }

    #[test]
    fn answers_come_from_trainings_rangers_and_shipped_models() {
        let text = PLAN
            .replace("[[comparisons]]", "[[blocks]]\narms = [\"d\", \"c\"]\nseeds = [2]\n\n[[comparisons]]")
            .replace("[[blocks]]\narms = [\"a\"", "[arms.c]\ntitle = \"c\"\nof = \"a\"\nranger = \"box_mlp\"\n\n[arms.d]\ntitle = \"d\"\nshipped = \"farsight-w\"\n\n[[blocks]]\narms = [\"a\"");
        let plan = read(&text).unwrap();
        let cell = |arm: &str| Cell { arm: arm.to_owned(), seed: 2 };
        assert_eq!(plan.work(&cell("a")), Work::Training);
        assert_eq!(plan.work(&cell("c")), Work::Ranging { of: cell("a"), by: RangerName::BoxMlp });
        assert_eq!(plan.work(&cell("d")), Work::Shipped(Family::FarsightW));
    }

    #[test]
    fn plans_that_cannot_be_run_are_told() {
        let table = [
            ("name = \"two\"", "name = \"a/b\"", "name is \"a/b\"; expected letters, digits and _"),
            ("seeds = [3]", "seeds = [2]", "blocks has the cell b-2 twice"),
            ("arms = [\"b\"]", "arms = [\"c\"]", "blocks names the arm \"c\"; expected one of [arms]"),
            ("against = \"a\"", "against = \"b\"", "comparisons compares b with itself"),
            (
                "method = \"smoke\"",
                "method = \"smoke\"\ntrain = { seed = 1 }",
                "train.seed is the experiment's to say; expected none in base and arms",
            ),
            (
                "method = \"smoke\"",
                "method = \"smoke\"\nparts = [{ name = \"first\" }]",
                "parts in base or an arm; a cell of an experiment is one training, expected none",
            ),
            ("least_seeds = 2", "least_seeds = 0", "endpoints.least_seeds is 0; expected at least 1"),
            (
                "train = \"train\"",
                "train = \"../train\"",
                "data.train is \"../train\"; expected the name of a split in ImageSets",
            ),
            ("title = \"plain\"", "title = \"plain\"\nmin_score = 1.5", "arms.a.min_score is 1.5; expected 0 to 1"),
            (
                "title = \"plain\"",
                "title = \"plain\"\nof = \"b\"\nranger = \"guidance\"\nmin_score = 0.1",
                "arms.a has min_score and ranger; expected the score at the arm that it is of",
            ),
            ("method = \"smoke\"", "", "arms.a has no method; expected one in its patch or in [base]"),
            (
                "patch.model = {",
                "patch.method = \"monodle\"\npatch.model = {",
                "arms.b is of \"monodle\" and inherits base.model, which is of \"smoke\"; expected that table in the arms",
            ),
            ("resamples = 9", "resamples = 1000001", "endpoints.resamples is 1000001; expected 1 to 1000000"),
            (
                "[arms.a]",
                "[arms.c]\ntitle = \"c\"\nof = \"a\"\n\n[arms.a]",
                "arms.c has one of of and ranger; expected both, or none of them",
            ),
            (
                "[arms.a]\ntitle = \"plain\"",
                "[arms.a]\ntitle = \"plain\"\nof = \"c\"\nranger = \"guidance\"",
                "arms.a.of is \"c\"; expected an arm that is trained",
            ),
            (
                "[arms.a]\ntitle = \"plain\"",
                "[arms.a]\ntitle = \"plain\"\nafter = \"b\"",
                "blocks has the cell a-1 and not b-1 before it, after which it goes on",
            ),
            (
                "[arms.a]\ntitle = \"plain\"",
                "[arms.a]\ntitle = \"plain\"\nafter = \"a\"",
                "arms.a.after is \"a\"; expected an arm that is trained, and after no other one",
            ),
            (
                "[arms.a]\ntitle = \"plain\"",
                "[arms.a]\ntitle = \"plain\"\nafter = \"b\"\nshipped = \"farsight-w\"",
                "arms.a has after and is not trained; expected none",
            ),
            (
                "[arms.a]\ntitle = \"plain\"",
                "[arms.a]\ntitle = \"plain\"\nshipped = \"farsight-x\"",
                "arms.a.shipped is \"farsight-x\"; expected one of farsight-w, farsight-s, farsight-n",
            ),
            (
                "[arms.b]\ntitle = \"other\"",
                "[arms.b]\ntitle = \"other\"\nshipped = \"farsight-w\"",
                "arms.b has more than one of patch, ranger and shipped; expected one",
            ),
            (
                "[arms.a]\ntitle = \"plain\"",
                "[arms.a]\ntitle = \"plain\"\nof = \"b\"\nranger = \"guidance\"",
                "blocks has the cell a-1 and not b-1 before it, whose answers it ranges",
            ),
        ];
        for (old, new, expected) in table {
            let error = format!("{:#}", read(&PLAN.replace(old, new)).unwrap_err());
            assert!(error.ends_with(expected), "{error}");
        }
        assert!(format!("{:#}", read(&PLAN.replace("ap3d = 0.56", "apd = 1")).unwrap_err()).contains("apd"));
    }

    #[test]
    fn cells_are_counted_before_they_are_made() {
        let many = |word: &str| vec![word; 100_000].join(", ");
        let text = PLAN.replace("arms = [\"b\"]", &format!("arms = [{}]", many("\"b\"")));
        let error = read(&text.replace("seeds = [3]", &format!("seeds = [{}]", many("3")))).unwrap_err();
        assert!(format!("{error:#}").ends_with("blocks has 10000000004 cells; expected at most 10000"), "{error:#}");
    }

    /// A plan of the project.
    fn plan(name: &str) -> Experiment {
        Experiment::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/experiments").join(name)).unwrap()
    }

    #[test]
    fn the_claim_has_35_cells_and_a_first_verdict_after_15() {
        let plan = plan("claim.toml");
        let cells = plan.cells();
        assert_eq!(cells.len(), 35);
        for arm in ["smoke", "clff", "dgh", "both", "corner_floor"] {
            assert_eq!(cells[..15].iter().filter(|cell| cell.arm == arm).count(), 3, "{arm}");
        }
        for arm in ["smoke", "clff", "dgh", "both"] {
            assert_eq!(cells.iter().filter(|cell| cell.arm == arm).count(), 5, "{arm}");
        }
        assert_eq!(self::plan("alpha.toml").cells().len(), 10);
    }

    #[test]
    fn arms_differ_in_msfe_and_heatmap_alone_and_begin_with_the_same_weights() {
        for plan in [plan("claim.toml"), plan("alpha.toml")] {
            let config = |arm: &str| plan.config(&Cell { arm: arm.to_owned(), seed: 2 });
            let model = |arm: &str| config(arm)["model"].clone().try_into::<SmokeConfig>().unwrap();
            let arms = plan.arms();
            let begun = |arm: &str| initial_weights(&model(arm).graph(), 2).tensors;
            let (base, base_weights) = (config(&arms[0]), begun(&arms[0]));
            for arm in &arms {
                assert!(model(arm).validate().is_ok(), "{arm}");
                let mut same = config(arm);
                for field in ["msfe", "heatmap"] {
                    set(&mut same, "model", field, base["model"][field].clone());
                }
                // What starts anew has to be there; which part that is follows from the network.
                if let Some(anew) = config(arm)["train"].get("start_without") {
                    let prefixes: Vec<String> = anew.clone().try_into().unwrap();
                    let is_there = |prefix: &String| begun(arm).keys().any(|name| name.starts_with(prefix.as_str()));
                    assert!(prefixes.iter().all(is_there), "{arm}: {prefixes:?}");
                    set(&mut same, "train", "start_without", base["train"]["start_without"].clone());
                }
                assert_eq!(same, base, "{arm}: the same but for two fields, the order of frames (train.seed) included");
                let weights = begun(arm);
                assert!(base_weights.iter().all(|(name, tensor)| weights[name] == *tensor), "{arm}");
                let own = weights.keys().filter(|name| !base_weights.contains_key(*name));
                assert!(own.into_iter().all(|name| name.starts_with("backbone.body.msfe.")), "{arm}");
            }
        }
    }

    #[test]
    fn backbones_name_parts_of_their_networks_and_go_on_after_another_arm() {
        let plan = plan("backbones.toml");
        for arm in plan.arms() {
            let config = plan.config(&Cell { arm: arm.clone(), seed: 1 });
            let model = config["model"].clone().try_into::<SmokeConfig>().unwrap();
            model.validate().unwrap();
            let graph = model.graph();
            let is_there = |prefix: &str| graph.parameters.iter().any(|part| part.name.starts_with(prefix));
            for field in ["start_without", "freeze"] {
                let prefixes = config["train"].get(field).map(|prefixes| prefixes.clone().try_into::<Vec<String>>());
                let prefixes = prefixes.transpose().unwrap().unwrap_or_default();
                assert!(prefixes.iter().all(|prefix| is_there(prefix)), "{arm}: {prefixes:?}");
            }
            let factors = config["train"].get("rate_factors").and_then(Value::as_table);
            assert!(factors.is_none_or(|factors| factors.keys().all(|prefix| is_there(prefix))), "{arm}");
        }
        let before = plan.before(&Cell { arm: "then_slow".to_owned(), seed: 1 });
        assert_eq!(before, Some(Cell { arm: "first".to_owned(), seed: 1 }));
    }

    /// Multiply-accumulates of an arm's network, and its method.
    fn cost(plan: &Experiment, arm: &str) -> (String, u64) {
        let config = plan.config(&Cell { arm: arm.to_owned(), seed: 1 });
        let (method, model) = (config["method"].as_str().unwrap(), config["model"].as_table().unwrap().clone());
        let Description { graph, input: [width, height], .. } = Description::of_table(method, model).unwrap().unwrap();
        (method.to_owned(), total(&count(&graph, width, height).unwrap()).macs)
    }

    #[test]
    fn table_1_has_arms_named_by_method_at_equal_cost() {
        let plan = plan("table1.toml");
        let (_, smoke) = cost(&plan, "smoke");
        let is_trained = |arm: &String| plan.work(&Cell { arm: arm.clone(), seed: 1 }) == Work::Training;
        let (trained, others): (Vec<String>, Vec<String>) = plan.arms().into_iter().partition(is_trained);
        assert_eq!(trained, ["oftnet", "gs3d", "monogrnet", "centernet3d", "monodle", "smoke", "smoke_imp"]);
        let rangers = RangerName::ALL.map(RangerName::word);
        assert_eq!(others, [&rangers[..], &["farsight_w"]].concat());
        for arm in &trained {
            let (method, macs) = cost(&plan, arm);
            assert!(arm == &method || arm == "smoke_imp", "{arm} is of {method}");
            let share = macs as f64 / smoke as f64;
            // MSFE is what improved SMOKE adds.
            let most = if arm == "smoke_imp" { 1.1 } else { 1.03 };
            assert!((0.97..=most).contains(&share), "{arm}: {macs} of {smoke}, {share:.3}");
        }
        let claim = self::plan("claim.toml");
        for (arm, same) in [("smoke", "smoke"), ("smoke_imp", "both")] {
            let model =
                |plan: &Experiment, arm: &str| plan.config(&Cell { arm: arm.to_owned(), seed: 1 })["model"].clone();
            assert_eq!(model(&plan, arm), model(&claim, same), "{arm} is that of claim.toml");
        }
        let metrics = |plan: &Experiment| [plan.endpoints.primary.clone(), plan.endpoints.secondary.clone()];
        assert_eq!(metrics(&plan), metrics(&claim));
    }
}
