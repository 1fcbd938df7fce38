//! The network: `MobileNetV2`, four steps down behind it, and at each of six maps two 1x1 convolutions: boxes and
//! classes of its anchors.

use farsight_graph::graph::{Graph, NodeId};
use farsight_graph::layers::inverted_residuals::{Convention, PREFIX, conv_norm_relu6};
use farsight_graph::layers::mobilenet_v2::mobilenet_v2_maps;
use farsight_graph::layers::{Builder, NormKind};

use farsight_graph::graph::Window;

use super::anchors::{LEVELS, STRIDES, shapes};

/// Outputs of the boxes, one a level: `[images, 4 anchors, rows, columns]`; of each anchor y, x, height, width.
pub const BOXES: [&str; LEVELS] = ["boxes0", "boxes1", "boxes2", "boxes3", "boxes4", "boxes5"];

/// Outputs of the classes, one a level: `[images, labels anchors, rows, columns]`, logits.
pub const CLASSES: [&str; LEVELS] = ["classes0", "classes1", "classes2", "classes3", "classes4", "classes5"];

/// The block whose expansion is the first map (torchvision's index).
const FIRST_MAP_BLOCK: usize = 14;

/// Channels of the second map, and its index in torchvision's names.
const LAST_CHANNELS: usize = 1280;
const LAST_LAYER: usize = 18;

/// Channels inside and behind each step down.
const STEPS: [[usize; 2]; LEVELS - 2] = [[256, 512], [128, 256], [128, 256], [64, 128]];

/// The network whose classes have `labels` channels an anchor.
pub(super) fn network(labels: usize) -> Graph {
    let mut b = Builder::new(NormKind::Batch);
    let image = b.input(3);
    let maps = mobilenet_v2_maps(&mut b, image, 1.0, Convention::Tensorflow300);
    let first = maps.expansions.iter().find(|(index, _)| *index == FIRST_MAP_BLOCK).map_or(image, |(_, node)| *node);
    let pointwise = Window::same(1, 1);
    let mut x =
        conv_norm_relu6(&mut b, maps.levels[5], &format!("{PREFIX}features.{LAST_LAYER}"), LAST_CHANNELS, pointwise);
    let mut levels: Vec<NodeId> = vec![first, x];
    b.stage("steps");
    for (step, [inside, behind]) in STEPS.into_iter().enumerate() {
        let window = Convention::Tensorflow300.window(3, STRIDES[step + 1], 2);
        x = conv_norm_relu6(&mut b, x, &format!("steps.{step}.0"), inside, pointwise);
        x = conv_norm_relu6(&mut b, x, &format!("steps.{step}.1"), behind, window);
        levels.push(x);
    }
    b.stage("heads");
    for (level, x) in levels.into_iter().enumerate() {
        let anchors = shapes(level).len();
        let boxes = b.conv_with_bias(x, &format!("heads.{level}.boxes"), 4 * anchors, 1, None);
        b.tap(BOXES[level], boxes);
        let classes = b.conv_with_bias(x, &format!("heads.{level}.classes"), labels * anchors, 1, None);
        b.tap(CLASSES[level], classes);
    }
    b.finish()
}
