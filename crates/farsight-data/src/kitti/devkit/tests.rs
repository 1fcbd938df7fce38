use super::{DevkitRows, rows_as_devkit};
use crate::kitti::RowKind;

const LABEL: &str = "Car 0.00 0 -1.57 608.40 182.50 719.60 281.90 1.52 1.66 4.07 0.80 1.71 13.60 -1.62\n";
const RESULT: &str = "Car -1 -1 -1.57 608.40 182.50 719.60 281.90 1.52 1.66 4.07 0.80 1.71 13.60 -1.62 0.9\n";

fn kinds(read: &DevkitRows) -> Vec<(usize, &'static str)> {
    read.diagnostics.iter().map(|(line, diagnostic)| (*line, diagnostic.kind())).collect()
}

#[test]
fn odd_files_are_read_as_the_devkit_reads_them() {
    let with = |text: &str, old: &str, new: &str| text.replacen(old, new, 1);
    let (label, result) = (RowKind::Label, RowKind::Result);
    // What it is, the file, its kind, how many rows count, what is told.
    let cases = [
        ("nothing", String::new(), result, 0, vec![]),
        ("blank lines", format!("\n{RESULT}\n \n{RESULT}\n"), result, 2, vec![]),
        ("no last line end", RESULT.trim_end().to_owned(), result, 1, vec![]),
        ("15 fields", format!("{LABEL}{RESULT}"), result, 1, vec![(1, "rows dropped")]),
        (
            "only 15 fields",
            LABEL.repeat(3),
            result,
            0,
            vec![(1, "rows dropped"), (2, "rows dropped"), (3, "rows dropped")],
        ),
        ("an error bar", with(RESULT, "0.9\n", "0.9 0.5\n").repeat(2), result, 2, vec![]),
        ("18 fields", with(RESULT, "0.9\n", "0.9 0.5 7\n") + RESULT, result, 2, vec![(1, "rows with extra fields")]),
        ("an error bar that is none", with(RESULT, "0.9\n", "0.9 nan\n"), result, 1, vec![(1, "values out of range")]),
        ("a negative error bar", with(RESULT, "0.9\n", "0.9 -0.5\n"), result, 1, vec![(1, "values out of range")]),
        (
            "a score in a label file",
            RESULT.replace("-1 -1 ", "0 0 ") + LABEL,
            label,
            2,
            vec![(1, "rows with extra fields")],
        ),
        ("a row over two lines", with(RESULT, " 1.52 ", "\n1.52 "), result, 1, vec![(1, "rows over several lines")]),
        ("two rows on one line", with(&RESULT.repeat(2), "0.9\n", "0.9 "), result, 2, vec![]),
        (
            "a word for a number",
            with(&RESULT.repeat(2), "13.60", "far"),
            result,
            1,
            vec![(1, "rows dropped"), (1, "rows dropped")],
        ),
        ("no number", with(RESULT, "0.9", "nan"), result, 1, vec![(1, "numbers that are not finite")]),
        ("endless", with(RESULT, "13.60", "-inf"), result, 1, vec![(1, "numbers that are not finite")]),
        ("absurd", with(RESULT, "13.60", "1e9"), result, 1, vec![(1, "absurd numbers")]),
        (
            "occlusion 0.00",
            with(LABEL, " 0 ", " 0.00 ") + LABEL,
            label,
            1,
            vec![(1, "occlusion that is no whole number")],
        ),
        ("Windows", RESULT.replace('\n', "\r\n"), result, 1, vec![(1, "Windows line ends")]),
        ("unknown class", with(RESULT, "Car", "Bus"), result, 1, vec![(1, "unknown classes")]),
        ("another case", with(RESULT, "Car", "car"), result, 1, vec![(1, "classes in unusual case")]),
        ("a mark before the first word", format!("\u{feff}{RESULT}"), result, 1, vec![(1, "unknown classes")]),
        ("no width", with(RESULT, "1.66", "0"), result, 1, vec![(1, "values out of range")]),
        (
            "a unit",
            with(RESULT, "0.9", "0.9%"),
            result,
            1,
            vec![(1, "numbers that go on as text"), (1, "rows with extra fields")],
        ),
    ];
    let failed: Vec<_> = cases
        .iter()
        .filter_map(|(name, text, kind, rows, told)| {
            let read = rows_as_devkit(text, *kind);
            (read.rows.len() != *rows || kinds(&read) != *told).then(|| format!("{name}: {read:?}"))
        })
        .collect();
    assert!(failed.is_empty(), "{failed:#?}");
}

#[test]
fn rows_after_an_odd_one_keep_their_error_bars() {
    let with_bar = RESULT.replacen("0.9\n", "0.9 0.5\n", 1);
    for odd in [RESULT.replacen("13.60", "far", 1), RESULT.replacen(" 1.52 ", "\n1.52 ", 1), LABEL.to_owned()] {
        let read = rows_as_devkit(&format!("{with_bar}{odd}{with_bar}{with_bar}"), RowKind::Result);
        let bars = read.rows.iter().filter(|row| row.range_sigma_m == Some(0.5)).count();
        assert_eq!((bars, read.rows.last().map(|row| row.line)), (3, Some(3 + odd.lines().count())), "{odd}{read:?}");
        assert!(kinds(&read).iter().all(|(line, _)| (2..=3).contains(line)), "{odd}{read:?}");
    }
}

#[test]
fn both_ways_of_reading_give_the_same_row() {
    let ordinary = rows_as_devkit(RESULT, RowKind::Result);
    let by_words = rows_as_devkit(&RESULT.replacen("-1 -1", "-1\n-1", 1), RowKind::Result);
    assert_eq!(ordinary.rows, by_words.rows);
}

#[test]
fn a_17th_column_of_results_is_the_error_bar() {
    let read = rows_as_devkit(&RESULT.replace("0.9\n", "0.9 1.25\n"), RowKind::Result);
    assert_eq!(read.rows[0].range_sigma_m, Some(1.25));
    assert_eq!(read.rows[0].row.score, Some(0.9));
}
