//! Encode and decode: between a box in the scene with its 2D box and the channels at one cell of the maps.
//! `decode(encode(x)) = x`.

use farsight_core::box3d::ray_angle;
use farsight_core::{Box2d, Box3d, Camera, Dimensions, wrapped_angle};

use crate::center_map::{Heading, depth_scale};

/// What stands at one cell, after activations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Encoded {
    /// Column and row of the cell that holds the projected centre of the 3D box.
    pub cell: [usize; 2],
    /// Depth of the box's centre, metres, virtual where the codec says so.
    pub depth_m: f64,
    /// The observation angle.
    pub heading: Heading,
    /// Height, width and length, metres.
    pub dimensions_hwl: [f64; 3],
    /// From the cell to the projected centre of the 3D box, cells.
    pub center_offset: [f64; 2],
    /// From the cell to the centre of the 2D box, cells.
    pub box_offset: [f64; 2],
    /// Width and height of the 2D box, cells.
    pub box_size: [f64; 2],
}

/// The two directions of the code.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Codec {
    /// Focal length, pixels of the network's input, under which virtual depth is true depth; none for depth as it is.
    pub depth_focal_px: Option<f64>,
}

impl Codec {
    /// What stands at the cell of `object`, whose 2D box is `box2d` in cells of the feature map of `map_size` (width,
    /// height) seen by `camera`. None when the centre of the 3D box has no cell.
    pub fn encode(&self, object: &Box3d, box2d: &Box2d, camera: &Camera, map_size: [usize; 2]) -> Option<Encoded> {
        let center = camera.pixel_from_point(object.center())?;
        let is_inside = (0..2).all(|axis| center[axis] >= 0.0 && center[axis] < map_size[axis] as f64);
        if !(is_inside && object.depth_m() > 0.0) {
            return None;
        }
        let cell = center.map(|v| v as usize);
        let from_cell = |point: [f64; 2]| [0, 1].map(|axis| point[axis] - cell[axis] as f64);
        let box_center = [f64::midpoint(box2d.x1, box2d.x2), f64::midpoint(box2d.y1, box2d.y2)];
        let Dimensions { height, width, length } = object.dimensions;
        Some(Encoded {
            cell,
            depth_m: object.depth_m() / depth_scale(self.depth_focal_px, camera),
            heading: Heading::from_alpha(object.alpha()),
            dimensions_hwl: [height, width, length],
            center_offset: from_cell(center),
            box_offset: from_cell(box_center),
            box_size: [box2d.width(), box2d.height()],
        })
    }

    /// The box that `encoded` stands for under `camera` (of the feature map).
    pub fn decode(&self, encoded: &Encoded, camera: &Camera) -> Box3d {
        let pixel = [0, 1].map(|axis| encoded.cell[axis] as f64 + encoded.center_offset[axis]);
        let [height, width, length] = encoded.dimensions_hwl;
        let depth_m = encoded.depth_m * depth_scale(self.depth_focal_px, camera);
        let [x, y, z] = camera.point_from_pixel(pixel, depth_m);
        let location = [x, y + height / 2.0, z];
        let yaw = wrapped_angle(encoded.heading.alpha() + ray_angle(location));
        Box3d { dimensions: Dimensions { height, width, length }, location, yaw }
    }

    /// The 2D box of `encoded`, cells of the feature map.
    pub fn box2d(encoded: &Encoded) -> Box2d {
        let [x, y] = [0, 1].map(|axis| encoded.cell[axis] as f64 + encoded.box_offset[axis]);
        let [width, height] = encoded.box_size.map(|side| side.max(0.0));
        Box2d::new(x - width / 2.0, y - height / 2.0, x + width / 2.0, y + height / 2.0)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn what_is_encoded_comes_back(
            x in -9.0..9.0, y in 0.5..2.5, z in 4.0..80.0, yaw in -3.1..3.1, height in 0.5..4.0, length in 0.5..12.0,
            left in 0.0..300.0, top in 0.0..80.0, side in 1.0..60.0, focal in prop::option::of(200.0..900.0),
        ) {
            let camera = Camera::from_hfov(80.0, 320, 96).unwrap();
            let codec = Codec { depth_focal_px: focal };
            let dimensions = Dimensions { height, width: 1.7, length };
            let object = Box3d { dimensions, location: [x, y, z], yaw };
            let box2d = Box2d::new(left, top, left + side, top + side / 2.0);
            let Some(encoded) = codec.encode(&object, &box2d, &camera, [320, 96]) else { return Ok(()) };
            let back = codec.decode(&encoded, &camera);
            prop_assert!(back.location.iter().zip(object.location).all(|(a, b)| (a - b).abs() < 1e-9), "{back:?}");
            prop_assert!(wrapped_angle(back.yaw - object.yaw).abs() < 1e-9, "{} and {yaw}", back.yaw);
            prop_assert_eq!(back.dimensions, object.dimensions);
            let found = Codec::box2d(&encoded);
            for (a, b) in [(found.x1, box2d.x1), (found.y1, box2d.y1), (found.x2, box2d.x2), (found.y2, box2d.y2)] {
                prop_assert!((a - b).abs() < 1e-9, "{found:?}");
            }
            prop_assert!(encoded.center_offset.iter().all(|offset| (0.0..1.0).contains(offset)));
        }
    }

    #[test]
    fn what_has_no_cell_is_left_out() {
        let camera = Camera::from_hfov(80.0, 320, 96).unwrap();
        let dimensions = Dimensions { height: 1.5, width: 1.6, length: 3.9 };
        let codec = Codec { depth_focal_px: None };
        let box2d = Box2d::new(0.0, 0.0, 9.0, 9.0);
        for location in [[60.0, 1.6, 8.0], [-60.0, 1.6, 8.0], [0.0, 1.6, -8.0], [0.0, 30.0, 8.0]] {
            let object = Box3d { dimensions, location, yaw: 0.0 };
            assert_eq!(codec.encode(&object, &box2d, &camera, [320, 96]), None, "{location:?}");
        }
    }
}
