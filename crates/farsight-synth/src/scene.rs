//! What the renderer is given: triangles, materials, light and atmosphere, and the camera that looks at them.
//!
//! Coordinates are KITTI's, of a level camera: x right, y **down**, z forward, metres, origin at the camera. The
//! ground of a flat scene lies at `y = camera height`. A pitched or rolled camera is a [`Camera`] whose 3x4 projection
//! contains the rotation, so boxes stay upright and labels exact.

use farsight_core::{Box3d, Camera, ObjectClass};

use crate::device::Device;

/// A colour, linear light, red, green, blue; 1 is a white surface in full light.
pub type Color = [f32; 3];

/// A point or direction, metres.
pub type Vec3 = [f32; 3];

/// Index of a material in [`Scene::materials`].
pub type MaterialId = u16;

/// Who a triangle belongs to: 0 is the background, others are labelled objects numbered from 1 in the order of their
/// labels.
pub type InstanceId = u16;

/// One corner of a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vertex {
    /// Where.
    pub position: Vec3,
    /// Unit normal, for smooth shading.
    pub normal: Vec3,
    /// Coordinates of the pattern, metres along the surface where the pattern has a size.
    pub uv: [f32; 2],
}

/// One triangle. Both sides are visible; the normal is turned towards the viewer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Triangle {
    /// Indices into [`Mesh::vertices`].
    pub vertices: [u32; 3],
    /// What it is made of.
    pub material: MaterialId,
    /// Paint on a surface in the same plane: a higher layer wins over a lower one (road 0, marking 1, contact shadow
    /// 2).
    pub layer: u8,
}

/// Triangles that belong together.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// Corners.
    pub vertices: Vec<Vertex>,
    /// Triangles between them.
    pub triangles: Vec<Triangle>,
}

/// A mesh in the scene, already in the scene's coordinates.
#[derive(Debug, Clone, PartialEq)]
pub struct Object {
    /// Its triangles.
    pub mesh: Mesh,
    /// Whose they are.
    pub instance: InstanceId,
    /// Whether it throws shadows.
    pub casts_shadow: bool,
}

/// What a surface is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Material {
    /// Colour of the surface.
    pub color: Color,
    /// How the colour varies.
    pub pattern: Pattern,
    /// Strength of the sun's highlight, 0 to 1; of transparent glass more.
    pub specular: f32,
    /// Sharpness of the highlight, the exponent of Blinn and Phong.
    pub shininess: f32,
    /// Share of the surroundings (sky above, ground below) that it mirrors straight on; more at a grazing angle.
    pub reflectivity: f32,
    /// Light that it gives off itself.
    pub emission: Color,
}

/// How a surface's colour varies. Lengths are in units of `uv`, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pattern {
    /// Not at all.
    Plain,
    /// Value noise of several octaves: mixes `color` with `other` by up to `amount`. Asphalt, grass, plaster, dirt.
    Noise {
        /// Second colour.
        other: Color,
        /// Size of the largest features.
        scale: f32,
        /// 0 to 1.
        amount: f32,
        /// Which noise.
        seed: u32,
    },
    /// Rows of bricks or slabs with joints of `other`, each brick a little different.
    Bricks {
        /// Colour of the joints.
        other: Color,
        /// Width and height of a brick.
        size: [f32; 2],
        /// Width of the joints.
        joint: f32,
        /// Variation of a brick's brightness, 0 to 1.
        variation: f32,
        /// Which variation.
        seed: u32,
    },
    /// A regular grid of rectangles of `other` on `color`, each a little different and some lit: windows of a house.
    Windows {
        /// Colour of the panes.
        other: Color,
        /// Distance between windows, across and up.
        pitch: [f32; 2],
        /// Share of the pitch that the window takes, across and up.
        fill: [f32; 2],
        /// Share of lit windows, 0 to 1.
        lit: f32,
        /// Which.
        seed: u32,
    },
    /// Stripes of `color` and `other` along v (v across the stripes).
    Stripes {
        /// Second colour.
        other: Color,
        /// Width of a pair of stripes.
        period: f32,
        /// Share that `other` takes.
        share: f32,
    },
    /// Leaves: noise in brightness, and holes through which one sees; `density` 1 has none.
    Leaves {
        /// Second colour.
        other: Color,
        /// Size of a tuft.
        scale: f32,
        /// Share that is not a hole, 0 to 1.
        density: f32,
        /// Which.
        seed: u32,
    },
    /// Glass: in each pixel so many of the samples show it, the others what is behind.
    Transparent {
        /// Share of the samples that show the glass, 0 to 1. What the whole pane mirrors, these have to: divide the
        /// material's `specular` and `reflectivity` by it.
        share: f32,
    },
    /// Worn paint: `color` with holes of noise that show what is below; `wear` 0 has none.
    Worn {
        /// Size of the holes.
        scale: f32,
        /// Share of holes, 0 to 1.
        wear: f32,
        /// Which.
        seed: u32,
    },
}

/// The sun, or the moon.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sun {
    /// Unit vector from the scene to it (y negative: above).
    pub direction: Vec3,
    /// Light it gives on a surface that faces it.
    pub color: Color,
    /// Strength of cast shadows, 0 (overcast) to 1.
    pub shadow: f32,
    /// Leaves between it and the scene.
    pub canopy: Option<Canopy>,
}

/// Leaves high above the scene, out of the picture, through which the sun falls in patches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Canopy {
    /// Share of the ground in the sun, 0 to 1.
    pub open: f32,
    /// Size of the largest patches, metres.
    pub scale_m: f32,
    /// Which leaves.
    pub seed: u32,
}

/// A lamp: a street lamp, a headlight, a lit shop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lamp {
    /// Where.
    pub position: Vec3,
    /// Unit direction in which it shines.
    pub direction: Vec3,
    /// Cosine of half its cone; -1 shines everywhere.
    pub cone_cos: f32,
    /// Light at one metre.
    pub color: Color,
    /// Nothing farther than this is lit, metres.
    pub reach_m: f32,
}

/// The sky: seen behind everything, mirrored in paint and glass, and the light of the shade.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sky {
    /// Colour overhead.
    pub zenith: Color,
    /// Colour at the horizon.
    pub horizon: Color,
    /// Light from below.
    pub ground: Color,
    /// Factor on the light that the sky gives to surfaces.
    pub ambient: f32,
    /// Share of the sky under clouds, 0 to 1.
    pub clouds: f32,
    /// Colour of the clouds.
    pub cloud_color: Color,
    /// Sine of the elevation up to which houses and trees hide it in what surfaces mirror, on average.
    pub skyline: f32,
    /// Which clouds.
    pub seed: u32,
    /// What is seen and mirrored of it instead of colours and clouds.
    pub photograph: Option<SkyPhotograph>,
}

/// A photographed sky.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkyPhotograph {
    /// Which.
    pub map: SkyMap,
    /// The unit direction on the ground, x and z, where its brightest place is: below the sun.
    pub towards_sun: [f32; 2],
    /// Its median radiance.
    pub gain: f32,
}

/// Radiance maps by Poly Haven, CC0 (`NOTICE`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SkyMap {
    /// Grey, above high-rises.
    City,
    /// Violet, above mountains, just before sunrise.
    Dawn,
    /// Between pines.
    Forest,
    /// Clear, above a meadow.
    Park,
    /// Sun between clouds.
    Sky,
    /// Clear, a low sun in haze.
    Sunrise,
    /// A square with a low sun.
    Sunset,
    /// Thin clouds above a waterfront after sunset.
    Venice,
}

impl SkyMap {
    /// All of them.
    pub const ALL: [Self; 8] =
        [Self::City, Self::Dawn, Self::Forest, Self::Park, Self::Sky, Self::Sunrise, Self::Sunset, Self::Venice];
}

/// Fog, haze and rain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Atmosphere {
    /// Colour that everything far away takes.
    pub fog_color: Color,
    /// Share lost a metre: `exp(-density * distance)` is left.
    pub fog_density: f32,
    /// How wet horizontal surfaces are, 0 to 1: darker, and mirrors of the sky and of lamps.
    pub wetness: f32,
    /// Rain streaks in the picture, 0 to 1.
    pub rain: f32,
}

/// Everything the renderer needs to know.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Who looks; of the finished image's pixels.
    pub camera: Camera,
    /// Width and height of the image, pixels.
    pub image_size: [usize; 2],
    /// What is there.
    pub objects: Vec<Object>,
    /// What it is made of.
    pub materials: Vec<Material>,
    /// The sun.
    pub sun: Sun,
    /// Lamps.
    pub lamps: Vec<Lamp>,
    /// The sky.
    pub sky: Sky,
    /// The atmosphere.
    pub atmosphere: Atmosphere,
    /// What takes the picture.
    pub device: Device,
}

/// Somebody in traffic: what the label of its instance says.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelledObject {
    /// What it is.
    pub class: ObjectClass,
    /// Its box.
    pub box3d: Box3d,
    /// The instance of its triangles.
    pub instance: InstanceId,
    /// What its number plates, and nothing else, are made of.
    pub plate: Option<MaterialId>,
}

/// A scene and who is in it.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelledScene {
    /// What the renderer is given.
    pub scene: Scene,
    /// Those in traffic, numbered from 1.
    pub objects: Vec<LabelledObject>,
}
