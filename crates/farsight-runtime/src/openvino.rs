//! OpenVINO, loaded at run time. Only this file knows whether it is compiled in.
//!
//! Sharers run the same compiled networks, so the weights are there once; each has an inference request of its own.

#[cfg(not(feature = "openvino"))]
use absent as engine;
#[cfg(feature = "openvino")]
use present as engine;

pub use engine::{open, version};

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

#[cfg(feature = "openvino")]
mod present {
    use std::path::Path;
    use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

    use farsight_onnx::{OnnxModel, TensorInfo};
    use openvino::{
        CompiledModel, Core, DeviceType, Dimension, ElementType, InferRequest, PartialShape, RwPropertyKey, Shape,
        Tensor as OvTensor,
    };

    use super::{NAME, OpenvinoPrecision};
    use crate::EngineError;
    use crate::elf::check_whole;
    use crate::library::{Failure, unpanicked};
    use crate::runner::{Runner, Tensor, TensorView, input};

    /// So many compiled forms of one network are kept: an image of another shape now and then costs no compiling.
    const KEPT: usize = 4;

    /// Loads the shared `library` (`libopenvino_c`, 2025.1 or later) and `model`, to be run by so many threads; `None`
    /// takes one for each core. So many sharers run at the same time; more wait for each other.
    ///
    /// # Errors
    /// When the library cannot be loaded, is too old, or refuses the model.
    pub fn open(
        library: &Path,
        model: OnnxModel,
        threads: Option<usize>,
        sharers: usize,
        precision: OpenvinoPrecision,
    ) -> Result<Box<dyn Runner>, EngineError> {
        unpanicked(NAME, || {
            load(library)?;
            let mut core = Core::new()?;
            core.set_property(&DeviceType::CPU, &RwPropertyKey::HintInferencePrecision, hint(precision))?;
            if let Some(threads) = threads {
                let all = threads * sharers;
                core.set_property(&DeviceType::CPU, &RwPropertyKey::InferenceNumThreads, &all.to_string())?;
            }
            if sharers > 1 {
                core.set_property(&DeviceType::CPU, &RwPropertyKey::NumStreams, &sharers.to_string())?;
                // Each network would tie its first stream to the same core, and a network and the one that follows it
                // would wait for each other while another core has nothing to do.
                core.set_property(&DeviceType::CPU, &RwPropertyKey::HintEnableCpuPinning, "NO")?;
            }
            core.read_model_from_buffer(model.bytes(), None)?;
            let compiler = Mutex::new(Compiler { core, forms: Vec::new() });
            Ok(Box::new(OpenvinoRunner { network: Arc::new(Network { model, compiler }), request: None }) as _)
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

    /// OpenVINO's word for it.
    fn hint(precision: OpenvinoPrecision) -> &'static str {
        match precision {
            OpenvinoPrecision::F32 => "f32",
            OpenvinoPrecision::Bf16 => "bf16",
        }
    }

    /// Loads the library; a process has one, and the first that was loaded stays.
    fn load(library: &Path) -> Result<(), Failure> {
        check_whole(library)?;
        Ok(openvino_sys::library::load_from(library)?)
    }

    /// A network and its compiled forms, which all sharers run.
    struct Network {
        model: OnnxModel,
        compiler: Mutex<Compiler>,
    }

    struct Compiler {
        core: Core,
        /// The last ones that were made.
        forms: Vec<(InputShape, CompiledModel)>,
    }

    /// Which inputs a compiled form takes; OpenVINO is faster when it knows all sides.
    #[derive(Debug, Clone, PartialEq, Eq)]
    struct InputShape {
        /// None takes any number of images.
        batch: Option<usize>,
        /// Channels, rows, columns.
        rest: Vec<usize>,
    }

    impl InputShape {
        fn takes(&self, shape: &[usize]) -> bool {
            shape
                .split_first()
                .is_some_and(|(batch, rest)| self.rest == rest && self.batch.is_none_or(|known| known == *batch))
        }

        fn dimensions(&self) -> Vec<Dimension> {
            let batch = self.batch.map_or(Dimension::new(-1, -1), known);
            [batch].into_iter().chain(self.rest.iter().map(|&side| known(side))).collect()
        }
    }

    fn known(side: usize) -> Dimension {
        Dimension::new(side as i64, side as i64)
    }

    impl Network {
        /// A request for inputs of this shape. The second batch size that is asked for compiles a form for all of them:
        /// second stages see as many crops as there are objects.
        fn request(&self, shape: &[usize]) -> Result<(InputShape, InferRequest), Failure> {
            let mut compiler: MutexGuard<'_, Compiler> = self.compiler.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some((takes, form)) = compiler.forms.iter_mut().find(|(takes, _)| takes.takes(shape)) {
                return Ok((takes.clone(), form.create_infer_request()?));
            }
            let (&batch, rest) = shape.split_first().ok_or("an input without sides")?;
            let before = compiler.forms.iter().position(|(takes, _)| takes.rest == rest);
            let takes = InputShape { batch: before.is_none().then_some(batch), rest: rest.to_vec() };
            let mut model = compiler.core.read_model_from_buffer(self.model.bytes(), None)?;
            let sides = PartialShape::new(shape.len() as i64, &takes.dimensions())?;
            model.reshape_input_by_name(&self.model.input().name, &sides)?;
            let mut form = compiler.core.compile_model(&model, DeviceType::CPU)?;
            let request = form.create_infer_request()?;
            if let Some(superseded) = before {
                compiler.forms.remove(superseded);
            } else if compiler.forms.len() >= KEPT {
                compiler.forms.remove(0);
            }
            compiler.forms.push((takes.clone(), form));
            Ok((takes, request))
        }
    }

    /// Runs an ONNX model with OpenVINO on the CPU.
    struct OpenvinoRunner {
        network: Arc<Network>,
        /// For inputs of the last shape.
        request: Option<(InputShape, InferRequest)>,
    }

    impl OpenvinoRunner {
        fn values(&mut self, given: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, Failure> {
            let model = &self.network.model;
            let name = &model.input().name;
            let view = input(given, name)?;
            let sides: Vec<i64> = view.shape.iter().map(|&side| side as i64).collect();
            let mut images = OvTensor::new(ElementType::F32, &Shape::new(&sides)?)?;
            images.get_data_mut::<f32>()?.copy_from_slice(view.values);
            let fitting = self.request.take().filter(|(takes, _)| takes.takes(view.shape));
            let fitting = match fitting {
                Some(fitting) => fitting,
                None => self.network.request(view.shape)?,
            };
            let (_, request) = self.request.insert(fitting);
            request.set_tensor(name, &images)?;
            request.infer()?;
            let tensor = |output: &TensorInfo| {
                let tensor = request.get_tensor(&output.name)?;
                let shape = tensor.get_shape()?.get_dimensions().iter().map(|&side| side as usize).collect();
                Ok(Tensor { shape, values: tensor.get_data::<f32>()?.to_vec() })
            };
            model.outputs().iter().map(tensor).collect()
        }
    }

    impl Runner for OpenvinoRunner {
        fn engine(&self) -> &str {
            NAME
        }

        fn inputs(&self) -> &[TensorInfo] {
            std::slice::from_ref(self.network.model.input())
        }

        fn outputs(&self) -> &[TensorInfo] {
            self.network.model.outputs()
        }

        fn run(&mut self, inputs: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, EngineError> {
            unpanicked(NAME, || self.values(inputs))
        }

        fn share(&self) -> Result<Box<dyn Runner>, EngineError> {
            Ok(Box::new(Self { network: self.network.clone(), request: None }))
        }
    }
}

#[cfg(not(feature = "openvino"))]
mod absent {
    use std::path::Path;

    use farsight_onnx::OnnxModel;

    use super::{NAME, OpenvinoPrecision};
    use crate::{EngineError, Runner};

    /// The engine is not compiled in.
    ///
    /// # Errors
    /// Always.
    pub fn open(
        _: &Path,
        _: OnnxModel,
        _: Option<usize>,
        _: usize,
        _: OpenvinoPrecision,
    ) -> Result<Box<dyn Runner>, EngineError> {
        Err(EngineError::not_built(NAME))
    }

    /// The engine is not compiled in.
    ///
    /// # Errors
    /// Always.
    pub fn version(_: &Path) -> Result<String, EngineError> {
        Err(EngineError::not_built(NAME))
    }
}
