//! Checkpoints that were damaged, data that changed under a run, and folders that two runs want.

use std::fs;
use std::path::{Path, PathBuf};

use farsight_data::kitti::write_labels;
use farsight_files::FolderLock;
use farsight_methods::smoke::train::{SmokeRun, SmokeTask};
use farsight_train::checkpoint;
use farsight_train::config::ValidateConfig;
use farsight_train::metrics::StepSummary;
use farsight_train::training::{CHECKPOINT_FILE, Callback, Job, Start, TrainError, fit};

use crate::tiny::{Silent, car, data_set, run_config};

/// A checkpoint of a short run on the data set in `data`.
fn trained(data: &Path) -> (SmokeRun, PathBuf) {
    let (run, out) = (run_config(data), data.join("run"));
    fit::<SmokeTask>(&Job { run: run.clone(), out: out.clone(), resume: false }, &mut Silent::default()).unwrap();
    (run, out)
}

fn resumed(run: &SmokeRun, out: &Path, callback: &mut dyn Callback) -> Result<PathBuf, TrainError> {
    fit::<SmokeTask>(&Job { run: run.clone(), out: out.to_owned(), resume: true }, callback)
}

#[test]
fn every_flipped_bit_of_a_checkpoint_is_told() {
    let folder = data_set(4);
    let (run, out) = trained(folder.path());
    let path = out.join(CHECKPOINT_FILE);
    let whole = fs::read(&path).unwrap();
    checkpoint::read(&path, &run.identity()).unwrap();
    // All over the file: header, weights and both moments.
    let step = whole.len() / 97;
    for place in (0..whole.len()).step_by(step) {
        let mut flipped = whole.clone();
        flipped[place] ^= 1 << (place % 8);
        fs::write(&path, flipped).unwrap();
        let told = checkpoint::read(&path, &run.identity()).map(|_| ()).unwrap_err().to_string();
        assert!(told.starts_with(&path.display().to_string()), "{place}: {told}");
    }
    fs::write(&path, &whole).unwrap();
    checkpoint::read(&path, &run.identity()).unwrap();
}

/// Says yes, and keeps what it was asked.
#[derive(Default)]
struct Accepting(Vec<String>);

impl Callback for Accepting {
    fn on_start(&mut self, _: Start) {}

    fn on_step(&mut self, _: &StepSummary) {}

    fn accepts_other_data(&mut self, differences: &[String]) -> bool {
        self.0 = differences.to_vec();
        true
    }

    fn validate(&mut self, _: u64, _: &Path, _: &ValidateConfig) -> Result<Vec<(String, f64)>, String> {
        Ok(Vec::new())
    }
}

/// Changes the data set in a folder.
type Change = fn(&Path);

#[test]
fn other_data_are_refused_with_what_differs_unless_they_are_accepted() {
    let changes: [(&str, Change); 4] = [
        ("it had 6 frames, now there are 4", |root| {
            fs::write(root.join("ImageSets/train.txt"), "000000\n000001\n000002\n000003\n").unwrap();
        }),
        ("the frames have other names", |root| {
            fs::write(root.join("ImageSets/train.txt"), "000005\n000001\n000002\n000003\n000004\n000000\n").unwrap();
        }),
        ("the images are others", |root| {
            let image = root.join("training/image_2/000002.png");
            image::RgbImage::new(200, 64).save(image).unwrap();
        }),
        ("labels or cameras are others", |root| {
            write_labels(&root.join("training/label_2/000002.txt"), &[car(3)]).unwrap();
        }),
    ];
    for (expected, change) in changes {
        let folder = data_set(6);
        let (run, out) = trained(folder.path());
        resumed(&run, &out, &mut Silent::default()).unwrap();
        change(folder.path());
        let told = resumed(&run, &out, &mut Silent::default()).unwrap_err().to_string();
        assert!(told.contains(expected) && told.contains("--accept-other-data"), "{told}");
        let mut accepting = Accepting::default();
        resumed(&run, &out, &mut accepting).unwrap();
        assert!(accepting.0.iter().any(|difference| difference == expected), "{:?}", accepting.0);
    }
}

#[test]
fn the_same_data_in_another_folder_are_the_same_and_other_ones_are_not() {
    let (folder, moved, larger) = (data_set(4), data_set(4), data_set(5));
    let (run, out) = trained(folder.path());
    let in_folder = |root: &Path| {
        let mut run = run.clone();
        run.data.root = Some(root.to_owned());
        resumed(&run, &out, &mut Silent::default()).map_err(|error| error.to_string())
    };
    in_folder(moved.path()).unwrap();
    let told = in_folder(larger.path()).unwrap_err();
    assert!(told.contains("it had 4 frames, now there are 5"), "{told}");
}

#[test]
fn another_config_is_told_field_by_field() {
    let folder = data_set(4);
    let (mut run, out) = trained(folder.path());
    run.data.limit = 3;
    run.train.seed += 1;
    let told = resumed(&run, &out, &mut Silent::default()).unwrap_err().to_string();
    // Fewer frames are other data, too; they are told first.
    assert!(told.contains("it had 4 frames, now there are 3"), "{told}");
    let told = resumed(&run, &out, &mut Accepting::default()).unwrap_err().to_string();
    assert!(told.contains("data.limit was 0 and is 3") && told.contains("train.seed was "), "{told}");
}

#[test]
fn a_folder_is_for_one_training_at_a_time() {
    let folder = data_set(4);
    let out = folder.path().join("run");
    fs::create_dir(&out).unwrap();
    let lock = FolderLock::take(&out).unwrap();
    let job = Job { run: run_config(folder.path()), out: out.clone(), resume: false };
    let told = fit::<SmokeTask>(&job, &mut Silent::default()).unwrap_err().to_string();
    assert!(told.ends_with("another training is going on in this folder; expected another --out"), "{told}");
    drop(lock);
    // What a killed run left half written is gone afterwards.
    let scratch = out.join(".checkpoint.safetensors.99999999-0.partial");
    fs::write(&scratch, "half").unwrap();
    fit::<SmokeTask>(&job, &mut Silent::default()).unwrap();
    assert!(!scratch.exists());
}
