//! OpenVINO, loaded at run time.

use std::path::Path;

use farsight_core::HeadMaps;
use farsight_net::onnx::{INPUT, OnnxModel};
use openvino::{Core, DeviceType, ElementType, InferRequest, PartialShape, RwPropertyKey, Shape, Tensor};

use crate::engine::{apart, batch_size};
use crate::library::{Failure, unpanicked};
use crate::{Engine, EngineError};

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
pub struct OpenvinoEngine {
    core: Core,
    model: OnnxModel,
    /// The network compiled for the shape of the last input; OpenVINO is faster when it knows it.
    compiled: Option<([usize; 4], InferRequest)>,
}

impl OpenvinoEngine {
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
            let mut engine = Self { core, model, compiled: None };
            let [width, height] = engine.model.config().input;
            engine.request([1, 3, height, width])?;
            Ok(engine)
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
    fn request(&mut self, shape: [usize; 4]) -> Result<&mut InferRequest, Failure> {
        let known = self.compiled.take().filter(|(compiled_shape, _)| *compiled_shape == shape);
        let request = match known {
            Some((_, request)) => request,
            None => self.compile(shape)?,
        };
        Ok(&mut self.compiled.insert((shape, request)).1)
    }

    fn compile(&mut self, shape: [usize; 4]) -> Result<InferRequest, Failure> {
        let mut model = self.core.read_model_from_buffer(self.model.bytes(), None)?;
        let shape = PartialShape::new_static(4, &shape.map(|side| side as i64))?;
        model.reshape_input_by_name(INPUT, &shape)?;
        Ok(self.core.compile_model(&model, DeviceType::CPU)?.create_infer_request()?)
    }

    fn run(&mut self, inputs: &[f32], size @ [width, height]: [usize; 2]) -> Result<Vec<HeadMaps>, Failure> {
        let outputs = self.model.outputs().map(str::to_owned);
        let shape = [batch_size(inputs, size), 3, height, width];
        let mut images = Tensor::new(ElementType::F32, &Shape::new(&shape.map(|side| side as i64))?)?;
        images.get_data_mut::<f32>()?.copy_from_slice(inputs);
        let request = self.request(shape)?;
        request.set_tensor(INPUT, &images)?;
        request.infer()?;
        let (map_size, logits) = map(request, &outputs[0])?;
        let (_, regression) = map(request, &outputs[1])?;
        Ok(apart(shape[0], map_size, logits, regression))
    }
}

/// Width, height and values of an output.
fn map(request: &InferRequest, name: &str) -> Result<([usize; 2], Vec<f32>), Failure> {
    let tensor = request.get_tensor(name)?;
    let shape = tensor.get_shape()?;
    let &[_, _, height, width] = shape.get_dimensions() else {
        return Err(format!("\"{name}\" has the shape {:?}", shape.get_dimensions()).into());
    };
    Ok(([width as usize, height as usize], tensor.get_data::<f32>()?.to_vec()))
}

impl Engine for OpenvinoEngine {
    fn name(&self) -> &'static str {
        NAME
    }

    fn batch_head_maps(&mut self, inputs: &[f32], input_size: [usize; 2]) -> Result<Vec<HeadMaps>, EngineError> {
        unpanicked(NAME, || self.run(inputs, input_size))
    }
}

/// Loads the library; a process has one, and the first that was loaded stays.
fn load(library: &Path) -> Result<(), Failure> {
    Ok(openvino_sys::library::load_from(library)?)
}
