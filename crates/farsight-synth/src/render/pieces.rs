//! The pieces of surface that a row of pixels shows, sorted by material and handed out four at a time.

use super::lanes::{Lanes, Vec3s};
use super::shade::Fragments;
use super::surface::Interpolated;
use crate::scene::Color;
use crate::vector::add_scaled;

/// The end of a chain of pieces.
pub(crate) const END: u32 = u32::MAX;

/// A piece of surface as one pixel shows it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Piece {
    /// Where and how it lies.
    pub(crate) interpolated: Interpolated,
    /// Column of the pixel.
    pub(crate) column: u32,
    /// Share of the pixel that it fills.
    pub(crate) share: f32,
    /// The next piece of the same material; [`END`] for one that is new.
    pub(crate) next: u32,
}

/// The pieces of one row in chains, one a material, the last for the sky.
pub(crate) struct Pieces {
    all: Vec<Piece>,
    ends: Vec<Chain>,
    /// The chains that are not empty, in the order of their first pieces.
    touched: Vec<usize>,
}

#[derive(Debug, Clone, Copy)]
struct Chain {
    first: u32,
    last: u32,
}

/// Four pieces of one material; fewer at the end of a chain, whose last piece then stands in with a share of 0.
pub(crate) struct Batch {
    /// What the pieces are.
    pub(crate) fragments: Fragments,
    columns: [u32; 4],
    shares: [f32; 4],
}

impl Pieces {
    pub(crate) fn new(chains: usize) -> Self {
        let empty = Chain { first: END, last: END };
        Self { all: Vec::new(), ends: vec![empty; chains], touched: Vec::new() }
    }

    #[inline]
    pub(crate) fn push(&mut self, chain: usize, piece: Piece) {
        let number = self.all.len() as u32;
        let ends = &mut self.ends[chain];
        if ends.first == END {
            ends.first = number;
            self.touched.push(chain);
        } else {
            self.all[ends.last as usize].next = number;
        }
        ends.last = number;
        self.all.push(piece);
    }

    /// How many chains have pieces.
    pub(crate) fn chains(&self) -> usize {
        self.touched.len()
    }

    /// The number of a chain that has pieces, and its first piece.
    pub(crate) fn chain(&self, index: usize) -> (usize, u32) {
        let chain = self.touched[index];
        (chain, self.ends[chain].first)
    }

    pub(crate) fn clear(&mut self) {
        for &chain in &self.touched {
            self.ends[chain].first = END;
        }
        self.touched.clear();
        self.all.clear();
    }

    /// The next four pieces of a chain; `next` moves on behind them.
    #[inline]
    pub(crate) fn batch(&self, next: &mut u32) -> Batch {
        let mut pieces = [&self.all[*next as usize]; 4];
        let mut shares = [0.0; 4];
        for lane in 0..4 {
            if *next == END {
                pieces[lane] = pieces[lane - 1];
            } else {
                pieces[lane] = &self.all[*next as usize];
                shares[lane] = pieces[lane].share;
                *next = pieces[lane].next;
            }
        }
        let [a, b, c, d] = pieces;
        let transposed =
            |of: fn(&Piece) -> [f32; 4]| Lanes::transpose([of(a).into(), of(b).into(), of(c).into(), of(d).into()]);
        let [x, y, z, u] = transposed(|piece| piece.interpolated.place);
        let [nx, ny, nz, v] = transposed(|piece| piece.interpolated.facing);
        let [u_across, u_down, v_across, v_down] = transposed(|piece| piece.interpolated.slopes);
        let fragments = Fragments {
            position: [x, y, z],
            normal: [nx, ny, nz],
            uv: [u, v],
            footprint: [u_across.abs() + u_down.abs(), v_across.abs() + v_down.abs()],
            columns: [a.column, d.column],
        };
        Batch { fragments, columns: [a.column, b.column, c.column, d.column], shares }
    }
}

impl Batch {
    #[inline]
    /// Adds what is seen of the pieces to the colours of their pixels.
    pub(crate) fn add_to(&self, colors: &mut [Color], seen: Vec3s) {
        let [red, green, blue] = [seen[0].to_array(), seen[1].to_array(), seen[2].to_array()];
        for lane in 0..4 {
            let color = &mut colors[self.columns[lane] as usize];
            *color = add_scaled(*color, [red[lane], green[lane], blue[lane]], self.shares[lane]);
        }
    }
}
