//! Scenes without end, finished: pixels, camera and labels.

use farsight_core::{Camera, Label};
use farsight_data::Frame;
use farsight_data::annotations::DepthMap;

use crate::generator::{SceneConfig, generate_scene};
use crate::labels::LabelRules;
use crate::layout::scene_from_labels;
use crate::plates::plates;
use crate::render::render;
use crate::rng::{LAYOUT_STREAM, SCENE_STREAM, SENSOR_STREAM, SceneRng, twin_seed};
use crate::scene::LabelledScene;
use crate::sensor::SensorModel;

/// Random scenes of one seed, each there whenever it is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneStream {
    /// What the scenes look like and which cameras see them; without a [`problem`](SceneConfig::problem).
    pub config: SceneConfig,
    /// Which scenes.
    pub seed: u64,
}

impl SceneStream {
    /// Name of the frame of scene number `index`.
    pub fn id(index: u64) -> String {
        format!("{index:06}")
    }

    /// The region of scene number `index`; none for KITTI's city.
    pub fn region(&self, index: u64) -> Option<&'static str> {
        // What is drawn first of a scene.
        self.config.regions.sample_name(&mut SceneRng::new(self.seed, index, SCENE_STREAM))
    }

    /// The region of the [`twin`](SceneStream::twin) of the frame of this name; none for KITTI's city.
    pub fn twin_region(&self, id: &str) -> Option<&'static str> {
        self.config.regions.sample_name(&mut SceneRng::new(twin_seed(self.seed, id), 0, LAYOUT_STREAM))
    }

    /// Scene number `index`, rendered and captured: the same bytes for any number of threads.
    pub fn frame(&self, index: u64) -> Frame {
        let labelled = generate_scene(&self.config, self.seed, index);
        captured(&labelled, Self::id(index), &mut SceneRng::new(self.seed, index, SENSOR_STREAM))
    }

    /// A frame with the objects of `labels` at their own positions under their own `camera`, in a random scene around
    /// them: in the stream's region, weather and kind of camera.
    ///
    /// The scene follows from the seed and the frame's name `id`. Truncation and occlusion are those of the picture,
    /// which need not be those of `labels`.
    pub fn twin(&self, labels: &[Label], camera: &Camera, image_size: [usize; 2], id: &str) -> Frame {
        let seed = twin_seed(self.seed, id);
        let labelled = scene_from_labels(&self.config, labels, camera, image_size, seed);
        captured(&labelled, id.to_owned(), &mut SceneRng::new(seed, 0, SENSOR_STREAM))
    }
}

/// The twin of a frame in the world that is drawn without a world file: see [`SceneStream::twin`].
pub fn frame_from_labels(labels: &[Label], camera: &Camera, image_size: [usize; 2], seed: u64, id: &str) -> Frame {
    SceneStream { config: SceneConfig::default(), seed }.twin(labels, camera, image_size, id)
}

/// The image of a scene, with its camera and labels.
fn captured(labelled: &LabelledScene, id: String, rng: &mut SceneRng) -> Frame {
    let LabelledScene { scene, objects } = labelled;
    let rendered = render(scene);
    let sensor = SensorModel::sample_of(scene.device, &scene.atmosphere, rng.inner());
    let image = sensor.capture(&rendered);
    let labels = LabelRules::for_width(scene.image_size[0]).labels(scene, objects, &rendered);
    let plates = plates(scene, objects, &rendered, &labels);
    Frame::new(id, image, scene.camera, labels).with(plates).with(DepthMap { depth_m: rendered.depth_m })
}
