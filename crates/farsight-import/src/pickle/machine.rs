//! The stack machine behind [`super::Pickled::read`].

use std::collections::BTreeMap;
use std::rc::Rc;

use super::input::Input;
use super::opcode as op;
use super::value::{Global, Id, Storage, Tensor, Value};
use super::{MAX_VALUES, PickleError, Pickled};

/// Most axes of a tensor; a convolution has four. Bounded because every tensor holds its own copy of its shape.
const MAX_AXES: usize = 8;

/// State of the reader.
pub(super) struct Machine<'a> {
    input: Input<'a>,
    values: Vec<Value>,
    stack: Vec<Id>,
    /// Heights of the stack where a MARK stands.
    marks: Vec<usize>,
    memo: BTreeMap<usize, Id>,
    /// Byte of the opcode at work, for errors.
    at: usize,
}

type Done = Result<(), PickleError>;

impl<'a> Machine<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        let input = Input::new(bytes);
        Self { input, values: Vec::new(), stack: Vec::new(), marks: Vec::new(), memo: BTreeMap::new(), at: 0 }
    }

    pub(super) fn run(mut self) -> Result<Pickled, PickleError> {
        loop {
            self.at = self.input.position();
            let [opcode] = self.input.array()?;
            if opcode == op::STOP {
                let root = self.pop()?;
                return Ok(Pickled { values: self.values, root, length: self.input.position() });
            }
            self.step(opcode)?;
        }
    }

    fn step(&mut self, opcode: u8) -> Done {
        match opcode {
            op::PROTO => self.input.take(1).map(drop),
            op::FRAME => self.input.take(8).map(drop),
            op::MARK => {
                self.marks.push(self.stack.len());
                Ok(())
            }
            op::POP => self.pop().map(drop),
            op::POP_MARK => self.pop_to_mark().map(drop),
            op::DUP => {
                let top = self.top()?;
                self.stack.push(top);
                Ok(())
            }
            op::BINGET | op::LONG_BINGET | op::BINPUT | op::LONG_BINPUT | op::MEMOIZE => self.step_memo(opcode),
            op::GLOBAL | op::STACK_GLOBAL | op::REDUCE | op::NEWOBJ | op::NEWOBJ_EX | op::BUILD | op::BINPERSID => {
                self.step_object(opcode)
            }
            op::APPEND | op::APPENDS | op::SETITEM | op::SETITEMS | op::ADDITEMS => self.step_fill(opcode),
            _ => {
                let value = self.plain_value(opcode)?;
                self.push(value)
            }
        }
    }

    /// Opcodes that make one value out of the stream or the top of the stack.
    fn plain_value(&mut self, opcode: u8) -> Result<Value, PickleError> {
        Ok(match opcode {
            op::NONE => Value::Other("None"),
            op::NEWTRUE => Value::Bool(true),
            op::NEWFALSE => Value::Bool(false),
            op::BININT => Value::Int(i64::from(i32::from_le_bytes(self.input.array()?))),
            op::BININT1 => Value::Int(self.input.unsigned::<1>()? as i64),
            op::BININT2 => Value::Int(self.input.unsigned::<2>()? as i64),
            op::LONG1 => integer(self.input.block::<1>()?),
            op::LONG4 => integer(self.input.block::<4>()?),
            op::BINFLOAT => {
                self.input.take(8)?;
                Value::Other("a float")
            }
            op::BINUNICODE | op::BINSTRING => text(self.input.block::<4>()?),
            op::SHORT_BINUNICODE | op::SHORT_BINSTRING => text(self.input.block::<1>()?),
            op::BINUNICODE8 => text(self.input.block::<8>()?),
            op::BINBYTES => bytes(self.input.block::<4>()?),
            op::SHORT_BINBYTES => bytes(self.input.block::<1>()?),
            op::BINBYTES8 => bytes(self.input.block::<8>()?),
            op::EMPTY_TUPLE => Value::Tuple(Vec::new()),
            op::TUPLE => Value::Tuple(self.pop_to_mark()?),
            op::TUPLE1 => Value::Tuple(self.pop_many(1)?),
            op::TUPLE2 => Value::Tuple(self.pop_many(2)?),
            op::TUPLE3 => Value::Tuple(self.pop_many(3)?),
            op::EMPTY_LIST => Value::List(Vec::new()),
            op::LIST => Value::List(self.pop_to_mark()?),
            op::EMPTY_DICT => Value::Dict(Vec::new()),
            op::DICT => Value::Dict(self.pop_pairs()?),
            op::EMPTY_SET => Value::Other("a set"),
            op::FROZENSET => {
                self.pop_to_mark()?;
                Value::Other("a set")
            }
            _ => return Err(PickleError::Opcode { at: self.at, opcode }),
        })
    }

    fn step_memo(&mut self, opcode: u8) -> Done {
        match opcode {
            op::BINGET => self.recall::<1>(),
            op::LONG_BINGET => self.recall::<4>(),
            op::BINPUT => self.remember(|machine| machine.input.unsigned::<1>()),
            op::LONG_BINPUT => self.remember(|machine| machine.input.unsigned::<4>()),
            _ => self.remember(|machine| Ok(machine.memo.len())),
        }
    }

    fn recall<const N: usize>(&mut self) -> Done {
        let index = self.input.unsigned::<N>()?;
        let id = *self.memo.get(&index).ok_or(PickleError::Memo { at: self.at, index })?;
        self.stack.push(id);
        Ok(())
    }

    fn remember(&mut self, index: impl FnOnce(&mut Self) -> Result<usize, PickleError>) -> Done {
        let (index, top) = (index(self)?, self.top()?);
        self.memo.insert(index, top);
        Ok(())
    }

    /// Opcodes that put values into the container below them. Containers that are not data here swallow them.
    fn step_fill(&mut self, opcode: u8) -> Done {
        match opcode {
            op::APPEND => {
                let item = self.pop()?;
                self.extend_list(&[item])
            }
            op::APPENDS => {
                let items = self.pop_to_mark()?;
                self.extend_list(&items)
            }
            op::SETITEM => {
                let pair = self.pop_many(2)?;
                self.extend_dict(vec![(pair[0], pair[1])])
            }
            op::SETITEMS => {
                let pairs = self.pop_pairs()?;
                self.extend_dict(pairs)
            }
            _ => self.pop_to_mark().map(drop),
        }
    }

    fn extend_list(&mut self, items: &[Id]) -> Done {
        let target = self.top()?;
        match &mut self.values[target.0 as usize] {
            Value::List(list) => list.extend_from_slice(items),
            Value::Object(_) | Value::Other(_) => {}
            other => return Err(PickleError::Type { at: self.at, found: other.describe().into(), expected: "a list" }),
        }
        Ok(())
    }

    fn extend_dict(&mut self, pairs: Vec<(Id, Id)>) -> Done {
        let target = self.top()?;
        match &mut self.values[target.0 as usize] {
            Value::Dict(entries) => entries.extend(pairs),
            Value::Object(_) | Value::Other(_) => {}
            other => {
                return Err(PickleError::Type {
                    at: self.at,
                    found: other.describe().into(),
                    expected: "a dictionary",
                });
            }
        }
        Ok(())
    }

    fn step_object(&mut self, opcode: u8) -> Done {
        match opcode {
            op::GLOBAL => {
                let (module, name) = (self.input.line()?, self.input.line()?);
                let global = Global::named(&String::from_utf8_lossy(module), &String::from_utf8_lossy(name));
                self.push(Value::Global(global))
            }
            op::STACK_GLOBAL => {
                let names = self.pop_many(2)?;
                let global = Global::named(self.text(names[0])?, self.text(names[1])?);
                self.push(Value::Global(global))
            }
            op::BINPERSID => self.push_storage(),
            // What BUILD would set are attributes, `_metadata` of a state dictionary for instance: no tensor is among
            // them.
            op::BUILD => self.pop().map(drop),
            op::NEWOBJ_EX => {
                self.pop()?;
                self.call()
            }
            _ => self.call(),
        }
    }

    /// REDUCE and NEWOBJ: gives what the call of a known global means, and calls nothing.
    fn call(&mut self) -> Done {
        let call = self.pop_many(2)?;
        let (callee, arguments) = (self.value(call[0]), self.tuple(call[1])?);
        let result = match callee {
            Value::Global(Global::RebuildTensor) => Value::Tensor(Box::new(self.tensor(arguments)?)),
            Value::Global(Global::RebuildParameter | Global::Size) => {
                let inner = *arguments.first().ok_or(PickleError::Stack { at: self.at })?;
                self.stack.push(inner);
                return Ok(());
            }
            Value::Global(Global::OrderedDict) if arguments.is_empty() => Value::Dict(Vec::new()),
            Value::Global(Global::Unknown(class)) => Value::Object(Rc::clone(class)),
            _ => Value::Other("an object"),
        };
        self.push(result)
    }

    /// The arguments of `_rebuild_tensor_v2`: storage, offset, shape, strides, and what only training needs.
    fn tensor(&self, arguments: &[Id]) -> Result<Tensor, PickleError> {
        let [storage, offset, shape, strides, ..] = *arguments else {
            return Err(PickleError::Type { at: self.at, found: "less".into(), expected: "a tensor's four arguments" });
        };
        let Value::Storage(storage) = self.value(storage) else { return Err(self.expected(storage, "a storage")) };
        let sizes = |id| match self.tuple(id)? {
            axes if axes.len() > MAX_AXES => Err(self.expected(id, "a tuple of at most eight sizes")),
            axes => axes.iter().map(|size| self.size(*size)).collect(),
        };
        Ok(Tensor {
            storage: (**storage).clone(),
            offset: self.size(offset)?,
            shape: sizes(shape)?,
            strides: sizes(strides)?,
        })
    }

    /// The persistent id of PyTorch: `("storage", type, key, device, count)`, and in old files a view, which is None.
    fn push_storage(&mut self) -> Done {
        let id = self.pop()?;
        let fields = self.tuple(id)?;
        let ([tag, kind, key, _device, count] | [tag, kind, key, _device, count, _]) = *fields else {
            return Err(self.expected(id, "a storage's five or six fields"));
        };
        if **self.text(tag)? != *"storage" {
            return Err(self.expected(tag, "the text \"storage\""));
        }
        if let Some(view) = fields.get(5).filter(|view| !matches!(self.value(**view), Value::Other("None"))) {
            return Err(self.expected(*view, "None: views of storages, of PyTorch before 0.4, are not read"));
        }
        let Value::Global(Global::StorageType(kind)) = self.value(kind) else {
            return Err(self.expected(kind, "a storage class of PyTorch"));
        };
        let storage = Storage { key: Rc::clone(self.text(key)?), kind, count: self.size(count)? };
        self.push(Value::Storage(Box::new(storage)))
    }

    fn push(&mut self, value: Value) -> Done {
        if self.values.len() >= MAX_VALUES {
            return Err(PickleError::TooMany { at: self.at });
        }
        self.stack.push(Id(self.values.len() as u32));
        self.values.push(value);
        Ok(())
    }

    fn top(&self) -> Result<Id, PickleError> {
        let floor = self.marks.last().copied().unwrap_or(0);
        self.stack.get(floor..).and_then(<[Id]>::last).copied().ok_or(PickleError::Stack { at: self.at })
    }

    fn pop(&mut self) -> Result<Id, PickleError> {
        let top = self.top()?;
        self.stack.pop();
        Ok(top)
    }

    /// The topmost values, bottom first; none of them from below a MARK.
    fn pop_many(&mut self, count: usize) -> Result<Vec<Id>, PickleError> {
        let floor = self.marks.last().copied().unwrap_or(0);
        let start = self.stack.len().checked_sub(count).filter(|start| *start >= floor);
        Ok(self.stack.split_off(start.ok_or(PickleError::Stack { at: self.at })?))
    }

    fn pop_to_mark(&mut self) -> Result<Vec<Id>, PickleError> {
        let mark = self.marks.pop().ok_or(PickleError::Stack { at: self.at })?;
        Ok(self.stack.split_off(mark))
    }

    fn pop_pairs(&mut self) -> Result<Vec<(Id, Id)>, PickleError> {
        let items = self.pop_to_mark()?;
        let (pairs, rest) = items.as_chunks::<2>();
        if rest.is_empty() {
            Ok(pairs.iter().map(|[key, value]| (*key, *value)).collect())
        } else {
            Err(PickleError::Stack { at: self.at })
        }
    }

    fn value(&self, id: Id) -> &Value {
        &self.values[id.0 as usize]
    }

    fn text(&self, id: Id) -> Result<&Rc<str>, PickleError> {
        if let Value::Text(text) = self.value(id) { Ok(text) } else { Err(self.expected(id, "a text")) }
    }

    fn tuple(&self, id: Id) -> Result<&[Id], PickleError> {
        if let Value::Tuple(items) = self.value(id) { Ok(items) } else { Err(self.expected(id, "a tuple")) }
    }

    fn size(&self, id: Id) -> Result<usize, PickleError> {
        let size = if let Value::Int(number) = self.value(id) { usize::try_from(*number).ok() } else { None };
        size.ok_or_else(|| self.expected(id, "a count"))
    }

    fn expected(&self, id: Id, expected: &'static str) -> PickleError {
        PickleError::Type { at: self.at, found: self.value(id).describe().into(), expected }
    }
}

/// An integer as LONG1 and LONG4 write it: two's complement, lowest byte first, no byte at all for zero.
fn integer(bytes: &[u8]) -> Value {
    let Some(last) = bytes.last() else { return Value::Int(0) };
    let mut wide = [if *last >= 0x80 { 0xff } else { 0 }; 8];
    match wide.get_mut(..bytes.len()) {
        Some(low) => {
            low.copy_from_slice(bytes);
            Value::Int(i64::from_le_bytes(wide))
        }
        None => Value::BigInt(bytes.into()),
    }
}

fn text(bytes: &[u8]) -> Value {
    Value::Text(String::from_utf8_lossy(bytes).into())
}

fn bytes(_: &[u8]) -> Value {
    Value::Other("bytes")
}
