//! OpenVINO, loaded at run time.

use std::path::Path;

use farsight_core::HeadMaps;
use farsight_net::onnx::{INPUT, OnnxModel};
use openvino::{Core, DeviceType, ElementType, InferRequest, PartialShape, RwPropertyKey, Shape, Tensor};

use crate::engine::{Failure, unpanicked};
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
    /// The network compiled for the size of the last input; OpenVINO is faster when it knows the size.
    compiled: Option<([usize; 2], InferRequest)>,
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
            let size = engine.model.config().input;
            engine.request(size)?;
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

    /// The network compiled for inputs of `size`.
    fn request(&mut self, size: [usize; 2]) -> Result<&mut InferRequest, Failure> {
        let known = self.compiled.take().filter(|(compiled_size, _)| *compiled_size == size);
        let request = match known {
            Some((_, request)) => request,
            None => self.compile(size)?,
        };
        Ok(&mut self.compiled.insert((size, request)).1)
    }

    fn compile(&mut self, [width, height]: [usize; 2]) -> Result<InferRequest, Failure> {
        let mut model = self.core.read_model_from_buffer(self.model.bytes(), None)?;
        let shape = PartialShape::new_static(4, &[1, 3, height as i64, width as i64])?;
        model.reshape_input_by_name(INPUT, &shape)?;
        Ok(self.core.compile_model(&model, DeviceType::CPU)?.create_infer_request()?)
    }

    fn run(&mut self, input: &[f32], size: [usize; 2]) -> Result<HeadMaps, Failure> {
        let outputs = self.model.outputs().map(str::to_owned);
        let shape = Shape::new(&[1, 3, size[1] as i64, size[0] as i64])?;
        let mut image = Tensor::new(ElementType::F32, &shape)?;
        image.get_data_mut::<f32>()?.copy_from_slice(input);
        let request = self.request(size)?;
        request.set_tensor(INPUT, &image)?;
        request.infer()?;
        let (map_size, logits) = map(request, &outputs[0])?;
        let (_, regression) = map(request, &outputs[1])?;
        Ok(HeadMaps { logits, regression, map_size })
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

    fn head_maps(&mut self, input: &[f32], input_size: [usize; 2]) -> Result<HeadMaps, EngineError> {
        unpanicked(NAME, || self.run(input, input_size))
    }
}

/// Loads the library; a process has one, and the first that was loaded stays.
fn load(library: &Path) -> Result<(), Failure> {
    Ok(openvino_sys::library::load_from(library)?)
}
