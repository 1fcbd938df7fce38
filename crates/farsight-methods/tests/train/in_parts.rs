//! Trainings in parts.

use std::fs;
use std::path::Path;

use crate::tiny::{Silent, data_set, run_config};
use farsight_graph::weights::Weights;
use farsight_methods::smoke::SmokeModel;
use farsight_methods::training::train;
use farsight_train::training::FileOptions;

/// The last part would learn nothing: its model is what it started from.
const PARTS: &str = r#"
[[parts]]
name = "first"
train.epochs = 1

[[parts]]
name = "second"
train = { epochs = 2, seed = 9 }

[[parts]]
name = "third"
mean_of = ["first", "second"]
train = { epochs = 1, learning_rate = 1e-12, weight_decay = 0.0 }
"#;

/// The tiny run with these parts, and the model that comes out of it, or what is wrong.
fn trained(root: &Path, parts: &str, resume: bool) -> (Result<Weights, String>, usize) {
    let config = root.join("run.toml");
    fs::write(&config, toml::to_string(&run_config(root)).unwrap() + parts).unwrap();
    let options = FileOptions { data: None, out: root.join("out"), resume };
    let mut callback = Silent::default();
    let model = train(&config, &options, &mut callback).map_err(|error| error.to_string());
    (model.map(|path| weights(&path)), callback.losses.len())
}

fn weights(path: &Path) -> Weights {
    SmokeModel::read(path).unwrap().weights
}

/// The largest difference between parameters that learn.
fn difference(a: &Weights, b: &Weights) -> f32 {
    let learnt = a.tensors.iter().filter(|(name, _)| !name.contains("running"));
    let of = |name: &String, values: &[f32]| {
        values.iter().zip(&b.tensors[name].values).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    learnt.map(|(name, tensor)| of(name, &tensor.values)).fold(0.0, f32::max)
}

#[test]
fn each_part_goes_on_from_the_one_before_or_from_a_mean() {
    let folder = data_set(4);
    let root = folder.path();
    let (third, steps) = trained(root, PARTS, false);
    let third = third.unwrap();
    assert_eq!(steps, 8);
    let [first, second] = ["first", "second"].map(|part| weights(&root.join(format!("out/{part}/model.safetensors"))));
    assert!(difference(&first, &second) > 1e-4);
    assert!(difference(&first.mean_with(&second).unwrap(), &third) < 1e-6);
    let said = fs::read_to_string(root.join("out/second.toml")).unwrap();
    assert!(said.contains("out/first/model.safetensors") && said.contains("seed = 9"), "{said}");

    // A run that was killed after its second part, and one that is done.
    fs::remove_dir_all(root.join("out/third")).unwrap();
    let (again, steps) = trained(root, PARTS, true);
    assert_eq!((again.unwrap().tensors, steps), (third.tensors.clone(), 2));
    let (again, steps) = trained(root, PARTS, true);
    assert_eq!((again.unwrap().tensors, steps), (third.tensors, 0));
    let (refused, _) = trained(root, PARTS, false);
    assert!(refused.unwrap_err().contains("first"));
}

#[test]
fn parts_that_cannot_be_trained_are_told_before_the_first_one_is() {
    let folder = data_set(2);
    let root = folder.path();
    for (parts, problem) in [
        ("[[parts]]\nname = \"a/b\"", "name is \"a/b\"; expected letters"),
        ("[[parts]]\nname = \"a\"\n[[parts]]\nname = \"a\"", "two are called \"a\""),
        ("[[parts]]\nname = \"a\"\nmean_of = [\"a\", \"b\"]", "mean_of names \"a\"; expected a part before it"),
        ("[[parts]]\nname = \"a\"\n[[parts]]\nname = \"b\"\ntrain.epochs = 0", "part b: "),
        ("[[parts]]\nname = \"a\"\n[[parts]]\nname = \"b\"\ntrian.epochs = 1", "trian"),
        ("[[parts]]\nname = \"a\"\nmean_of = [\"b\"]", "mean_of"),
        ("[[parts]]\ntrain.epochs = 1", "name"),
    ] {
        let (result, steps) = trained(root, parts, false);
        let error = result.unwrap_err();
        assert!(error.contains(problem) && error.contains("run.toml") && steps == 0, "{error}");
    }
    assert!(!root.join("out").exists());
}
