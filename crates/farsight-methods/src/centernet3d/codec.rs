//! Encode and decode: between a box in the scene with its 2D box and the channels at one cell of the maps.
//! `decode(encode(x)) = x` where the centre of the 3D box is seen at the centre of the 2D box.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_6};

use farsight_core::box3d::ray_angle;
use farsight_core::{Box2d, Box3d, Camera, Dimensions, wrapped_angle};

use crate::center_map::depth_scale;

/// Middle of each bin of the observation angle, radians.
const BIN_CENTERS: [f64; 2] = [-FRAC_PI_2, FRAC_PI_2];

/// Bins reach so far beyond a half turn, radians; angles where they overlap are learnt by both.
const BIN_OVERLAP: f64 = FRAC_PI_6;

/// One bin of the observation angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadingBin {
    /// Whether the angle is in it; of an answer the difference of its logits.
    pub score: f64,
    /// Sine and cosine of the angle less the bin's middle.
    pub sin_cos: [f64; 2],
}

/// What stands at one cell, after activations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Encoded {
    /// Column and row of the cell that holds the 2D box's centre.
    pub cell: [usize; 2],
    /// Depth of the box's centre, metres, virtual where the codec says so.
    pub depth_m: f64,
    /// The observation angle's bins.
    pub bins: [HeadingBin; 2],
    /// Height, width and length, metres.
    pub dimensions_hwl: [f64; 3],
    /// Width and height of the 2D box, cells.
    pub size: [f64; 2],
    /// Position of its centre within the cell, cells.
    pub offset: [f64; 2],
}

/// The two directions of the code.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Codec {
    /// Focal length, pixels of the network's input, under which virtual depth is true depth; none for depth as it is.
    pub depth_focal_px: Option<f64>,
}

impl Codec {
    /// What stands at the cell of `object`, whose 2D box is `box2d` in cells of the feature map seen by `camera`. None
    /// when the centre of the 2D box has no cell.
    pub fn encode(&self, object: &Box3d, box2d: &Box2d, camera: &Camera) -> Option<Encoded> {
        let center = [f64::midpoint(box2d.x1, box2d.x2), f64::midpoint(box2d.y1, box2d.y2)];
        if !(center.iter().all(|v| *v >= 0.0) && object.depth_m() > 0.0) {
            return None;
        }
        let alpha = wrapped_angle(object.alpha());
        let bins = BIN_CENTERS.map(|center| {
            let off = wrapped_angle(alpha - center);
            let (sin, cos) = off.sin_cos();
            HeadingBin { score: f64::from(off.abs() < FRAC_PI_2 + BIN_OVERLAP), sin_cos: [sin, cos] }
        });
        let Dimensions { height, width, length } = object.dimensions;
        Some(Encoded {
            cell: center.map(|v| v as usize),
            depth_m: object.depth_m() / depth_scale(self.depth_focal_px, camera),
            bins,
            dimensions_hwl: [height, width, length],
            size: [box2d.width(), box2d.height()],
            offset: center.map(f64::fract),
        })
    }

    /// The box that `encoded` stands for under `camera` (of the feature map): its centre is taken to be seen at the
    /// centre of the 2D box, as by the authors.
    pub fn decode(&self, encoded: &Encoded, camera: &Camera) -> Box3d {
        let pixel = [0, 1].map(|axis| encoded.cell[axis] as f64 + encoded.offset[axis]);
        let [height, width, length] = encoded.dimensions_hwl;
        let [x, y, z] = camera.point_from_pixel(pixel, encoded.depth_m * depth_scale(self.depth_focal_px, camera));
        let location = [x, y + height / 2.0, z];
        // Of equal bins the first counts.
        let bin = usize::from(encoded.bins[1].score > encoded.bins[0].score);
        let [sin, cos] = encoded.bins[bin].sin_cos;
        let alpha = sin.atan2(cos) + BIN_CENTERS[bin];
        Box3d {
            dimensions: Dimensions { height, width, length },
            location,
            yaw: wrapped_angle(alpha + ray_angle(location)),
        }
    }

    /// The 2D box of `encoded`, cells of the feature map.
    pub fn box2d(encoded: &Encoded) -> Box2d {
        let [x, y] = [0, 1].map(|axis| encoded.cell[axis] as f64 + encoded.offset[axis]);
        let [width, height] = encoded.size.map(|side| side.max(0.0));
        Box2d::new(x - width / 2.0, y - height / 2.0, x + width / 2.0, y + height / 2.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_encoded_comes_back() {
        let camera = Camera::from_hfov(80.0, 320, 96).unwrap();
        for codec in [Codec { depth_focal_px: None }, Codec { depth_focal_px: Some(500.0) }] {
            for turn in 0..24 {
                let yaw = wrapped_angle(f64::from(turn) * 0.27 - 3.0);
                let dimensions = Dimensions { height: 1.5, width: 1.6, length: 3.9 };
                let object = Box3d { dimensions, location: [3.0, 1.7, 21.0], yaw };
                let [u, v] = camera.pixel_from_point(object.center()).unwrap();
                let box2d = Box2d::new(u - 7.0, v - 3.0, u + 7.0, v + 3.0);
                let encoded = codec.encode(&object, &box2d, &camera).unwrap();
                let back = codec.decode(&encoded, &camera);
                assert!(back.location.iter().zip(object.location).all(|(a, b)| (a - b).abs() < 1e-9), "{back:?}");
                assert!(wrapped_angle(back.yaw - object.yaw).abs() < 1e-9, "{} and {yaw}", back.yaw);
                let found = Codec::box2d(&encoded);
                assert!((found.x1 - box2d.x1).abs() < 1e-9 && (found.y2 - box2d.y2).abs() < 1e-9, "{found:?}");
                assert!(encoded.bins.iter().any(|bin| bin.score > 0.5), "every angle is in a bin");
            }
        }
    }
}
