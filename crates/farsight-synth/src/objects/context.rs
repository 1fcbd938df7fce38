//! What a mesh is built from: materials, random draws, level of detail, and what it is doing.

use crate::palette::Palette;
use crate::rng::SceneRng;
use crate::scene::MaterialId;

/// How finely something is built, by its distance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Detail {
    Far,
    Middle,
    Near,
}

impl Detail {
    /// What an object at this distance needs, for a camera of this focal length.
    pub(crate) fn at(distance_m: f64, focal_px: f64) -> Self {
        let metre_px = focal_px / distance_m.max(1.0);
        match metre_px {
            px if px > 24.0 => Self::Near,
            px if px > 11.0 => Self::Middle,
            _ => Self::Far,
        }
    }

    /// `near` corners around something round, fewer farther away.
    pub(crate) fn sides(self, near: usize) -> usize {
        match self {
            Self::Near => near,
            Self::Middle => (near * 2 / 3).max(5),
            Self::Far => (near * 2 / 5).max(4),
        }
    }
}

/// What a labelled object is doing, as far as it shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct ObjectState {
    /// Lamps are lit.
    pub(crate) lights_on: bool,
    /// Brake lamps are lit.
    pub(crate) braking: bool,
    /// Someone may be driving, walking, riding; otherwise it is parked.
    pub(crate) moving: bool,
}

/// Everything that a mesh is drawn from.
pub(crate) struct BuildContext<'a> {
    pub(crate) palette: &'a mut Palette,
    pub(crate) rng: SceneRng,
    pub(crate) detail: Detail,
    pub(crate) state: ObjectState,
    /// Colours that no factory makes.
    pub(crate) unusual: bool,
    /// What number plates are made of, once something that has some is built.
    pub(crate) plate: Option<MaterialId>,
}
