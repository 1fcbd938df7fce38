//! Scenes without end, finished: pixels, camera and labels.

use farsight_data::Frame;

use crate::dice::Dice;
use crate::labels::LabelRules;
use crate::photo::PhotoSettings;
use crate::render::render;
use crate::{Drawn, WorldConfig, draw_scene};

/// The stream of draws that decides about the photograph; the scene has stream 0.
const PHOTO_STREAM: u64 = 1;

/// Random scenes of one seed, each there whenever it is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneStream {
    /// What the scenes look like and which cameras see them; without a [`problem`](WorldConfig::problem).
    pub world: WorldConfig,
    /// Which scenes.
    pub seed: u64,
}

impl SceneStream {
    /// Scene number `index`, rendered and photographed: the same bytes on every machine.
    pub fn frame(&self, index: u64) -> Frame {
        let drawn = draw_scene(&self.world, self.seed, index);
        photographed(&drawn, format!("{index:06}"), &mut Dice::new(self.seed, index, PHOTO_STREAM))
    }
}

/// The photograph of a scene, with its camera and labels.
fn photographed(drawn: &Drawn, id: String, dice: &mut Dice) -> Frame {
    let Drawn { scene, actors } = drawn;
    let rendered = render(scene);
    let image = PhotoSettings::draw(&scene.air, dice.rng()).develop(&rendered);
    let labels = LabelRules::for_width(scene.image_size[0]).labels(scene, actors, &rendered);
    Frame { id, image, camera: scene.camera, labels }
}
