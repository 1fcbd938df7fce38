//! Folders and files as users have them: what is told, and what is refused.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use farsight_core::Camera;
use farsight_data::kitti::read_labels;
use farsight_data::{Dataset, Frame, MemoryDataset};
use farsight_eval::{FilesError, Findings, FrameFiles, Scores, ranging::RangingOptions, text};

const LABEL: &str = "Car 0.00 0 -1.57 608.40 182.50 719.60 281.90 1.52 1.66 4.07 0.80 1.71 13.60 -1.62\n";
const RESULT: &str = "Car -1 -1 -1.57 608.40 182.50 719.60 281.90 1.52 1.66 4.07 0.80 1.71 13.60 -1.62 0.9\n";

/// A scratch folder with `labels` and `results`, each a list of file names and contents.
fn folders(labels: &[(&str, &str)], results: &[(&str, &str)]) -> (tempfile::TempDir, PathBuf, PathBuf) {
    let scratch = tempfile::tempdir().unwrap();
    let folder = |name: &str, files: &[(&str, &str)]| {
        let folder = scratch.path().join(name);
        fs::create_dir_all(&folder).unwrap();
        for (file, text) in files {
            let path = folder.join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        folder
    };
    let (labels, results) = (folder("labels", labels), folder("results", results));
    (scratch, labels, results)
}

fn evaluate(labels: &Path, results: &Path, split: Option<&[&str]>) -> Result<Findings, FilesError> {
    let split = split.map(|ids| ids.iter().map(|id| (*id).to_owned()).collect());
    let options = RangingOptions { bootstrap: None, ..RangingOptions::default() };
    let (evaluation, findings) = FrameFiles::open(labels, results, split)?.evaluate(&options)?;
    drop(text::lines(&evaluation.report()));
    Ok(findings)
}

#[test]
fn wrong_folders_are_told_apart() {
    let good = [("000000.txt", LABEL)];
    let (_kept, labels, results) = folders(&good, &[("000000.txt", RESULT)]);
    let (_kept, inside, nothing) = folders(&[("training/label_2/000000.txt", LABEL)], &[]);
    let (_kept, fractions, other) =
        folders(&[("000000.txt", &LABEL.replace(" 0 ", " 0.00 "))], &[("000009.txt", RESULT)]);
    let missing = labels.join("nowhere");
    let cases = [
        (&missing, &results, None, "nowhere: no such folder; expected a folder of label files such as 000007.txt"),
        (&labels, &missing, None, "nowhere: no such folder; expected a folder of result files such as 000007.txt"),
        (&labels.join("000000.txt"), &results, None, "000000.txt: this is a file; expected a folder of label files"),
        (&labels, &nothing, None, "no .txt file in this folder; expected result files such as 000007.txt"),
        (&inside, &results, None, "training/label_2: give that folder"),
        (&labels, &labels, None, "these are labels, not results: the rows have 15 fields; expected 16"),
        (&labels, &other, None, "no frame has a label file in"),
        (&labels, &results, Some(["000000", "000001"].as_slice()), "1 of 2 frames of the split have no label file"),
        (&fractions, &results, None, "000000.txt:1: field 3 \"occluded\" is \"0.00\"; expected a whole number"),
    ];
    for (labels, results, split, want) in cases {
        let told = evaluate(labels, results, split).unwrap_err().to_string();
        assert!(told.contains(want), "{told}\nexpected: {want}");
    }
}

#[test]
fn what_the_devkit_does_silently_is_told_by_kind() {
    let labels = [("000000.txt", LABEL), ("000001.txt", LABEL), ("000002.txt", "")];
    let results = [
        ("000000.txt", format!("{LABEL}{RESULT}").replace('\n', "\r\n")),
        ("000001.txt", RESULT.replace("13.60", "nan").replace("Car", "Tram") + &RESULT.replace("Car", "car")),
        ("000005.txt", RESULT.to_owned()),
    ];
    let results: Vec<_> = results.iter().map(|(name, text)| (*name, text.as_str())).collect();
    let (_kept, labels, results) = folders(&labels, &results);
    let findings = evaluate(&labels, &results, None).unwrap();
    let told: Vec<_> = findings.iter().map(|finding| (finding.kind, finding.count)).collect();
    let want = [
        ("result files without a label file, left out", 1),
        (
            "frames without a result file, left out (their objects do not count as missed; give --split to demand all)",
            1,
        ),
        ("rows dropped", 1),
        ("Windows line ends", 1),
        ("numbers that are not finite", 1),
        ("classes in unusual case", 1),
        ("detections of classes that KITTI does not evaluate", 1),
    ];
    assert_eq!(told, want);
    let dropped = findings.iter().find(|finding| finding.kind == "rows dropped").unwrap().to_string();
    assert!(dropped.starts_with("rows dropped: 1; first "), "{dropped}");
    assert!(
        dropped.ends_with(
            "000000.txt:1: row dropped: field 16 \"score\" is \"Car\"; expected a number (a row of 16 fields)"
        ),
        "{dropped}"
    );
}

#[test]
fn what_a_model_has_learnt_beyond_kittis_classes_need_not_be_told() {
    let van = RESULT.replace("Car", "Van");
    let files = [("000000.txt", van.as_str())];
    let (_kept, labels, results) = folders(&[("000000.txt", LABEL)], &files);
    let told = |files: &FrameFiles| files.read("000000").unwrap().1.iter().count();
    let plain = FrameFiles::open(&labels, &results, None).unwrap();
    let own = plain.clone().with_any_classes();
    assert_eq!([told(&plain), told(&own), told(&own.with_results(&results).unwrap())], [1, 0, 1]);
}

#[test]
fn a_split_chooses_frames_and_demands_their_files() {
    let both = [("000000.txt", ""), ("000001.txt", "")];
    let (_kept, labels, results) = folders(&both, &both);
    let findings = evaluate(&labels, &results, Some(["000001"].as_slice())).unwrap();
    assert_eq!(findings.iter().map(|finding| finding.count).collect::<Vec<_>>(), [1]);
    fs::remove_file(results.join("000001.txt")).unwrap();
    let told = evaluate(&labels, &results, Some(["000001"].as_slice())).unwrap_err().to_string();
    assert!(told.contains("1 of 1 frames of the split have no result file"), "{told}");
    assert!(told.contains("needs an empty file"), "{told}");
}

#[test]
fn place_scores_need_an_error_bar_in_every_row() {
    // Straight ahead, seen from behind: 4.07 m long, of which 14/17 are shared at an overlap of 0.7. With the first
    // error bar the rest, 3/17, is one scale of Laplace's distribution.
    let row = RESULT.trim_end().replace("0.80 1.71 13.60 -1.62", "0.00 1.71 13.60 -1.5707963");
    let one_scale = 4.07 * 3.0 / 17.0 * 2.0_f64.sqrt();
    let results = format!("{row} {one_scale}\n{row} 1000000\n{row} 0\n");
    let files = [("000000.txt", results.as_str()), ("000001.txt", &format!("{row} 1\n{row}\n"))];
    let (_kept, labels, results) = folders(&files.map(|(name, _)| (name, LABEL)), &files);
    let files = FrameFiles::open(&labels, &results, None).unwrap().with_scores(Scores::Place);
    let (frame, _) = files.read("000000").unwrap();
    let scores: Vec<_> = frame.predictions.iter().map(|prediction| prediction.detection.score).collect();
    for (score, want) in scores.iter().zip([0.9 * (1.0 - (-1.0_f64).exp()), 0.0, 0.9]) {
        assert!((score - want).abs() < 1e-6, "{score}, not {want}");
    }
    let told = files.read("000001").unwrap_err().to_string();
    assert!(told.contains("000001.txt:2: no error bar; place scores need one in every row"), "{told}");
}

/// A data set without label files is evaluated as one with them.
#[test]
fn labels_of_a_data_set_in_memory_count_as_those_of_files() {
    let farther = LABEL.replace("13.60", "23.60");
    let (_kept, labels, results) =
        folders(&[("000000.txt", LABEL), ("000001.txt", &farther)], &[("000000.txt", RESULT), ("000001.txt", RESULT)]);
    let frame = |id: &str| {
        let labels = read_labels(&labels.join(format!("{id}.txt"))).unwrap();
        Frame::new(id, image::RgbImage::new(4, 2), Camera::from_intrinsics(9.0, 9.0, 2.0, 1.0).unwrap(), labels)
    };
    let memory = MemoryDataset::new("memory", ["000000", "000001"].map(frame));
    let dataset: Arc<dyn Dataset> = Arc::new(memory.clone());
    let options = RangingOptions { bootstrap: None, ..RangingOptions::default() };
    let report = |files: FrameFiles| files.evaluate(&options).unwrap().0.report();
    let found = report(FrameFiles::open(&dataset, &results, None).unwrap());
    let expected = report(FrameFiles::open(&labels, &results, None).unwrap());
    assert_eq!(serde_json::to_value(found).unwrap(), serde_json::to_value(expected).unwrap());

    let unlabelled: Arc<dyn Dataset> = Arc::new(memory.unlabelled());
    let told = FrameFiles::open(&unlabelled, &results, None).err();
    // Nobody has said what these frames show: every detection would be a false alarm.
    assert_eq!(told.unwrap().to_string(), "memory: no labels; expected a data set that has some");
}

#[test]
fn vehicles_can_be_one_class() {
    let (van, truck) = (LABEL.replace("Car", "Van"), RESULT.replace("Car", "Truck"));
    let unnamed = LABEL.replace("Car", "Vehicle");
    let (_kept, labels, results) = folders(
        &[("000000.txt", &van), ("000001.txt", &unnamed), ("000002.txt", &LABEL.replace("Car", "Pedestrian"))],
        &[("000000.txt", &truck), ("000001.txt", RESULT), ("000002.txt", &truck)],
    );
    let files = FrameFiles::open(labels.as_path(), &results, None).unwrap();
    let cars = |files: &FrameFiles| {
        let report =
            files.evaluate(&RangingOptions { bootstrap: None, ..RangingOptions::default() }).unwrap().0.report();
        let cars = report.ranging.group(farsight_eval::EvaluatedClass::Car, farsight_eval::ranging::Group::All);
        cars.map(|cars| (cars.whole.objects, cars.whole.found))
    };
    assert_eq!(cars(&files).map_or(0, |(objects, _)| objects), 0);
    assert_eq!(cars(&files.with_vehicles_as_cars()), Some((2, 2)));
}
