//! The fast multipole method: cells attract cells by expansions, leaves that are near each other pair by pair.
//!
//! The pair of cells (A, B) counts as far if r_A + r_B < theta |c_A - c_B|, else the larger is split; both ends of a
//! pair see the same numbers, so that what A does to B, B does to A. Each cell, as a target, settles the sources that its
//! parent left open and hands on the others; nothing is shared between targets, and the result does not depend on
//! threads.
//!
//! Sources: L. Greengard and V. Rokhlin, J. Comput. Phys. 73 (1987) 325; M.S. Warren and J.K. Salmon, Comput. Phys.
//! Commun. 87 (1995) 266; W. Dehnen, J. Comput. Phys. 179 (2002) 27.

use std::ops::Range;

use pulp::NullaryFnOnce;

use super::expansion::{contract, derivatives, exponential, narrow, narrow_len, wide, wide_len, widen};
use super::pairs::{Pack, Packed, Pull, PullF32, PullF64};
use super::tree::{Cell, GRAIN, Tree};
use crate::math::lanes::{Scalar, Singles};

/// Sources of an expansion taken at once.
const BATCH: usize = 8;

pub struct Walk<'a, L> {
    pub lanes: L,
    pub tree: &'a Tree,
    /// theta
    pub opening: f64,
    /// Pairs in single precision, but for targets that have a source nearer than this part of the leaf's radius.
    pub single: Option<f64>,
}

/// Scratch memory of a thread's walk.
struct Work<V> {
    /// Open sources by level, each level's behind its parent's.
    open: Vec<u32>,
    todo: Vec<u32>,
    far: Vec<u32>,
    near: Vec<u32>,
    ranges: Vec<Range<usize>>,
    moments: Vec<V>,
    field: Vec<V>,
    sums: Vec<V>,
    packed: Packed,
    targets: Vec<[f32; 3]>,
    nearest: Vec<f32>,
}

impl<L: Singles> Walk<'_, L> {
    /// Pull on every body, in the tree's order and units.
    pub fn pulls(&self) -> Vec<Pull> {
        let mut out = vec![[0.0; 4]; self.tree.index.len()];
        let local = vec![0.0; narrow_len(self.tree.order)];
        self.visit(0, &local, &mut self.work(&[0]), 0, &mut out);
        out
    }

    fn work(&self, open: &[u32]) -> Work<L::V> {
        let p = self.tree.order;
        let zero = self.lanes.splat(0.0);
        Work {
            open: open.to_vec(),
            todo: Vec::new(),
            far: Vec::new(),
            near: Vec::new(),
            ranges: Vec::new(),
            moments: vec![zero; self.tree.lines * 8],
            field: vec![zero; wide_len(p)],
            sums: vec![zero; narrow_len(p) * BATCH / L::WIDTH],
            packed: Packed::default(),
            targets: Vec::new(),
            nearest: Vec::new(),
        }
    }

    /// Evaluates the subtree of cell `a` with the local expansion of its parent about its own centre; its open sources
    /// are `work.open[from..]`.
    fn visit(&self, a: usize, local: &[f64], work: &mut Work<L::V>, from: usize, out: &mut [Pull]) {
        let cell = &self.tree.cells[a];
        let below = work.open.len();
        self.settle(a, from, work);
        let mut local = local.to_vec();
        if !work.far.is_empty() {
            self.lanes.run(Far { walk: self, cell, work, local: &mut local });
        }
        if cell.is_leaf() {
            self.lanes.run(Expand { walk: self, cell, local: &local, out });
            self.near(cell, work, out);
            return;
        }
        let halves = [a + 1, a + cell.second as usize];
        let [one, two] = halves.map(|half| {
            let mut shifted = vec![0.0; local.len()];
            let cells = [cell, &self.tree.cells[half]];
            self.lanes.run(Shift { p: self.tree.order, cells, local: &local, out: &mut shifted });
            shifted
        });
        let (out_one, out_two) = out.split_at_mut(self.tree.cells[halves[0]].count as usize);
        if cell.count as usize > GRAIN {
            let mut other = self.work(&work.open[below..]);
            rayon::join(
                || self.visit(halves[0], &one, work, below, out_one),
                || self.visit(halves[1], &two, &mut other, 0, out_two),
            );
        } else {
            self.visit(halves[0], &one, work, below, out_one);
            self.visit(halves[1], &two, work, below, out_two);
        }
        work.open.truncate(below);
    }

    /// Sorts the open sources of cell `a` into far, near, and open still, for its halves.
    fn settle(&self, a: usize, from: usize, work: &mut Work<L::V>) {
        let cells = &self.tree.cells;
        let cell = &cells[a];
        let theta2 = self.opening * self.opening;
        work.far.clear();
        work.near.clear();
        for k in from..work.open.len() {
            work.todo.push(work.open[k]);
            while let Some(b) = work.todo.pop() {
                let source = &cells[b as usize];
                let halves = || [b + 1, b + source.second];
                if b as usize == a {
                    if cell.is_leaf() {
                        work.near.push(b);
                    } else {
                        work.open.extend(halves());
                    }
                    continue;
                }
                let reach = cell.radius + source.radius;
                let d = [0, 1, 2].map(|k: usize| cell.centre[k] - source.centre[k]);
                let d2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
                let larger = (source.radius, b as usize) > (cell.radius, a);
                if reach * reach < theta2 * d2 {
                    work.far.push(b);
                } else if cell.is_leaf() && source.is_leaf() {
                    work.near.push(b);
                } else if cell.is_leaf() || (larger && !source.is_leaf()) {
                    work.todo.extend(halves());
                } else {
                    work.open.push(b);
                }
            }
        }
    }

    /// Adds the pull of the near leaves on the bodies of a leaf.
    fn near(&self, cell: &Cell, work: &mut Work<L::V>, out: &mut [Pull]) {
        let Work { near, ranges, packed, targets, nearest, .. } = work;
        let (l, bodies) = (self.lanes, &self.tree.bodies);
        let at = |i: usize| [bodies[0][i], bodies[1][i], bodies[2][i]];
        let (own, places) = (cell.bodies(), cell.bodies());
        ranges.clear();
        let Some(close) = self.single else {
            ranges.extend(near.iter().map(|&b| self.tree.cells[b as usize].bodies()));
            for (i, out) in places.zip(out) {
                l.run(PullF64 { l, bodies, ranges, p: at(i), out });
            }
            return;
        };
        // A body's own leaf in double precision: there are its nearest neighbours, and itself.
        for (i, out) in places.clone().zip(&mut *out) {
            l.run(PullF64 { l, bodies, ranges: std::slice::from_ref(&own), p: at(i), out });
        }
        let mut length = 0.0f64;
        for &b in near.iter() {
            let source = &self.tree.cells[b as usize];
            if source.first == cell.first {
                continue;
            }
            let d = [0, 1, 2].map(|k: usize| cell.centre[k] - source.centre[k]);
            length = length.max((d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt() + source.radius);
            ranges.push(source.bodies());
        }
        if ranges.is_empty() {
            return;
        }
        let length = length + cell.radius;
        l.run(Pack { to: packed, bodies, ranges, centre: cell.centre, length });
        targets.clear();
        let packed_at = |i: usize| {
            let x = at(i);
            [0, 1, 2].map(|k: usize| ((x[k] - cell.centre[k]) * (1.0 / length)) as f32)
        };
        targets.extend(places.clone().map(packed_at));
        nearest.resize(targets.len(), 0.0);
        let mut pulls = [[0.0; 4]; 64];
        let mut heap = Vec::new();
        let pulls = match targets.len() {
            0..=64 => &mut pulls[..targets.len()],
            n => {
                heap.resize(n, [0.0; 4]);
                &mut heap[..]
            }
        };
        l.run(PullF32 { l, packed, targets, out: pulls, nearest });
        // What the rounding of positions about the centre spoils is done again.
        let limit = (close * cell.radius / length).max(1e-6);
        for (k, i) in places.enumerate() {
            if (nearest[k] as f64) < limit * limit {
                l.run(PullF64 { l, bodies, ranges, p: at(i), out: &mut out[k] });
            } else {
                for c in 0..4 {
                    out[k][c] += pulls[k][c];
                }
            }
        }
    }
}

/// Adds the field of the far cells to a cell's local expansion.
struct Far<'a, L: Singles> {
    walk: &'a Walk<'a, L>,
    cell: &'a Cell,
    work: &'a mut Work<L::V>,
    local: &'a mut [f64],
}

impl<L: Singles> NullaryFnOnce for Far<'_, L> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let Far { walk, cell, work, local } = self;
        let (l, tree) = (walk.lanes, walk.tree);
        let (p, n, lines) = (tree.order, narrow_len(tree.order), tree.lines as u32);
        let [x, y, z] = [l.splat(cell.centre[0]), l.splat(cell.centre[1]), l.splat(cell.centre[2])];
        let Work { far, moments, field, sums, .. } = work;
        sums.fill(l.splat(0.0));
        let filler = tree.cells.len() as u32 * lines;
        let mut first = 0;
        while first < far.len() {
            let mut index = [filler; BATCH];
            for k in 0..BATCH.min(far.len() - first) {
                index[k] = far[first + k] * lines;
            }
            let mut slab = 0;
            while slab < BATCH / L::WIDTH {
                let mut index = {
                    let mut part = [0; BATCH];
                    part[..L::WIDTH].copy_from_slice(&index[slab * L::WIDTH..][..L::WIDTH]);
                    part
                };
                for line in 0..tree.lines {
                    let columns = l.gather(&tree.moments, &index);
                    moments[line * 8..][..8].copy_from_slice(&columns);
                    for k in 0..L::WIDTH {
                        index[k] += 1;
                    }
                }
                let d = [l.sub(x, moments[1]), l.sub(y, moments[2]), l.sub(z, moments[3])];
                derivatives(l, p, d, field);
                contract(l, p, false, moments, field, &mut sums[slab * n..][..n]);
                slab += 1;
            }
            first += BATCH;
        }
        for k in 0..n {
            let mut lanes = [0.0; BATCH];
            let mut slab = 0;
            while slab < BATCH / L::WIDTH {
                l.store(&mut lanes[slab * L::WIDTH..], sums[slab * n + k]);
                slab += 1;
            }
            let [a, b, c, d, e, f, g, h] = lanes;
            local[k] += ((a + b) + (c + d)) + ((e + f) + (g + h));
        }
    }
}

/// The local expansion of a cell about the centre of one of its halves.
struct Shift<'a> {
    p: usize,
    cells: [&'a Cell; 2],
    local: &'a [f64],
    out: &'a mut [f64],
}

/// Room for rows of the highest order.
const NARROW: usize = narrow_len(super::HIGHEST_ORDER);
const WIDE: usize = wide_len(super::HIGHEST_ORDER);

impl NullaryFnOnce for Shift<'_> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let Shift { p, cells: [from, to], local, out } = self;
        let (mut e, mut field) = ([0.0; NARROW], [0.0; WIDE]);
        exponential(Scalar, p, [0, 1, 2].map(|k: usize| to.centre[k] - from.centre[k]), &mut e);
        widen(Scalar, p, local, &mut field);
        contract(Scalar, p, true, &e, &field, out);
    }
}

/// Adds a leaf's local expansion to the pull on its bodies.
struct Expand<'a, L> {
    walk: &'a Walk<'a, L>,
    cell: &'a Cell,
    local: &'a [f64],
    out: &'a mut [Pull],
}

impl<L: Singles> NullaryFnOnce for Expand<'_, L> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let Expand { walk, cell, local, out } = self;
        let (l, p) = (walk.lanes, walk.tree.order);
        let mut field = [0.0; WIDE];
        widen(Scalar, p, local, &mut field);
        let mut e = [l.splat(0.0); NARROW];
        let bodies = [0, 1, 2].map(|k: usize| &walk.tree.bodies[k][cell.bodies()]);
        let mut first = 0;
        while first < out.len() {
            let here = (out.len() - first).min(BATCH);
            let mut at = [[0.0; BATCH]; 3];
            for k in 0..3 {
                for lane in 0..here {
                    at[k][lane] = bodies[k][first + lane] - cell.centre[k];
                }
            }
            let mut result = [[0.0; BATCH]; 4];
            let mut from = 0;
            while from < BATCH {
                let b = [l.load(&at[0][from..]), l.load(&at[1][from..]), l.load(&at[2][from..])];
                exponential(l, p, b, &mut e);
                let mut sums = [l.splat(0.0); 4];
                for q in 0..=p {
                    for c in 0..=q.min(1) {
                        let to_e = narrow(q, c);
                        for j in 0..=q - c {
                            let value = e[to_e + j];
                            sums[3] = l.mul_add(value, l.splat(field[wide(q, c) + j]), sums[3]);
                            if q < p {
                                sums[0] = l.mul_add(value, l.splat(field[wide(q + 1, c) + j]), sums[0]);
                                sums[1] = l.mul_add(value, l.splat(field[wide(q + 1, c) + j + 1]), sums[1]);
                                sums[2] = l.mul_add(value, l.splat(field[wide(q + 1, c + 1) + j]), sums[2]);
                            }
                        }
                    }
                }
                for k in 0..4 {
                    l.store(&mut result[k][from..], sums[k]);
                }
                from += L::WIDTH;
            }
            for lane in 0..here {
                for k in 0..4 {
                    out[first + lane][k] += result[k][lane];
                }
            }
            first += BATCH;
        }
    }
}
