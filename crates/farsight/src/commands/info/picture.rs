//! A network as a picture: a column a stage, a row a size of maps, a box for what of a stage has maps of that size.

use std::collections::BTreeMap;
use std::fmt::Write;

use farsight_graph::blocks::{Block, INPUT_STAGE};

use crate::printer::grouped;

/// Sizes and distances, units of the picture.
const BOX: [usize; 2] = [190, 76];
const GAP: [usize; 2] = [64, 34];
const MARGIN: usize = 24;
/// How far from a box's corner an arrow starts or ends that goes around other boxes.
const CORNER: usize = 12;
/// Heights of the title and of the names of the columns, and width of the sizes at the left and of the outputs' names
/// at the right.
const TITLE_HEIGHT: usize = 64;
const LEFT: usize = 90;
const RIGHT: usize = 130;

/// Fill and edge of the boxes of a column, by turns; dark enough beside white for people who see no colours.
const COLORS: [[&str; 2]; 6] = [
    ["#f2f2f2", "#6b6b6b"],
    ["#e3eefb", "#2f6db3"],
    ["#fdeedd", "#b3661a"],
    ["#e5f4e7", "#2f7d3a"],
    ["#f3e8f7", "#7d3f98"],
    ["#fbe6e6", "#ab3434"],
];

/// The picture, SVG. `title` is a line above it.
pub(super) fn svg(title: &str, blocks: &[Block]) -> String {
    let layout = Layout::new(blocks);
    let [width, height] = layout.size;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" \
         font-family=\"Helvetica, Arial, sans-serif\" font-size=\"13\">\n\
         <defs><marker id=\"tip\" viewBox=\"0 0 10 10\" refX=\"9\" refY=\"5\" \
         markerWidth=\"7\" markerHeight=\"7\" orient=\"auto-start-reverse\">\
         <path d=\"M0 0L10 5L0 10z\" fill=\"#555\"/></marker></defs>\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
    );
    text(&mut out, [MARGIN, MARGIN + 14], "font-size=\"17\" font-weight=\"bold\"", title);
    for (size, y) in &layout.rows {
        let [width, height] = size;
        text(&mut out, [MARGIN, y + BOX[1] / 2 + 4], "fill=\"#555\"", &format!("{width} x {height}"));
    }
    // Below the boxes, so that an arrow that passes one is hidden by it.
    for (place, block) in blocks.iter().enumerate() {
        for &input in &block.inputs {
            arrow(&mut out, &layout.places, input, place);
        }
    }
    for (block, &place) in blocks.iter().zip(&layout.places) {
        draw_box(&mut out, block, place);
    }
    out.push_str("</svg>\n");
    out
}

/// Where everything is.
struct Layout {
    /// Upper left corner of each block.
    places: Vec<[usize; 2]>,
    /// Sizes of maps, largest first, with the top of their rows.
    rows: Vec<([usize; 2], usize)>,
    size: [usize; 2],
}

impl Layout {
    fn new(blocks: &[Block]) -> Self {
        let mut sizes: Vec<[usize; 2]> = blocks.iter().map(|block| block.size).collect();
        sizes.sort_by_key(|&[width, height]| std::cmp::Reverse((width * height, width)));
        sizes.dedup();
        // Blocks of one column and one size stand below each other.
        let mut taken: BTreeMap<(usize, [usize; 2]), usize> = BTreeMap::new();
        let slots: Vec<usize> = blocks
            .iter()
            .map(|block| {
                let count = taken.entry((block.depth, block.size)).or_insert(0);
                *count += 1;
                *count - 1
            })
            .collect();
        let mut top = MARGIN + TITLE_HEIGHT;
        let mut rows = Vec::new();
        for size in sizes {
            rows.push((size, top));
            let most = taken.iter().filter(|((_, of), _)| *of == size).map(|(_, count)| *count).max().unwrap_or(1);
            top += most * (BOX[1] + GAP[1]);
        }
        let place = |(block, slot): (&Block, &usize)| {
            let row = rows.iter().find(|(size, _)| *size == block.size).map_or(0, |(_, top)| *top);
            [MARGIN + LEFT + block.depth * (BOX[0] + GAP[0]), row + slot * (BOX[1] + GAP[1])]
        };
        let places: Vec<[usize; 2]> = blocks.iter().zip(&slots).map(place).collect();
        let right = places.iter().map(|[x, _]| x + BOX[0]).max().unwrap_or(0);
        Self { places, rows, size: [right + RIGHT + MARGIN, top + MARGIN - GAP[1]] }
    }
}

fn draw_box(out: &mut String, block: &Block, [x, y]: [usize; 2]) {
    let [fill, edge] = COLORS[block.depth % COLORS.len()];
    let [width, height] = BOX;
    // Writing to a string cannot fail.
    let _ = writeln!(
        out,
        "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" rx=\"6\" \
         fill=\"{fill}\" stroke=\"{edge}\" stroke-width=\"1.5\"/>"
    );
    let middle = x + width / 2;
    let centred = "text-anchor=\"middle\"";
    text(out, [middle, y + 21], &format!("{centred} font-weight=\"bold\""), block.stage);
    let plural = if block.channels == 1 { "" } else { "s" };
    text(out, [middle, y + 39], centred, &format!("{} channel{plural}", block.channels));
    if block.stage != INPUT_STAGE {
        let costs = format!("{} parameters", grouped(block.parameters));
        text(out, [middle, y + 54], &format!("{centred} font-size=\"11\" fill=\"#333\""), &costs);
        let macs = format!("{:.3} GMAC", block.macs as f64 / 1e9);
        text(out, [middle, y + 68], &format!("{centred} font-size=\"11\" fill=\"#333\""), &macs);
    }
    for (i, name) in block.outputs.iter().enumerate() {
        let line = y + height / 2 + 4 + i * 16;
        text(out, [x + width + 12, line], "font-style=\"italic\" fill=\"#333\"", &format!("\u{2192} {name}"));
    }
}

/// From one block to another: down or up within a column, around what lies between, and from the right edge to the left
/// one otherwise.
fn arrow(out: &mut String, places: &[[usize; 2]], from: usize, to: usize) {
    let [width, height] = BOX;
    let ([x0, y0], [x1, y1]) = (places[from], places[to]);
    let (middle0, middle1, bend) = (y0 + height / 2, y1 + height / 2, GAP[0] / 2);
    let lies_between = |&[x, y]: &[usize; 2]| x == x0 && y > y0.min(y1) && y < y0.max(y1);
    let path = if x0 != x1 {
        let (start, end) = (x0 + width, x1.saturating_sub(2));
        format!("M{start} {middle0}C{} {middle0} {} {middle1} {end} {middle1}", start + bend, end.saturating_sub(bend))
    } else if places.iter().any(lies_between) {
        // At the corners, away from the arrows to other columns.
        let (low, high) = (CORNER, height - CORNER);
        let [start, end] = if y1 > y0 { [y0 + high, y1 + low] } else { [y0 + low, y1 + high] };
        let (edge, out) = (x0 + width, x0 + width + bend);
        format!("M{edge} {start}C{out} {start} {out} {end} {} {end}", edge + 2)
    } else if y1 > y0 {
        format!("M{0} {1}L{0} {2}", x0 + width / 2, y0 + height, y1.saturating_sub(2))
    } else {
        format!("M{0} {y0}L{0} {1}", x0 + width / 2, y1 + height + 2)
    };
    let _ = writeln!(
        out,
        "<path d=\"{path}\" fill=\"none\" stroke=\"#555\" stroke-width=\"1.3\" marker-end=\"url(#tip)\"/>"
    );
}

fn text(out: &mut String, [x, y]: [usize; 2], style: &str, words: &str) {
    let words = words.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    let _ = writeln!(out, "<text x=\"{x}\" y=\"{y}\" {style}>{words}</text>");
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use farsight_graph::blocks::{Block, blocks};
    use farsight_graph::count::{count, total};
    use farsight_graph::graph::{Parameter, Role};
    use farsight_graph::model::NetworkConfig;
    use farsight_methods::smoke::config::SmokeConfig;

    use super::{Layout, svg};

    #[test]
    fn every_parameter_and_operation_is_in_a_block_and_every_stage_has_one() {
        let config = SmokeConfig::default();
        let graph = config.graph();
        let blocks = blocks(&graph, 1280, 384).unwrap();
        let stages = count(&graph, 1280, 384).unwrap();
        let drawn: BTreeSet<&str> = blocks.iter().map(|block| block.stage).collect();
        for stage in &stages {
            let of_stage: Vec<&Block> = blocks.iter().filter(|block| block.stage == stage.stage).collect();
            assert!(drawn.contains(stage.stage), "{}", stage.stage);
            assert_eq!(of_stage.iter().map(|block| block.macs).sum::<u64>(), stage.macs, "{}", stage.stage);
        }
        let parameters: usize = blocks.iter().map(|block| block.parameters).sum();
        // The unused outer projections belong to no node.
        let unused: usize = graph.parameters.iter().filter(|p| p.role == Role::Unused).map(Parameter::len).sum();
        assert_eq!(parameters + unused, total(&stages).parameters);
        let outputs: Vec<&String> = blocks.iter().flat_map(|block| &block.outputs).collect();
        assert_eq!(outputs.len(), 2, "{outputs:?}");
    }

    #[test]
    fn no_two_boxes_overlap_and_all_lie_in_the_picture() {
        let config = SmokeConfig::default();
        let blocks = blocks(&config.graph(), 1280, 384).unwrap();
        let Layout { places, size, .. } = Layout::new(&blocks);
        for (i, a) in places.iter().enumerate() {
            assert!(a[0] + super::BOX[0] <= size[0] && a[1] + super::BOX[1] <= size[1], "{a:?} {size:?}");
            for b in &places[..i] {
                let apart = (0..2).any(|axis| a[axis].abs_diff(b[axis]) >= super::BOX[axis]);
                assert!(apart, "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn what_svg_would_misread_is_escaped() {
        let picture = svg("a < b & c", &[]);
        assert!(picture.contains("a &lt; b &amp; c") && picture.ends_with("</svg>\n"), "{picture}");
    }
}
