//! Every real KITTI file is read, and written again byte for byte.

use std::path::{Path, PathBuf};

use farsight_data::kitti::rows::rows_from_text;
use farsight_data::kitti::{
    Calibration, Row, RowKind, read_labels, read_results, read_rows, read_split, text_from_labels, text_from_results,
};
use farsight_data::{Dataset, KittiDataset};

use crate::material::unpacked;

const FRAMES: usize = 7481;
const VALIDATION_FRAMES: usize = 3769;

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

#[test]
fn all_labels_and_calibrations_come_out_as_they_went_in() {
    let Some(folder) = unpacked("labels-and-calib.tar.xz") else { return };
    let labels = files(&folder.path().join("training/label_2"));
    let calibrations = files(&folder.path().join("training/calib"));
    assert_eq!([labels.len(), calibrations.len()], [FRAMES; 2]);
    for path in labels {
        let written = text_from_labels(&read_labels(&path).unwrap());
        assert!(written == std::fs::read_to_string(&path).unwrap(), "{}", path.display());
    }
    for path in calibrations {
        let calibration = Calibration::read(&path).unwrap();
        let written = calibration.to_text();
        assert!(written == std::fs::read_to_string(&path).unwrap(), "{}", path.display());
        assert_eq!(Calibration::from_text(&written, &path).unwrap(), calibration);
    }
    for (split, count) in [("train", 3712), ("val", VALIDATION_FRAMES), ("trainval", FRAMES)] {
        let path = folder.path().join("ImageSets").join(split).with_extension("txt");
        assert_eq!(read_split(&path).unwrap().len(), count);
    }
}

#[test]
fn real_results_are_read_and_our_own_writing_is_stable() {
    let Some(folder) = unpacked("val-results.tar.xz") else { return };
    for (set, frames) in [("pointgnn_vishnuu95", VALIDATION_FRAMES), ("m3drpn_piethonista", VALIDATION_FRAMES)] {
        let paths = files(&folder.path().join(set).join("data"));
        assert_eq!(paths.len(), frames);
        for path in paths {
            let rows = read_rows(&path, RowKind::Result).unwrap();
            let detections = read_results(&path).unwrap();
            assert_eq!(rows.len(), detections.len());
            let text = text_from_results(&detections);
            let again = rows_from_text(&text, &path, RowKind::Result).unwrap();
            let again = text_from_results(&again.into_iter().map(Row::into_detection).collect::<Vec<_>>());
            assert_eq!(without_alpha(&again), without_alpha(&text), "{}", path.display());
        }
    }
}

/// Alpha is computed from yaw and location; when those are rounded its last digit may move.
fn without_alpha(text: &str) -> String {
    let kept = |line: &str| {
        line.split(' ').enumerate().filter(|(i, _)| *i != 3).map(|(_, w)| w.to_owned()).collect::<Vec<_>>()
    };
    text.lines().flat_map(kept).collect::<Vec<_>>().join(" ")
}

#[test]
fn the_frames_folder_opens_in_both_layouts() {
    let Some(kitti) = farsight_testing::kitti("") else { return };
    let root = kitti.join("frames");
    let all = KittiDataset::open(&root, None).unwrap();
    assert_eq!(all.len(), 84);
    let train = KittiDataset::open(&root, Some(Path::new("train"))).unwrap();
    let val = KittiDataset::open(&root.join("training"), Some(Path::new("val"))).unwrap();
    let by_path = KittiDataset::open(&root, Some(&root.join("ImageSets/val.txt"))).unwrap();
    assert_eq!([train.len(), val.len()], [64, 20]);
    assert_eq!(val.ids(), by_path.ids());
    let frame = all.frame(0).unwrap();
    assert_eq!((frame.id.as_str(), frame.image.dimensions(), frame.labels.len()), ("000000", (1224, 370), 1));
    assert_eq!(frame.camera, all.camera(0).unwrap());
}
