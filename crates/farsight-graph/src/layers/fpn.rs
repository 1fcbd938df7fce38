//! A feature pyramid (Lin et al. 2017, arXiv 1612.03144) as the neck of a classifier's backbone.

use super::Builder;
use super::dla_up::{NeckKind, neck_conv};
use crate::graph::{NodeId, Op, Window};

/// Prefix of the parameter names, torchvision's for a backbone with a pyramid.
const PREFIX: &str = "backbone.fpn.";

/// Appends the pyramid of `width` channels over backbone `levels` 2 to 5 (strides 4 to 32); returns its map at stride
/// 4.
///
/// Unlike the paper's it convolves before it goes down to the next level and not only at the end: the backbone may be
/// frozen, and then all that the detector learns is here and in the heads.
pub fn fpn(b: &mut Builder, levels: &[NodeId; 6], width: usize, kind: NeckKind) -> NodeId {
    b.stage("fpn");
    let mut above = None;
    for (i, &level) in levels[2..].iter().enumerate().rev() {
        let lateral = b.conv(level, &format!("{PREFIX}inner_blocks.{i}.0"), width, Window::same(1, 1));
        let mut x = b.norm(lateral, &format!("{PREFIX}inner_blocks.{i}.1"));
        if let Some(above) = above {
            let enlarged = b.map(Op::Upsample { factor: 2 }, above);
            x = b.add(x, enlarged);
        }
        above = Some(neck_conv(b, x, &format!("{PREFIX}layer_blocks.{i}"), width, kind));
    }
    above.unwrap_or(levels[2])
}
