//! Binary tree of cells over point masses, along a Morton curve, with moments about centres of mass.

use pulp::NullaryFnOnce;

use super::expansion::{exponential, narrow_len, shift_moments};
use crate::math::Vec3;
use crate::math::lanes::{Lanes, Line, Scalar};

/// Bits of a Morton key along each axis. A range that they cannot divide gets keys of its own box, so that depth is
/// bounded by the digits of f64.
const BITS: u32 = 21;

/// Cells of at most this many bodies get the exact radius; larger ones the bound that their halves give, which is
/// nearly as good and needs no walk over the bodies.
const EXACT_RADIUS: usize = 4096;

/// Below this many bodies a subtree is one task: large against the cost of a task, small against a thread's share.
pub const GRAIN: usize = 2048;

#[derive(Debug, Clone, Copy)]
pub struct Cell {
    /// Centre of mass, and the distance of the farthest body from it, in the tree's units.
    pub centre: [f64; 3],
    pub radius: f64,
    /// The cell's bodies, in the tree's order.
    pub first: u32,
    pub count: u32,
    /// How many cells further the second half is; 0 for a leaf. The first half is the next cell.
    pub second: u32,
}

impl Cell {
    pub fn bodies(&self) -> std::ops::Range<usize> {
        self.first as usize..(self.first + self.count) as usize
    }

    pub fn is_leaf(&self) -> bool {
        self.second == 0
    }
}

/// Cells in the order in which a walk from the root, first half before second, meets them. Lengths are over `length`
/// and from `origin`, masses over `mass`: numbers of order 1, whatever the units.
pub struct Tree {
    pub cells: Vec<Cell>,
    /// For each cell, `lines` rows: its narrow moments, with its centre in the place of the dipole; one cell more, of no
    /// mass and far away, fills up batches.
    pub moments: Vec<Line>,
    pub lines: usize,
    pub order: usize,
    /// Number of the body in the input, by place in the tree.
    pub index: Vec<u32>,
    /// x, y, z, m by place in the tree.
    pub bodies: [Vec<f64>; 4],
    /// The same in single precision, from the leaf's centre, with 16 more.
    pub offsets: [Vec<f32>; 4],
    /// m
    pub length: f64,
    /// kg
    pub mass: f64,
}

#[derive(Clone, Copy)]
struct Key {
    key: u64,
    index: u32,
}

/// The power of two at or above a positive number; 1 for others.
fn power_of_two(x: f64) -> f64 {
    if x.is_normal() { 2f64.powi(x.log2().ceil().clamp(-1000.0, 1000.0) as i32) } else { 1.0 }
}

/// Spreads the low 21 bits of `x` to every third.
fn spread(x: u64) -> u64 {
    let x = (x | x << 32) & 0x001f_0000_0000_ffff;
    let x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

/// Gives `keys` the Morton keys of their bodies in the cube around them, and sorts them; false if all coincide.
fn sort(keys: &mut [Key], positions: &[Vec3]) -> bool {
    let (mut low, mut high) = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
    for key in &*keys {
        low = low.inf(&positions[key.index as usize]);
        high = high.sup(&positions[key.index as usize]);
    }
    let scale = (1u64 << BITS) as f64 / (high - low).max();
    if !scale.is_finite() {
        return false;
    }
    let most = (1u64 << BITS) - 1;
    for key in &mut *keys {
        let at = (positions[key.index as usize] - low) * scale;
        let [x, y, z] = [at.x, at.y, at.z].map(|x| spread((x as u64).min(most)));
        key.key = x << 2 | y << 1 | z;
    }
    radix_sort(keys);
    true
}

/// Sorts by key: by counting over the first bits, then by comparison among the few whose first bits agree.
fn radix_sort(keys: &mut [Key]) {
    const DIGIT: u32 = 11;
    const LOWEST: u32 = 3 * BITS - 3 * DIGIT;
    if keys.len() < 1 << 10 {
        return keys.sort_unstable_by_key(|k| (k.key, k.index));
    }
    let mut from = keys.to_vec();
    let mut to = from.clone();
    for pass in 0..3 {
        let digit = |k: &Key| (k.key >> (LOWEST + pass * DIGIT)) as usize & ((1 << DIGIT) - 1);
        let mut starts = [0u32; 1 << DIGIT];
        from.iter().for_each(|k| starts[digit(k)] += 1);
        let mut sum = 0;
        for start in &mut starts {
            (sum, *start) = (sum + *start, sum);
        }
        for k in &from {
            let start = &mut starts[digit(k)];
            to[*start as usize] = *k;
            *start += 1;
        }
        std::mem::swap(&mut from, &mut to);
    }
    keys.copy_from_slice(&from);
    for run in keys.chunk_by_mut(|a, b| a.key >> LOWEST == b.key >> LOWEST) {
        if run.len() > 1 {
            run.sort_unstable_by_key(|k| (k.key, k.index));
        }
    }
}

/// Divides `keys` by the first bit in which they differ, down to leaves.
fn divide(cells: &mut Vec<Cell>, keys: &mut [Key], positions: &[Vec3], first: usize, leaf: usize) {
    let me = cells.len();
    let (first32, count) = (first as u32, keys.len() as u32);
    cells.push(Cell { centre: [0.0; 3], radius: 0.0, first: first32, count, second: 0 });
    let ends = |keys: &[Key]| (keys[0].key, keys[keys.len() - 1].key);
    if keys.len() <= leaf || (keys[0].key == ends(keys).1 && !sort(keys, positions)) {
        return;
    }
    let (low, high) = ends(keys);
    let bit = (low ^ high).ilog2();
    let middle = keys.partition_point(|k| k.key >> bit == low >> bit);
    let (one, two) = keys.split_at_mut(middle);
    divide(cells, one, positions, first, leaf);
    cells[me].second = (cells.len() - me) as u32;
    divide(cells, two, positions, first + middle, leaf);
}

impl Tree {
    /// The tree over at least one body, of leaves of at most `leaf` bodies (more where they coincide), with moments to
    /// order p.
    pub fn new<L: Lanes>(lanes: L, positions: &[Vec3], masses: &[f64], p: usize, leaf: usize) -> Self {
        let mut keys: Vec<Key> = (0..positions.len() as u32).map(|index| Key { key: 0, index }).collect();
        let mut cells = Vec::new();
        divide(&mut cells, &mut keys, positions, 0, leaf);

        let (mut low, mut high) = (positions[0], positions[0]);
        for x in positions {
            low = low.inf(x);
            high = high.sup(x);
        }
        // Zero if that is within: then lengths are exact, and bodies that crowd about it stay apart.
        let origin = low.sup(&Vec3::zeros().inf(&high));
        let (length, mass) = (power_of_two((high - low).max()), power_of_two(masses.iter().sum()));
        let (per_length, per_mass) = (1.0 / length, 1.0 / mass);
        let column = |f: &dyn Fn(usize) -> f64| -> Vec<f64> { keys.iter().map(|key| f(key.index as usize)).collect() };
        let bodies = [
            column(&|i| (positions[i].x - origin.x) * per_length),
            column(&|i| (positions[i].y - origin.y) * per_length),
            column(&|i| (positions[i].z - origin.z) * per_length),
            column(&|i| masses[i] * per_mass),
        ];
        let index = keys.iter().map(|key| key.index).collect();
        let lines = narrow_len(p).div_ceil(8);
        let mut moments = vec![[0.0; 8]; (cells.len() + 1) * lines];
        let filler = cells.len() * lines;
        moments[filler][1..4].fill(64.0);
        let up = Upward { lanes, p, lines, bodies: &bodies };
        up.visit(&mut cells, &mut moments[..filler]);
        let mut offsets = [0, 1, 2, 3].map(|_: usize| vec![0.0; positions.len() + 16]);
        for cell in cells.iter().filter(|cell| cell.is_leaf()) {
            for (k, column) in offsets.iter_mut().enumerate() {
                let from = if k < 3 { cell.centre[k] } else { 0.0 };
                for (to, x) in column[cell.bodies()].iter_mut().zip(&bodies[k][cell.bodies()]) {
                    *to = (x - from) as f32;
                }
            }
        }
        Tree { cells, moments, lines, order: p, index, bodies, offsets, length, mass }
    }
}

/// Centres, radii and moments from the leaves to the root.
#[derive(Clone, Copy)]
struct Upward<'a, L> {
    lanes: L,
    p: usize,
    lines: usize,
    bodies: &'a [Vec<f64>; 4],
}

impl<L: Lanes> Upward<'_, L> {
    /// The subtree whose cells and moments these are.
    fn visit(self, cells: &mut [Cell], moments: &mut [Line]) {
        let (me, below) = cells.split_first_mut().expect("a subtree has a root");
        let (mine, moments) = moments.split_at_mut(self.lines);
        if me.is_leaf() {
            self.lanes.run(Leaf { up: self, cell: me, moments: mine });
            return;
        }
        let (one, two) = below.split_at_mut(me.second as usize - 1);
        let (m_one, m_two) = moments.split_at_mut(one.len() * self.lines);
        if me.count as usize > GRAIN {
            rayon::join(|| self.visit(one, m_one), || self.visit(two, m_two));
        } else {
            self.visit(one, m_one);
            self.visit(two, m_two);
        }
        let halves = [(&one[0], &*m_one), (&two[0], &*m_two)];
        self.lanes.run(Parent { up: self, cell: me, moments: mine, halves });
    }

    /// Distance of the farthest of the bodies from `centre`.
    #[inline(always)]
    fn radius(&self, cell: &Cell, centre: [f64; 3]) -> f64 {
        let [x, y, z, _] = self.bodies;
        let [x, y, z] = [&x[cell.bodies()], &y[cell.bodies()], &z[cell.bodies()]];
        let mut largest = [0.0; 8];
        let mut k = 0;
        while k < x.len() {
            for lane in 0..8.min(x.len() - k) {
                let (dx, dy, dz) = (x[k + lane] - centre[0], y[k + lane] - centre[1], z[k + lane] - centre[2]);
                let d2 = dx.mul_add(dx, dy.mul_add(dy, dz * dz));
                largest[lane] = if d2 > largest[lane] { d2 } else { largest[lane] };
            }
            k += 8;
        }
        largest.iter().fold(0.0, |a: f64, b| a.max(*b)).sqrt()
    }
}

/// Mean of points by mass; without any mass, the mean.
#[inline(always)]
fn centre_of_mass(points: impl Iterator<Item = ([f64; 3], f64)>) -> ([f64; 3], f64) {
    let (mut moment, mut sum, mut mass, mut count) = ([0.0; 3], [0.0; 3], 0.0, 0.0);
    for (x, m) in points {
        for k in 0..3 {
            moment[k] += m * x[k];
            sum[k] += x[k];
        }
        mass += m;
        count += 1.0;
    }
    if mass > 0.0 { (moment.map(|x| x / mass), mass) } else { (sum.map(|x| x / count), 0.0) }
}

/// Room for a row of the highest order.
const ROW: usize = narrow_len(super::HIGHEST_ORDER).next_multiple_of(8);

/// Writes a cell's moments and centre in its lines.
#[inline(always)]
fn write_moments(moments: &mut [Line], row: &[f64; ROW], centre: [f64; 3]) {
    for (line, part) in moments.iter_mut().zip(row.chunks_exact(8)) {
        line.copy_from_slice(part);
    }
    moments[0][1..4].copy_from_slice(&centre);
}

struct Leaf<'a, L> {
    up: Upward<'a, L>,
    cell: &'a mut Cell,
    moments: &'a mut [Line],
}

impl<L: Lanes> NullaryFnOnce for Leaf<'_, L> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let Leaf { up, cell, moments } = self;
        let (l, n) = (up.lanes, narrow_len(up.p));
        let [x, y, z, m] = up.bodies;
        let (centre, _) = centre_of_mass(cell.bodies().map(|i| ([x[i], y[i], z[i]], m[i])));
        cell.centre = centre;
        cell.radius = up.radius(cell, centre);
        let mut row = [0.0; ROW];
        let mut e = [l.splat(0.0); ROW];
        for first in cell.bodies().step_by(8) {
            let mut part = [[0.0; 8]; 4];
            for lane in 0..8.min(cell.bodies().end - first) {
                let i = first + lane;
                for (part, x) in part.iter_mut().zip([centre[0] - x[i], centre[1] - y[i], centre[2] - z[i], m[i]]) {
                    part[lane] = x;
                }
            }
            for from in (0..8).step_by(L::WIDTH) {
                let [x, y, z, m] = [0, 1, 2, 3].map(|k: usize| l.load(&part[k][from..]));
                exponential(l, up.p, [x, y, z], &mut e);
                for k in 0..n {
                    let mut lanes = [0.0; 8];
                    l.store(&mut lanes, l.mul(m, e[k]));
                    // One after the other, as at any width.
                    for value in &lanes[..L::WIDTH] {
                        row[k] += value;
                    }
                }
            }
        }
        write_moments(moments, &row, centre);
    }
}

struct Parent<'a, L> {
    up: Upward<'a, L>,
    cell: &'a mut Cell,
    moments: &'a mut [Line],
    halves: [(&'a Cell, &'a [Line]); 2],
}

impl<L: Lanes> NullaryFnOnce for Parent<'_, L> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let Parent { up, cell, moments, halves } = self;
        let n = narrow_len(up.p);
        let (centre, _) = centre_of_mass(halves.iter().map(|(half, moments)| (half.centre, moments[0][0])));
        let (mut row, mut e) = ([0.0; ROW], [0.0; ROW]);
        let mut bound = 0.0f64;
        for (half, moments) in halves {
            let shift = [0, 1, 2].map(|k: usize| centre[k] - half.centre[k]);
            exponential(Scalar, up.p, shift, &mut e[..n]);
            shift_moments(Scalar, up.p, moments[..up.lines].as_flattened(), &e[..n], &mut row[..n]);
            bound = bound.max(Vec3::from(shift).norm() + half.radius);
        }
        cell.centre = centre;
        let exact = cell.count as usize <= EXACT_RADIUS;
        cell.radius = if exact { up.radius(cell, centre) } else { bound };
        write_moments(moments, &row, centre);
    }
}
