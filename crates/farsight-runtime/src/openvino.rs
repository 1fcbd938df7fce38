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

#[cfg(feature = "openvino")]
mod present {
    use std::path::Path;
    use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

    use farsight_onnx::{OnnxModel, TensorInfo};
    use openvino::{
        CompiledModel, Core, DeviceType, Dimension, ElementType, InferRequest, Model, PartialShape, RwPropertyKey,
        Shape, Tensor as OvTensor,
    };

    use super::NAME;
    use crate::EngineError;
    use crate::compiled_cache::CompiledCache;
    use crate::elf::check_whole;
    use crate::library::{Failure, unpanicked};
    use crate::runner::{Runner, Tensor, TensorView, input};
    use crate::session_options::{Device, FloatPrecision, SessionOptions};
    use crate::spare::Spare;

    /// So many forms of one network are compiled for inputs of one size. Inputs of all other sizes share one more,
    /// which is slower, but compiling takes as long as dozens of images.
    const FORMS_OF_ONE_SIZE: usize = 4;

    /// Loads the shared `library` (`libopenvino_c`, 2025.1 or later) and `model`. Where a folder for them is named,
    /// compiled networks are kept there.
    ///
    /// # Errors
    /// When the library cannot be loaded, is too old, or refuses the model, and when it finds no such device.
    pub fn open(
        library: &Path,
        model: OnnxModel,
        options: SessionOptions,
        compiled: Option<&Path>,
    ) -> Result<Box<dyn Runner>, EngineError> {
        unpanicked(NAME, || {
            load(library)?;
            let mut core = Core::new()?;
            let device = options.device;
            check_device(device, &core)?;
            let precision = match options.float {
                FloatPrecision::F32 => Some("f32"),
                FloatPrecision::Bf16 => Some("bf16"),
                // What it does by default.
                FloatPrecision::Fastest => None,
            };
            if let Some(precision) = precision {
                core.set_property(&named(device), &RwPropertyKey::HintInferencePrecision, precision)?;
            }
            if device == Device::Cpu {
                share_cores(&mut core, &options)?;
            }
            let first = Some(core.read_model_from_buffer(model.bytes(), None)?);
            let compiler = Mutex::new(Compiler { core, first, forms: Vec::new() });
            let network = Network { model, options, cache: compiled.map(CompiledCache::new), compiler };
            Ok(Box::new(OpenvinoRunner { network: Arc::new(network), request: None, spare: Spare::default() }) as _)
        })
    }

    /// OpenVINO's name of a device that it has.
    fn named(device: Device) -> DeviceType<'static> {
        match device {
            // More than one are GPU.0, GPU.1 and so on; GPU is the first of them.
            Device::Gpu => DeviceType::GPU,
            Device::Cpu | Device::Cuda | Device::TensorRt => DeviceType::CPU,
        }
    }

    /// Refuses a device that is not there.
    fn check_device(device: Device, core: &Core) -> Result<(), Failure> {
        match device {
            Device::Cpu => Ok(()),
            Device::Gpu => {
                let found = core.available_devices()?;
                let found: Vec<&str> = found.iter().map(AsRef::as_ref).collect();
                if found.iter().any(|name| name.starts_with("GPU")) {
                    return Ok(());
                }
                let text = format!(
                    "it finds no device gpu (it finds {}); that needs a GPU of Intel's with its OpenCL driver",
                    found.join(", ")
                );
                Err(text.into())
            }
            Device::Cuda | Device::TensorRt => Err(format!("it has no device {device}").into()),
        }
    }

    /// Threads and streams of the CPU.
    fn share_cores(core: &mut Core, options: &SessionOptions) -> Result<(), Failure> {
        let sharers = options.sharers.max(1);
        if let Some(threads) = options.threads {
            let all = threads * sharers;
            core.set_property(&DeviceType::CPU, &RwPropertyKey::InferenceNumThreads, &all.to_string())?;
        }
        if sharers > 1 {
            core.set_property(&DeviceType::CPU, &RwPropertyKey::NumStreams, &sharers.to_string())?;
            // Each network would tie its first stream to the same core, and a network and the one that follows it would
            // wait for each other while another core has nothing to do.
            core.set_property(&DeviceType::CPU, &RwPropertyKey::HintEnableCpuPinning, "NO")?;
        }
        Ok(())
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

    /// Loads the library; a process has one, and the first that was loaded stays.
    fn load(library: &Path) -> Result<(), Failure> {
        check_whole(library)?;
        Ok(openvino_sys::library::load_from(library)?)
    }

    /// A network and its compiled forms, which all sharers run.
    struct Network {
        model: OnnxModel,
        options: SessionOptions,
        cache: Option<CompiledCache>,
        compiler: Mutex<Compiler>,
    }

    struct Compiler {
        core: Core,
        /// As it was read to see whether it can be, until the first form is made of it.
        first: Option<Model>,
        /// In the order in which they were made; the one for any size is the last.
        forms: Vec<(InputShape, CompiledModel)>,
    }

    /// Which inputs a compiled form takes: images, channels, rows, columns; `None` takes any number. OpenVINO is faster
    /// when it knows all sides.
    #[derive(Debug, Clone, PartialEq, Eq)]
    struct InputShape(Vec<Option<usize>>);

    impl InputShape {
        fn takes(&self, shape: &[usize]) -> bool {
            self.0.len() == shape.len()
                && self.0.iter().zip(shape).all(|(known, side)| known.is_none_or(|it| it == *side))
        }

        fn dimensions(&self) -> Vec<Dimension> {
            let dimension = |side: &Option<usize>| side.map_or(-1, |side| side as i64);
            self.0.iter().map(|side| Dimension::new(dimension(side), dimension(side))).collect()
        }
    }

    impl Network {
        /// A request for inputs of this shape. More images than one compile a form for any number of them: second
        /// stages see as many crops as there are objects.
        fn request(&self, shape: &[usize]) -> Result<(InputShape, InferRequest), Failure> {
            let mut compiler: MutexGuard<'_, Compiler> = self.compiler.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some((takes, form)) = compiler.forms.iter_mut().find(|(takes, _)| takes.takes(shape)) {
                return Ok((takes.clone(), form.create_infer_request()?));
            }
            let (&batch, rest) = shape.split_first().ok_or("an input without sides")?;
            let known: Vec<_> = rest.iter().copied().map(Some).collect();
            let before = compiler.forms.iter().position(|(takes, _)| takes.0[1..] == known);
            let takes = if before.is_none() && compiler.forms.len() >= FORMS_OF_ONE_SIZE {
                let channels = known.iter().copied().take(1);
                InputShape([None].into_iter().chain(channels).chain(rest.iter().skip(1).map(|_| None)).collect())
            } else {
                InputShape([(before.is_none() && batch == 1).then_some(1)].into_iter().chain(known).collect())
            };
            let mut model = match compiler.first.take() {
                Some(model) => model,
                None => compiler.core.read_model_from_buffer(self.model.bytes(), None)?,
            };
            let sides = PartialShape::new(shape.len() as i64, &takes.dimensions())?;
            model.reshape_input_by_name(&self.model.input().name, &sides)?;
            let mut form = self.compiled(&mut compiler.core, &model, &takes)?;
            let request = form.create_infer_request()?;
            match before {
                Some(superseded) => compiler.forms[superseded] = (takes.clone(), form),
                None => compiler.forms.push((takes.clone(), form)),
            }
            Ok((takes, request))
        }

        /// The network compiled for these inputs; by the cache if that works.
        fn compiled(&self, core: &mut Core, model: &Model, takes: &InputShape) -> Result<CompiledModel, Failure> {
            let mut compile = |folder: &Path| {
                let folder = folder.to_str().ok_or("the name of its folder is not Unicode")?;
                core.set_property(&named(self.options.device), &RwPropertyKey::CacheDir, folder)?;
                Ok(core.compile_model(model, named(self.options.device))?)
            };
            let cached = self.cache.as_ref().map(|cache| {
                let how = format!("{takes:?} {:?} {}", self.options, openvino::version().build_number);
                cache.compiled(&CompiledCache::key(&[self.model.bytes(), how.as_bytes()]), &mut compile)
            });
            match cached {
                Some(Ok(form)) => Ok(form),
                // A full disk, or a file that was removed meanwhile; if it is the network, that is told now.
                Some(Err(_)) | None => compile(Path::new("")),
            }
        }
    }

    /// Runs an ONNX model with OpenVINO.
    struct OpenvinoRunner {
        network: Arc<Network>,
        /// For inputs of the last shape.
        request: Option<(InputShape, InferRequest)>,
        spare: Spare,
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
            let spare = &mut self.spare;
            request.set_tensor(name, &images)?;
            request.infer()?;
            let tensor = |output: &TensorInfo| {
                let tensor = request.get_tensor(&output.name)?;
                let shape = tensor.get_shape()?.get_dimensions().iter().map(|&side| side as usize).collect();
                Ok(Tensor { shape, values: spare.filled(tensor.get_data::<f32>()?) })
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

        fn recycle(&mut self, values: Vec<f32>) {
            self.spare.keep(values);
        }

        fn share(&self) -> Result<Box<dyn Runner>, EngineError> {
            Ok(Box::new(Self { network: self.network.clone(), request: None, spare: Spare::default() }))
        }
    }
}

#[cfg(not(feature = "openvino"))]
mod absent {
    use std::path::Path;

    use farsight_onnx::OnnxModel;

    use super::NAME;
    use crate::{EngineError, Runner, SessionOptions};

    /// The engine is not compiled in.
    ///
    /// # Errors
    /// Always.
    pub fn open(_: &Path, _: OnnxModel, _: SessionOptions, _: Option<&Path>) -> Result<Box<dyn Runner>, EngineError> {
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
