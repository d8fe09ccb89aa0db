//! Fast multipole method: cells attract cells by expansions; leaves that are near each other attract pair by pair.
//!
//! Cell B is far from cell A if r = (r_A + r_B)/d < theta, with d the distance of their centres, and the error of its
//! expansion, about M_B/d^2 sqrt((r_A/d)^2p + w_B^2 r^2p)/(1 - r^2)^2, is a small fraction of the pull at A. w_B is the
//! ratio of B's multipoles to those of all its mass at its radius. Otherwise the larger cell is split. Each cell, as a
//! target, classifies the sources that its parent left open and passes the open ones to its halves. Targets share
//! nothing, so that the result does not depend on threads.
//!
//! Sources: L. Greengard and V. Rokhlin, J. Comput. Phys. 73 (1987) 325; M.S. Warren and J.K. Salmon, Comput. Phys.
//! Commun. 87 (1995) 266; W. Dehnen, J. Comput. Phys. 179 (2002) 27 and Comput. Astrophys. Cosmol. 1 (2014) 1.

use std::ops::Range;

use pulp::NullaryFnOnce;

use super::cell::{CellSummary, MAX_BODIES_PER_TASK, TreeCell};
use super::expansion::{
    NARROW_LEN, NarrowRow, WideRow, contract_moments, evaluate_expansion, exponential_terms, for_lines,
    kernel_derivatives, narrow_len, pairwise_sum, store_row, widen_row,
};
use super::pairs::{
    BodyPull, CoarseKernel, FineKernel, MediumKernel, PackF32, PackF64, PackedBodies, PullF32, PullF64, SourceLeaf,
    TARGETS_AT_ONCE, WithKernel,
};
use super::settings::{ExpansionSettings, PairPrecision};
use super::tree::MassTree;
use super::upward::load_part;
use crate::math::simd::{F64Arithmetic, Scalar};
use crate::ranks;

/// Smallest number of bodies that are divided among ranks: a walk takes some microseconds a body, an exchange some 0.02 ms.
const MIN_DIVIDED_BODIES: usize = 256;

/// Number of expansion sources, or of cells to classify, per batch.
const BATCH_CELLS: usize = 8;

/// Walk over the tree that computes the pull on each body by expansions of order P and pairs.
pub struct TreeWalk<'a, L, const P: usize> {
    /// Arithmetic of the vectors.
    pub lanes: L,
    pub tree: &'a MassTree,
    pub settings: ExpansionSettings,
    /// Whether the potential is computed, too.
    pub potential: bool,
}

/// List that grows without branches on the classification, which no processor could predict here.
#[derive(Default)]
struct IndexList {
    items: Vec<u32>,
    count: usize,
}

impl IndexList {
    /// Reserves space for `more` items.
    #[inline(always)]
    fn reserve(&mut self, more: usize) {
        if self.count + more > self.items.len() {
            self.items.resize(2 * self.count + more + 64, 0);
        }
    }

    fn extend(&mut self, items: &[u32]) {
        self.reserve(items.len());
        self.items[self.count..][..items.len()].copy_from_slice(items);
        self.count += items.len();
    }
}

impl std::ops::Deref for IndexList {
    type Target = [u32];
    fn deref(&self) -> &[u32] {
        &self.items[..self.count]
    }
}

/// Scratch memory of a thread's walk.
#[derive(Default)]
struct WalkScratch {
    /// Open sources by level, each level's after its parent's.
    open: IndexList,
    /// Sources to classify for the present cell, and those found far and near.
    todo: IndexList,
    far_sources: IndexList,
    near_sources: IndexList,
    /// Partial sums of the far field: eight for each number of a narrow row.
    sums: Vec<[f64; 8]>,
    /// Leaves whose bodies attract those of the present leaf pair by pair.
    sources: Vec<SourceLeaf>,
    /// Bodies of these leaves, packed in either precision.
    singles: PackedBodies<f32>,
    doubles: PackedBodies<f64>,
    /// Positions of the present leaf's bodies.
    targets: Vec<[f64; 3]>,
    targets_f32: Vec<[f32; 3]>,
    /// Smallest squared distance of each target from a source, see [`PullF32`].
    nearest: Vec<f32>,
    /// Pull on each target.
    pulls: Vec<BodyPull>,
}

/// Data that a cell inherits from its ancestors, besides their local expansion.
#[derive(Clone, Copy)]
struct AncestorPull {
    /// Sum of M/d^2 over the far cells so far.
    far_strength: f64,
    /// Sum of M/d^2 over far and open sources, with the squared size of open ones added to d^2: about the smallest pull at
    /// this cell.
    strength: f64,
    /// Start of its open sources.
    from: usize,
}

/// Visit of a cell with the data from its ancestors.
struct CellVisit<'a> {
    /// Index of the cell.
    a: usize,
    /// Coefficients L_n of the local expansion about its centre, see [`super::expansion`].
    local: &'a mut NarrowRow<f64>,
    inherited: AncestorPull,
}

impl<L: F64Arithmetic, const P: usize> TreeWalk<'_, L, P> {
    /// Pull on every body, in the tree's order and units; the potential is invalid unless it was requested.
    pub fn body_pulls(&self) -> Vec<BodyPull> {
        ranks::divided_list(self.tree.index.len(), MIN_DIVIDED_BODIES, |range| self.pulls_of(range))
    }

    /// Pull on the bodies of a range in the tree's order.
    fn pulls_of(&self, range: Range<usize>) -> Vec<BodyPull> {
        let mut out = vec![[0.0; 4]; self.tree.index.len()];
        let mut work = WalkScratch::default();
        work.open.extend(&[0]);
        let CellSummary { mass, radius, .. } = CellSummary::from_line(&self.tree.summaries[0]);
        let strength = if radius > 0.0 { mass / (2.0 * radius * radius) } else { 0.0 };
        let inherited = AncestorPull { far_strength: 0.0, strength, from: 0 };
        self.visit_subtree(&range, CellVisit { a: 0, local: &mut [0.0; _], inherited }, &mut work, &mut out);
        out.truncate(range.end);
        out.drain(..range.start);
        out
    }

    /// Evaluates the bodies `range` in the subtree of a cell, and others of their leaves.
    fn visit_subtree(
        &self,
        range: &Range<usize>,
        CellVisit { a, local, inherited }: CellVisit,
        work: &mut WalkScratch,
        out: &mut [BodyPull],
    ) {
        let cell = &self.tree.cells[a];
        let bodies = cell.body_range();
        if bodies.end <= range.start || range.end <= bodies.start {
            return;
        }
        let summary = &CellSummary::from_line(&self.tree.summaries[a]);
        let below = work.open.len();
        let inherited = self.lanes.run(ClassifySources { walk: self, a, summary, inherited, work });
        if !work.far_sources.is_empty() {
            self.lanes.run(AddFarField {
                walk: self,
                summary,
                far_sources: &work.far_sources,
                sums: &mut work.sums,
                local,
            });
        }
        if cell.is_leaf() {
            self.lanes.run(EvaluateLeaf { walk: self, cell, summary, local, out });
            self.add_near_pulls(cell, summary, work, out);
            return;
        }
        let halves = [a + 1, a + cell.second as usize];
        let [mut one, mut two]: [NarrowRow<f64>; 2] = [[0.0; _]; 2];
        let [to_one, to_two] =
            halves.map(|half| centre_offset(&CellSummary::from_line(&self.tree.summaries[half]), summary));
        self.lanes.run(ShiftExpansion::<P> { shift: to_one, local, out: &mut one });
        self.lanes.run(ShiftExpansion::<P> { shift: to_two, local, out: &mut two });
        let (out_one, out_two) = out.split_at_mut(self.tree.cells[halves[0]].count as usize);
        if cell.count as usize > MAX_BODIES_PER_TASK {
            let mut other = WalkScratch::default();
            other.open.extend(&work.open[below..]);
            rayon::join(
                || self.visit_subtree(range, CellVisit { a: halves[0], local: &mut one, inherited }, work, out_one),
                || {
                    let inherited = AncestorPull { from: 0, ..inherited };
                    let second = CellVisit { a: halves[1], local: &mut two, inherited };
                    self.visit_subtree(range, second, &mut other, out_two)
                },
            );
        } else {
            self.visit_subtree(range, CellVisit { a: halves[0], local: &mut one, inherited }, work, out_one);
            self.visit_subtree(range, CellVisit { a: halves[1], local: &mut two, inherited }, work, out_two);
        }
        work.open.count = below;
    }

    /// Adds the pull of the near leaves on the bodies of a leaf.
    fn add_near_pulls(&self, cell: &TreeCell, summary: &CellSummary, work: &mut WalkScratch, out: &mut [BodyPull]) {
        let WalkScratch { near_sources, sources, singles, doubles, targets, targets_f32, nearest, pulls, .. } = work;
        let (l, bodies, offsets) = (self.lanes, &self.tree.bodies, &self.tree.offsets);
        targets.clear();
        targets.extend(cell.body_range().map(|i| [bodies[0][i], bodies[1][i], bodies[2][i]]));
        sources.clear();
        let Some(near_share) = self.settings.single else {
            sources.extend(
                near_sources
                    .iter()
                    .map(|&b| SourceLeaf { bodies: self.tree.cells[b as usize].body_range(), centre: [0.0; 3] }),
            );
            l.run(PackF64 { to: doubles, bodies, sources });
            l.run(PullF64 { l, packed: doubles, targets, out });
            return;
        };
        let (mut length, mut largest_radius) = (0.0, 0.0);
        for &b in near_sources.iter() {
            let source = CellSummary::from_line(&self.tree.summaries[b as usize]);
            let [x, y, z] = centre_offset(&source, summary);
            let reach = (x * x + y * y + z * z).sqrt() + source.radius;
            length = if reach > length { reach } else { length };
            largest_radius = if source.radius > largest_radius { source.radius } else { largest_radius };
        }
        length += summary.radius;
        if length == 0.0 {
            return; // all bodies at one position
        }
        let scale = 1.0 / length;
        // The leaf itself is first, so that a body has the same index among the sources as among the targets.
        sources.push(SourceLeaf { bodies: cell.body_range(), centre: [0.0; 3] });
        for &b in near_sources.iter() {
            let (source, other) =
                (&self.tree.cells[b as usize], CellSummary::from_line(&self.tree.summaries[b as usize]));
            if source.first != cell.first {
                let [x, y, z] = centre_offset(&other, summary);
                sources.push(SourceLeaf {
                    bodies: source.body_range(),
                    centre: [(x * scale) as f32, (y * scale) as f32, (z * scale) as f32],
                });
            }
        }
        let scale = scale as f32;
        l.run(PackF32 { l: l.single(), to: singles, offsets, sources, scale });
        targets_f32.clear();
        targets_f32
            .extend(cell.body_range().map(|i| [offsets[0][i] * scale, offsets[1][i] * scale, offsets[2][i] * scale]));
        nearest.resize(targets.len(), 0.0);
        pulls.clear();
        pulls.resize(targets.len(), [0.0; 4]);
        let pull = PullF32 { l: l.single(), packed: singles, length, targets: targets_f32, out: pulls, nearest };
        match (self.settings.pair, self.potential) {
            (PairPrecision::Coarse, false) => l.run(WithKernel(CoarseKernel, pull)),
            (PairPrecision::Medium, false) => l.run(WithKernel(MediumKernel::<false>, pull)),
            (PairPrecision::Coarse | PairPrecision::Medium, true) => l.run(WithKernel(MediumKernel::<true>, pull)),
            (PairPrecision::Fine, false) => l.run(WithKernel(FineKernel::<false>, pull)),
            (PairPrecision::Fine, true) => l.run(WithKernel(FineKernel::<true>, pull)),
        }
        // Pulls that the rounding of positions spoils are recomputed.
        let limit = ((near_share * (summary.radius + largest_radius) / length).max(1e-6) as f32).powi(2);
        let mut packed = false;
        let groups = targets.chunks(TARGETS_AT_ONCE).zip(nearest.chunks(TARGETS_AT_ONCE));
        for ((targets, nearest), (out, pulls)) in
            groups.zip(out.chunks_mut(TARGETS_AT_ONCE).zip(pulls.chunks(TARGETS_AT_ONCE)))
        {
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

/// Vector from the centre of `b` to that of `a`.
#[inline(always)]
fn centre_offset(a: &CellSummary, b: &CellSummary) -> [f64; 3] {
    [a.centre[0] - b.centre[0], a.centre[1] - b.centre[1], a.centre[2] - b.centre[2]]
}

/// Next `BATCH_CELLS` indices, padded by `filler`, and the number of valid ones.
#[inline(always)]
fn index_batch(items: &[u32], first: usize, filler: u32) -> ([u32; BATCH_CELLS], usize) {
    if let Some(full) = items[first..].first_chunk::<BATCH_CELLS>() {
        return (*full, BATCH_CELLS);
    }
    let mut index = [filler; BATCH_CELLS];
    let count = items.len() - first;
    index[..count].copy_from_slice(&items[first..]);
    (index, count)
}

/// Classifies the open sources of cell `a` as far, near, or still open for its halves; returns the data that the halves
/// inherit.
struct ClassifySources<'a, L, const P: usize> {
    walk: &'a TreeWalk<'a, L, P>,
    a: usize,
    summary: &'a CellSummary,
    inherited: AncestorPull,
    work: &'a mut WalkScratch,
}

/// Code of a source that is far: its expansion is used.
const FAR_CODE: f64 = 2.0;
/// Code of a near source that is larger than the target cell, or of any near source of a leaf: it is split unless it is a
/// leaf itself.
const SPLIT_CODE: f64 = 1.0;

impl<L: F64Arithmetic, const P: usize> NullaryFnOnce for ClassifySources<'_, L, P> {
    type Output = AncestorPull;
    #[inline(always)]
    fn call(self) -> AncestorPull {
        let ClassifySources { walk, a, summary, inherited, work } = self;
        let (l, tree) = (walk.lanes, walk.tree);
        let (cells, summaries) = (&tree.cells[..], &tree.summaries[..]);
        let is_leaf = cells[a].is_leaf();
        let WalkScratch { open, todo, far_sources, near_sources, .. } = work;
        let below = open.count;
        (todo.count, far_sources.count, near_sources.count) = (0, 0, 0);
        todo.extend(&open.items[inherited.from..open.count]);

        let centre = [l.splat(summary.centre[0]), l.splat(summary.centre[1]), l.splat(summary.centre[2])];
        let (zero, one, two) = (l.splat(0.0), l.splat(SPLIT_CODE), l.splat(FAR_CODE));
        let error_limit = walk.settings.share * inherited.strength;
        let limit = l.splat(error_limit * error_limit);
        let theta2 = l.splat(walk.settings.opening * walk.settings.opening);
        let (own_radius, own_radius2) = (l.splat(summary.radius), l.splat(summary.radius * summary.radius));
        let size = l.splat(if is_leaf { -1.0 } else { summary.radius });
        let (mut far_parts, mut open_parts) = ([0.0; BATCH_CELLS], [0.0; BATCH_CELLS]);
        let mut k = 0;
        while k < todo.count {
            let (index, batch_count) = index_batch(todo, k, cells.len() as u32);
            let mut codes = [0.0; BATCH_CELLS];
            let mut from = 0;
            while from < BATCH_CELLS {
                let [x, y, z, r, m, uneven, ..] = l.gather_lines(summaries, &index[from..]);
                let d = [l.sub(x, centre[0]), l.sub(y, centre[1]), l.sub(z, centre[2])];
                let d2 = l.mul_add(d[0], d[0], l.mul_add(d[1], d[1], l.mul(d[2], d[2])));
                let reach = l.add(r, own_radius);
                let reach2 = l.mul(reach, reach);
                let inverse = l.div(one, d2);
                let strength = l.mul(m, inverse);
                let (ratio2, own_ratio2) = (l.mul(reach2, inverse), l.mul(own_radius2, inverse));
                let mut point_error2 = l.mul(strength, strength);
                let mut multipole_error2 = l.mul(point_error2, uneven);
                let mut q = 0;
                while q < P {
                    point_error2 = l.mul(point_error2, own_ratio2);
                    multipole_error2 = l.mul(multipole_error2, ratio2);
                    q += 1;
                }
                let margin = l.sub(one, ratio2);
                let margin2 = l.mul(margin, margin);
                let largest_error2 = l.mul(limit, l.mul(margin2, margin2));
                let code = l.select_greater(r, size, one, zero);
                let small = l.select_greater(largest_error2, l.add(point_error2, multipole_error2), two, code);
                let code = l.select_greater(l.mul(theta2, d2), reach2, small, code);
                l.store(&mut codes[from..], code);
                let far_strength = l.add(l.load(&far_parts[from..]), l.select_greater(code, one, strength, zero));
                l.store(&mut far_parts[from..], far_strength);
                // A source that remains open pulls at least as if its squared size were added to d^2. The cell itself
                // may not pull at all, if all its mass is at one position.
                let open_strength = l.select_greater(d2, zero, l.div(m, l.add(d2, reach2)), zero);
                let open_strength = l.select_greater(one, code, open_strength, zero);
                let open_strength = l.add(l.load(&open_parts[from..]), open_strength);
                l.store(&mut open_parts[from..], open_strength);
                from += L::WIDTH;
            }
            todo.reserve(2 * BATCH_CELLS);
            far_sources.reserve(BATCH_CELLS);
            near_sources.reserve(BATCH_CELLS);
            open.reserve(BATCH_CELLS);
            let (to_classify, to_far) = (
                &mut todo.items[todo.count..][..2 * BATCH_CELLS],
                &mut far_sources.items[far_sources.count..][..BATCH_CELLS],
            );
            let (to_near, to_open) = (
                &mut near_sources.items[near_sources.count..][..BATCH_CELLS],
                &mut open.items[open.count..][..BATCH_CELLS],
            );
            let [mut classify_count, mut far_count, mut near_count, mut open_count] = [0; 4];
            for lane in 0..batch_count {
                let b = index[lane];
                let second = cells[b as usize].second;
                let code = codes[lane].to_bits();
                let is_far = code == FAR_CODE.to_bits();
                let split = (code == SPLIT_CODE.to_bits()) & (second != 0);
                to_far[far_count & (BATCH_CELLS - 1)] = b;
                far_count += is_far as usize;
                to_near[near_count & (BATCH_CELLS - 1)] = b;
                near_count += (!is_far & is_leaf & (second == 0)) as usize;
                to_classify[classify_count & (2 * BATCH_CELLS - 1)] = b + 1;
                to_classify[(classify_count + 1) & (2 * BATCH_CELLS - 1)] = b + second;
                classify_count += 2 * split as usize;
                to_open[open_count & (BATCH_CELLS - 1)] = b;
                open_count += (!is_far & !split & !is_leaf) as usize;
            }
            todo.count += classify_count;
            far_sources.count += far_count;
            near_sources.count += near_count;
            open.count += open_count;
            k += batch_count;
        }
        let far_strength = inherited.far_strength + pairwise_sum(&far_parts);
        AncestorPull { far_strength, strength: far_strength + pairwise_sum(&open_parts), from: below }
    }
}

/// Adds the field of the far cells to a cell's local expansion.
struct AddFarField<'a, L, const P: usize> {
    walk: &'a TreeWalk<'a, L, P>,
    summary: &'a CellSummary,
    far_sources: &'a [u32],
    sums: &'a mut Vec<[f64; 8]>,
    local: &'a mut NarrowRow<f64>,
}

impl<L: F64Arithmetic, const P: usize> NullaryFnOnce for AddFarField<'_, L, P> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let AddFarField { walk, summary, far_sources, sums: parts, local } = self;
        let (l, tree) = (walk.lanes, walk.tree);
        let lines = narrow_len(P).div_ceil(8);
        let centre = [l.splat(summary.centre[0]), l.splat(summary.centre[1]), l.splat(summary.centre[2])];
        parts.resize(NARROW_LEN, [0.0; 8]);
        let mut from = 0;
        while from < BATCH_CELLS {
            let mut sums: NarrowRow<L::V> = [l.splat(0.0); _];
            let mut first = 0;
            while first < far_sources.len() {
                let (cells, _) = index_batch(far_sources, first, tree.cells.len() as u32);
                let mut moments: NarrowRow<L::V> = [l.splat(0.0); _];
                for_lines!(LINE < narrow_len(P).div_ceil(8), {
                    let mut index = [0; BATCH_CELLS];
                    let mut k = 0;
                    while k < L::WIDTH {
                        index[k] = cells[from + k] * lines as u32 + LINE as u32;
                        k += 1;
                    }
                    let columns = l.gather_lines(&tree.moments, &index);
                    let mut k = 0;
                    while k < 8 {
                        moments[LINE * 8 + k] = columns[k];
                        k += 1;
                    }
                });
                let d = [l.sub(centre[0], moments[1]), l.sub(centre[1], moments[2]), l.sub(centre[2], moments[3])];
                let mut field: WideRow<L::V> = [l.splat(0.0); _];
                kernel_derivatives::<L, P>(l, d, &mut field);
                contract_moments::<L, P, false>(l, &moments, &field, &mut sums);
                first += BATCH_CELLS;
            }
            store_row::<L, P>(l, &sums, from, parts);
            from += L::WIDTH;
        }
        let mut k = 0;
        while k < 8 * lines {
            let mut index = [0; BATCH_CELLS];
            for lane in 0..L::WIDTH {
                index[lane] = (k + lane) as u32;
            }
            let [a, b, c, d, e, f, g, h] = l.gather_lines(parts, &index);
            let sum = l.add(l.add(l.add(a, b), l.add(c, d)), l.add(l.add(e, f), l.add(g, h)));
            let sum = l.add(l.load(&local[k..]), sum);
            l.store(&mut local[k..], sum);
            k += L::WIDTH;
        }
    }
}

/// Shifts a local expansion to a centre at `shift` from the old one.
struct ShiftExpansion<'a, const P: usize> {
    shift: [f64; 3],
    local: &'a NarrowRow<f64>,
    /// Output; zeros on entry.
    out: &'a mut NarrowRow<f64>,
}

impl<const P: usize> NullaryFnOnce for ShiftExpansion<'_, P> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let ShiftExpansion { shift, local, out } = self;
        let (mut e, mut field): (NarrowRow<f64>, WideRow<f64>) = ([0.0; _], [0.0; _]);
        exponential_terms::<_, P>(Scalar, shift, &mut e);
        widen_row::<_, P>(Scalar, local, &mut field);
        contract_moments::<_, P, true>(Scalar, &e, &field, out);
    }
}

/// Adds a leaf's local expansion to the pull on its bodies.
struct EvaluateLeaf<'a, L, const P: usize> {
    walk: &'a TreeWalk<'a, L, P>,
    cell: &'a TreeCell,
    summary: &'a CellSummary,
    local: &'a NarrowRow<f64>,
    out: &'a mut [BodyPull],
}

impl<L: F64Arithmetic, const P: usize> NullaryFnOnce for EvaluateLeaf<'_, L, P> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let EvaluateLeaf { walk, cell, summary, local, out } = self;
        let l = walk.lanes;
        let (mut field, mut wide): (WideRow<f64>, WideRow<L::V>) = ([0.0; _], [l.splat(0.0); _]);
        widen_row::<_, P>(Scalar, local, &mut field);
        for k in 0..field.len() {
            wide[k] = l.splat(field[k]);
        }
        let [x, y, z, _] = &walk.tree.bodies;
        let bodies = [&x[cell.body_range()], &y[cell.body_range()], &z[cell.body_range()]];
        let centre = summary.centre;
        let mut first = 0;
        while first < out.len() {
            let mut b = [l.splat(0.0); 3];
            for k in 0..3 {
                b[k] = l.sub(load_part(l, bodies[k], first, centre[k]), l.splat(centre[k]));
            }
            let mut e: NarrowRow<L::V> = [l.splat(0.0); _];
            exponential_terms::<L, P>(l, b, &mut e);
            let sums = evaluate_expansion::<L, P>(l, &e, &wide);
            let mut result = [[0.0; BATCH_CELLS]; 4];
            for k in 0..4 {
                l.store(&mut result[k], sums[k]);
            }
            for lane in 0..L::WIDTH.min(out.len() - first) {
                for k in 0..4 {
                    out[first + lane][k] += result[k][lane];
                }
            }
            first += L::WIDTH;
        }
    }
}
