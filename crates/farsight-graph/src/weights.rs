//! The numbers of a network: named tensors, read from and written to safetensors files.
//!
//! Everything is `f32` in memory and on writing; half, bfloat16 and double are accepted on reading. A file from a
//! stranger gives an error, never a panic, and never more memory than a few times its own size.

mod element;
mod seal;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use safetensors::Dtype;
use safetensors::tensor::{Metadata, TensorInfo};
use sha2::{Digest, Sha256};
use thiserror::Error;

pub use element::Element;
use farsight_files::{WriteError, open_regular, read_file, write_atomically};
pub use seal::FILE_SHA256_KEY;
use seal::Seal;

/// Name of the free-text block in a safetensors header (safetensors format).
const METADATA_KEY: &str = "__metadata__";

/// The length of the header stands in the first eight bytes (safetensors format).
const LENGTH_BYTES: usize = 8;

/// The largest file of weights that is read, bytes: many times the largest network of this field.
pub const MAX_FILE: u64 = 4 << 30;

/// The largest header that is read, bytes: many times that of any network here, and read in less than a second.
const MAX_HEADER: usize = 4 << 20;

/// Values that go into a hash at once.
const HASHED_AT_ONCE: usize = 4096;

/// Last part of the name of batch norm's step counter, which no forward pass uses.
pub const STEP_COUNTER: &str = "num_batches_tracked";

/// Why weights could not be read, found or written.
#[derive(Debug, Error)]
pub enum WeightsError {
    /// The file could not be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's answer.
        source: io::Error,
    },
    /// The file's length is not what its header promises.
    #[error("{}: not a whole safetensors file: {found} bytes; expected {expected}", path.display())]
    Length {
        /// The file.
        path: PathBuf,
        /// Bytes in the file.
        found: usize,
        /// Bytes that the header asks for (at least).
        expected: usize,
    },
    /// The header is no valid safetensors header.
    #[error("{}: safetensors header: {source}", path.display())]
    Header {
        /// The file.
        path: PathBuf,
        /// Where in the header, and what.
        source: serde_json::Error,
    },
    /// A tensor has a number format that no network uses.
    #[error("{}: tensor \"{name}\" holds {found}; expected F32, F16, BF16 or F64", path.display())]
    Dtype {
        /// The file.
        path: PathBuf,
        /// The tensor.
        name: String,
        /// Its format.
        found: Dtype,
    },
    /// The file is not as it was written.
    #[error(
        "{}: its contents have the hash {}..., its header says {}...: the file was damaged or changed since it was written; expected another copy of it",
        path.display(), start_of(found), start_of(expected)
    )]
    Hash {
        /// The file.
        path: PathBuf,
        /// SHA-256 of its contents.
        found: String,
        /// SHA-256 that the header gives.
        expected: String,
    },
    /// A tensor has a number that no network computes with.
    #[error("{}: tensor \"{name}\" has {value} at place {place}; expected finite numbers", path.display())]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// The tensor.
        name: String,
        /// Where in it, from 0, last axis fastest.
        place: usize,
        /// What stands there.
        value: f32,
    },
    /// The file could not be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A tensor that was asked for is not there.
    #[error("tensor \"{name}\" is missing; expected the shape {expected:?}")]
    Missing {
        /// The tensor.
        name: String,
        /// The shape it should have.
        expected: Vec<usize>,
    },
    /// A tensor has another shape than was asked for.
    #[error("tensor \"{name}\" has the shape {found:?}; expected {expected:?}")]
    Shape {
        /// The tensor.
        name: String,
        /// Its shape.
        found: Vec<usize>,
        /// The shape it should have.
        expected: Vec<usize>,
    },
    /// The count of values does not fit the shape.
    #[error("{found} values for a tensor of shape {shape:?}")]
    Count {
        /// The shape.
        shape: Vec<usize>,
        /// How many values were given.
        found: usize,
    },
}

/// One tensor: its shape and as many values, last axis fastest.
#[derive(Debug, Clone, PartialEq)]
pub struct WeightTensor {
    /// Sizes along the axes: `[out, in, height, width]` for a convolution.
    pub shape: Vec<usize>,
    /// The values, last axis fastest; as many as the shape asks for.
    pub values: Vec<f32>,
}

impl WeightTensor {
    /// A tensor of this shape; an empty shape is a single number.
    ///
    /// # Errors
    /// [`WeightsError::Count`] when the values do not fill the shape exactly.
    pub fn new(shape: Vec<usize>, values: Vec<f32>) -> Result<Self, WeightsError> {
        if element_count(&shape) == Some(values.len()) {
            Ok(Self { shape, values })
        } else {
            Err(WeightsError::Count { shape, found: values.len() })
        }
    }
}

/// The product of the axes, unless it is beyond all memory.
pub fn element_count(shape: &[usize]) -> Option<usize> {
    shape.iter().try_fold(1_usize, |count, size| count.checked_mul(*size))
}

/// Named tensors and free-text facts about them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Weights {
    /// The tensors by name; Farsight's names are those of official SMOKE (spec section 13).
    pub tensors: BTreeMap<String, WeightTensor>,
    /// Facts that travel in the file's header; Farsight's own keys start with `farsight.`.
    pub metadata: BTreeMap<String, String>,
}

impl Weights {
    /// The mean of these and other weights of the same network (a model soup): often better on other data than either
    /// training that it was made of. None when the tensors differ in name or shape.
    pub fn mean_with(&self, other: &Self) -> Option<Self> {
        let is_same = self.tensors.len() == other.tensors.len();
        let mean = |(name, tensor): (&String, &WeightTensor)| {
            let twin = other.tensors.get(name).filter(|twin| twin.shape == tensor.shape)?;
            let values = tensor.values.iter().zip(&twin.values).map(|(a, b)| f32::midpoint(*a, *b)).collect();
            Some((name.clone(), WeightTensor { shape: tensor.shape.clone(), values }))
        };
        let tensors = self.tensors.iter().map(mean).collect::<Option<_>>().filter(|_| is_same)?;
        Some(Self { tensors, metadata: self.metadata.clone() })
    }

    /// Reads a safetensors file. Step counters of batch norm (`num_batches_tracked`) are dropped.
    ///
    /// # Errors
    /// [`WeightsError`] names the file, and the tensor where there is one.
    pub fn read(path: &Path) -> Result<Self, WeightsError> {
        let bytes =
            read_file(path, MAX_FILE).map_err(|source| WeightsError::Read { path: path.to_path_buf(), source })?;
        Self::from_safetensors(&bytes, path)
    }

    /// The facts in the header of a safetensors file; its tensors are not read, nor looked at.
    ///
    /// # Errors
    /// As [`Weights::read`].
    pub fn read_metadata(path: &Path) -> Result<BTreeMap<String, String>, WeightsError> {
        let failed = |source| WeightsError::Read { path: path.to_path_buf(), source };
        let mut file = open_regular(path).map_err(failed)?;
        let found = usize::try_from(file.metadata().map_err(failed)?.len()).unwrap_or(usize::MAX);
        let wrong_length = |expected| WeightsError::Length { path: path.to_path_buf(), found, expected };
        if found < LENGTH_BYTES {
            return Err(wrong_length(LENGTH_BYTES));
        }
        let mut length = [0; LENGTH_BYTES];
        file.read_exact(&mut length).map_err(failed)?;
        let expected = usize::try_from(u64::from_le_bytes(length)).unwrap_or(usize::MAX).saturating_add(LENGTH_BYTES);
        // Nothing is made room for that is not there.
        if expected > found {
            return Err(wrong_length(expected));
        }
        check_header(expected - LENGTH_BYTES, path)?;
        let mut header = vec![0; expected - LENGTH_BYTES];
        file.read_exact(&mut header).map_err(failed)?;
        let header: Metadata = serde_json::from_slice(&header)
            .map_err(|source| WeightsError::Header { path: path.to_path_buf(), source })?;
        Ok(header.metadata().clone().unwrap_or_default().into_iter().collect())
    }

    /// Reads a safetensors file that is in memory already; `source` is only what errors call it.
    ///
    /// # Errors
    /// As [`Weights::read`].
    pub fn from_safetensors(bytes: &[u8], source: &Path) -> Result<Self, WeightsError> {
        let (header, data) = split_header(bytes, source)?;
        let mut tensors = BTreeMap::new();
        for name in header.offset_keys() {
            let Some(info) = header.info(&name) else { continue };
            if info.dtype == Dtype::I64 && is_step_counter(&name) {
                continue;
            }
            let element = Element::from_dtype(info.dtype).filter(|element| *element != Element::I64);
            let Some(element) = element else {
                return Err(WeightsError::Dtype { path: source.to_path_buf(), name, found: info.dtype });
            };
            let (start, end) = info.data_offsets;
            let tensor = WeightTensor::new(info.shape.clone(), element.decode(&data[start..end]))?;
            tensors.insert(name, tensor);
        }
        let mut metadata: BTreeMap<String, String> =
            header.metadata().clone().unwrap_or_default().into_iter().collect();
        // The hash is the file's, not the weights'.
        if let Some(expected) = metadata.remove(FILE_SHA256_KEY) {
            let found = hash_of(&header, &metadata, data);
            if found != expected {
                return Err(WeightsError::Hash { path: source.to_path_buf(), found, expected });
            }
        }
        Ok(Self { tensors, metadata })
    }

    /// Whether every number is finite; `source` is only what errors call the file.
    ///
    /// # Errors
    /// [`WeightsError::NotFinite`] names the first tensor that has another one.
    pub fn check_finite(&self, source: &Path) -> Result<(), WeightsError> {
        for (name, tensor) in &self.tensors {
            if let Some(place) = tensor.values.iter().position(|value| !value.is_finite()) {
                let (path, name, value) = (source.to_path_buf(), name.clone(), tensor.values[place]);
                return Err(WeightsError::NotFinite { path, name, place, value });
            }
        }
        Ok(())
    }

    /// Writes a safetensors file (F32), whole or not at all. Equal weights give equal bytes.
    ///
    /// # Errors
    /// [`WeightsError::Write`] names the file and the step that failed.
    pub fn write(&self, path: &Path) -> Result<(), WeightsError> {
        Ok(write_atomically(path, |out| self.write_safetensors(out))?)
    }

    /// Writes a safetensors file of half-precision numbers (F16): half the size, about three significant digits. For
    /// files that are shipped.
    ///
    /// # Errors
    /// As [`Weights::write`].
    pub fn write_half(&self, path: &Path) -> Result<(), WeightsError> {
        Ok(write_atomically(path, |out| self.write_elements(Element::F16, out))?)
    }

    /// Writes the safetensors format to a stream.
    ///
    /// # Errors
    /// Those of the stream.
    pub fn write_safetensors(&self, out: &mut dyn Write) -> io::Result<()> {
        self.write_elements(Element::F32, out)
    }

    fn write_elements(&self, element: Element, out: &mut dyn Write) -> io::Result<()> {
        let header = self.header(element)?;
        out.write_all(&(header.len() as u64).to_le_bytes())?;
        out.write_all(&header)?;
        let mut bytes = Vec::new();
        for tensor in self.tensors.values() {
            bytes.clear();
            element.encode(&tensor.values, &mut bytes);
            out.write_all(&bytes)?;
        }
        Ok(())
    }

    /// The tensor of this name, when its shape is the expected one.
    ///
    /// # Errors
    /// [`WeightsError::Missing`] or [`WeightsError::Shape`].
    pub fn tensor(&self, name: &str, expected: &[usize]) -> Result<&WeightTensor, WeightsError> {
        let (name_owned, expected_owned) = (|| name.to_owned(), || expected.to_vec());
        match self.tensors.get(name) {
            None => Err(WeightsError::Missing { name: name_owned(), expected: expected_owned() }),
            Some(tensor) if tensor.shape != expected => {
                Err(WeightsError::Shape { name: name_owned(), found: tensor.shape.clone(), expected: expected_owned() })
            }
            Some(tensor) => Ok(tensor),
        }
    }

    /// SHA-256 of names, shapes and values (as `f32`, little-endian) in the order of the names, hexadecimal: the same
    /// in whatever file they are.
    pub fn sha256(&self) -> String {
        let mut hash = Sha256::new();
        let mut bytes = Vec::with_capacity(4 * HASHED_AT_ONCE);
        for (name, tensor) in &self.tensors {
            hash.update(format!("{name} {:?}\n", tensor.shape));
            for values in tensor.values.chunks(HASHED_AT_ONCE) {
                bytes.clear();
                bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
                hash.update(&bytes);
            }
        }
        hexadecimal(&hash.finalize())
    }

    /// The header as JSON, padded with spaces so that the data starts at a multiple of eight bytes.
    ///
    /// Written here and not by the safetensors crate, which walks a hash map: its files differ from run to run.
    fn header(&self, element: Element) -> io::Result<Vec<u8>> {
        let mut entries = serde_json::Map::new();
        let mut seal = Seal::new(&self.metadata);
        let mut bytes = Vec::new();
        let mut start = 0;
        for (name, tensor) in &self.tensors {
            if element_count(&tensor.shape) != Some(tensor.values.len()) {
                let found = tensor.values.len();
                return Err(io::Error::other(WeightsError::Count { shape: tensor.shape.clone(), found }));
            }
            let end = start + element.size() * tensor.values.len();
            bytes.clear();
            element.encode(&tensor.values, &mut bytes);
            seal.tensor(name, &element.dtype().to_string(), &tensor.shape, &bytes);
            let info = TensorInfo { dtype: element.dtype(), shape: tensor.shape.clone(), data_offsets: (start, end) };
            entries.insert(name.clone(), serde_json::to_value(info)?);
            start = end;
        }
        let mut metadata = self.metadata.clone();
        metadata.insert(FILE_SHA256_KEY.to_owned(), seal.finish());
        entries.insert(METADATA_KEY.to_owned(), serde_json::to_value(&metadata)?);
        let mut header = serde_json::to_vec(&entries)?;
        header.resize(header.len().next_multiple_of(LENGTH_BYTES), b' ');
        Ok(header)
    }
}

/// As much of a hash as tells it from another one.
fn start_of(hash: &str) -> String {
    hash.chars().take(12).collect()
}

/// The hash of a file's contents as [`Seal`] has it.
fn hash_of(header: &Metadata, metadata: &BTreeMap<String, String>, data: &[u8]) -> String {
    let mut names = header.offset_keys();
    names.sort_unstable();
    let mut seal = Seal::new(metadata);
    for (name, info) in names.iter().filter_map(|name| Some((name, header.info(name)?))) {
        let (start, end) = info.data_offsets;
        seal.tensor(name, &info.dtype.to_string(), &info.shape, &data[start..end]);
    }
    seal.finish()
}

/// Two digits a byte, as programs print a checksum.
pub fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        // Writing to a string cannot fail.
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// Whether this is the name of a step counter of batch norm, which no forward pass uses.
pub fn is_step_counter(name: &str) -> bool {
    name.rsplit('.').next() == Some(STEP_COUNTER)
}

/// The checked header and the data behind it.
/// Refuses headers that would take too much memory as a tree.
fn check_header(length: usize, path: &Path) -> Result<(), WeightsError> {
    if length <= MAX_HEADER {
        return Ok(());
    }
    let problem = format!("its header has {length} bytes; expected at most {MAX_HEADER}");
    Err(WeightsError::Read { path: path.to_path_buf(), source: io::Error::new(io::ErrorKind::FileTooLarge, problem) })
}

fn split_header<'a>(bytes: &'a [u8], path: &Path) -> Result<(Metadata, &'a [u8]), WeightsError> {
    let wrong_length = |expected| WeightsError::Length { path: path.to_path_buf(), found: bytes.len(), expected };
    let (length, rest) = bytes.split_first_chunk::<LENGTH_BYTES>().ok_or_else(|| wrong_length(LENGTH_BYTES))?;
    let header_length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
    let (header, data) =
        rest.split_at_checked(header_length).ok_or_else(|| wrong_length(header_length.saturating_add(LENGTH_BYTES)))?;
    check_header(header_length, path)?;
    let header: Metadata =
        serde_json::from_slice(header).map_err(|source| WeightsError::Header { path: path.to_path_buf(), source })?;
    // Parsing has checked that the tensors lie side by side and fit their shapes; what is left is that the data is all
    // there.
    if header.data_len() == data.len() {
        Ok((header, data))
    } else {
        Err(wrong_length(header.data_len().saturating_add(bytes.len() - data.len())))
    }
}
