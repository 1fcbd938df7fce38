//! What follows the detector as users meet it: `--refiner`, `--plates`, `--above-road`, and `farsight export` of a
//! refiner or a plate reader.

use std::fs;
use std::path::Path;

use crate::program::{done, farsight, root};
use farsight_graph::graph::Role;
use farsight_methods::smoke::SmokeModel;
use serde_json::Value;

const SCENE: &str = "assets/scenes/image_2/000000.jpg";

/// What `range` says of a scene of the demo: depth, error bar and score of each object.
fn found(folder: &Path, more: &[&str]) -> Vec<[f64; 3]> {
    let scene = root().join(SCENE).display().to_string();
    let calibration = root().join("assets/scenes/calib/000000.txt").display().to_string();
    done(folder, &[&["range", &scene, "--calib", &calibration, "--json", "out.json"], more].concat());
    let json: Value = serde_json::from_slice(&fs::read(folder.join("out.json")).unwrap()).unwrap();
    let number = |value: &Value| value.as_f64().unwrap();
    let objects = json[0]["detections"].as_array().unwrap().iter();
    objects.map(|d| [number(&d["location"][2]), number(&d["range_sigma_m"]), number(&d["score"])]).collect()
}

/// A copy of the model at `shipped` with other weights and the same answers: what no forward pass reads is changed.
fn with_other_weights(shipped: &str, folder: &Path) -> String {
    let mut model = SmokeModel::read(Path::new(shipped)).unwrap();
    let unused = model.graph.parameters.iter().find(|parameter| parameter.role == Role::Unused).unwrap();
    model.weights.tensors.get_mut(&unused.name).unwrap().values[0] += 1.0;
    model.write(&folder.join("other.safetensors")).unwrap();
    "other.safetensors".to_owned()
}

fn told(folder: &Path, arguments: &[&str]) -> String {
    let output = farsight(folder, arguments);
    assert!(!output.status.success(), "{arguments:?} must fail");
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn the_refiner_moves_boxes_and_says_how_sure_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let all = ["--max-overlap", "1"];
    let smoke = ["--max-overlap", "1", "--model", "farsight-s"];
    let first = found(folder, &[&smoke[..], &["--refiner", "none"]].concat());
    let both = found(folder, &smoke);
    assert!(first.len() > 2 && both.len() > 2, "{first:?}\n{both:?}");
    let nearest = |depth_m: f64| {
        let off = |other: &&[f64; 3]| (other[0] / depth_m).ln().abs();
        *first.iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap()
    };
    for [both_m, sigma_m, score] in &both {
        assert!((0.005..0.5).contains(&(sigma_m / both_m)), "{both_m} m, give or take {sigma_m}");
        assert!((0.5..1.0).contains(score));
    }
    assert!(both.windows(2).all(|pair| pair[0][2] >= pair[1][2]), "not in order: {both:?}");
    let moved =
        |place: fn(&[f64; 3]) -> f64| both.iter().filter(|d| (place(d) - place(&nearest(d[0]))).abs() > 1e-6).count();
    assert!(moved(|d| d[0]) > 0 && moved(|d| d[2]) > 0, "nothing changed");
    // The shipped weights get all that they get in the program from whatever file they are read; other weights are used
    // as they are, unless a refiner or a road is named.
    let shipped = root().join("models/farsight-s.safetensors").display().to_string();
    done(folder, &["export", "--model", &shipped, "--out", "shipped.onnx"]);
    assert_eq!(found(folder, &[&all[..], &["--model", "shipped.onnx"]].concat()), both);
    let model = with_other_weights(&shipped, folder);
    let refiner = root().join("models/farsight-refiner.safetensors").display().to_string();
    let own = |more: &[&str]| found(folder, &[&all[..], &["--model", &model], more].concat());
    assert_eq!(own(&[]), found(folder, &[&smoke[..], &["--refiner", "none", "--above-road", "none"]].concat()));
    let without = |more: &[&str]| found(folder, &[&smoke[..], more].concat());
    assert_eq!(own(&["--refiner", &refiner]), without(&["--plates", "none", "--above-road", "none"]));
    let plates = root().join("models/farsight-plates.safetensors").display().to_string();
    assert_eq!(own(&["--refiner", &refiner, "--plates", &plates, "--above-road", "any"]), both);
}

#[test]
fn what_is_asked_for_decides_nothing_but_what_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let from = |least: f64| found(folder, &["--max-overlap", "1", "--min-score", &least.to_string()]);
    let all = from(0.05);
    for least in [0.5, 0.9] {
        let surer: Vec<_> = all.iter().filter(|d| d[2] > least).copied().collect();
        let few = from(least);
        assert!(all.len() > surer.len() && surer == few, "{all:?}\n{few:?}");
    }
}

#[test]
fn one_road_under_all_moves_distances_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let on = |road: &[&str]| found(folder, &[&["--max-overlap", "1"], road].concat());
    let alone = on(&["--above-road", "none"]);
    for together in [on(&[]), on(&["--above-road", "1.65"])] {
        assert_eq!(alone.len(), together.len());
        for ([before_m, sigma_m, score], [after_m, after_sigma_m, after_score]) in alone.iter().zip(&together) {
            assert!((score - after_score).abs() < 1e-12, "scores stay");
            assert!((after_m / before_m).ln().abs() < 0.2, "{before_m} m became {after_m} m");
            assert!(after_sigma_m / after_m < 1.001 * sigma_m / before_m, "more is known than before");
        }
        assert!(alone.iter().zip(&together).any(|(a, b)| (a[0] - b[0]).abs() > 1e-3), "nothing moved");
    }
    let unused = told(folder, &["eval", "--labels", ".", "--results", ".", "--above-road", "1.65"]);
    assert!(unused.contains("expected --data"), "{unused}");
}

#[test]
fn plates_move_distances_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let alone = ["--model", "farsight-s", "--max-overlap", "1", "--above-road", "none"];
    let with = |plates: &[&str]| found(folder, &[&alone, plates].concat());
    let (without, read) = (with(&["--plates", "none"]), with(&[]));
    assert_eq!(without.len(), read.len());
    for ([before_m, sigma_m, score], [after_m, after_sigma_m, after_score]) in without.iter().zip(&read) {
        assert!((score - after_score).abs() < 1e-12, "scores stay");
        assert!((after_m / before_m).ln().abs() < 0.2, "{before_m} m became {after_m} m");
        assert!(after_sigma_m / after_m < 1.1 * sigma_m / before_m, "less is known than before");
    }
    let surer = without.iter().zip(&read).filter(|(a, b)| b[1] / b[0] < 0.8 * a[1] / a[0]).count();
    assert!(surer > 0, "no plate was read: {read:?}");
}

#[test]
fn a_region_moves_all_vehicles_by_one_factor() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let alone = ["--max-overlap", "1", "--above-road", "none"];
    let of = |region: &str| found(folder, &[&alone[..], &["--region", region]].concat());
    let world = of("world");
    assert_eq!(world, found(folder, &alone));
    assert!(world.len() > 2);
    let ratios = |region: &str| -> Vec<f64> { of(region).iter().zip(&world).map(|(a, b)| a[0] / b[0]).collect() };
    for [smaller, larger] in [["europe", "north-america"]] {
        let [smaller, larger] = [smaller, larger].map(ratios);
        assert!(smaller[0] < larger[0], "{smaller:?} and {larger:?}");
        for ratios in [smaller, larger] {
            let odd = ratios.iter().filter(|ratio| (*ratio - ratios[0]).abs() > 1e-9 && (*ratio - 1.0).abs() > 1e-9);
            assert_eq!(odd.count(), 0, "neither the region's factor nor 1: {ratios:?}");
        }
    }
    let scene = root().join(SCENE).display().to_string();
    let range = |more: &[&str]| told(folder, &[&["range", &scene, "--hfov", "81"], more].concat());
    let unfitted = range(&["--model", "farsight-s", "--region", "japan"]);
    assert!(unfitted.contains("farsight-s: the region japan is asked for"), "{unfitted}");
    let unknown = range(&["--region", "texas"]);
    assert!(unknown.contains("expected world, europe, north-america, china, japan, india"), "{unknown}");
}

#[test]
#[ignore = "takes half a minute: `cargo xtask test --all`"]
fn a_refiner_learns_the_scale_of_regions_from_their_splits() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("japan.toml"), "regions = { japan = 1.0 }\ndensity = [1.5, 2.0]\n").unwrap();
    done(folder, &["synth", "--scene-config", "japan.toml", "--out", "scenes", "--frames", "24", "--seed", "5"]);
    assert_eq!(fs::read_to_string(folder.join("scenes/ImageSets/japan.txt")).unwrap().lines().count(), 24);
    let shipped = root().join("models/farsight-w-refiner.safetensors").display().to_string();
    let export = ["export", "--half", "--model", &shipped, "--fit-on", "scenes", "--detector", "farsight-w"];
    let output = farsight(folder, &[&export[..], &["--out", "fitted.safetensors"]].concat());
    let status = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && status.contains("japan: distances of vehicles times"), "{status}");
    let refiner = ["--refiner", "fitted.safetensors"];
    assert!(!found(folder, &[&refiner[..], &["--region", "japan"]].concat()).is_empty());
    let scene = root().join(SCENE).display().to_string();
    let other = told(folder, &[&["range", &scene, "--hfov", "81", "--region", "india"][..], &refiner].concat());
    assert!(other.contains("the region india is asked for"), "{other}");
}

#[test]
#[ignore = "takes half a minute: `cargo xtask test --all`"]
fn refiner_and_plate_reader_are_fitted_to_the_shipped_model() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    done(folder, &["synth", "--out", "scenes", "--frames", "24", "--seed", "5"]);
    for part in ["refiner", "plates"] {
        let shipped = root().join(format!("models/farsight-{part}.safetensors")).display().to_string();
        let fitted = format!("{part}.safetensors");
        let export = ["export", "--half", "--model", &shipped, "--fit-on", "scenes", "--out", &fitted];
        let output = farsight(folder, &export);
        let status = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success() && status.contains("errors correlated by"), "{status}");
        assert!(!found(folder, &["--model", "farsight-s", &format!("--{part}"), &fitted]).is_empty());
    }
}

#[test]
fn mistakes_are_told_with_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let scene = root().join(SCENE).display().to_string();
    let range = |refiner: &str| told(folder, &["range", &scene, "--hfov", "81", "--refiner", refiner]);
    let missing = range("nothing.safetensors");
    assert!(missing.contains("nothing.safetensors: no such file") && missing.contains("or none"), "{missing}");
    let model = root().join("models/farsight-s.safetensors").display().to_string();
    let detector = range(&model);
    assert!(detector.contains("farsight-s.safetensors") && detector.contains("expected a refiner"), "{detector}");
    let refiner = root().join("models/farsight-refiner.safetensors").display().to_string();
    let export = told(folder, &["export", "--half", "--model", &refiner, "--out", "x.safetensors"]);
    assert!(export.contains("a refiner; expected --half and --fit-on DIR beside it, or neither"), "{export}");
    let resized =
        ["export", "--half", "--model", &refiner, "--fit-on", "scenes", "--input", "640x192", "--out", "x.safetensors"];
    assert!(told(folder, &resized).contains("--input and --focal-range are of detectors"));
    let described = [
        "export",
        "--half",
        "--model",
        &refiner,
        "--fit-on",
        "scenes",
        "--training-data",
        "a",
        "--out",
        "x.safetensors",
    ];
    assert!(
        told(folder, &described).contains("--training-data, --training-data-licence and --evaluation are of detectors")
    );
    let scenes = root().join("assets/scenes/image_2").display().to_string();
    let cascade = |model: &str, more: &[&str]| {
        let export = ["export", "--half", "--model", model, "--cascade-on", &scenes, "--out", "x.safetensors"];
        told(folder, &[&export[..], more].concat())
    };
    assert!(cascade(&refiner, &[]).contains("image_2: too few detections with high scores"));
    assert!(cascade("farsight-s", &[]).contains("a detector; --cascade-on is of refiners"));
    assert!(cascade("shipped-plates", &[]).contains("shipped-plates: --cascade-on is of refiners"));
    for more in [["--fit-on", "scenes"], ["--input", "640x192"], ["--training-data", "a"]] {
        assert!(cascade(&refiner, &more).contains("--cascade-on changes nothing else of the model"), "{more:?}");
    }
    let ranges = cascade(&refiner, &["--int8", "--calibration", &scenes]);
    assert!(ranges.contains("--int8 --half measures ranges and changes nothing else of the model"), "{ranges}");
    assert!(!folder.join("x.onnx").exists() && !folder.join("x.safetensors").exists());
    let as_detector = told(folder, &["range", &scene, "--hfov", "81", "--model", &refiner]);
    let expected = "farsight-refiner.safetensors: a refiner; expected a detector, name it with --refiner";
    assert!(as_detector.contains(expected), "{as_detector}");
    for (config, expected) in [("refiner", "the config of a refiner"), ("plates", "the config of a plate reader")] {
        let config = root().join(format!("configs/{config}.toml")).display().to_string();
        let bench = told(folder, &["bench", "--model", &config]);
        assert!(bench.contains(expected) && bench.contains(".toml: "), "{bench}");
    }

    let plates = root().join("models/farsight-plates.safetensors").display().to_string();
    let other_part = told(folder, &["range", &scene, "--hfov", "81", "--plates", &refiner]);
    assert!(
        other_part.contains("farsight-refiner.safetensors") && other_part.contains("a plate reader"),
        "{other_part}"
    );
    let as_detector = told(folder, &["range", &scene, "--hfov", "81", "--model", &plates]);
    assert!(as_detector.contains("a plate reader; expected a detector, name it with --plates"), "{as_detector}");
    let unused = told(folder, &["eval", "--labels", ".", "--results", ".", "--plates", "none"]);
    assert!(unused.contains("expected --data"), "{unused}");
}
