//! Centres of mass, radii and moments of a tree's cells, from the leaves to the root.

use pulp::NullaryFnOnce;

use super::cell::{CellLine, CellSummary, MAX_BODIES_PER_TASK, TreeCell};
use super::expansion::{
    NARROW_LEN, NarrowRow, WideRow, exponential_terms, for_degrees, kernel_derivatives, narrow_index, narrow_len,
    pairwise_sum, shift_moments, store_row, wide_index,
};
use crate::math::simd::{F64Arithmetic, Scalar};
use crate::math::{Vec3, vector_length};

/// Number of bodies up to which a cell gets the exact radius. Larger cells get the bound from their halves, which is
/// nearly as good and needs no loop over the bodies.
const MAX_EXACT_RADIUS_BODIES: usize = 4096;

/// Upward pass: centres, radii and moments from the leaves to the root.
#[derive(Clone, Copy)]
pub struct UpwardPass<'a, L, const P: usize> {
    /// Arithmetic of the vectors.
    pub lanes: L,
    /// Number of lines of a cell's moments.
    pub lines: usize,
    /// x, y, z, m by position in the tree, in its units.
    pub bodies: &'a [Vec<f64>; 4],
    /// Result of [`axis_derivatives`].
    pub axes: &'a [CellLine; NARROW_LEN],
}

/// Parts of a [`MassTree`](super::tree::MassTree) that belong to a subtree.
pub struct SubtreeOutput<'a> {
    /// Summary of each cell, root first.
    pub summaries: &'a mut [CellLine],
    /// Narrow moments of each cell, `lines` lines a cell.
    pub moments: &'a mut [CellLine],
    /// x, y, z, m of each body, relative to its leaf's centre.
    pub offsets: [&'a mut [f32]; 4],
}

impl<L: F64Arithmetic, const P: usize> UpwardPass<'_, L, P> {
    /// Computes the subtree of these cells.
    pub fn visit_subtree(self, cells: &[TreeCell], out: SubtreeOutput) {
        let (cell, below) = cells.split_first().expect("a subtree has a root");
        let (summary, summaries) = out.summaries.split_first_mut().expect("as many as cells");
        let (own_moments, moments) = out.moments.split_at_mut(self.lines);
        if cell.is_leaf() {
            self.lanes.run(LeafMoments { up: self, cell, summary, moments: own_moments, offsets: out.offsets });
            return;
        }
        let (first_half, second_half) = below.split_at(cell.second as usize - 1);
        let (summaries_one, summaries_two) = summaries.split_at_mut(first_half.len());
        let (moments_one, moments_two) = moments.split_at_mut(first_half.len() * self.lines);
        let [x, y, z, m] = out.offsets.map(|column| column.split_at_mut(first_half[0].count as usize));
        let first =
            SubtreeOutput { summaries: &mut *summaries_one, moments: &mut *moments_one, offsets: [x.0, y.0, z.0, m.0] };
        let second =
            SubtreeOutput { summaries: &mut *summaries_two, moments: &mut *moments_two, offsets: [x.1, y.1, z.1, m.1] };
        if cell.count as usize > MAX_BODIES_PER_TASK {
            rayon::join(|| self.visit_subtree(first_half, first), || self.visit_subtree(second_half, second));
        } else {
            self.visit_subtree(first_half, first);
            self.visit_subtree(second_half, second);
        }
        let halves = [
            (CellSummary::from_line(&summaries_one[0]), &*moments_one),
            (CellSummary::from_line(&summaries_two[0]), &*moments_two),
        ];
        self.lanes.run(ParentMoments { up: self, cell, summary, moments: own_moments, halves });
    }

    /// [`CellSummary::uneven`] from moments about the centre of mass: for each multipole, the mean square over eight
    /// axes.
    #[inline(always)]
    fn multipole_unevenness(&self, row: &NarrowRow<f64>, radius: f64, mass: f64) -> f64 {
        let (l, area) = (self.lanes, radius * radius);
        let (mut largest, mut unit) = (0.0, mass * mass * area);
        for_degrees!(Q <= P, {
            if Q != 0 && Q != 1 {
                let mut squares = [0.0; 8];
                let mut from = 0;
                while from < 8 {
                    let mut sum = l.splat(0.0);
                    let mut k = narrow_index(Q, 0);
                    while k < narrow_index(Q + 1, 0) {
                        sum = l.mul_add(l.splat(row[k]), l.load(&self.axes[k][from..]), sum);
                        k += 1;
                    }
                    l.store(&mut squares[from..], l.mul(sum, sum));
                    from += L::WIDTH;
                }
                // Legendre's polynomial of degree q has the mean square 1/(2q + 1).
                let square = pairwise_sum(&squares) * ((2 * Q + 1) as f64 / 8.0);
                unit *= area;
                if square > largest * unit {
                    largest = square / unit;
                }
            }
        });
        // If squares are near the smallest representable numbers, returns the upper bound.
        if unit > 1e-280 && largest < 1.0 { largest } else { 1.0 }
    }

    /// Distance from `centre` to the farthest of the bodies.
    #[inline(always)]
    fn cell_radius(&self, cell: &TreeCell, centre: [f64; 3]) -> f64 {
        let l = self.lanes;
        let columns = [
            &self.bodies[0][cell.body_range()],
            &self.bodies[1][cell.body_range()],
            &self.bodies[2][cell.body_range()],
        ];
        let centre = [l.splat(centre[0]), l.splat(centre[1]), l.splat(centre[2])];
        let mut largest = l.splat(0.0);
        let mut first = 0;
        while first < columns[0].len() {
            let mut d2 = l.splat(0.0);
            for k in 0..3 {
                // Missing bodies are copies of the first.
                let d = l.sub(load_part(l, columns[k], first, columns[k][0]), centre[k]);
                d2 = l.mul_add(d, d, d2);
            }
            largest = l.select_greater(d2, largest, d2, largest);
            first += L::WIDTH;
        }
        let mut lanes = [0.0; 8];
        l.store(&mut lanes, largest);
        let mut largest_of_lanes = 0.0;
        for d2 in lanes {
            largest_of_lanes = if d2 > largest_of_lanes { d2 } else { largest_of_lanes };
        }
        largest_of_lanes.sqrt()
    }
}

/// Derivatives of 1/r along eight axes, by coefficient of a narrow row.
pub fn axis_derivatives<const P: usize>() -> [CellLine; NARROW_LEN] {
    const SAMPLE_AXES: [[f64; 3]; 8] = [
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [1.0, 1.0, 1.0],
        [1.0, 1.0, -1.0],
        [1.0, -1.0, 1.0],
        [-1.0, 1.0, 1.0],
        [1.0, 2.0, -3.0],
    ];
    let mut columns = [[0.0; 8]; NARROW_LEN];
    for (lane, axis) in SAMPLE_AXES.iter().enumerate() {
        let axis = Vec3::from(*axis).normalize();
        let mut field: WideRow<f64> = [0.0; _];
        kernel_derivatives::<_, P>(Scalar, [axis.x, axis.y, axis.z], &mut field);
        for_degrees!(Q <= P, {
            for k in 0..2 * Q + 1 {
                columns[narrow_index(Q, 0) + k][lane] = field[wide_index(Q, 0) + k];
            }
        });
    }
    columns
}

/// `WIDTH` numbers of a column, padded at its end.
#[inline(always)]
pub fn load_part<L: F64Arithmetic>(l: L, column: &[f64], first: usize, filler: f64) -> L::V {
    if first + L::WIDTH <= column.len() {
        return l.load(&column[first..]);
    }
    let mut part = [filler; 8];
    part[..column.len() - first].copy_from_slice(&column[first..]);
    l.load(&part)
}

/// Mean of points weighted by mass; without any mass, the plain mean.
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

/// Writes a cell's moments and centre in its lines.
#[inline(always)]
fn write_moments(moments: &mut [CellLine], row: &NarrowRow<f64>, centre: [f64; 3]) {
    for (line, part) in moments.iter_mut().zip(row.chunks_exact(8)) {
        line.copy_from_slice(part);
    }
    moments[0][1..4].copy_from_slice(&centre);
}

/// Reads a row from its lines.
#[inline(always)]
fn read_moments(moments: &[CellLine]) -> NarrowRow<f64> {
    let mut row = [0.0; _];
    for (line, part) in moments.iter().zip(row.chunks_exact_mut(8)) {
        part.copy_from_slice(line);
    }
    row
}

/// Computes the summary, the moments and the offsets of a leaf from its bodies.
struct LeafMoments<'a, L, const P: usize> {
    up: UpwardPass<'a, L, P>,
    cell: &'a TreeCell,
    summary: &'a mut CellLine,
    moments: &'a mut [CellLine],
    offsets: [&'a mut [f32]; 4],
}

impl<L: F64Arithmetic, const P: usize> NullaryFnOnce for LeafMoments<'_, L, P> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let LeafMoments { up, cell, summary, moments, offsets } = self;
        let l = up.lanes;
        let [x, y, z, m] = up.bodies;
        let [x, y, z, m] = [&x[cell.body_range()], &y[cell.body_range()], &z[cell.body_range()], &m[cell.body_range()]];
        let (centre, mass) = centre_of_mass((0..x.len()).map(|i| ([x[i], y[i], z[i]], m[i])));
        let radius = up.cell_radius(cell, centre);
        let [to_x, to_y, to_z, to_m] = offsets;
        for i in 0..x.len() {
            to_x[i] = (x[i] - centre[0]) as f32;
            to_y[i] = (y[i] - centre[1]) as f32;
            to_z[i] = (z[i] - centre[2]) as f32;
            to_m[i] = m[i] as f32;
        }
        let mut parts = [[0.0; 8]; NARROW_LEN];
        let centre_lanes = [l.splat(centre[0]), l.splat(centre[1]), l.splat(centre[2])];
        let mut from = 0;
        while from < 8 {
            let mut sums: NarrowRow<L::V> = [l.splat(0.0); _];
            let mut first = from;
            while first < x.len() {
                let to_centre = [
                    l.sub(centre_lanes[0], load_part(l, x, first, centre[0])),
                    l.sub(centre_lanes[1], load_part(l, y, first, centre[1])),
                    l.sub(centre_lanes[2], load_part(l, z, first, centre[2])),
                ];
                let m = load_part(l, m, first, 0.0);
                let mut e: NarrowRow<L::V> = [l.splat(0.0); _];
                exponential_terms::<L, P>(l, to_centre, &mut e);
                for_degrees!(Q <= P, {
                    let mut k = narrow_index(Q, 0);
                    while k < narrow_index(Q + 1, 0) {
                        sums[k] = l.mul_add(m, e[k], sums[k]);
                        k += 1;
                    }
                });
                first += 8;
            }
            store_row::<L, P>(l, &sums, from, &mut parts);
            from += L::WIDTH;
        }
        let mut row: NarrowRow<f64> = [0.0; _];
        let mut k = 0;
        while k < narrow_len(P) {
            row[k] = pairwise_sum(&parts[k]);
            k += 1;
        }
        *summary =
            CellSummary { centre, radius, mass, uneven: up.multipole_unevenness(&row, radius, mass) }.cell_line();
        write_moments(moments, &row, centre);
    }
}

/// Computes the summary and the moments of a cell from its halves.
struct ParentMoments<'a, L, const P: usize> {
    up: UpwardPass<'a, L, P>,
    cell: &'a TreeCell,
    summary: &'a mut CellLine,
    moments: &'a mut [CellLine],
    halves: [(CellSummary, &'a [CellLine]); 2],
}

impl<L: F64Arithmetic, const P: usize> NullaryFnOnce for ParentMoments<'_, L, P> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let ParentMoments { up, cell, summary, moments, halves } = self;
        let (centre, mass) = centre_of_mass(halves.iter().map(|(half, _)| (half.centre, half.mass)));
        let mut row: NarrowRow<f64> = [0.0; _];
        let mut bound = 0.0f64;
        for (half, moments) in halves {
            let shift = [0, 1, 2].map(|k: usize| centre[k] - half.centre[k]);
            let mut e: NarrowRow<f64> = [0.0; _];
            exponential_terms::<_, P>(Scalar, shift, &mut e);
            shift_moments::<_, P>(Scalar, &read_moments(&moments[..up.lines]), &e, &mut row);
            bound = bound.max(vector_length(&Vec3::from(shift)) + half.radius);
        }
        let exact = cell.count as usize <= MAX_EXACT_RADIUS_BODIES;
        let radius = if exact { up.cell_radius(cell, centre) } else { bound };
        *summary =
            CellSummary { centre, radius, mass, uneven: up.multipole_unevenness(&row, radius, mass) }.cell_line();
        write_moments(moments, &row, centre);
    }
}
