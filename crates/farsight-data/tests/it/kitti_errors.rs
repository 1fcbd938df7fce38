//! What the readers say about malformed files, and the text that the writers make.

use std::path::Path;

use farsight_core::{Box2d, Box3d, Camera, Detection, Dimensions, ObjectClass};
use farsight_data::kitti::rows::{rows_from_text, rows_from_text_lenient};
use farsight_data::kitti::split::split_from_text;
use farsight_data::kitti::{Calibration, RowKind, read_results, text_from_results, write_results};
use farsight_data::{Dataset, Frame, KittiDataset};

const CAR: &str = "Car 0.00 0 -1.58 587.01 173.33 614.12 200.12 1.65 1.67 3.64 -0.65 1.71 46.70 -1.59";
const DONT_CARE: &str = "DontCare -1 -1 -10 498.20 171.30 585.40 189.60 -1 -1 -1 -1000 -1000 -1000 -10";

/// `row` with field number `number` (from 1) replaced.
fn with_field(row: &str, number: usize, value: &str) -> String {
    let mut words: Vec<_> = row.split(' ').collect();
    words[number - 1] = value;
    words.join(" ")
}

fn label_problem(text: &str) -> String {
    let path = Path::new("label_2/000007.txt");
    rows_from_text(text, path, RowKind::Label).map_or_else(|error| error.to_string(), |_| "none".to_owned())
}

#[test]
fn malformed_labels_are_told_with_file_line_and_field() {
    let cases = [
        (CAR.to_owned(), "none"),
        (DONT_CARE.to_owned(), "none"),
        (with_field(CAR, 9, "-1.63"), r#"field 9 "height" is "-1.63"; expected a positive number of metres"#),
        (with_field(CAR, 10, "0"), r#"field 10 "width" is "0"; expected a positive number of metres"#),
        (with_field(CAR, 11, "x"), r#"field 11 "length" is "x"; expected a number"#),
        (with_field(CAR, 14, "NaN"), r#"field 14 "z" is "NaN"; expected a number"#),
        (with_field(CAR, 15, "inf"), r#"field 15 "rotation_y" is "inf"; expected a number"#),
        (with_field(CAR, 3, "0.00"), r#"field 3 "occluded" is "0.00"; expected a whole number"#),
        (with_field(CAR, 3, "4"), r#"field 3 "occluded" is "4"; expected a whole number from -1 to 3"#),
        (with_field(CAR, 2, "-1"), r#"field 2 "truncated" is "-1"; expected a share from 0 to 1 (-1 for DontCare)"#),
        (
            with_field(CAR, 2, "1.01"),
            r#"field 2 "truncated" is "1.01"; expected a share from 0 to 1 (-1 for DontCare)"#,
        ),
        (with_field(CAR, 7, "500"), r#"field 7 "right" is "500"; expected a right edge not left of the left one"#),
        (with_field(CAR, 8, "1"), r#"field 8 "bottom" is "1"; expected a bottom edge not above the top one"#),
        (with_field(DONT_CARE, 8, "1"), r#"field 8 "bottom" is "1"; expected a bottom edge not above the top one"#),
        (with_field(CAR, 1, "\u{feff}Car"), "field 1 \"type\" is \"\u{feff}Car\"; expected the name of a class"),
        (with_field(CAR, 1, "0.5"), r#"field 1 "type" is "0.5"; expected the name of a class"#),
        (format!("{CAR} 0.9"), "16 fields; expected 15"),
        ("Car".to_owned(), "1 field; expected 15"),
    ];
    for (row, expected) in cases {
        let expected =
            if expected == "none" { expected.to_owned() } else { format!("label_2/000007.txt:3: {expected}") };
        assert_eq!(label_problem(&format!("{CAR}\n\n{row}\n")), expected, "{row}");
    }
}

#[test]
fn windows_line_ends_blank_lines_and_a_missing_last_line_end_are_accepted() {
    let text = format!("\r\n{CAR}\r\n\r\n  {DONT_CARE}\t\r\n{CAR}");
    assert_eq!(rows_from_text(&text, Path::new("a"), RowKind::Label).unwrap().len(), 3);
    assert_eq!(rows_from_text("", Path::new("a"), RowKind::Label).unwrap(), []);
}

#[test]
fn the_lenient_reader_counts_what_it_skips() {
    let text = format!("{CAR}\n{CAR} 1\n{DONT_CARE}\nCar\n");
    let (rows, skipped) = rows_from_text_lenient(&text, Path::new("a.txt"), RowKind::Label);
    assert_eq!((rows.len(), skipped.count), (2, 2));
    assert_eq!(skipped.first.unwrap().to_string(), "a.txt:2: 16 fields; expected 15");
}

#[test]
fn results_may_lack_a_3d_box_and_must_have_a_score() {
    let problem = |text: &str| rows_from_text(text, Path::new("r"), RowKind::Result).err().map(|e| e.to_string());
    let only_2d = "Car -1 -1 -10 10.0 20.0 30.0 40.0 -1 -1 -1 -1000 -1000 -1000 -10 0.9";
    assert_eq!(problem(only_2d), None);
    assert_eq!(problem(&format!("{CAR} 12.5")), None);
    assert_eq!(problem(&format!("{} 0.5", with_field(CAR, 3, "0.00"))), None);
    assert_eq!(problem(&format!("{CAR} 0.5 1.25")), None);
    assert_eq!(problem(CAR).unwrap(), "r:1: 15 fields; expected 16");
    assert_eq!(problem(&format!("{CAR} nan")).unwrap(), r#"r:1: field 16 "score" is "nan"; expected a number"#);
    let expected =
        r#"r:1: field 17 "range_sigma_m" is "-1"; expected the error bar of the distance, metres, or nothing"#;
    assert_eq!(problem(&format!("{CAR} 0.5 -1")).unwrap(), expected);
}

fn detection(range_sigma_m: Option<f64>) -> Detection {
    let dimensions = Dimensions { height: 1.5, width: 1.625, length: 4.25 };
    let box3d = Box3d { dimensions, location: [0.0, 1.5, 20.0], yaw: -1.5 };
    let box2d = Box2d::new(1.0, 2.5, 30.0, 40.125);
    Detection { class: ObjectClass::Car, score: 0.875, box2d, box3d, range_sigma_m }
}

#[test]
fn results_are_written_as_documented_and_read_back_equal() {
    let detections = [detection(None), detection(Some(0.75))];
    let row =
        "Car -1 -1 -1.5000 1.0000 2.5000 30.0000 40.1250 1.5000 1.6250 4.2500 0.0000 1.5000 20.0000 -1.5000 0.8750";
    assert_eq!(text_from_results(&detections), format!("{row}\n{row} 0.7500\n"));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("000000.txt");
    write_results(&path, &detections).unwrap();
    assert_eq!(read_results(&path).unwrap(), detections);
    write_results(&path, &[]).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), b"");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no scratch file is left");
    let nowhere = folder.path().join("none/000000.txt");
    let text = write_results(&nowhere, &[]).unwrap_err().to_string();
    assert!(text.starts_with(&format!("{}: cannot be written: ", nowhere.display())), "{text}");
}

const P2: &str = "P2: 700 0 600 45 0 700 180 -0.3 0 0 1 0.005";

#[test]
fn calibrations_are_told_with_line_and_row() {
    let problem = |text: &str| Calibration::from_text(text, Path::new("c.txt")).err().map(|e| e.to_string());
    let names = "expected one of P0: P1: P2: P3: R0_rect: Tr_velo_to_cam: Tr_imu_to_velo: road:";
    let cases = [
        (P2.to_owned(), None),
        (format!("{P2}\nroad: 0.1 0 1.6 0.01 0.01 0.05"), None),
        (format!("{P2}\nroad: 0.1 0 1.6"), Some("c.txt:2: row \"road:\" has 3 numbers; expected 6".to_owned())),
        (
            format!("{P2}\nroad: 0.1 0 -1.6 0.01 0.01 0.05"),
            Some(
                "c.txt:2: row \"road:\": slope, tilt, height and their errors are [0.1, 0.0, -1.6, 0.01, 0.01, 0.05]; \
                 expected a positive height and errors of at least 0"
                    .to_owned(),
            ),
        ),
        (format!("\r\n{P2}\r\n\r\n"), None),
        (
            String::new(),
            Some(r#"c.txt: no row "P2:"; expected the 3x4 projection of the left colour camera"#.to_owned()),
        ),
        (format!("{P2}\n{P2}"), Some(r#"c.txt:2: second row "P2:"; expected one"#.to_owned())),
        (format!("{P2}\nP9: 1"), Some(format!(r#"c.txt:2: row "P9:"; {names}"#))),
        ("P2 7".to_owned(), Some(format!(r#"c.txt:1: row "P2"; {names}"#))),
        ("R0_rect: 1 0 0".to_owned(), Some(r#"c.txt:1: row "R0_rect:" has 3 numbers; expected 9"#.to_owned())),
        (P2.replace("600", "six"), Some(r#"c.txt:1: row "P2:", number 3 is "six"; expected a number"#.to_owned())),
        (
            P2.replace("P2: 700", "P2: -700"),
            Some(r#"c.txt:1: row "P2:": focal length fx is -700; expected a positive number of pixels"#.to_owned()),
        ),
    ];
    for (text, expected) in cases {
        assert_eq!(problem(&text), expected, "{text}");
    }
}

#[test]
fn a_calibration_of_the_camera_alone_is_written_and_read() {
    let camera = Camera::from_hfov(80.0, 1242, 375).unwrap();
    let text = Calibration::from_camera(&camera).to_text();
    let read = Calibration::from_text(&text, Path::new("c")).unwrap().camera();
    let close = |(a, b): (&f64, &f64)| (a - b).abs() < 1e-9;
    assert!(read.projection.as_flattened().iter().zip(camera.projection.as_flattened()).all(close));
    assert!(text.starts_with("P2: 7.400789") && text.contains("e+02 0.000000000000e+00 6.205000000000e+02"), "{text}");
}

#[test]
fn splits_are_ids_each_once() {
    let problem = |text: &str| split_from_text(text, Path::new("train.txt")).err().map(|e| e.to_string());
    assert_eq!(split_from_text("000001\r\n\n 000007 \n", Path::new("t")).unwrap(), ["000001", "000007"]);
    let cases = [
        ("", "train.txt: no frame; expected one id a line"),
        ("1\n2\n1\n", "train.txt:3: frame 1 is on line 1 already; expected each frame once"),
        ("1\n../2\n", r#"train.txt:2: "../2"; expected the id of one frame, such as 000007"#),
        ("1 1\n", r#"train.txt:1: "1 1"; expected the id of one frame, such as 000007"#),
    ];
    for (text, expected) in cases {
        assert_eq!(problem(text).as_deref(), Some(expected));
    }
}

#[test]
fn a_data_set_that_lacks_something_says_what() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let problem = |split: Option<&str>| {
        let error = KittiDataset::open(root, split.map(Path::new)).err().unwrap();
        error.to_string().replace(&root.display().to_string(), "ROOT")
    };
    let expected =
        |missing| format!("ROOT: no folder \"{missing}\"; expected {{image_2,calib,label_2}} here or in training/");
    for missing in ["image_2", "calib", "label_2"] {
        assert_eq!(problem(None), expected(missing));
        std::fs::create_dir(root.join(missing)).unwrap();
    }
    assert_eq!(problem(None), "ROOT/image_2: no images; expected files such as 000000.png");
    assert_eq!(problem(Some("train")), "no split \"train\"; expected a file such as ROOT/ImageSets/train.txt");
    for id in ["000000", "000001", "000002"] {
        image::RgbImage::new(8, 4).save(root.join(format!("image_2/{id}.png"))).unwrap();
    }
    for name in ["calib/000000.txt", "label_2/000000.txt", "calib/000001.txt"] {
        std::fs::write(root.join(name), if name.starts_with("calib") { P2 } else { CAR }).unwrap();
    }
    let incomplete = "2 of 3 frames lack files; the first is 000001: expected ROOT/label_2/000001.txt";
    assert_eq!(problem(None), incomplete);
    // Other systems and cameras write extensions in upper case.
    std::fs::rename(root.join("image_2/000002.png"), root.join("image_2/000002.PNG")).unwrap();
    assert_eq!(problem(None), incomplete);
    std::fs::rename(root.join("image_2/000000.png"), root.join("image_2/000000.PNG")).unwrap();

    std::fs::create_dir(root.join("ImageSets")).unwrap();
    std::fs::write(root.join("ImageSets/train.txt"), "000000\n").unwrap();
    let dataset = KittiDataset::open(root, Some(Path::new("train"))).unwrap();
    let frame = dataset.frame(0).unwrap();
    let Frame { id, image, camera, labels, .. } = &*frame;
    assert_eq!((id.as_str(), image.dimensions(), labels.len()), ("000000", (8, 4), 1));
    let expected = Calibration::from_text(P2, Path::new("c")).unwrap().camera();
    assert_eq!(*camera, expected);
    assert!(*camera != camera.without_fourth_column());
}
