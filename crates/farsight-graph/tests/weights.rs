//! Safetensors files: laws, and files from strangers.

#![allow(clippy::unwrap_used, reason = "the helpers of a test may panic")]

use std::collections::BTreeMap;
use std::path::Path;

use farsight_graph::weights::{WeightTensor, Weights, WeightsError};
use proptest::prelude::*;

fn file(header: &str, data: &[u8]) -> Vec<u8> {
    [&(header.len() as u64).to_le_bytes(), header.as_bytes(), data].concat()
}

fn read(bytes: &[u8]) -> Result<Weights, WeightsError> {
    Weights::from_safetensors(bytes, Path::new("model.safetensors"))
}

fn bytes_of(weights: &Weights) -> Vec<u8> {
    let mut bytes = Vec::new();
    weights.write_safetensors(&mut bytes).unwrap();
    bytes
}

#[test]
fn facts_are_read_without_the_tensors() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    let metadata = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        Weights::read_metadata(&path).map_err(|error| error.to_string())
    };
    // The tensor is not there.
    let header = r#"{"__metadata__":{"a":"b"},"t":{"dtype":"F32","shape":[2],"data_offsets":[0,8]}}"#;
    assert_eq!(metadata(&file(header, b"")).unwrap(), BTreeMap::from([("a".to_owned(), "b".to_owned())]));
    assert!(metadata(&file("{}", b"")).unwrap().is_empty());
    for (bytes, told) in [
        (b"short".as_slice(), "not a whole safetensors file: 5 bytes; expected 8"),
        (&[0xff; 9], "not a whole safetensors file: 9 bytes; expected 18446744073709551615"),
        (&file("{", b""), "safetensors header: EOF"),
    ] {
        let error = metadata(bytes).unwrap_err();
        assert!(error.contains(told), "{error}");
    }
}

#[test]
fn each_refusal_names_the_file_and_the_place() {
    let rows: [(&[u8], &str); 7] = [
        (b"", "model.safetensors: not a whole safetensors file: 0 bytes; expected 8"),
        (&[0xff; 8], "model.safetensors: not a whole safetensors file: 8 bytes; expected 18446744073709551615"),
        (&file("{}", b"behind"), "model.safetensors: not a whole safetensors file: 16 bytes; expected 10"),
        (
            &file(r#"{"a":{"dtype":"F32","shape":[2],"data_offsets":[0,8]}}"#, b"1234"),
            "model.safetensors: not a whole safetensors file: 66 bytes; expected 70",
        ),
        (&file("{", b""), "model.safetensors: safetensors header: EOF"),
        (
            &file(r#"{"a":{"dtype":"F32","shape":[4611686018427387904],"data_offsets":[0,4]}}"#, b"1234"),
            "model.safetensors: safetensors header: ",
        ),
        (
            &file(r#"{"a":{"dtype":"U8","shape":[4],"data_offsets":[0,4]}}"#, b"1234"),
            "model.safetensors: tensor \"a\" holds U8; expected F32, F16, BF16 or F64",
        ),
    ];
    for (bytes, message) in rows {
        let error = read(bytes).unwrap_err().to_string();
        assert!(error.starts_with(message), "{error}\nexpected\n{message}");
    }
}

#[test]
fn offsets_near_the_end_of_all_memory_are_an_error() {
    let end = usize::MAX;
    let header = format!(r#"{{"a":{{"dtype":"U8","shape":[{}],"data_offsets":[0,{}]}}}}"#, end / 8, end / 8);
    assert!(matches!(read(&file(&header, b"")), Err(WeightsError::Length { .. })));
}

#[test]
fn step_counters_are_dropped_and_other_integers_refused() {
    let header = |name| format!(r#"{{"{name}":{{"dtype":"I64","shape":[],"data_offsets":[0,8]}}}}"#);
    assert_eq!(read(&file(&header("norm.num_batches_tracked"), &[0; 8])).unwrap(), Weights::default());
    assert!(matches!(read(&file(&header("target"), &[0; 8])), Err(WeightsError::Dtype { .. })));
}

#[test]
fn half_precision_is_read() {
    let header = r#"{"h":{"dtype":"F16","shape":[1],"data_offsets":[0,2]},"b":{"dtype":"BF16","shape":[1],"data_offsets":[2,4]}}"#;
    let weights = read(&file(header, &[0x00, 0xbe, 0xc0, 0xbf])).unwrap();
    assert_eq!(weights.tensors["h"].values, [-1.5]);
    assert_eq!(weights.tensors["b"].values, [-1.5]);
}

#[test]
fn a_tensor_is_asked_for_with_its_shape() {
    let tensors = BTreeMap::from([("a".to_owned(), WeightTensor::new(vec![2, 1], vec![1.0, 2.0]).unwrap())]);
    let weights = Weights { tensors, metadata: BTreeMap::new() };
    assert!(weights.tensor("a", &[2, 1]).is_ok());
    assert_eq!(
        weights.tensor("a", &[1, 2]).unwrap_err().to_string(),
        "tensor \"a\" has the shape [2, 1]; expected [1, 2]"
    );
    assert_eq!(weights.tensor("b", &[1]).unwrap_err().to_string(), "tensor \"b\" is missing; expected the shape [1]");
    assert!(WeightTensor::new(vec![2, usize::MAX], vec![0.0]).is_err());
}

#[test]
fn a_tensor_that_does_not_fill_its_shape_is_not_written() {
    let tensors = BTreeMap::from([("a".to_owned(), WeightTensor { shape: vec![3], values: vec![1.0] })]);
    assert!(Weights { tensors, metadata: BTreeMap::new() }.write_safetensors(&mut Vec::new()).is_err());
}

fn any_weights() -> impl Strategy<Value = Weights> {
    let tensor = prop::collection::vec(1_usize..4, 0..4).prop_flat_map(|shape| {
        let count = shape.iter().product();
        let values = prop::collection::vec(-1e30_f32..1e30, count..=count);
        (Just(shape), values).prop_map(|(shape, values)| WeightTensor { shape, values })
    });
    let metadata = prop::collection::btree_map("[a-z.]{1,9}", "\\PC{0,9}", 0..4);
    (prop::collection::btree_map("[a-z.]{1,9}", tensor, 0..6), metadata)
        .prop_map(|(tensors, metadata)| Weights { tensors, metadata })
}

proptest! {
    #[test]
    fn what_is_written_is_read_back(weights in any_weights()) {
        let bytes = bytes_of(&weights);
        prop_assert_eq!(&read(&bytes).unwrap(), &weights);
        // The crate that the format comes from reads it too.
        prop_assert_eq!(safetensors::SafeTensors::deserialize(&bytes).unwrap().len(), weights.tensors.len());
    }

    #[test]
    fn no_damaged_file_makes_the_reader_panic(
        weights in any_weights(),
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let mut bytes = bytes_of(&weights);
        for (place, byte) in edits {
            let place = place.index(bytes.len());
            bytes[place] = byte;
        }
        let _ = read(&bytes);
    }
}

/// Weights whose file has a fact, a config-like text and two tensors.
fn sealed_example() -> Weights {
    let tensor = |values: &[f32]| WeightTensor { shape: vec![values.len()], values: values.to_vec() };
    let tensors = [("b.bias".to_owned(), tensor(&[0.5, -2.0])), ("a.weight".to_owned(), tensor(&[1.0, 3.0, 7.25]))];
    Weights {
        tensors: tensors.into(),
        metadata: [("farsight.model".to_owned(), "{\"std_m\":16.32}".to_owned())].into(),
    }
}

#[test]
fn a_flipped_bit_anywhere_is_told() {
    let weights = sealed_example();
    let bytes = bytes_of(&weights);
    assert_eq!(read(&bytes).unwrap(), weights, "the hash is the file's and no fact of the weights");
    for place in 0..bytes.len() {
        for bit in 0..8 {
            let mut flipped = bytes.clone();
            flipped[place] ^= 1 << bit;
            // A flip in the key of the hash, or in spaces behind the header, may leave a file that says the same or has
            // no hash.
            if let Ok(read) = read(&flipped) {
                assert!(read == weights || read.metadata.len() > weights.metadata.len(), "byte {place}, bit {bit}");
                assert_eq!(read.tensors, weights.tensors, "byte {place}, bit {bit}");
            }
        }
    }
    let mut flipped = bytes.clone();
    *flipped.last_mut().unwrap() ^= 1;
    let told = read(&flipped).unwrap_err().to_string();
    assert!(told.starts_with("model.safetensors: its contents have the hash "), "{told}");
}

#[test]
fn files_from_before_the_hash_are_read() {
    let header = r#"{"__metadata__":{"a":"b"},"t":{"dtype":"F32","shape":[1],"data_offsets":[0,4]}}"#;
    assert_eq!(read(&file(header, &1.5_f32.to_le_bytes())).unwrap().tensors["t"].values, [1.5]);
}

#[test]
fn numbers_that_are_not_finite_are_told_by_tensor_and_place() {
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut weights = sealed_example();
        weights.check_finite(Path::new("m.safetensors")).unwrap();
        weights.tensors.get_mut("a.weight").unwrap().values[2] = value;
        let told = weights.check_finite(Path::new("m.safetensors")).unwrap_err().to_string();
        let expected = format!("m.safetensors: tensor \"a.weight\" has {value} at place 2; expected finite numbers");
        assert_eq!(told, expected);
    }
}

#[test]
fn a_mean_is_that_of_every_number_and_of_one_network_only() {
    let weights = |values: [f32; 2], name: &str| Weights {
        tensors: BTreeMap::from([(name.to_owned(), WeightTensor { shape: vec![2], values: values.to_vec() })]),
        metadata: BTreeMap::from([("of".to_owned(), name.to_owned())]),
    };
    let mean = weights([1.0, -3.0], "a").mean_with(&weights([2.0, 3.0], "a")).expect("one network");
    assert_eq!(mean, weights([1.5, 0.0], "a"));
    assert!(weights([1.0, 2.0], "a").mean_with(&weights([1.0, 2.0], "b")).is_none());
    let mut more = weights([1.0, 2.0], "a");
    more.tensors.insert("b".to_owned(), WeightTensor { shape: vec![1], values: vec![0.0] });
    assert!(weights([1.0, 2.0], "a").mean_with(&more).is_none());
    more.tensors.remove("b");
    more.tensors.insert("a".to_owned(), WeightTensor { shape: vec![1, 2], values: vec![0.0; 2] });
    assert!(weights([1.0, 2.0], "a").mean_with(&more).is_none());
}
