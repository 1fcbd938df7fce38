//! The engine that is always there: `rten`, in pure Rust, with convolutions of our own.

use std::sync::Arc;

use farsight_onnx::{OnnxModel, TensorInfo};
use rten::{ThreadPool, ValueView, thread_pool};

use crate::EngineError;
use crate::library::{Failure, unpanicked};
use crate::plan::Plan;
use crate::runner::{Runner, Tensor, TensorView, input};

/// Its name as users write it.
const NAME: &str = "rten";

/// Runs an ONNX model with `rten`.
pub struct RtenRunner {
    plan: Arc<Plan>,
    inputs: Vec<TensorInfo>,
    outputs: Vec<TensorInfo>,
    threads: Option<usize>,
    /// Threads of its own, started when it first runs; sharers must not wait for each other.
    pool: Option<Arc<ThreadPool>>,
}

impl RtenRunner {
    /// Loads `model`, to be run by so many threads; `None` takes one for each core.
    ///
    /// # Errors
    /// When rten cannot load the model; it has no `DeformConv`, for instance.
    pub fn new(model: OnnxModel, threads: Option<usize>) -> Result<Self, EngineError> {
        let (inputs, outputs) = (vec![model.input().clone()], model.outputs().to_vec());
        unpanicked(NAME, || {
            let plan = Plan::new(model)?;
            Ok(Self { plan: Arc::new(plan), inputs, outputs, threads, pool: None })
        })
    }

    fn values(&mut self, given: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, Failure> {
        let mut views = Vec::with_capacity(self.inputs.len());
        for TensorInfo { name, .. } in &self.inputs {
            let view = input(given, name)?;
            views.push(ValueView::from_shape(view.shape, view.values)?);
        }
        if self.pool.is_none() {
            self.pool = self.threads.map(|threads| Arc::new(ThreadPool::with_num_threads(threads)));
        }
        let (plan, pool) = (&self.plan, &self.pool);
        let work = || plan.run(views, pool.as_ref());
        match pool {
            Some(pool) => pool.run(work),
            None => thread_pool().run(work),
        }
    }
}

impl Runner for RtenRunner {
    fn engine(&self) -> &str {
        NAME
    }

    fn inputs(&self) -> &[TensorInfo] {
        &self.inputs
    }

    fn outputs(&self) -> &[TensorInfo] {
        &self.outputs
    }

    fn run(&mut self, inputs: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, EngineError> {
        unpanicked(NAME, || self.values(inputs))
    }

    fn share(&self) -> Result<Box<dyn Runner>, EngineError> {
        let Self { plan, inputs, outputs, threads, pool: _ } = self;
        let (inputs, outputs) = (inputs.clone(), outputs.clone());
        Ok(Box::new(Self { plan: plan.clone(), inputs, outputs, threads: *threads, pool: None }))
    }
}
