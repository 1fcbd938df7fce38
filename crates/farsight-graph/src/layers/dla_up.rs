//! The neck: `DLAUp` and `IDAUp` (spec section 3), with deformable or plain convolutions; `DLAUp` alone
//! where the maps are joined side by side.

use serde::{Deserialize, Serialize};

use super::Builder;
use crate::graph::{NodeId, Window};

/// The 3x3 convolutions of the neck.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NeckKind {
    /// Modulated deformable convolutions, as SMOKE.
    #[default]
    Deformable,
    /// Ordinary convolutions: every engine runs them, and fast.
    Plain,
    /// Ordinary convolutions over both maps side by side instead of their sum, and `DLAUp` alone: the neck of `MonoDLE`
    /// and those after it (flagship spec 0.1).
    Concat,
}

/// Appends the neck to backbone `levels` 0 to 5; returns the map at stride 4.
pub fn dla_up(b: &mut Builder, levels: &[NodeId; 6], channels: [usize; 6], kind: NeckKind) -> NodeId {
    let [_, _, level2, level3, level4, level5] = *levels;
    let merge = |b: &mut Builder, stage: &str, index: usize, deep: NodeId, shallow: NodeId, factor: usize| {
        let names = MergeNames { ida: format!("backbone.body.{stage}"), index };
        let channels = b.channels(shallow);
        merge(b, &names, kind, [deep, shallow], channels, factor)
    };
    // Each stage starts from the original level and climbs through what the stage before made (spec 3.3).
    let d16 = merge(b, "dla_up.ida_0", 1, level5, level4, 2);
    let a8 = merge(b, "dla_up.ida_1", 1, level4, level3, 2);
    let d8 = merge(b, "dla_up.ida_1", 2, d16, a8, 2);
    let b4 = merge(b, "dla_up.ida_2", 1, level3, level2, 2);
    let c4 = merge(b, "dla_up.ida_2", 2, a8, b4, 2);
    let d4 = merge(b, "dla_up.ida_2", 3, d8, c4, 2);
    debug_assert_eq!(b.channels(d4), channels[2]);
    for (name, node) in [("dla_up_s16", d16), ("dla_up_s8", d8), ("dla_up_s4", d4)] {
        b.tap(name, node);
    }
    if kind == NeckKind::Concat {
        return d4;
    }
    let e4 = merge(b, "ida_up", 1, d8, d4, 2);
    let f4 = merge(b, "ida_up", 2, d16, e4, 4);
    b.tap("ida_up_1", e4);
    f4
}

struct MergeNames {
    ida: String,
    index: usize,
}

impl MergeNames {
    fn of(&self, part: &str) -> String {
        format!("{}.{part}_{}", self.ida, self.index)
    }
}

/// Brings the deep map to the shallow one's width and size, adds or joins them, and convolves (spec
/// 3.2).
fn merge(
    b: &mut Builder,
    names: &MergeNames,
    kind: NeckKind,
    [deep, shallow]: [NodeId; 2],
    channels: usize,
    factor: usize,
) -> NodeId {
    b.stage(if names.ida.ends_with("ida_up") { "ida_up" } else { "dla_up" });
    let projected = neck_conv(b, deep, &names.of("proj"), channels, kind);
    let enlarged = b.up_conv(projected, &names.of("up"), factor);
    let joined = if kind == NeckKind::Concat { b.concat(&[enlarged, shallow]) } else { b.add(enlarged, shallow) };
    neck_conv(b, joined, &names.of("node"), channels, kind)
}

pub(super) fn neck_conv(b: &mut Builder, x: NodeId, name: &str, channels: usize, kind: NeckKind) -> NodeId {
    let x = match kind {
        NeckKind::Deformable => b.deform_conv(x, &format!("{name}.deform_conv"), channels),
        NeckKind::Plain | NeckKind::Concat => b.conv(x, &format!("{name}.conv"), channels, Window::same(3, 1)),
    };
    let x = b.norm(x, &format!("{name}.norm"));
    b.relu(x)
}
