//! Import of checkpoints that PyTorch itself wrote (`scripts/make_checkpoint_fixtures.py`).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use farsight_core::input::{ChannelOrder, Sampling};
use farsight_graph::weights::{WeightTensor, Weights};
use farsight_import::{CheckpointProblem, read_pth, tensors_from_pth};
use farsight_methods::smoke::import::{
    ImagenetNorms, ImportOptions, Imported, Layout, canonical_names, import, is_dead,
};
use farsight_methods::smoke::{Quirks, SmokeConfig};
use farsight_testing::{Array, Golden};
use proptest::prelude::*;

/// Parameters of the 16-channel network, as the script prints them.
const NARROW_PARAMETERS: usize = 177_371;

const SMOKE_FIXTURES: [(&str, Layout); 4] = [
    ("official_zip.pth", Layout::OfficialSmoke),
    ("official_legacy.pth", Layout::OfficialSmoke),
    ("mmdet3d_zip.pth", Layout::Mmdet3d),
    ("mmdet3d_legacy.pth", Layout::Mmdet3d),
];

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name)
}

fn imported(name: &str) -> Imported {
    import(&fixture(name), ImportOptions::default()).unwrap()
}

/// Twin of `pool_value` in the script.
fn pool_value(k: usize) -> f32 {
    ((k * 7919 % 2039) as f32 - 1019.0) / 4096.0
}

/// Twin of `pool_offset` in the script.
fn pool_offset(index: usize) -> usize {
    index * 53 % 500
}

#[test]
fn every_tensor_of_every_file_holds_exactly_what_was_saved() {
    for (file, layout) in SMOKE_FIXTURES {
        let result = imported(file);
        assert_eq!(result.layout, layout, "{file}");
        assert_eq!((result.left_over, result.missing), (vec![], vec![]), "{file}");
        let names: Vec<&String> = result.weights.tensors.keys().collect();
        assert_eq!(names, canonical_names().iter().collect::<Vec<_>>(), "{file}");
        for (index, (name, tensor)) in result.weights.tensors.iter().enumerate() {
            let expected: Vec<f32> = (0..tensor.values.len()).map(|k| pool_value(pool_offset(index) + k)).collect();
            assert_eq!(tensor.values, expected, "{file}: {name}");
            assert_eq!(tensor.shape.iter().product::<usize>(), expected.len(), "{file}: {name}");
        }
        let parameters: usize = result.weights.tensors.values().map(|tensor| tensor.values.len()).sum();
        assert_eq!(parameters, NARROW_PARAMETERS, "{file}");
    }
}

#[test]
fn shapes_are_those_of_the_narrow_network() {
    let weights = imported("official_zip.pth").weights;
    let rows: [(&str, &[usize]); 6] = [
        ("backbone.body.base.base_layer.0.weight", &[16, 3, 7, 7]),
        ("backbone.body.base.level4.tree2.root.conv.weight", &[16, 64, 1, 1]),
        ("backbone.body.ida_up.up_2.weight", &[16, 1, 8, 8]),
        ("backbone.body.ida_up.node_1.deform_conv.conv_offset_mask.weight", &[27, 16, 3, 3]),
        ("heads.predictor.class_head.3.weight", &[3, 16, 1, 1]),
        ("heads.predictor.regression_head.3.bias", &[8]),
    ];
    for (name, shape) in rows {
        weights.tensor(name, shape).unwrap();
    }
}

#[test]
fn the_config_says_how_each_network_was_trained() {
    let narrow = SmokeConfig { level_channels: Some([16; 6]), head_channels: Some(16), ..SmokeConfig::default() };
    let official = Quirks { camera_3x3: true, channels: ChannelOrder::Bgr, sampling: Sampling::HalfPixel };
    let table = [
        ("official_legacy.pth", Some(SmokeConfig { quirks: official, ..narrow.clone() })),
        ("mmdet3d_zip.pth", Some(narrow)),
        ("imagenet_zip.pth", None),
    ];
    for (file, config) in table {
        assert_eq!(imported(file).config, config, "{file}");
    }
}

#[test]
fn mmdetection3d_files_keep_their_class_order_until_import() {
    let theirs = read_pth(&fixture("mmdet3d_zip.pth")).unwrap();
    let bias = imported("mmdet3d_zip.pth").weights.tensors["heads.predictor.class_head.3.bias"].values.clone();
    let reversed: Vec<f32> = bias.into_iter().rev().collect();
    assert_eq!(theirs["bbox_head.conv_cls.bias"].values, reversed);
}

#[test]
fn imagenet_norms_are_taken_as_the_official_loader_takes_them_or_all() {
    for file in ["imagenet_zip.pth", "imagenet_legacy.pth"] {
        let path = fixture(file);
        let all = import(&path, ImportOptions { imagenet_norms: ImagenetNorms::All }).unwrap();
        let official = import(&path, ImportOptions::default()).unwrap();
        // 6 convolutions, 3 norms with the same name in both, 3 that are called otherwise.
        assert_eq!(all.weights.tensors.len(), 6 + 2 * 3 + 2 * 3, "{file}");
        assert_eq!(official.weights.tensors.len(), 6 + 2 * 3, "{file}");
        assert!(official.weights.tensors.iter().all(|(name, tensor)| all.weights.tensors[name] == *tensor));
        // The running statistics of 6 norms and the classifier; the step counters are not worth a word.
        assert_eq!(all.left_over.len(), 2 * 6 + 2, "{file}");
        assert_eq!(official.left_over.len(), 2 * 6 + 2 + 2 * 3, "{file}");
        let dead = canonical_names().iter().filter(|name| is_dead(name)).count();
        assert_eq!(all.missing.len(), 233 - dead - all.weights.tensors.len(), "{file}");
    }
}

#[test]
fn imported_weights_survive_a_safetensors_file() {
    let folder = tempfile::tempdir().unwrap();
    let (first, second) = (folder.path().join("a.safetensors"), folder.path().join("b.safetensors"));
    let weights = imported("mmdet3d_legacy.pth").weights;
    weights.write(&first).unwrap();
    let read = Weights::read(&first).unwrap();
    assert_eq!(read, weights);
    read.write(&second).unwrap();
    assert_eq!(std::fs::read(first).unwrap(), std::fs::read(second).unwrap(), "equal weights give equal bytes");
}

#[test]
fn files_that_are_no_checkpoints_say_so() {
    assert!(matches!(tensors_from_pth(b"GIF89a..."), Err(CheckpointProblem::Format { .. })));
    assert!(matches!(tensors_from_pth(b""), Err(CheckpointProblem::Format { .. })));
    assert!(matches!(tensors_from_pth(b"PK\x03\x04 no more"), Err(CheckpointProblem::Zip(_))));
    let error = read_pth(Path::new("no/such/file.pth")).unwrap_err().to_string();
    assert!(error.starts_with("no/such/file.pth: "), "{error}");
}

#[test]
fn a_file_that_was_cut_short_is_an_error() {
    for (file, _) in SMOKE_FIXTURES {
        let bytes = std::fs::read(fixture(file)).unwrap();
        for kept in (0..bytes.len()).step_by(997).chain([bytes.len() - 1]) {
            assert!(tensors_from_pth(&bytes[..kept]).is_err(), "{file} cut to {kept} bytes");
        }
    }
}

/// Checkpoints of the golden networks, made by the script with `--golden`; too large to commit.
#[test]
fn golden_networks_arrive_unchanged() {
    let Some(folder) = std::env::var_os("FARSIGHT_FIXTURES_FULL").map(PathBuf::from) else {
        println!("skipped: FARSIGHT_FIXTURES_FULL is not set");
        return;
    };
    for (size, golden) in
        [("tiny", Some(Golden::open("net_tiny_weights"))), ("full", Golden::open_large("net_full_weights"))]
    {
        let Some(golden) = golden else { return };
        let names = canonical_names();
        let tensor = |array: &Array| WeightTensor { shape: array.shape.clone(), values: array.to_f32() };
        let all = golden.iter().map(|(name, array)| (name.to_owned(), tensor(array)));
        let expected: BTreeMap<String, WeightTensor> = all.filter(|(name, _)| names.contains(name)).collect();
        for file in ["official_zip", "official_legacy", "mmdet3d_zip", "mmdet3d_legacy"] {
            let path = folder.join(format!("net_{size}_{file}.pth"));
            let result = import(&path, ImportOptions::default()).unwrap();
            assert!(result.weights.tensors == expected, "{}", path.display());
        }
    }
}

/// A fixture with some of its bytes replaced.
fn damaged() -> impl Strategy<Value = Vec<u8>> {
    let files =
        ["official_zip.pth", "official_legacy.pth", "mmdet3d_zip.pth", "mmdet3d_legacy.pth", "imagenet_zip.pth"];
    let contents = files.map(|file| std::fs::read(fixture(file)).unwrap());
    let edits = prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12);
    (prop::sample::select(contents.to_vec()), edits).prop_map(|(mut bytes, edits)| {
        for (place, byte) in edits {
            let place = place.index(bytes.len());
            bytes[place] = byte;
        }
        bytes
    })
}

proptest! {
    #[test]
    fn no_damaged_file_makes_the_reader_panic(bytes in damaged()) {
        let _ = tensors_from_pth(&bytes);
    }

    #[test]
    fn no_bytes_behind_a_good_start_make_the_reader_panic(
        start in prop::sample::select(vec![&b"PK\x03\x04"[..], &LEGACY_START[..], b"\x80\x02"]),
        rest in prop::collection::vec(any::<u8>(), 0..300),
    ) {
        let _ = tensors_from_pth(&[start, &rest].concat());
    }
}

/// The pickles that open every legacy file: the magic number, the version, and an empty machine description.
const LEGACY_START: [u8; 25] = *b"\x80\x02\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19.\x80\x02M\xe9\x03.\x80\x02}.";

#[test]
fn a_tflite_file_cut_or_changed_anywhere_is_an_error_or_another_network() {
    let whole = std::fs::read(fixture("mobilenet_v2_tensorflow.tflite")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.tflite");
    let outcome = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        import(&path, ImportOptions::default())
            .map(|imported| imported.missing.len())
            .map_err(|error| error.to_string())
    };
    assert_eq!(outcome(&whole), Ok(0));
    // The tables stand at both ends.
    let places =
        (0..400).chain((400..whole.len() - 4000).step_by(997)).chain((whole.len() - 4000..whole.len()).step_by(13));
    for place in places {
        assert!(outcome(&whole[..place]).is_err(), "cut at {place}");
        for value in [0, 0x7f, 0xff] {
            let mut changed = whole.clone();
            changed[place] = value;
            // Whatever it gives, it gives it without a panic.
            let _ = outcome(&changed);
        }
    }
    let error = outcome(&whole[..100]).unwrap_err();
    assert!(error.contains("m.tflite: TFLite file: "), "{error}");
}
