//! The fast multipole method: cells attract cells by expansions, leaves that are near each other pair by pair.
//!
//! The pair of cells (A, B) counts as far if r_A + r_B < theta |c_A - c_B|, else the larger is split; both ends of a
//! pair see the same numbers, so that what A does to B, B does to A. Each cell, as a target, settles the sources that its
//! parent left open and hands on the others; nothing is shared between targets, and the result does not depend on
//! threads.
//!
//! Sources: L. Greengard and V. Rokhlin, J. Comput. Phys. 73 (1987) 325; M.S. Warren and J.K. Salmon, Comput. Phys.
//! Commun. 87 (1995) 266; W. Dehnen, J. Comput. Phys. 179 (2002) 27.

use pulp::NullaryFnOnce;

use super::expansion::{contract, derivatives, exponential, narrow, narrow_len, wide, wide_len, widen};
use super::pairs::{PackF32, PackF64, Packed, Pull, PullF32, PullF64, Source, TARGETS};
use super::tree::{Cell, GRAIN, Tree};
use crate::math::lanes::{Scalar, Singles};

/// Sources of an expansion taken at once.
const BATCH: usize = 8;

pub struct Walk<'a, L> {
    pub lanes: L,
    pub tree: &'a Tree,
    /// theta
    pub opening: f64,
    /// Pairs in single precision, but for targets that have a source nearer than this part of the leaves' radii.
    pub single: Option<f64>,
}

/// A list that grows without branching on what is asked, which no processor could foresee here.
#[derive(Default)]
struct List {
    items: Vec<u32>,
    count: usize,
}

impl List {
    fn push_if(&mut self, wanted: bool, item: u32) {
        if self.count == self.items.len() {
            self.items.resize(2 * self.count + 64, 0);
        }
        self.items[self.count] = item;
        self.count += wanted as usize;
    }

    fn extend(&mut self, items: &[u32]) {
        items.iter().for_each(|&item| self.push_if(true, item));
    }

    fn clear(&mut self) {
        self.count = 0;
    }
}

impl std::ops::Deref for List {
    type Target = [u32];
    fn deref(&self) -> &[u32] {
        &self.items[..self.count]
    }
}

/// Scratch memory of a thread's walk.
struct Work<V> {
    /// Open sources by level, each level's behind its parent's.
    open: List,
    todo: List,
    far: List,
    near: List,
    sources: Vec<Source>,
    moments: Vec<V>,
    field: Vec<V>,
    sums: Vec<V>,
    singles: Packed<f32>,
    doubles: Packed<f64>,
    targets: Vec<[f64; 3]>,
    targets_f32: Vec<[f32; 3]>,
    nearest: Vec<f32>,
    pulls: Vec<Pull>,
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
        let mut list = List::default();
        list.extend(open);
        Work {
            open: list,
            todo: List::default(),
            far: List::default(),
            near: List::default(),
            sources: Vec::new(),
            moments: vec![zero; self.tree.lines * 8],
            field: vec![zero; wide_len(p)],
            sums: vec![zero; narrow_len(p) * BATCH / L::WIDTH],
            singles: Packed::default(),
            doubles: Packed::default(),
            targets: Vec::new(),
            targets_f32: Vec::new(),
            nearest: Vec::new(),
            pulls: Vec::new(),
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
        work.open.count = below;
    }

    /// Sorts the open sources of cell `a` into far, near, and open still, for its halves.
    fn settle(&self, a: usize, from: usize, work: &mut Work<L::V>) {
        let cells = &self.tree.cells;
        let cell = &cells[a];
        let theta2 = self.opening * self.opening;
        let Work { open, todo, far, near, .. } = work;
        far.clear();
        near.clear();
        todo.clear();
        todo.extend(&open.items[from..open.count]);
        let mut k = 0;
        while k < todo.count {
            let b = todo.items[k];
            k += 1;
            let source = &cells[b as usize];
            let halves = [b + 1, b + source.second];
            if b as usize == a {
                near.push_if(cell.is_leaf(), b);
                open.push_if(!cell.is_leaf(), halves[0]);
                open.push_if(!cell.is_leaf(), halves[1]);
                continue;
            }
            let reach = cell.radius + source.radius;
            let d = [0, 1, 2].map(|k: usize| cell.centre[k] - source.centre[k]);
            let d2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            let is_far = reach * reach < theta2 * d2;
            let larger = (source.radius > cell.radius) | ((source.radius == cell.radius) & (b as usize > a));
            let split = !is_far & !source.is_leaf() & (larger | cell.is_leaf());
            far.push_if(is_far, b);
            near.push_if(!is_far & cell.is_leaf() & source.is_leaf(), b);
            todo.push_if(split, halves[0]);
            todo.push_if(split, halves[1]);
            open.push_if(!is_far & !split & !cell.is_leaf(), b);
        }
    }

    /// Adds the pull of the near leaves on the bodies of a leaf.
    fn near(&self, cell: &Cell, work: &mut Work<L::V>, out: &mut [Pull]) {
        let Work { near, sources, singles, doubles, targets, targets_f32, nearest, pulls, .. } = work;
        let (l, bodies, offsets) = (self.lanes, &self.tree.bodies, &self.tree.offsets);
        targets.clear();
        targets.extend(cell.bodies().map(|i| [bodies[0][i], bodies[1][i], bodies[2][i]]));
        sources.clear();
        let Some(close) = self.single else {
            sources.extend(near.iter().map(|&b| (self.tree.cells[b as usize].bodies(), [0.0; 3])));
            l.run(PackF64 { to: doubles, bodies, sources });
            l.run(PullF64 { l, packed: doubles, targets, out });
            return;
        };
        // A body's own leaf in double precision: there are its nearest neighbours, and itself.
        sources.push((cell.bodies(), [0.0; 3]));
        l.run(PackF64 { to: doubles, bodies, sources });
        l.run(PullF64 { l, packed: doubles, targets, out });
        sources.clear();
        let others = || near.iter().map(|&b| &self.tree.cells[b as usize]).filter(|s| s.first != cell.first);
        let between = |source: &Cell| [0, 1, 2].map(|k: usize| source.centre[k] - cell.centre[k]);
        let reach = |source: &Cell| {
            let d = between(source);
            (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt() + source.radius
        };
        let length = others().map(reach).fold(0.0, f64::max) + cell.radius;
        let scale = 1.0 / length;
        sources.extend(others().map(|source| (source.bodies(), between(source).map(|x| (x * scale) as f32))));
        if sources.is_empty() {
            return;
        }
        let scale = scale as f32;
        l.run(PackF32 { l, to: singles, offsets, sources, scale });
        targets_f32.clear();
        targets_f32.extend(cell.bodies().map(|i| [0, 1, 2].map(|k: usize| offsets[k][i] * scale)));
        nearest.resize(targets.len(), 0.0);
        pulls.clear();
        pulls.resize(targets.len(), [0.0; 4]);
        l.run(PullF32 { l, packed: singles, length, targets: targets_f32, out: pulls, nearest });
        // What the rounding of positions spoils is done again.
        let largest = others().map(|source| source.radius).fold(cell.radius, f64::max);
        let limit = ((close * (cell.radius + largest) / length).max(1e-6) as f32).powi(2);
        let mut packed = false;
        let groups = targets.chunks(TARGETS).zip(nearest.chunks(TARGETS));
        for ((targets, nearest), (out, pulls)) in groups.zip(out.chunks_mut(TARGETS).zip(pulls.chunks(TARGETS))) {
            if nearest[0] < limit {
                if !packed {
                    l.run(PackF64 { to: doubles, bodies, sources });
                    packed = true;
                }
                l.run(PullF64 { l, packed: doubles, targets, out });
            } else {
                out.as_flattened_mut().iter_mut().zip(pulls.as_flattened()).for_each(|(out, pull)| *out += pull);
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
                    for place in &mut index {
                        *place += 1;
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
