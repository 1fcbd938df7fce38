//! OpenVINO, loaded at run time.

use std::path::{Path, PathBuf};

use farsight_onnx::{OnnxModel, TensorInfo};
use openvino::{Core, DeviceType, ElementType, InferRequest, PartialShape, RwPropertyKey, Shape, Tensor as OvTensor};

use crate::EngineError;
use crate::library::{Failure, unpanicked};
use crate::runner::{Runner, Tensor, TensorView, input};

/// Its name as users write it.
const NAME: &str = "openvino";

/// In which numbers OpenVINO computes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OpenvinoPrecision {
    /// Single precision, the same answer as from every engine.
    #[default]
    F32,
    /// bfloat16 where the CPU has it: about half the time, two to three digits.
    Bf16,
}

impl OpenvinoPrecision {
    /// OpenVINO's word for it.
    fn hint(self) -> &'static str {
        match self {
            Self::F32 => "f32",
            Self::Bf16 => "bf16",
        }
    }
}

/// Runs an ONNX model with OpenVINO on the CPU.
pub struct OpenvinoRunner {
    core: Core,
    /// What another runner is made from.
    library: PathBuf,
    model: OnnxModel,
    threads: Option<usize>,
    precision: OpenvinoPrecision,
    /// The network compiled for the shape of the last input; OpenVINO is faster when it knows it.
    compiled: Option<(Vec<usize>, InferRequest)>,
}

impl OpenvinoRunner {
    /// Loads the shared `library` (`libopenvino_c`, 2025.1 or later) and `model`, to be run by so many threads; `None` takes one for each core.
    ///
    /// # Errors
    /// When the library cannot be loaded, is too old, or refuses the model.
    pub fn new(
        library: &Path,
        model: OnnxModel,
        threads: Option<usize>,
        precision: OpenvinoPrecision,
    ) -> Result<Self, EngineError> {
        unpanicked(NAME, || {
            load(library)?;
            let mut core = Core::new()?;
            core.set_property(&DeviceType::CPU, &RwPropertyKey::HintInferencePrecision, precision.hint())?;
            if let Some(threads) = threads {
                core.set_property(&DeviceType::CPU, &RwPropertyKey::InferenceNumThreads, &threads.to_string())?;
            }
            core.read_model_from_buffer(model.bytes(), None)?;
            Ok(Self { core, library: library.to_owned(), model, threads, precision, compiled: None })
        })
    }

    /// Loads the library at `path` and says which version it is.
    ///
    /// # Errors
    /// When it cannot be loaded or is too old.
    pub fn version(path: &Path) -> Result<String, EngineError> {
        unpanicked(NAME, || {
            load(path)?;
            Ok(openvino::version().build_number)
        })
    }

    /// The network compiled for inputs of this shape.
    fn request(&mut self, shape: &[usize]) -> Result<&mut InferRequest, Failure> {
        let known = self.compiled.take().filter(|(compiled_shape, _)| compiled_shape == shape);
        let request = match known {
            Some((_, request)) => request,
            None => self.compile(shape)?,
        };
        Ok(&mut self.compiled.insert((shape.to_vec(), request)).1)
    }

    fn compile(&mut self, shape: &[usize]) -> Result<InferRequest, Failure> {
        let mut model = self.core.read_model_from_buffer(self.model.bytes(), None)?;
        let shape = PartialShape::new_static(shape.len() as i64, &sides(shape))?;
        model.reshape_input_by_name(&self.model.input().name, &shape)?;
        Ok(self.core.compile_model(&model, DeviceType::CPU)?.create_infer_request()?)
    }

    fn values(&mut self, given: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, Failure> {
        let (name, outputs) = (self.model.input().name.clone(), self.model.outputs().to_vec());
        let view = input(given, &name)?;
        let mut images = OvTensor::new(ElementType::F32, &Shape::new(&sides(view.shape))?)?;
        images.get_data_mut::<f32>()?.copy_from_slice(view.values);
        let request = self.request(view.shape)?;
        request.set_tensor(&name, &images)?;
        request.infer()?;
        let tensor = |output: &TensorInfo| {
            let tensor = request.get_tensor(&output.name)?;
            let shape = tensor.get_shape()?.get_dimensions().iter().map(|&side| side as usize).collect();
            Ok(Tensor { shape, values: tensor.get_data::<f32>()?.to_vec() })
        };
        outputs.iter().map(tensor).collect()
    }
}

fn sides(shape: &[usize]) -> Vec<i64> {
    shape.iter().map(|&side| side as i64).collect()
}

impl Runner for OpenvinoRunner {
    fn engine(&self) -> &str {
        NAME
    }

    fn inputs(&self) -> &[TensorInfo] {
        std::slice::from_ref(self.model.input())
    }

    fn outputs(&self) -> &[TensorInfo] {
        self.model.outputs()
    }

    fn run(&mut self, inputs: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, EngineError> {
        unpanicked(NAME, || self.values(inputs))
    }

    fn share(&self) -> Result<Box<dyn Runner>, EngineError> {
        Ok(Box::new(Self::new(&self.library, self.model.clone(), self.threads, self.precision)?))
    }
}

/// Loads the library; a process has one, and the first that was loaded stays.
fn load(library: &Path) -> Result<(), Failure> {
    Ok(openvino_sys::library::load_from(library)?)
}
