//! Ten megabytes of anything: each reader of files takes a second and 256 MB at most, and refuses more by its limit.
//!
//! Labels, results, calibrations and splits have such a test beside them (`farsight-data`). The figures are printed
//! (`-- --nocapture`) and stand in docs/reliability.md; what is asserted is the memory, and that the test ends at all.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "the helpers of a test may panic and print")]

use std::fs;
use std::io::Write;
use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;

use farsight_files::MeasuredTable;
use farsight_laws::named;
use farsight_laws::readers::{BINARY, Reader, TEXT};
use farsight_testing::{Counting, keep_table, peak};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// What is counted is counted for the whole process.
static ALONE: Mutex<()> = Mutex::new(());

/// Bytes of an input.
const SIZE: usize = 10_000_000;

/// Configs end at a mebibyte.
const CONFIG_SIZE: usize = 1_000_000;

/// Bytes that a reader may take for it.
const MOST: usize = 256_000_000;

fn repeated(text: &str, size: usize) -> String {
    text.repeat(size / text.len())
}

/// As many of the lines as there is room for.
fn numbered(size: usize, line: impl Fn(usize) -> String) -> String {
    let mut text = String::with_capacity(size + 200);
    for number in 0.. {
        if text.len() >= size {
            break;
        }
        text.push_str(&line(number));
    }
    text
}

/// The good files of a kind.
fn seeds(target: &str) -> Vec<Vec<u8>> {
    (named(target).unwrap().seeds)()
}

/// Texts that are hard on one reader of text or another.
fn texts(size: usize) -> Vec<(&'static str, String)> {
    let label = "0 7 Car 0 0 -1.5 600 170 700 230 1.5 1.6 4.0 1.0 1.7 20.0 -1.57";
    let [lines, _, frame, ..] = &seeds("answers")[..] else { panic!("no answers") };
    let [lines, frame] = [lines, frame].map(|bytes| String::from_utf8(bytes.clone()).unwrap());
    let record = lines.lines().next().unwrap();
    vec![
        ("one line of words", repeated("a b ", size)),
        ("one line of numbers", repeated("1 ", size)),
        ("a word a line", repeated("a\n", size)),
        ("one word", repeated("a", size)),
        ("one number", repeated("1", size)),
        ("empty lines", repeated("\n", size)),
        ("names", numbered(size, |number| format!("n{number} Car\n"))),
        ("rows of one frame", repeated(&format!("{label}\n"), size)),
        ("rows of many frames", numbered(size, |number| format!("{number}{}\n", &label[1..]))),
        ("a row far away", format!("199999{}\n", &label[1..])),
        ("oxts", repeated(&(["1"; 30].join(" ") + "\n"), size)),
        ("poses", repeated(&(["1"; 12].join(" ") + "\n"), size)),
        ("times", "time_s,speed_mps,yaw_rate\n".to_owned() + &numbered(size, |number| format!("{number},1,1\n"))),
        ("columns", "time_s,speed_mps,yaw_rate".to_owned() + &repeated(",a", size)),
        ("plates", repeated("0 0.5 1.2 12.5 1.6 0.52 0.11\n", size)),
        ("array of numbers", format!("[{}1]", repeated("1,", size))),
        ("array of objects", format!("[{}{{}}]", repeated("{},", size))),
        ("array of answers", format!("[{}{record}]", repeated(&format!("{record},"), size))),
        ("answers", repeated(&format!("{record}\n"), size)),
        ("depths", repeated("[", size)),
        ("one string", format!("[\"{}\"]", repeated("a", size))),
        ("escapes", format!("[\"{}\"]", repeated("\\u00e4", size))),
        ("frames", numbered(size, |number| frame.replacen("\"frame\":0", &format!("\"frame\":{number}"), 1))),
        ("empty frames", numbered(size, |number| format!("{{\"frame\":{number},\"time_s\":0,\"tracks\":[]}}\n"))),
        ("frame far away", "{\"frame\":199999,\"time_s\":0,\"tracks\":[]}\n".to_owned()),
        ("inputs", manifest(&numbered(size, |number| format!(",{{\"name\":\"{number}\",\"sha256\":null}}")))),
        ("cells", {
            let cells = numbered(size, |seed| format!("{{\"arm\":\"a\",\"seed\":{seed},\"steps\":1}},"));
            format!("{{\"cells\":[{}],\"comparisons\":[]}}", cells.trim_end_matches(','))
        }),
        ("TOML array", format!("a = [{}1]", repeated("1,", size))),
        ("TOML keys", numbered(size, |number| format!("k{number} = 1\n"))),
        ("TOML tables", numbered(size, |number| format!("[t{number}]\n"))),
        ("TOML path", repeated("a.", size) + "a = 1"),
        ("TOML braces", format!("a = {}", repeated("{a=", size))),
    ]
}

/// A manifest with more inputs, each with a comma before it.
fn manifest(more: &str) -> String {
    let seeds = seeds("answers");
    let whole = seeds.iter().map(|bytes| String::from_utf8_lossy(bytes)).find(|text| text.contains("first_item"));
    whole.unwrap().replacen(
        "{\"name\":\"a.jpg\",\"sha256\":null}",
        &format!("{{\"name\":\"a.jpg\",\"sha256\":null}}{more}"),
        1,
    )
}

/// A safetensors file with this header and no data.
fn with_header(header: &str) -> Vec<u8> {
    [&(header.len() as u64).to_le_bytes(), header.as_bytes()].concat()
}

/// A checkpoint of `PyTorch` whose pickle is these instructions.
fn with_pickle(instructions: &[u8]) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let mut archive = zip::ZipWriter::new(&mut bytes);
    let stored = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    archive.start_file("archive/data.pkl", stored).unwrap();
    archive.write_all(&[&[0x80, 2], instructions, b"."].concat()).unwrap();
    archive.finish().unwrap();
    bytes.into_inner()
}

/// A protobuf field with this number.
fn field(number: u8, content: &[u8]) -> Vec<u8> {
    let mut length = content.len();
    let mut bytes = vec![number << 3 | 2];
    while length >= 0x80 {
        bytes.push(length as u8 | 0x80);
        length >>= 7;
    }
    bytes.push(length as u8);
    [&bytes, content].concat()
}

/// Files that are hard on one reader or another.
fn binaries() -> Vec<(&'static str, Vec<u8>)> {
    let tensor = |number| format!("\"t{number}\":{{\"dtype\":\"F32\",\"shape\":[0],\"data_offsets\":[0,0]}},");
    let tensors = numbered(SIZE, tensor);
    let [onnx] = &seeds("model")[..] else { panic!("no ONNX file") };
    let tflite = seeds("tflite").remove(0);
    let times = |bytes: &[u8]| bytes.repeat(SIZE / bytes.len());
    // A chain of directories of 65,535 entries each.
    let entries = |order: &[u8; 2]| {
        let directory =
            [&[0xff, 0xff][..], &[0x0f, 1, 2, 0, 1, 0, 0, 0, 8, 0, 0, 0].repeat(65_535), &[8, 0, 0, 0]].concat();
        [&order[..], &[42, 0, 8, 0, 0, 0], &times(&directory)].concat()
    };
    vec![
        ("zeros", vec![0; SIZE]),
        ("ones", vec![0xff; SIZE]),
        ("header of tensors", with_header(&format!("{{{}}}", tensors.trim_end_matches(',')))),
        ("header of one fact", with_header(&format!("{{\"__metadata__\":{{\"a\":\"{}\"}}}}", "a".repeat(SIZE)))),
        ("header of facts", {
            let facts = numbered(SIZE, |number| format!("\"{number}\":\"\","));
            with_header(&format!("{{\"__metadata__\":{{{}}}}}", facts.trim_end_matches(',')))
        }),
        ("header of depths", with_header(&"[".repeat(SIZE))),
        ("pickle of nothing", with_pickle(&times(b"N"))),
        ("pickle of marks", with_pickle(&times(b"("))),
        ("pickle of lists", with_pickle(&times(b"]"))),
        ("pickle of dictionaries", with_pickle(&times(b"}"))),
        ("pickle of copies", with_pickle(&[&b"]"[..], &times(b"2")].concat())),
        ("pickle of words", with_pickle(&times(b"X\x01\x00\x00\x00a"))),
        ("pickle of tuples", with_pickle(&[&b")"[..], &times(b"\x85")].concat())),
        ("pickle of one memo", with_pickle(&times(b"Nq\x00"))),
        ("TFLite, longer", [&tflite[..], &vec![0; SIZE]].concat()),
        ("TFLite of ones", [&[28, 0, 0, 0][..], b"TFL3", &times(&[1, 0, 0, 0])].concat()),
        ("ONNX with facts", [&onnx[..], &times(&field(14, b""))].concat()),
        ("ONNX with a long fact", [&onnx[..], &field(14, &field(1, &vec![b'a'; SIZE]))].concat()),
        ("ONNX of nodes", [&onnx[..], &field(7, &times(&field(1, b"")))].concat()),
        ("ONNX of constants", [&onnx[..], &field(7, &times(&field(5, b"")))].concat()),
        ("ONNX of depths", times(&[0x3a, 0xff, 0xff, 0xff, 0x03])),
        ("TIFF of entries", entries(b"II")),
        ("EXIF of entries", [&b"Exif\0\0"[..], &entries(b"II")].concat()),
        ("JPEG of segments", [&[0xff, 0xd8][..], &times(&[0xff, 0xe1, 0, 2])].concat()),
        (
            "PNG of chunks",
            [&b"\x89PNG\r\n\x1a\n"[..], &times(&[0, 0, 0, 0, b't', b'E', b'X', b't', 0, 0, 0, 0])].concat(),
        ),
    ]
}

/// What a reader takes for a file, bytes and seconds, and what it says.
fn taken(reader: &Reader, folder: &Path, content: &[u8]) -> (usize, f64, Result<(), String>) {
    let path = folder.join(reader.file);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(&path, content).unwrap();
    let start = Instant::now();
    let (bytes, told) = peak(|| (reader.read)(&path));
    (bytes, start.elapsed().as_secs_f64(), told)
}

/// Reads all inputs by all readers, and tells the worst of each reader.
fn all(readers: &[Reader], inputs: &[(&'static str, Vec<u8>)], folder: &Path, table: &mut MeasuredTable) {
    for reader in readers {
        let (mut most, mut slowest) = ((0, ""), (0.0, ""));
        for (name, content) in inputs {
            let (bytes, seconds, told) = taken(reader, folder, content);
            assert!(bytes <= MOST, "{}, {name}: {bytes} bytes; {told:?}", reader.name);
            most = if bytes > most.0 { (bytes, name) } else { most };
            slowest = if seconds > slowest.0 { (seconds, name) } else { slowest };
        }
        let ((bytes, large), (seconds, slow)) = (most, slowest);
        let memory = format!("{} MB", bytes / 1_000_000);
        println!("{}: {memory} for {large}, {seconds:.2} s for {slow}", reader.name);
        table.put([reader.name.to_owned(), memory, large.to_owned(), format!("{seconds:.2} s"), slow.to_owned()]);
    }
}

#[test]
fn ten_megabytes_of_anything_take_a_bounded_amount_of_memory() {
    let _alone = ALONE.lock();
    let folder = tempfile::tempdir().unwrap();
    let bytes = |texts: Vec<(&'static str, String)>| texts.into_iter().map(|(name, text)| (name, text.into_bytes()));
    let is_config = |reader: &&Reader| Path::new(reader.file).extension().is_some_and(|end| end == "toml");
    let command = "cargo test --release -p farsight-laws --test large_files";
    let mut table = MeasuredTable::new(command, ["reader", "memory", "taken for", "time", "spent on"]);
    let (configs, others): (Vec<&Reader>, Vec<&Reader>) = TEXT.iter().partition(is_config);
    let owned = |readers: Vec<&Reader>| readers.into_iter().copied().collect::<Vec<_>>();
    all(&owned(others), &bytes(texts(SIZE)).collect::<Vec<_>>(), folder.path(), &mut table);
    all(&owned(configs), &bytes(texts(CONFIG_SIZE)).collect::<Vec<_>>(), folder.path(), &mut table);
    all(BINARY, &binaries(), folder.path(), &mut table);
    keep_table("large-files", &table);
}

#[test]
fn larger_files_are_refused_by_their_limit() {
    let _alone = ALONE.lock();
    let folder = tempfile::tempdir().unwrap();
    // A file of nothing takes no room on the disk.
    let sparse = |reader: &Reader, length: u64| {
        let path = folder.path().join(reader.file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::File::create(&path).unwrap().set_len(length).unwrap();
        (reader.read)(&path).unwrap_err()
    };
    for reader in TEXT.iter().chain(BINARY).filter(|reader| !["EXIF", "image"].contains(&reader.name)) {
        let told = sparse(reader, 5 << 30);
        let name = Path::new(reader.file).file_name().unwrap().to_str().unwrap();
        let is_limit = told.contains("expected at most ") || reader.name == "safetensors, header";
        assert!(told.contains(name) && is_limit, "{}: {told}", reader.name);
    }
}
