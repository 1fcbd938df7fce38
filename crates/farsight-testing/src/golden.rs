//! Reference tensors, computed independently in double precision and stored in single (`tests/golden/README.md`).

use std::collections::BTreeMap;
use std::path::PathBuf;

use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};

use crate::workspace;

/// Names the folder of reference files that comes first.
const VARIABLE: &str = "FARSIGHT_GOLDEN";

/// The reference files in the repository.
const COMMITTED: &str = "tests/golden";

/// Reference files that are too large for the repository.
const LARGE: &str = "../shared/golden";

/// A reference tensor, last axis fastest.
#[derive(Debug, Clone, PartialEq)]
pub struct Array {
    /// Its shape.
    pub shape: Vec<usize>,
    /// Its values. NaN where the file does not say: of some large tensors only a sample is stored.
    pub values: Vec<f64>,
}

/// The tensors of one reference file by name.
#[derive(Debug, Clone, PartialEq)]
pub struct Golden(BTreeMap<String, Array>);

impl Golden {
    /// The committed file `name`, or the one of that name in the folder that `FARSIGHT_GOLDEN` names.
    pub fn open(name: &str) -> Self {
        let path = path(name, &[COMMITTED]);
        Self::read(&path.unwrap_or_else(|| panic!("no {name}.safetensors in {COMMITTED}")))
    }

    /// A file that is too large to be committed, from the folder that `FARSIGHT_GOLDEN` names or `../shared/golden`.
    ///
    /// `None`, with a printed reason, where it is not there.
    pub fn open_large(name: &str) -> Option<Self> {
        let path = path(name, &[LARGE]);
        if path.is_none() {
            println!("skipped: no {name}.safetensors in {LARGE}; {VARIABLE} names another folder");
        }
        path.as_ref().map(Self::read)
    }

    fn read(path: &PathBuf) -> Self {
        let bytes = std::fs::read(path).unwrap();
        let file = SafeTensors::deserialize(&bytes).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let stored = file.iter().map(|(name, view)| (name.to_owned(), Array::from_view(&view))).collect();
        Self(whole(stored))
    }

    /// The tensor `name`.
    pub fn array(&self, name: &str) -> &Array {
        self.0.get(name).unwrap_or_else(|| panic!("no reference tensor \"{name}\""))
    }

    /// Whether there is a tensor `name`.
    pub fn contains(&self, name: &str) -> bool {
        self.0.contains_key(name)
    }

    /// All tensors with their names, in the order of the names.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (&str, &Array)> {
        self.0.iter().map(|(name, array)| (name.as_str(), array))
    }

    /// The values of the tensor `name`.
    pub fn numbers(&self, name: &str) -> Vec<f64> {
        self.array(name).values.clone()
    }

    /// The values of the tensor `name` in the precision in which they are stored.
    pub fn to_f32(&self, name: &str) -> Vec<f32> {
        self.array(name).to_f32()
    }

    /// The values of the tensor `name`, which are whole and not negative.
    pub fn integers(&self, name: &str) -> Vec<usize> {
        self.array(name).integers()
    }

    /// The values of the tensor `name`, which are those of pixels.
    pub fn bytes(&self, name: &str) -> Vec<u8> {
        self.integers(name).into_iter().map(|value| u8::try_from(value).unwrap()).collect()
    }

    /// The values of the tensor `name`, so many a row.
    pub fn rows<const WIDTH: usize>(&self, name: &str) -> Vec<[f64; WIDTH]> {
        let (rows, rest) = self.array(name).values.as_chunks::<WIDTH>();
        assert!(rest.is_empty(), "{name} has no rows of {WIDTH}");
        rows.to_vec()
    }
}

impl Array {
    /// The values in the precision in which they are stored.
    pub fn to_f32(&self) -> Vec<f32> {
        self.values.iter().map(|&value| value as f32).collect()
    }

    /// The values, which are whole and not negative.
    pub fn integers(&self) -> Vec<usize> {
        let whole = |&value: &f64| {
            assert!(value >= 0.0 && value.fract() == 0.0, "{value} is no whole number");
            value as usize
        };
        self.values.iter().map(whole).collect()
    }

    fn from_view(view: &TensorView<'_>) -> Self {
        let data = view.data();
        let values = match view.dtype() {
            Dtype::U8 => data.iter().map(|&byte| f64::from(byte)).collect(),
            Dtype::I32 => data.as_chunks().0.iter().map(|&b| f64::from(i32::from_le_bytes(b))).collect(),
            Dtype::I64 => data.as_chunks().0.iter().map(|&b| i64::from_le_bytes(b) as f64).collect(),
            Dtype::F32 => data.as_chunks().0.iter().map(|&b| f64::from(f32::from_le_bytes(b))).collect(),
            other => panic!("reference tensors of {other:?} are not read"),
        };
        Self { shape: view.shape().to_vec(), values }
    }
}

/// The first file of this name: in the folder that the environment names, else in those of `defaults`.
fn path(name: &str, defaults: &[&str]) -> Option<PathBuf> {
    let named = std::env::var_os(VARIABLE).map(PathBuf::from);
    let folders = named.into_iter().chain(defaults.iter().map(PathBuf::from));
    folders.map(|folder| workspace().join(folder).join(format!("{name}.safetensors"))).find(|path| path.is_file())
}

/// `stored` with thinned tensors put together: NAME@values at NAME@places of NAME@shape, NAME@elsewhere in all others.
fn whole(mut stored: BTreeMap<String, Array>) -> BTreeMap<String, Array> {
    let thinned: Vec<String> =
        stored.keys().filter_map(|name| name.strip_suffix("@values").map(str::to_owned)).collect();
    for name in thinned {
        let [values, places, shape, elsewhere] = ["values", "places", "shape", "elsewhere"]
            .map(|part| stored.remove(&format!("{name}@{part}")).unwrap_or_else(|| panic!("no {name}@{part}")));
        let shape = shape.integers();
        let mut dense = vec![elsewhere.values[0]; shape.iter().product()];
        assert_eq!(places.values.len(), values.values.len(), "{name}");
        for (place, value) in places.integers().into_iter().zip(values.values) {
            dense[place] = value;
        }
        stored.insert(name, Array { shape, values: dense });
    }
    stored
}

#[cfg(test)]
mod tests {
    use super::*;

    fn array(shape: &[usize], values: &[f64]) -> Array {
        Array { shape: shape.to_vec(), values: values.to_vec() }
    }

    #[test]
    fn thinned_tensors_are_whole_again() {
        let stored = [
            ("a", array(&[2], &[1.0, 2.0])),
            ("b@elsewhere", array(&[], &[f64::NAN])),
            ("b@places", array(&[2], &[5.0, 1.0])),
            ("b@shape", array(&[2], &[2.0, 3.0])),
            ("b@values", array(&[2], &[7.0, 8.0])),
        ];
        let whole = Golden(whole(stored.map(|(name, array)| (name.to_owned(), array)).into()));
        assert_eq!(whole.iter().map(|(name, _)| name).collect::<Vec<_>>(), ["a", "b"]);
        assert_eq!(whole.array("b").shape, [2, 3]);
        let known: Vec<_> = whole.numbers("b").into_iter().map(|value| (!value.is_nan()).then_some(value)).collect();
        assert_eq!(known, [None, Some(8.0), None, None, None, Some(7.0)]);
    }

    #[test]
    fn the_committed_files_are_all_there_and_small() {
        let files = std::fs::read_dir(workspace().join(COMMITTED)).unwrap().map(|entry| entry.unwrap());
        let sizes: Vec<u64> = files.map(|file| file.metadata().unwrap().len()).collect();
        assert!(sizes.len() >= 20, "{} files", sizes.len());
        assert!(sizes.iter().sum::<u64>() <= 8_000_000, "{} bytes", sizes.iter().sum::<u64>());
    }
}
