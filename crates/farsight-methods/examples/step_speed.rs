//! One training step at a time, on request: the Farsight half of `scripts/compare_training_step.py`.
//!
//! `step_speed CONFIG BATCH`: for every line on standard input, one step on a fixed random batch; its seconds on
//! standard output.

use std::io::{BufRead, stdin};
use std::time::Instant;

use farsight_core::{Box3d, Camera, Dimensions};
use farsight_graph::init::initial_weights;
use farsight_graph::model::NetworkConfig;
use farsight_methods::smoke::targets::{ObjectTarget, Targets, feature_camera};
use farsight_methods::smoke::train::SmokeRun;
use farsight_methods::smoke::train::loss::{BatchTargets, CORNER_DIVISOR_PER_IMAGE, CornerWeights, loss};
use farsight_methods::smoke::{LOGITS, REGRESSION};
use farsight_train::adam::Adam;
use farsight_train::executor::{Mode, Network};
use tch::{Device, Kind, Tensor};

/// Objects in each image.
const OBJECTS: usize = 5;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [config, batch_size] = arguments.as_slice() else { return Err("usage: step_speed CONFIG BATCH".into()) };
    let run = SmokeRun::read(config.as_ref())?;
    let batch_size: usize = batch_size.parse()?;
    let device = Device::cuda_if_available();
    let graph = run.model.graph();
    let output = |name: &str| graph.tap(name).ok_or("the network has no such output");
    let outputs = [output(LOGITS)?, output(REGRESSION)?];
    let weights = initial_weights(&graph, 0);
    let network = Network::new(graph, &weights, device, run.train.precision.named().unwrap_or_default())?;
    let mut adam = Adam::new(run.train.adam(), network.trainable_parameters());
    let [width, height] = run.model.input;
    let input = Tensor::randn([batch_size as i64, 3, height as i64, width as i64], (Kind::Float, device));
    let targets = targets(&run, batch_size, device)?;
    let codec = run.model.codec();

    for _ in stdin().lock().lines() {
        let start = Instant::now();
        let maps = network.forward(&input, Mode::Train, &outputs);
        let divisor = CORNER_DIVISOR_PER_IMAGE * batch_size as f64;
        let (objective, _) = loss(&codec, &maps[0], &maps[1], &targets, CornerWeights::uniform(divisor));
        let parameters: Vec<Tensor> =
            network.trainable_parameters().map(|(_, tensor)| tensor.shallow_clone()).collect();
        let gradients = Tensor::run_backward(&[objective], &parameters, false, false);
        adam.step(&parameters, &gradients, 1e-4);
        if let Device::Cuda(index) = device {
            tch::Cuda::synchronize(index as i64);
        }
        #[expect(clippy::print_stdout, reason = "the answer to the script")]
        {
            println!("{}", start.elapsed().as_secs_f64());
        }
    }
    Ok(())
}

/// The same few cars in every image.
fn targets(run: &SmokeRun, batch_size: usize, device: Device) -> Result<BatchTargets, Box<dyn std::error::Error>> {
    let [width, height] = run.model.input;
    let focal = 0.58 * width as f64;
    let camera = Camera::from_intrinsics(focal, focal, width as f64 / 2.0, height as f64 / 2.0)?;
    let car = |i: usize| ObjectTarget {
        class: 0,
        cell: [width / 8 + i, height / 8],
        box3d: Box3d {
            dimensions: Dimensions { height: 1.5, width: 1.6, length: 3.9 },
            location: [i as f64, 1.6, 20.0],
            yaw: 1.0,
        },
    };
    let objects: Vec<ObjectTarget> = (0..OBJECTS).map(car).collect();
    let map_size @ [map_width, map_height] = [width / 4, height / 4];
    let mut heatmap = vec![0.0; run.model.classes.len() * map_width * map_height];
    for object in &objects {
        heatmap[object.cell[1] * map_width + object.cell[0]] = 1.0;
    }
    let image = Targets { heatmap, map_size, objects, camera: feature_camera(&camera) };
    Ok(BatchTargets::new(&vec![image; batch_size], &vec![true; batch_size], device))
}
