//! The answers of `farsight eval`, word by word.

use std::fs;
use std::path::Path;
use std::process::Command;

const LABELS: &str = "\
Car 0.00 0 1.50 600.00 170.00 700.00 230.00 1.50 1.60 4.00 1.00 1.70 20.00 1.60
Van 0.00 0 1.50 100.00 170.00 200.00 230.00 2.00 1.80 5.00 -9.00 1.70 18.00 1.60
Car 0.00 2 1.50 300.00 170.00 400.00 230.00 1.50 1.60 4.00 -5.00 1.70 22.00 1.60
Car 0.00 0 1.50 800.00 170.00 840.00 200.00 1.50 1.60 4.00 9.00 1.70 40.00 1.60
DontCare -1 -1 -10 900.00 150.00 1000.00 250.00 -1 -1 -1 -1000 -1000 -1000 -10
";

const RESULTS: &str = "\
Car -1 -1 1.50 600.00 170.00 700.00 230.00 1.50 1.60 4.00 1.00 1.70 20.10 1.60 0.9 0.5
Car -1 -1 1.50 100.00 170.00 200.00 230.00 1.50 1.60 4.00 -9.00 1.70 18.00 1.60 0.8
Car -1 -1 1.50 910.00 160.00 960.00 210.00 1.50 1.60 4.00 12.00 1.70 30.00 1.60 0.7
Car -1 -1 1.50 10.00 160.00 60.00 210.00 1.50 1.60 4.00 -20.00 1.70 30.00 1.60 0.6
Tram -1 -1 1.50 10.00 160.00 60.00 210.00 3.50 2.60 9.00 -20.00 1.70 30.00 1.60 0.5
";

/// Exit status, standard output and standard error of `farsight eval` on the scene above.
fn eval(folder: &Path, arguments: &[&str]) -> (i32, String, String) {
    eval_files(folder, LABELS, RESULTS, arguments)
}

/// The same with other files.
fn eval_files(folder: &Path, labels: &str, results: &str, arguments: &[&str]) -> (i32, String, String) {
    for (name, text) in [("labels", labels), ("results", results)] {
        fs::create_dir_all(folder.join(name)).unwrap();
        fs::write(folder.join(name).join("000001.txt"), text).unwrap();
    }
    let output = Command::new(env!("CARGO_BIN_EXE_farsight"))
        .args(["eval", "--labels", "labels", "--results", "results"])
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

#[test]
fn explain_names_every_fate() {
    let folder = tempfile::tempdir().unwrap();
    let (status, out, _) = eval(folder.path(), &["--explain", "000001", "--metric", "2d"]);
    let expected = "frame 000001: 2d overlap above car 0.7, pedestrian 0.5, cyclist 0.5; all scores
     ground truth                        easy                            moderate                        hard
g0   Car 60.0 px, z 20.0 m               found by d0 (1.000)             found by d0 (1.000)             found by d0 (1.000)
g1   Van 60.0 px, z 18.0 m               ignored: looks like a car (d1)  ignored: looks like a car (d1)  ignored: looks like a car (d1)
g2   Car 60.0 px, z 22.0 m               ignored: occluded               ignored: occluded               missed
g3   Car 30.0 px, z 40.0 m               ignored: too small              missed                          missed
g4   DontCare 100.0 px, z -1000.0 m      excuses                         excuses                         excuses
     detections                          easy                            moderate                        hard
d0   Car 0.900, 60.0 px, z 20.1 m        true: g0 (1.000)                true: g0 (1.000)                true: g0 (1.000)
d1   Car 0.800, 60.0 px, z 18.0 m        ignored: on g1                  ignored: on g1                  ignored: on g1
d2   Car 0.700, 50.0 px, z 30.0 m        ignored: DontCare               ignored: DontCare               ignored: DontCare
d3   Car 0.600, 50.0 px, z 30.0 m        false: nothing there            false: nothing there            false: nothing there
d4   Tram 0.500, 50.0 px, z 30.0 m       not evaluated                   not evaluated                   not evaluated
";
    assert_eq!((status, out.as_str()), (0, expected));
}

#[test]
fn explain_takes_the_metric_and_the_overlaps_that_it_is_given() {
    let folder = tempfile::tempdir().unwrap();
    // 0.1 m of 4 m: enough in both; in the table below nothing else overlaps at all.
    for (arguments, heading, found) in [
        (["--metric", "bev"].as_slice(), "bev overlap above car 0.7, pedestrian 0.5, cyclist 0.5; all scores", true),
        (&["--loose"], "3d overlap above car 0.5, pedestrian 0.25, cyclist 0.25; all scores", true),
        (&["--min-score", "0.95"], "3d overlap above car 0.7, pedestrian 0.5, cyclist 0.5; scores from 0.95", false),
    ] {
        let (status, out, err) = eval(folder.path(), &[&["--explain", "000001"], arguments].concat());
        assert_eq!(status, 0, "{err}");
        assert_eq!(out.lines().next(), Some(format!("frame 000001: {heading}").as_str()));
        assert_eq!(out.contains("found by d0"), found, "{out}");
    }
    let near = RESULTS.replace("20.10 1.60 0.9 0.5", "21.00 1.60 0.9");
    for (arguments, fate) in [([].as_slice(), "missed (nearest d0, 0."), (&["--loose"], "found by d0 (0.")] {
        let (_, out, _) = eval_files(folder.path(), LABELS, &near, &[&["--explain", "000001"], arguments].concat());
        assert!(out.lines().nth(2).unwrap().contains(fate), "{out}");
    }
}

#[test]
fn strict_makes_an_error_of_what_is_told_otherwise() {
    let folder = tempfile::tempdir().unwrap();
    let (status, _, err) = eval(folder.path(), &[]);
    let kind = "detections of classes that KITTI does not evaluate";
    assert_eq!(status, 0);
    assert!(err.contains(&format!("warning: {kind}: 1; first results/000001.txt:5: \"Tram\"\n")), "{err}");
    let (status, out, err) = eval(folder.path(), &["--strict"]);
    let expected = format!("error: results/000001.txt:5: \"Tram\" ({kind})\n");
    assert_eq!((status, out.as_str(), err.as_str()), (1, "", expected.as_str()));
    let (status, out, err) = eval(folder.path(), &["--strict", "--explain", "000001"]);
    assert_eq!((status, out.as_str(), err.as_str()), (1, "", expected.as_str()));
}

#[test]
fn strict_looks_at_the_other_results_too() {
    let folder = tempfile::tempdir().unwrap();
    let others = folder.path().join("others");
    fs::create_dir_all(&others).unwrap();
    // What is odd about the labels is told once.
    let labels = LABELS.replace("Van", "van");
    let results: String = RESULTS.split_inclusive('\n').filter(|row| !row.starts_with("Tram")).collect();
    fs::write(others.join("000001.txt"), results.replace("Car", "car")).unwrap();
    let arguments = ["--strict", "--against", "others"];
    let (status, out, err) = eval_files(folder.path(), &labels, &results, &arguments);
    assert_eq!((status, out.as_str()), (1, ""));
    assert_eq!(err.lines().filter(|line| line.contains("labels/000001.txt:2")).count(), 1, "{err}");
    assert_eq!(err.lines().filter(|line| line.contains("others/000001.txt:")).count(), 4, "{err}");
    assert_eq!(err.lines().count(), 5, "{err}");
    // A comparison needs a result for every frame.
    fs::rename(others.join("000001.txt"), others.join("000002.txt")).unwrap();
    let (status, _, err) = eval_files(folder.path(), LABELS, &results, &["--against", "others"]);
    let expected = "error: 1 of 1 frames of the comparison have no result file; the first is others/000001.txt \
                    (a frame in which nothing was found needs an empty file)\n";
    assert_eq!((status, err.as_str()), (2, expected));
}

#[test]
fn without_resamples_there_are_figures_and_no_intervals() {
    let folder = tempfile::tempdir().unwrap();
    let others = folder.path().join("others");
    fs::create_dir_all(&others).unwrap();
    fs::write(others.join("000001.txt"), RESULTS.replace("20.10", "20.30")).unwrap();
    let (status, out, err) = eval(folder.path(), &["--against", "others", "--resamples", "0", "--json", "a.json"]);
    assert_eq!(status, 0, "{err}");
    assert!(out.contains("distance of cars, metres\n") && out.contains("0.1000    0.3000   -0.2000  "), "{out}");
    let json: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(folder.path().join("a.json")).unwrap()).unwrap();
    assert!(json["ranging"]["car"]["moderate"]["intervals"].is_null());
    assert!(json["against"]["rows"][0]["figures"]["mae_z"]["interval"].is_null());
}

#[test]
fn the_same_results_twice_are_said_to_be_identical() {
    let folder = tempfile::tempdir().unwrap();
    let others = folder.path().join("others");
    fs::create_dir_all(&others).unwrap();
    let compared = |theirs: &str| {
        fs::write(others.join("000001.txt"), theirs).unwrap();
        let (status, out, err) = eval(folder.path(), &["--against", "others", "--resamples", "20", "--json", "a.json"]);
        assert_eq!(status, 0, "{err}");
        let json = fs::read_to_string(folder.path().join("a.json")).unwrap();
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        (out, json["against"]["identical"].as_bool().unwrap())
    };
    let (out, is_identical) = compared(RESULTS);
    assert!(out.ends_with("\n\nidentical: both results have the same detections in every frame\n"), "{out}");
    assert!(is_identical);
    // A false alarm more changes no distance and is a difference all the same.
    let car = "Car -1 -1 1.50 400.00 160.00 450.00 210.00 1.50 1.60 4.00 -9.00 1.70 33.00 1.60 0.55\n";
    let (out, is_identical) = compared(&format!("{RESULTS}{car}"));
    assert!(out.contains("+0.0000") && out.contains("  the same\n") && !out.contains("identical"), "{out}");
    assert!(!is_identical);
}

#[test]
fn any_number_of_files_without_a_counterpart_is_told_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    eval(folder.path(), &[]);
    for id in 100..400 {
        fs::write(folder.path().join(format!("results/{id:06}.txt")), "").unwrap();
    }
    let told = "result files without a label file, left out: 300; first results/000100.txt";
    let (status, _, err) = eval(folder.path(), &["--min-score", "0"]);
    assert_eq!((status, err.matches("results/0001").count()), (0, 1), "{err}");
    let (status, _, strict) = eval(folder.path(), &["--strict"]);
    assert_eq!((status, strict.matches("results/0001").count()), (1, 1), "{strict}");
    assert!(err.contains(told) && strict.contains(told), "{err}{strict}");
}

#[test]
fn results_without_detections_and_labels_without_objects_are_no_accident() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["--json", "a.json", "--report", "page", "--resamples", "20"];
    let (status, out, err) = eval_files(folder.path(), LABELS, "", &arguments);
    assert_eq!((status, out.as_str()), (0, "1 frame\n\ndistance of cars: none of 3 objects found\n"));
    assert!(err.contains("note: car: not evaluated, as there is no usable detection of the class"), "{err}");
    let json: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(folder.path().join("a.json")).unwrap()).unwrap();
    assert!(json["ap"]["car"]["2d"].is_null());
    // Silence is counted: three cars, none found, nothing to take an error of.
    let all = &json["ranging"]["car"]["all"];
    assert_eq!((&all["objects"], &all["found"], &all["share"]), (&3.into(), &0.into(), &0.0.into()));
    assert!(all["mae_z"].is_null());
    let page = fs::read_to_string(folder.path().join("page/index.html")).unwrap();
    assert!(page.contains("No object that counts was found"));
    let (status, _, err) = eval_files(folder.path(), "", RESULTS, &arguments);
    assert_eq!(status, 0);
    assert!(err.contains("note: car easy: no object counts; its AP means nothing"), "{err}");
}

#[test]
fn a_frame_or_folder_that_is_not_there_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let (status, _, err) = eval(folder.path(), &["--explain", "7"]);
    let expected = "error: frame 7 is not evaluated; expected one of 000001 ... 000001\n";
    assert_eq!((status, err.as_str()), (2, expected));
    let (status, _, err) = eval(folder.path(), &["--against", "reslts"]);
    let expected = "error: reslts: no such folder; expected a folder of result files such as 000007.txt\n";
    assert_eq!((status, err.lines().last().unwrap_or_default()), (2, expected.trim_end()));
}

#[test]
fn json_and_report_hold_what_is_promised() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["--json", "a.json", "--report", "page", "--against", "results", "--resamples", "50"];
    let (status, _, err) = eval(folder.path(), &arguments);
    assert_eq!(status, 0, "{err}");
    let json: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(folder.path().join("a.json")).unwrap()).unwrap();
    assert_eq!(json["frames"], 1);
    for table in ["ap", "ap_loose"] {
        for metric in ["2d", "aos", "bev", "3d"] {
            assert_eq!(json[table]["car"][metric]["r40"].as_array().map(Vec::len), Some(3), "{table} {metric}");
            assert_eq!(json[table]["car"][metric]["r11"].as_array().map(Vec::len), Some(3), "{table} {metric}");
        }
        assert!(json[table]["cyclist"]["3d"].is_null());
    }
    let interval = &json["ap"]["car"]["3d"]["r40_interval"][1];
    assert_eq!(interval.as_array().map(Vec::len), Some(2), "{interval}");
    assert!(json["ap"]["car"]["aos"]["r40_interval"].is_null());
    let moderate = &json["ranging"]["car"]["moderate"];
    assert_eq!((&moderate["objects"], &moderate["found"]), (&2.into(), &1.into()));
    assert!((moderate["mae_z"].as_f64().unwrap() - 0.1).abs() < 1e-9);
    assert_eq!(moderate["calibration"]["rows"][0]["within_1_sigma"], 1.0);
    assert_eq!(moderate["calibration"]["by_occlusion"][0]["within_90"]["share"], 1.0);
    assert_eq!(json["against"]["rows"][0]["figures"]["mae_z"]["difference"], 0.0);
    let coverage = moderate["calibration"]["coverage"].as_array().unwrap();
    assert_eq!((coverage.len(), &coverage[30]["observed"]), (31, &1.0.into()));
    let page = fs::read_to_string(folder.path().join("page/index.html")).unwrap();
    assert!(page.contains("data:image/png;base64,") && !page.contains("src=\"http"));
    for chart in ["car_3d_curve", "car_error_bar_coverage"] {
        assert!(page.contains(chart), "{chart}");
        assert!(folder.path().join(format!("page/{chart}.png")).is_file(), "{chart}");
    }
    assert!(!page.contains("data:image/jpeg"), "without --images there is nothing to draw on");
}

#[test]
fn the_worst_frames_are_drawn_where_there_are_images() {
    let folder = tempfile::tempdir().unwrap();
    for part in ["image_2", "calib"] {
        fs::create_dir_all(folder.path().join(part)).unwrap();
    }
    let arguments = ["--report", "page", "--images", "image_2", "--resamples", "0"];
    let (status, _, err) = eval(folder.path(), &arguments);
    assert_eq!(status, 0);
    let told = "warning: frames on the page without a picture: 1; first image_2: no image of frame 000001; expected 000001.png";
    assert!(err.contains(told), "{err}");
    let image = image::RgbImage::from_pixel(1242, 375, image::Rgb([90, 90, 90]));
    image.save(folder.path().join("image_2/000001.png")).unwrap();
    let camera = "721.5 0 609.6 44.9 0 721.5 172.9 0.2 0 0 1 0.003";
    fs::write(folder.path().join("calib/000001.txt"), format!("P2: {camera}\n")).unwrap();
    let (status, _, err) = eval(folder.path(), &arguments);
    assert!(status == 0 && !err.contains("without a picture"), "{err}");
    let page = fs::read_to_string(folder.path().join("page/index.html")).unwrap();
    assert!(page.contains("data:image/jpeg;base64,") && page.contains("<td>g0 car</td><td>d0</td>"));
    assert!(folder.path().join("page/worst_000001.png").is_file() && !page.contains("side by side"));
    let others = folder.path().join("others");
    fs::create_dir(&others).unwrap();
    fs::write(others.join("000001.txt"), "").unwrap();
    let against: Vec<_> = arguments.into_iter().chain(["--against", "others"]).collect();
    let (status, _, err) = eval(folder.path(), &against);
    assert!(status == 0 && !err.contains("without a picture"), "{err}");
    let page = fs::read_to_string(folder.path().join("page/index.html")).unwrap();
    let scenes = &page[page.find("Scenes, side by side").unwrap()..];
    assert!(scenes.contains("<h3>000001, "));
    let found = |results: &str| {
        let caption = scenes.split_once(&format!("<figcaption>{results}: ")).unwrap().1;
        caption.split(' ').next().unwrap().parse::<usize>().unwrap()
    };
    assert!(found("results") > 0);
    assert_eq!(found("others"), 0);
    for side in ["ours", "against"] {
        assert!(folder.path().join(format!("page/scene_000001_{side}.png")).is_file(), "{side}");
    }
    // However often the page shows a frame, it is told once that its image is missing.
    fs::rename(folder.path().join("image_2/000001.png"), folder.path().join("elsewhere.png")).unwrap();
    let (status, _, err) = eval(folder.path(), &against);
    assert!(status == 0 && err.contains(told), "{err}");
    let (status, _, err) = eval(folder.path(), &["--report", "page", "--images", "nowhere"]);
    let expected = "error: nowhere: no such folder; expected a folder of images such as 000007.png\n";
    assert_eq!((status, err.as_str()), (2, expected));
}

#[test]
fn place_scores_rank_what_is_sure_of_its_place_first() {
    let folder = tempfile::tempdir().unwrap();
    let (status, _, err) = eval(folder.path(), &["--scores", "place"]);
    assert_eq!((status, err.contains("results/000001.txt:2: no error bar")), (2, true), "{err}");

    // Ten cars that are where they are said to be, by narrow error bars, and ten that are 5 m off, by wide ones and
    // with higher scores.
    let car = |i: usize, z: f64, rest: &str| {
        let [left, right] = [10 * i, 10 * i + 9];
        format!("Car 0 0 1.50 {left} 170.00 {right} 230.00 1.50 1.60 4.00 {}.00 1.70 {z:.2} 1.60{rest}\n", 4 * i)
    };
    let labels: String = (0..20).map(|i| car(i, 20.0, "")).collect();
    let results: String =
        (0..20).map(|i| if i < 10 { car(i, 20.0, " 0.6 0.1") } else { car(i, 25.0, " 0.9 4.0") }).collect();
    let ap = |arguments: &[&str]| {
        let (status, _, err) = eval_files(folder.path(), &labels, &results, arguments);
        assert_eq!(status, 0, "{err}");
        let json: serde_json::Value =
            serde_json::from_str(&fs::read_to_string(folder.path().join("a.json")).unwrap()).unwrap();
        (json["scores"].clone(), json["ap"]["car"]["3d"]["r40"][1].as_f64().unwrap())
    };
    let (given, by_score) = ap(&["--json", "a.json"]);
    let (place, by_place) = ap(&["--json", "a.json", "--scores", "place"]);
    assert_eq!((given, place), ("as_given".into(), "place".into()));
    // Half of the recall points reached, at a precision of 1 instead of at most one half.
    assert!(by_place > 1.9 * by_score && by_score > 0.0, "{by_place} and {by_score}");
}

/// Sixty cars in as many frames, some of them missed; every detection is `offset_m` too far away.
fn sixty_frames(folder: &Path, name: &str, offset_m: f64) {
    let car = |i: u32, offset_m: f64, score: &str| {
        let z = 12.0 + f64::from(i % 30) + offset_m;
        format!("Car 0.00 {} 1.50 600.00 170.00 700.00 230.00 1.50 1.60 4.00 1.00 1.70 {z:.2} 1.60{score}\n", i % 2)
    };
    for (part, offset_m, is_results) in [("labels", 0.0, false), (name, offset_m, true)] {
        fs::create_dir_all(folder.join(part)).unwrap();
        for i in 0..60 {
            let score = if is_results { format!(" 0.{} 0.50", 30 + i) } else { String::new() };
            let text = if is_results && i % 7 == 0 { String::new() } else { car(i, offset_m, &score) };
            fs::write(folder.join(part).join(format!("{i:06}.txt")), text).unwrap();
        }
    }
}

/// What `farsight eval` says of those, and the JSON.
fn eval_sixty(arguments: &[&str]) -> (String, serde_json::Value) {
    let folder = tempfile::tempdir().unwrap();
    sixty_frames(folder.path(), "results", 0.3);
    sixty_frames(folder.path(), "others", 1.5);
    let output = Command::new(env!("CARGO_BIN_EXE_farsight"))
        .args(["eval", "--labels", "labels", "--results", "results", "--resamples", "200", "--json", "a.json"])
        .args(arguments)
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let json = fs::read_to_string(folder.path().join("a.json")).unwrap();
    (String::from_utf8(output.stdout).unwrap(), serde_json::from_str(&json).unwrap())
}

#[test]
fn ap_has_intervals_and_is_compared_by_part() {
    let (out, json) = eval_sixty(&["--against", "others"]);
    let row = out.lines().position(|line| line.starts_with("  3d   0.70")).unwrap();
    let interval = out.lines().nth(row + 1).unwrap();
    assert!(interval.starts_with("    95% interval ") && interval.contains('-'), "{out}");
    for name in ["hard, 60-100 px high", "hard, at 20-30 m", "hard, occlusion 1"] {
        let line = out.lines().find(|line| line.starts_with("  3d   0.70") && line.contains(name));
        assert!(line.is_some_and(|line| line.ends_with("  differs")), "{name}: {out}");
    }
    let rows = json["against"]["ap"].as_array().unwrap();
    let row = |division: &str, part: &str| {
        let is_asked = |row: &&serde_json::Value| {
            row["metric"] == "3d"
                && row["overlap"] == 0.7
                && row["group"] == "hard"
                && row["division"] == division
                && row["part"] == part
        };
        rows.iter().find(is_asked).unwrap()
    };
    // What is hidden and what is not together are all.
    assert_eq!(row("all", "all")["objects"], 60);
    assert_eq!((&row("occlusion", "0")["objects"], &row("occlusion", "1")["objects"]), (&30.into(), &30.into()));
    let (all, low) = (row("all", "all"), row("all", "all")["interval"][0].as_f64().unwrap());
    assert!(all["excludes_zero"] == true && low > 0.0 && all["difference"].as_f64().unwrap() > low, "{all}");
    // Errors of 0.3 m lie within half a metre, and 52 of 60 cars were found.
    let bars = &json["ranging"]["car"]["moderate"]["calibration"]["rows"][0];
    assert_eq!((&bars["count"], &bars["within_50"]["share"]), (&51.into(), &1.0.into()));
    assert!(bars["within_50"]["interval"][0].as_f64().unwrap() > 0.9, "{bars}");
    assert!(out.contains("error bars of cars") && out.contains("100% ["), "{out}");
}

#[test]
fn the_oracle_tells_what_each_part_is_worth() {
    let (out, json) = eval_sixty(&["--oracle", "depth,heading", "--oracle", "depth"]);
    let oracle = json["oracle"].as_array().unwrap();
    let parts: Vec<_> = oracle.iter().map(|row| row["parts"].to_string()).collect();
    assert_eq!(parts, [r#"["depth"]"#, r#"["heading"]"#, r#"["depth","heading"]"#]);
    let lines: Vec<_> = out.lines().skip_while(|line| !line.starts_with("AP car moderate")).collect();
    assert_eq!(lines[0], "AP car moderate, R40, if the truth stood in for");
    assert!(lines[2].starts_with("  nothing ") && lines[5].starts_with("  depth + heading "), "{out}");
    assert!(lines[4].contains("+0.00 [+0.00, +0.00]  the same"), "{out}");
    let (_, json) = eval_sixty(&[]);
    assert!(json.get("oracle").is_none());
}
