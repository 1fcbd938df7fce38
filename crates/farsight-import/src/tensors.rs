//! From a pickled state dictionary to tensors.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use super::error::CheckpointProblem;
use super::pickle::{Id, Pickled, Tensor, Value};
use super::storages::Storages;
use farsight_graph::weights::{Element, WeightTensor, element_count};

/// Keys under which training programs put the state dictionary: official SMOKE, mmdetection3d.
const WRAPPERS: [&str; 2] = ["model", "state_dict"];

/// What data-parallel training puts before every name.
const PARALLEL_PREFIX: &str = "module.";

/// Values that any file may unfold to (16 MiB of them), however small it is: tensors may share storages.
const FREE_VALUES: usize = 1 << 22;

/// All tensors of the file's state dictionary by name; the file is `file_length` bytes long.
pub(super) fn read_tensors(
    pickled: &Pickled,
    storages: &mut Storages<'_>,
    file_length: usize,
) -> Result<BTreeMap<String, WeightTensor>, CheckpointProblem> {
    let mut reader = Reader { storages, blocks: BTreeMap::new(), budget: file_length.max(FREE_VALUES) };
    let mut tensors = BTreeMap::new();
    for (name, id) in state_dict(pickled)? {
        let tensor = match pickled.get(id) {
            Value::Tensor(tensor) => reader.tensor(name, tensor)?,
            other => {
                return Err(CheckpointProblem::NotATensor {
                    name: name.to_owned(),
                    found: other.describe().to_owned(),
                });
            }
        };
        tensors.insert(name.to_owned(), tensor);
    }
    Ok(without_parallel_prefix(tensors))
}

/// The entries of the dictionary that holds the tensors.
fn state_dict(pickled: &Pickled) -> Result<Vec<(&str, Id)>, CheckpointProblem> {
    let root = pickled.root();
    let dictionary = WRAPPERS.iter().find_map(|key| pickled.entry(root, key)).unwrap_or(root);
    let missing = |found: &str| CheckpointProblem::NoStateDict { found: found.to_owned() };
    let Value::Dict(entries) = dictionary else { return Err(missing(dictionary.describe())) };
    if !entries.iter().any(|(_, value)| matches!(pickled.get(*value), Value::Tensor(_))) {
        return Err(missing("a dictionary without tensors"));
    }
    let named = |(key, value): &(Id, Id)| match pickled.get(*key) {
        Value::Text(name) => Ok((&**name, *value)),
        other => Err(missing(&format!("a dictionary with {} as a key", other.describe()))),
    };
    entries.iter().map(named).collect()
}

fn without_parallel_prefix(tensors: BTreeMap<String, WeightTensor>) -> BTreeMap<String, WeightTensor> {
    if !tensors.keys().all(|name| name.starts_with(PARALLEL_PREFIX)) {
        return tensors;
    }
    tensors.into_iter().map(|(name, tensor)| (name[PARALLEL_PREFIX.len()..].to_owned(), tensor)).collect()
}

/// Reads each storage once, and keeps count of what it gives out.
struct Reader<'r, 'a> {
    storages: &'r mut Storages<'a>,
    blocks: BTreeMap<String, Cow<'a, [u8]>>,
    /// Values that may still be given out.
    budget: usize,
}

impl Reader<'_, '_> {
    fn tensor(&mut self, name: &str, tensor: &Tensor) -> Result<WeightTensor, CheckpointProblem> {
        let Some(element) = tensor.storage.kind.element else {
            let found = format!("a tensor of torch.{}", tensor.storage.kind.name);
            return Err(CheckpointProblem::NotATensor { name: name.to_owned(), found });
        };
        let outside = || CheckpointProblem::Bounds {
            name: name.to_owned(),
            shape: tensor.shape.clone(),
            strides: tensor.strides.clone(),
            offset: tensor.offset,
            count: tensor.storage.count,
        };
        let count = fitting_count(tensor).ok_or_else(outside)?;
        self.budget = self.budget.checked_sub(count).ok_or(CheckpointProblem::TooMuch)?;
        let values = gather(self.block(tensor)?, tensor, element, count).ok_or_else(outside)?;
        WeightTensor::new(tensor.shape.clone(), values).map_err(|_| outside())
    }

    fn block(&mut self, tensor: &Tensor) -> Result<&[u8], CheckpointProblem> {
        let storage = &tensor.storage;
        let block = match self.blocks.entry(storage.key.to_string()) {
            Entry::Occupied(entry) => entry.into_mut(),
            Entry::Vacant(entry) => entry.insert(self.storages.read(&storage.key)?),
        };
        // Asked every time: a hostile pickle may name one storage with several lengths.
        let expected = storage.count.saturating_mul(storage.kind.size);
        if block.len() == expected {
            Ok(block)
        } else {
            let (key, found) = (storage.key.to_string(), block.len());
            Err(CheckpointProblem::StorageLength { key, found, expected })
        }
    }
}

/// How many values the tensor has, when all of them lie in its storage and it has no more of them than the storage.
///
/// The second condition refuses expanded tensors, whose few stored values stand for any number; a network's weights
/// never are.
fn fitting_count(tensor: &Tensor) -> Option<usize> {
    let Tensor { storage, offset, shape, strides } = tensor;
    let count = element_count(shape).filter(|_| shape.len() == strides.len())?;
    if count == 0 {
        return Some(0);
    }
    let reach = |last: usize, (size, stride): (&usize, &usize)| last.checked_add((size - 1).checked_mul(*stride)?);
    let last = shape.iter().zip(strides).try_fold(*offset, reach)?;
    (last < storage.count && count <= storage.count).then_some(count)
}

/// The values in the order of the shape, last axis fastest; none when the block is shorter than its storage says.
fn gather(block: &[u8], tensor: &Tensor, element: Element, count: usize) -> Option<Vec<f32>> {
    let size = element.size();
    if count == 0 {
        return Some(Vec::new());
    }
    if is_contiguous(tensor) {
        let start = tensor.offset * size;
        return Some(element.decode(block.get(start..start + count * size)?));
    }
    let mut bytes = Vec::with_capacity(count * size);
    let mut place = vec![0; tensor.shape.len()];
    for _ in 0..count {
        let at = tensor.offset + place.iter().zip(&tensor.strides).map(|(index, stride)| index * stride).sum::<usize>();
        bytes.extend_from_slice(block.get(at * size..(at + 1) * size)?);
        advance(&mut place, &tensor.shape);
    }
    Some(element.decode(&bytes))
}

fn is_contiguous(tensor: &Tensor) -> bool {
    let mut expected = 1_usize;
    tensor.shape.iter().zip(&tensor.strides).rev().all(|(size, stride)| {
        let fits = *size == 1 || *stride == expected;
        expected = expected.saturating_mul(*size);
        fits
    })
}

/// The next place in the order of the shape, last axis fastest.
fn advance(place: &mut [usize], shape: &[usize]) {
    for (index, size) in place.iter_mut().zip(shape).rev() {
        *index += 1;
        if *index < *size {
            return;
        }
        *index = 0;
    }
}
