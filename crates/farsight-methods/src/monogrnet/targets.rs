//! What the three networks are asked to answer for one image.

use farsight_core::overlap::iou_2d;
use farsight_core::{Affine2, Box2d, Box3d, Camera, Dimensions, Label, wrapped_angle};
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use super::MonoGrNetConfig;
use super::codec::{CORNER_STEP_M, cell_camera, cell_center, decode_move, encode_box, encode_move, local_corners};
use super::layout::{BOX_NUMBERS, CELL_STRIDE, CORNER_NUMBERS};

/// Cells whose centres lie in a box so many times narrower and lower around the same middle are the object's
/// (authors').
const FOCUS: f64 = 1.8;

/// A box that overlaps its object's less is background (authors').
const MIN_OVERLAP: f64 = 0.35;

/// Errors that later parts learn to bear: of a 2D box as shares of its sides, of a 3D box along its ray and of its
/// sides as logarithms, and of its yaw, radians.
const BOX_ERROR: f64 = 0.06;
const BOX3D_ERROR: f64 = 0.08;
const YAW_ERROR_RAD: f64 = 0.15;

/// So much larger are the errors of a box that is to be told for background.
const BACKGROUND_FACTOR: f64 = 6.0;

/// What a cell is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CellClass {
    /// Nothing is here.
    Background,
    /// An object of this class.
    Object(usize),
    /// Whatever it says: it sees the edge of an object.
    Ignored,
}

/// An object at a cell that is its own.
#[derive(Debug, Clone, PartialEq)]
pub struct CellTarget {
    /// Column and row.
    pub cell: [usize; 2],
    /// Its 2D box ([`encode_box`]).
    pub box2d: [f64; BOX_NUMBERS],
    /// Virtual depth of the centre, metres.
    pub depth_m: f64,
    /// Where the centre of the 3D box is seen from the middle of the cell, cells.
    pub center: [f64; 2],
}

/// A 2D box that the second part looks at.
#[derive(Debug, Clone, PartialEq)]
pub struct BoxTarget {
    /// The cell that found it.
    pub cell: [usize; 2],
    /// The box, grid.
    pub box2d: Box2d,
    /// What is there; none for background, of which nothing else is asked.
    pub object: Option<BoxObject>,
}

/// What is asked of a box with an object.
#[derive(Debug, Clone, PartialEq)]
pub struct BoxObject {
    /// Its class.
    pub class: usize,
    /// What moves the box to the object's.
    pub step: [f64; BOX_NUMBERS],
    /// Virtual depth of the centre, metres.
    pub depth_m: f64,
    /// Where the centre of the 3D box is seen from the middle of the cell, cells.
    pub center: [f64; 2],
    /// Corners by themselves ([`local_corners`]), metres.
    pub corners: [f64; CORNER_NUMBERS],
}

/// A 3D box that the third part looks at.
#[derive(Debug, Clone, PartialEq)]
pub struct CornerTarget {
    /// Where it is seen, grid.
    pub seen: Box2d,
    /// By what its corners are off, metres.
    pub steps: [f64; CORNER_NUMBERS],
}

/// Targets of one image.
#[derive(Debug, Clone, PartialEq)]
pub struct Targets {
    /// Width and height of the grid.
    pub grid: [usize; 2],
    /// What each cell is asked for, row by row.
    pub cells: Vec<CellClass>,
    /// Cells with objects.
    pub objects: Vec<CellTarget>,
    /// For each object its own box, one as a cell would find it, and one that is too far off.
    pub boxes: Vec<BoxTarget>,
    /// For each object its own 3D box and one as the second part would find it.
    pub corners: Vec<CornerTarget>,
}

/// An object as the grid sees it.
struct Seen<'a> {
    class: usize,
    label: &'a Label,
    /// Its box on the grid, cut at the image's edge.
    box2d: Box2d,
    /// Virtual depth of the centre, metres, and where that is seen on the grid.
    depth_m: f64,
    center: [f64; 2],
}

/// Targets for `labels` in a network input of `input_size` (width, height, pixels) seen by `input_camera`; errors of
/// boxes are drawn from `rng`.
pub fn targets(
    labels: &[Label],
    config: &MonoGrNetConfig,
    input_camera: &Camera,
    input_size: [usize; 2],
    rng: &mut impl Rng,
) -> Targets {
    let grid = input_size.map(|side| side / CELL_STRIDE);
    let mut seen: Vec<Seen> = labels.iter().filter_map(|label| Seen::new(label, config, input_camera, grid)).collect();
    // Nearer objects hide others and are drawn over them.
    seen.sort_by(|a, b| b.label.box3d.depth_m().total_cmp(&a.label.box3d.depth_m()));
    let mut owners: Vec<Option<usize>> = vec![None; grid[0] * grid[1]];
    let mut cells = vec![CellClass::Background; grid[0] * grid[1]];
    for (place, object) in seen.iter().enumerate() {
        for (cell, class) in object.cells(grid) {
            let at = cell[1] * grid[0] + cell[0];
            (owners[at], cells[at]) = (matches!(class, CellClass::Object(_)).then_some(place), class);
        }
    }
    let mut made = Targets { grid, cells, objects: Vec::new(), boxes: Vec::new(), corners: Vec::new() };
    for (place, object) in seen.iter().enumerate() {
        let own = (0..owners.len()).filter(|&at| owners[at] == Some(place));
        let own: Vec<[usize; 2]> = own.map(|at| [at % grid[0], at / grid[0]]).collect();
        made.objects.extend(own.iter().map(|&cell| object.target(cell)));
        // What is hidden behind a nearer object at every cell of its own is not found, and so not looked at again.
        if let Some(&cell) = own.iter().min_by(|a, b| object.off(**a).total_cmp(&object.off(**b))) {
            let errors = [0.0, BOX_ERROR, BACKGROUND_FACTOR * BOX_ERROR];
            made.boxes.extend(errors.map(|error| object.box_target(cell, error, rng)));
            let errors = [0.25, 1.0].into_iter();
            made.corners.extend(errors.filter_map(|error| object.corner_target(input_camera, error, rng)));
        }
    }
    made
}

impl<'a> Seen<'a> {
    fn new(label: &'a Label, config: &MonoGrNetConfig, input_camera: &Camera, grid: [usize; 2]) -> Option<Self> {
        let class = config.classes.iter().position(|known| known.class == label.class)?;
        let whole = label.box2d.transformed(&Affine2::scaling(1.0 / CELL_STRIDE as f64));
        let [width, height] = grid.map(|side| side as f64);
        let box2d = whole.clamped(width, height);
        let center = label.box3d.center();
        if !(box2d.width() > 0.0 && box2d.height() > 0.0 && center[2] > 0.0) {
            return None;
        }
        let depth_m = config.codec().virtual_depth(center[2], input_camera);
        Some(Self { class, label, box2d, depth_m, center: cell_camera(input_camera).pixel_from_point(center)? })
    }

    /// The cells that see it, and what they are asked for; at least one has to find it.
    fn cells(&self, [columns, rows]: [usize; 2]) -> Vec<([usize; 2], CellClass)> {
        let middle = [f64::midpoint(self.box2d.x1, self.box2d.x2), f64::midpoint(self.box2d.y1, self.box2d.y2)];
        let half = [self.box2d.width() / 2.0, self.box2d.height() / 2.0];
        let is_within = |cell: [usize; 2], factor: f64| {
            let at = cell_center(cell);
            (0..2).all(|axis| (at[axis] - middle[axis]).abs() <= half[axis] * factor)
        };
        let all = (0..rows).flat_map(|row| (0..columns).map(move |column| [column, row]));
        let mut found: Vec<([usize; 2], CellClass)> = all
            .filter(|&cell| is_within(cell, 1.0))
            .map(|cell| {
                let is_own = is_within(cell, 1.0 / FOCUS);
                (cell, if is_own { CellClass::Object(self.class) } else { CellClass::Ignored })
            })
            .collect();
        if !found.iter().any(|(_, class)| *class == CellClass::Object(self.class)) {
            let last = [columns - 1, rows - 1];
            let cell = [0, 1].map(|axis| (middle[axis].max(0.0) as usize).min(last[axis]));
            found.retain(|(other, _)| *other != cell);
            found.push((cell, CellClass::Object(self.class)));
        }
        found
    }

    /// How far the middle of the box lies from that of a cell.
    fn off(&self, cell: [usize; 2]) -> f64 {
        let [dx, dy, ..] = encode_box(&self.box2d, cell);
        dx.hypot(dy)
    }

    fn center_from(&self, cell: [usize; 2]) -> [f64; 2] {
        let from = cell_center(cell);
        [self.center[0] - from[0], self.center[1] - from[1]]
    }

    fn target(&self, cell: [usize; 2]) -> CellTarget {
        let (box2d, center) = (encode_box(&self.box2d, cell), self.center_from(cell));
        CellTarget { cell, box2d, depth_m: self.depth_m, center }
    }

    /// A box that is off by an error of this deviation.
    fn box_target(&self, cell: [usize; 2], error: f64, rng: &mut impl Rng) -> BoxTarget {
        let mut normal = || error * rng.sample::<f64, _>(StandardNormal);
        let step = [normal(), normal(), normal(), normal()];
        let box2d = decode_move(&self.box2d, step);
        let object = (iou_2d(&box2d, &self.box2d) >= MIN_OVERLAP).then(|| {
            let corners = local_corners(&self.label.box3d);
            BoxObject {
                class: self.class,
                step: encode_move(&box2d, &self.box2d),
                depth_m: self.depth_m,
                center: self.center_from(cell),
                corners: std::array::from_fn(|k| corners[k / 3][k % 3]),
            }
        });
        BoxTarget { cell, box2d, object }
    }

    /// A 3D box that is off by `share` of the usual errors; none where it is not seen.
    fn corner_target(&self, input_camera: &Camera, share: f64, rng: &mut impl Rng) -> Option<CornerTarget> {
        let mut normal = |deviation: f64| share * deviation * rng.sample::<f64, _>(StandardNormal);
        let truth = &self.label.box3d;
        let Dimensions { height, width, length } = truth.dimensions;
        let farther = normal(BOX3D_ERROR).exp();
        let dimensions = Dimensions {
            height: height * normal(BOX3D_ERROR).exp(),
            width: width * normal(BOX3D_ERROR).exp(),
            length: length * normal(BOX3D_ERROR).exp(),
        };
        let yaw = wrapped_angle(truth.yaw + normal(YAW_ERROR_RAD));
        let [x, y, z] = truth.center().map(|value| value * farther);
        let found = Box3d { dimensions, location: [x, y + dimensions.height / 2.0, z], yaw };
        let seen = found.projected(&cell_camera(input_camera))?;
        let (from, to) = (found.corners(), truth.corners());
        let within = |step: f64| step.clamp(-CORNER_STEP_M, CORNER_STEP_M);
        let steps = std::array::from_fn(|k| within(to[k / 3][k % 3] - from[k / 3][k % 3]));
        Some(CornerTarget { seen, steps })
    }
}
