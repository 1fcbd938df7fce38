//! Answers that are no numbers, told and not decoded: a heatmap of NaN has no peaks, which looks like an empty road.

use std::path::PathBuf;

use farsight_onnx::TensorInfo;

use crate::{EngineError, Runner, Tensor, TensorView};

/// A runner whose answers are finite; others are errors that name the model and the output.
pub struct FiniteRunner {
    runner: Box<dyn Runner>,
    /// What errors call the model.
    model: PathBuf,
}

impl FiniteRunner {
    /// Checks what `runner` answers; `model` is only what errors call it.
    pub fn new(runner: Box<dyn Runner>, model: impl Into<PathBuf>) -> Self {
        Self { runner, model: model.into() }
    }
}

impl Runner for FiniteRunner {
    fn engine(&self) -> &str {
        self.runner.engine()
    }

    fn inputs(&self) -> &[TensorInfo] {
        self.runner.inputs()
    }

    fn outputs(&self) -> &[TensorInfo] {
        self.runner.outputs()
    }

    fn run(&mut self, inputs: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, EngineError> {
        let answers = self.runner.run(inputs)?;
        for (output, tensor) in self.runner.outputs().iter().zip(&answers) {
            if let Some(place) = tensor.values.iter().position(|value| !value.is_finite()) {
                let (model, name, value) = (self.model.display(), &output.name, tensor.values[place]);
                let told = format!("{model}: output \"{name}\" has {value} at place {place}; expected finite numbers");
                return Err(EngineError::new(self.engine(), format!("{told}: are the weights broken?")));
            }
        }
        Ok(answers)
    }

    fn recycle(&mut self, values: Vec<f32>) {
        self.runner.recycle(values);
    }

    fn share(&self) -> Result<Box<dyn Runner>, EngineError> {
        Ok(Box::new(Self { runner: self.runner.share()?, model: self.model.clone() }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Answers what it is told to.
    #[derive(Clone)]
    struct Parrot(Vec<f32>, [TensorInfo; 1]);

    impl Runner for Parrot {
        fn engine(&self) -> &'static str {
            "parrot"
        }

        fn inputs(&self) -> &[TensorInfo] {
            &[]
        }

        fn outputs(&self) -> &[TensorInfo] {
            &self.1
        }

        fn run(&mut self, _: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, EngineError> {
            Ok(vec![Tensor { shape: vec![self.0.len()], values: self.0.clone() }])
        }

        fn share(&self) -> Result<Box<dyn Runner>, EngineError> {
            Ok(Box::new(self.clone()))
        }
    }

    #[test]
    fn answers_that_are_no_numbers_are_told_by_sharers_too() {
        let outputs = [TensorInfo { name: "heat".to_owned(), channels: None }];
        let answers = |values: Vec<f32>| {
            let runner = FiniteRunner::new(Box::new(Parrot(values, outputs.clone())), "m.onnx");
            let shared = runner.share().unwrap().run(&[]).map_err(|error| error.to_string());
            shared.map(|tensors| tensors[0].values.clone())
        };
        assert_eq!(answers(vec![1.0, f32::MAX]), Ok(vec![1.0, f32::MAX]));
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let told = answers(vec![0.0, value]).unwrap_err();
            let expected = format!("m.onnx: output \"heat\" has {value} at place 1; expected finite numbers");
            assert!(told.contains(&expected), "{told}");
        }
    }
}
