//! Scenes without end, finished: pixels, camera and labels.

use farsight_core::{Camera, Label};
use farsight_data::Frame;
use farsight_data::annotations::DepthMap;

use crate::dice::Dice;
use crate::labels::LabelRules;
use crate::photo::PhotoSettings;
use crate::plates::plates;
use crate::render::render;
use crate::{Drawn, WorldConfig, draw_scene, scene_from_labels};

/// The stream of draws that decides about the photograph; scenes and layouts have 0 and 1.
const PHOTO_STREAM: u64 = 2;

/// Fowler, Noll and Vo's prime, for 64 bits.
const FNV_PRIME: u64 = 0x0100_0000_01b3;

/// Random scenes of one seed, each there whenever it is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneStream {
    /// What the scenes look like and which cameras see them; without a [`problem`](WorldConfig::problem).
    pub world: WorldConfig,
    /// Which scenes.
    pub seed: u64,
}

impl SceneStream {
    /// Name of the frame of scene number `index`.
    pub fn id(index: u64) -> String {
        format!("{index:06}")
    }

    /// Scene number `index`, rendered and photographed: the same bytes for any number of threads.
    pub fn frame(&self, index: u64) -> Frame {
        let drawn = draw_scene(&self.world, self.seed, index);
        photographed(&drawn, Self::id(index), &mut Dice::new(self.seed, index, PHOTO_STREAM))
    }
}

/// A frame with the objects of `labels` at their own positions under their own `camera`, in a world drawn around them.
///
/// The world follows from `seed` and the frame's name `id`. Truncation and occlusion are those of the picture, which need not be those of `labels`.
pub fn twin(labels: &[Label], camera: &Camera, image_size: [usize; 2], seed: u64, id: &str) -> Frame {
    let seed = id.bytes().fold(seed, |seed, byte| (seed ^ u64::from(byte)).wrapping_mul(FNV_PRIME));
    let drawn = scene_from_labels(labels, camera, image_size, seed);
    photographed(&drawn, id.to_owned(), &mut Dice::new(seed, 0, PHOTO_STREAM))
}

/// The photograph of a scene, with its camera and labels.
fn photographed(drawn: &Drawn, id: String, dice: &mut Dice) -> Frame {
    let Drawn { scene, actors } = drawn;
    let rendered = render(scene);
    let image = PhotoSettings::draw(&scene.air, dice.rng()).develop(&rendered);
    let labels = LabelRules::for_width(scene.image_size[0]).labels(scene, actors, &rendered);
    let plates = plates(scene, actors, &rendered, &labels);
    Frame::new(id, image, scene.camera, labels).with(plates).with(DepthMap { depth_m: rendered.depth_m })
}
