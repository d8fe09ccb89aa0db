//! L U of a matrix of 3x3 blocks, one block row and column per contact.
//!
//! Contacts are eliminated in fronts: full matrices of the contacts eliminated together and of the later ones coupled to
//! them. The remainder of a front after the elimination of its own contacts is added to the front of the first of the later
//! ones. A small or nearly full matrix is one front. Rows are exchanged among a front's own.
//!
//! Every number is the same at all widths of arithmetic: terms are subtracted from it one by one, in the order of
//! elimination.
//!
//! Sources: I. S. Duff, J. K. Reid, ACM Trans. Math. Softw. 9 (1983) 302-325 (fronts); P. R. Amestoy, T. A. Davis, I. S. Duff,
//! SIAM J. Matrix Anal. Appl. 17 (1996) 886-905 (order of elimination).

use super::types::{LocalVector, MatrixBlock};
use crate::math::simd::{F64Arithmetic, LaneOperation, SimdWidth};

/// Number of rows below which one front is always faster.
const MIN_SPARSE_ROWS: usize = 200;
/// Share of nonzeros of a matrix above which one front is faster: factors fill up.
const MAX_SPARSE_FILL: f64 = 0.2;
/// Largest share of zeros in a front up to which fronts are joined.
const MAX_FRONT_ZEROS: f64 = 0.2;

/// Whether more than one front is faster.
fn is_sparse(size: usize, entries: usize) -> bool {
    size >= MIN_SPARSE_ROWS && (entries as f64) < MAX_SPARSE_FILL * (size as f64).powi(2)
}

/// Cost of the factors of a matrix with that number of entries, in units of [`super::newton_cost`].
pub fn factor_cost(size: usize, entries: usize) -> f64 {
    let rows = size as f64;
    if is_sparse(size, entries) { entries as f64 * (50.0 + 0.03 * rows) } else { 0.025 * rows.powi(3) }
}

/// Cost of a solution with these factors, in the same units.
pub fn solution_cost(size: usize, entries: usize) -> f64 {
    if is_sparse(size, entries) { entries as f64 } else { 0.3 * (size as f64).powi(2) }
}

/// A block with its row and column; each position occurs once.
pub type BlockEntry = (usize, usize, MatrixBlock);

/// Factors L U with row exchanges: matrices need not be symmetric or definite.
pub struct LuFactors {
    fronts: Vec<FrontalMatrix>,
    width: SimdWidth,
}

/// Front: contacts that are eliminated together, and the later ones coupled to them.
struct FrontalMatrix {
    /// Contacts that are eliminated here; each has three rows and three columns.
    own: Vec<u32>,
    /// Later contacts that are coupled to these.
    later: Vec<u32>,
    /// Row exchanged with each of the own rows, in their order, panel by panel of [`PANEL_COLUMNS`] columns.
    pivots: Vec<u32>,
    /// Own columns: U, and below the diagonal L, whose diagonal is 1; its rows are exchanged up to the end of its panel.
    left: Vec<f64>,
    /// Own rows of the other columns: U.
    right: Vec<f64>,
}

impl LuFactors {
    /// Factors of the matrix of `count` rows of blocks with these entries; `None` if no pivot is found, e.g. if it is
    /// singular.
    pub fn new(count: usize, entries: &[BlockEntry]) -> Option<Self> {
        Self::at_width(count, entries, SimdWidth::detect())
    }

    fn at_width(count: usize, entries: &[BlockEntry], width: SimdWidth) -> Option<Self> {
        let mut fronts = if is_sparse(3 * count, 9 * entries.len()) {
            elimination_fronts(count, entries)
        } else {
            (count > 0).then(|| FrontalMatrix::from_contacts((0..count as u32).collect())).into_iter().collect()
        };
        // Front in which each contact is eliminated.
        let mut front_of = vec![0; count];
        for (k, front) in fronts.iter().enumerate() {
            front.own.iter().for_each(|&i| front_of[i as usize] = k);
        }
        let mut entries_of = vec![Vec::new(); fronts.len()];
        entries.iter().for_each(|entry| entries_of[front_of[entry.0].min(front_of[entry.1])].push(entry));
        let mut remainders: Vec<Vec<(usize, Vec<f64>)>> = vec![Vec::new(); fronts.len()];
        let mut first_row = vec![0; count];
        let mut a = Vec::new();
        for k in 0..fronts.len() {
            let front = &mut fronts[k];
            let (own, size) = front.row_counts();
            let stride = column_stride(size);
            front.own.iter().chain(&front.later).enumerate().for_each(|(k, &i)| first_row[i as usize] = 3 * k);
            a.clear();
            a.resize(stride * size, 0.0);
            for (i, j, block) in entries_of[k].drain(..) {
                for (row, values) in block.iter().enumerate() {
                    for (column, value) in values.iter().enumerate() {
                        a[(first_row[*j] + column) * stride + first_row[*i] + row] += value;
                    }
                }
            }
            for (child, remainder) in std::mem::take(&mut remainders[k]) {
                let later = &fronts[child].later;
                for (column, values) in remainder.chunks_exact(3 * later.len()).enumerate() {
                    let to = (first_row[later[column / 3] as usize] + column % 3) * stride;
                    for (values, &i) in values.chunks_exact(3).zip(later) {
                        let to = &mut a[to + first_row[i as usize]..][..3];
                        to.iter_mut().zip(values).for_each(|(to, value)| *to += value);
                    }
                }
            }
            let front = &mut fronts[k];
            front.pivots.resize(own, 0);
            if !eliminate_front(width, &mut a, stride, size, &mut front.pivots) {
                return None;
            }
            let column_rows = |c: usize| &a[c * stride..][..size];
            (0..own).for_each(|c| front.left.extend_from_slice(column_rows(c)));
            (own..size).for_each(|c| front.right.extend_from_slice(&column_rows(c)[..own]));
            if let Some(next) = front.later.iter().map(|&i| front_of[i as usize]).min() {
                remainders[next].push((k, (own..size).flat_map(|c| column_rows(c)[own..].iter().copied()).collect()));
            }
        }
        Some(LuFactors { fronts, width })
    }

    /// x of A x = `right`; may be infinite or NaN if A is nearly singular.
    pub fn solve(&self, right: &[LocalVector]) -> Vec<LocalVector> {
        let mut x = right.to_vec();
        self.width.run(TriangularSolution { factors: self, x: &mut x });
        x
    }
}

impl FrontalMatrix {
    fn from_contacts(own: Vec<u32>) -> Self {
        FrontalMatrix { own, later: Vec::new(), pivots: Vec::new(), left: Vec::new(), right: Vec::new() }
    }

    /// Number of eliminated rows, and of all rows.
    fn row_counts(&self) -> (usize, usize) {
        (3 * self.own.len(), 3 * (self.own.len() + self.later.len()))
    }
}

/// Stride of a column: whole vectors may begin at any of its rows.
fn column_stride(size: usize) -> usize {
    (size + 7).next_multiple_of(8)
}

/// Fronts with little fill, each after the fronts whose remainders are added to it.
fn elimination_fronts(count: usize, entries: &[BlockEntry]) -> Vec<FrontalMatrix> {
    let mut pairs: Vec<[u32; 2]> = Vec::with_capacity(2 * entries.len());
    pairs.extend(entries.iter().flat_map(|&(i, j, _)| [[i as u32, j as u32], [j as u32, i as u32]]));
    pairs.sort_unstable();
    pairs.dedup();
    pairs.retain(|[i, j]| i != j);
    let mut starts = vec![0; count + 1];
    pairs.iter().for_each(|[i, _]| starts[*i as usize + 1] += 1);
    (0..count).for_each(|i| starts[i + 1] += starts[i]);
    let neighbours: Vec<usize> = pairs.iter().map(|[_, j]| *j as usize).collect();
    let (order, positions) = match amd::order(count, &starts, &neighbours, &amd::Control::default()) {
        Ok((order, positions, _)) => (order, positions),
        Err(_) => ((0..count).collect(), (0..count).collect()),
    };

    // By position in the order: the later contacts coupled by the elimination, the positions of which it is the first of these,
    // and the front; then the fronts with their zeros.
    let mut later: Vec<Vec<u32>> = Vec::with_capacity(count);
    let mut children: Vec<Vec<u32>> = vec![Vec::new(); count];
    let mut last_coupled = vec![usize::MAX; count];
    let mut front_of = vec![0; count];
    let mut fronts: Vec<(Vec<u32>, f64)> = Vec::new();
    for k in 0..count {
        last_coupled[k] = k;
        let mut coupled = Vec::new();
        let near = neighbours[starts[order[k]]..starts[order[k] + 1]].iter().map(|&j| positions[j] as u32);
        let from = children[k].iter().flat_map(|&child| later[child as usize].iter().copied());
        for j in near.filter(|&j| j as usize > k).chain(from) {
            if last_coupled[j as usize] != k {
                last_coupled[j as usize] = k;
                coupled.push(j);
            }
        }
        if let Some(&next) = coupled.iter().min() {
            children[next as usize].push(k as u32);
        }
        let joined = children[k].iter().map(|&child| child as usize).max_by_key(|&child| later[child].len());
        let front = joined.map(|child| (front_of[child], later[child].len())).and_then(|(front, before)| {
            let (own, zeros) = &fronts[front];
            let zeros = zeros + (own.len() * (coupled.len() + 1 - before)) as f64;
            let entry_count = ((own.len() + 1) * (coupled.len() + 1 + own.len() / 2)) as f64;
            (zeros <= MAX_FRONT_ZEROS * entry_count).then_some((front, zeros))
        });
        match front {
            Some((front, zeros)) => {
                fronts[front].0.push(k as u32);
                fronts[front].1 = zeros;
                front_of[k] = front;
            }
            None => {
                front_of[k] = fronts.len();
                fronts.push((vec![k as u32], 0.0));
            }
        }
        later.push(coupled);
    }
    fronts.sort_unstable_by_key(|(own, _)| own.last().copied());
    let contacts = |positions: &[u32]| positions.iter().map(|&k| order[k as usize] as u32).collect();
    fronts
        .iter()
        .map(|(own, _)| FrontalMatrix {
            later: contacts(&later[own[own.len() - 1] as usize]),
            ..FrontalMatrix::from_contacts(contacts(own))
        })
        .collect()
}

/// Eliminates the first rows, as many as there are `pivots`, of the columns of `size` rows, in place. Returns false if no
/// pivot is found.
fn eliminate_front(width: SimdWidth, a: &mut [f64], stride: usize, size: usize, pivots: &mut [u32]) -> bool {
    width.run(FrontElimination { a, stride, size, pivots })
}

/// Operation of [`eliminate_front`].
struct FrontElimination<'a> {
    /// Matrix of the front, column after column.
    a: &'a mut [f64],
    /// Distance of the starts of two columns in `a`.
    stride: usize,
    /// Number of rows, and of columns.
    size: usize,
    /// Output: row exchanged with each of the eliminated rows.
    pivots: &'a mut [u32],
}

/// Columns that are eliminated before the columns to the right are updated.
const PANEL_COLUMNS: usize = 24;

impl LaneOperation for FrontElimination<'_> {
    type Output = bool;
    #[inline(always)]
    fn call<L: F64Arithmetic>(self, l: L) -> bool {
        let FrontElimination { a, stride, size, pivots } = self;
        let own = pivots.len();
        for from in (0..own).step_by(PANEL_COLUMNS) {
            let to = (from + PANEL_COLUMNS).min(own);
            for j in from..to {
                let column = &a[j * stride..][..own];
                let mut pivot = j;
                for i in j + 1..own {
                    pivot = if column[i].abs() > column[pivot].abs() { i } else { pivot };
                }
                let inverse = 1.0 / column[pivot];
                if !(inverse.is_finite() && inverse != 0.0) {
                    return false;
                }
                pivots[j] = pivot as u32;
                (from..to).for_each(|c| a.swap(c * stride + j, c * stride + pivot));
                a[j * stride + j + 1..][..size - j - 1].iter_mut().for_each(|x| *x *= inverse);
                let (before, after) = a.split_at_mut((j + 1) * stride);
                let lower = &before[j * stride + j + 1..][..size - j - 1];
                for column in after.chunks_exact_mut(stride).take(to - j - 1) {
                    let u = column[j];
                    subtract_multiple(&mut column[j + 1..size], lower, u);
                }
            }
            let (before, after) = a.split_at_mut(to * stride);
            let panel =
                ColumnPanel { columns: &before[from * stride..], stride, from, pivots: &pivots[from..to], size };
            let mut groups = after[..(size - to) * stride].chunks_exact_mut(4 * stride);
            groups.by_ref().for_each(|columns| panel.update_columns::<L, 4>(l, columns));
            groups.into_remainder().chunks_exact_mut(stride).for_each(|column| panel.update_columns::<L, 1>(l, column));
        }
        true
    }
}

/// Exchanges the rows from `from` on with those given by `pivots`.
#[inline(always)]
fn swap_rows(x: &mut [f64], from: usize, pivots: &[u32]) {
    pivots.iter().enumerate().for_each(|(k, &pivot)| x.swap(from + k, pivot as usize));
}

/// `x` minus `lower` times `u`.
#[inline(always)]
fn subtract_multiple(x: &mut [f64], lower: &[f64], u: f64) {
    x.iter_mut().zip(lower).for_each(|(x, l)| *x = (-l).mul_add(u, *x));
}

/// Columns of L, the first of which belongs to row `from`, as many as there are `pivots`.
struct ColumnPanel<'a> {
    columns: &'a [f64],
    /// Distance of the starts of two columns.
    stride: usize,
    from: usize,
    pivots: &'a [u32],
    /// Number of rows.
    size: usize,
}

impl ColumnPanel<'_> {
    /// Exchanges rows of `Q` columns further right as in this panel, and subtracts its columns from them, each times its
    /// number of U.
    #[inline(always)]
    fn update_columns<L: F64Arithmetic, const Q: usize>(&self, l: L, columns: &mut [f64]) {
        let &ColumnPanel { columns: panel, stride, from, pivots, size } = self;
        let to = from + pivots.len();
        let mut u = [[0.0; Q]; PANEL_COLUMNS];
        for (q, column) in columns.chunks_exact_mut(stride).enumerate() {
            swap_rows(column, from, pivots);
            for k in from..to {
                u[k - from][q] = column[k];
                subtract_multiple(
                    &mut column[k + 1..to],
                    &panel[(k - from) * stride + k + 1..][..to - k - 1],
                    u[k - from][q],
                );
            }
        }
        for row in (to..size).step_by(2 * L::WIDTH) {
            // The last vector may end among the unused rows.
            let second = if row + L::WIDTH < size { row + L::WIDTH } else { row };
            let mut sums = [[l.splat(0.0); 2]; Q];
            for q in 0..Q {
                sums[q] = [l.load(&columns[q * stride + row..]), l.load(&columns[q * stride + second..])];
            }
            for (column, u) in panel.chunks_exact(stride).zip(&u[..to - from]) {
                let lower = [l.load(&column[row..]), l.load(&column[second..])];
                for q in 0..Q {
                    let u = l.splat(u[q]);
                    sums[q] = [l.neg_mul_add(lower[0], u, sums[q][0]), l.neg_mul_add(lower[1], u, sums[q][1])];
                }
            }
            for q in 0..Q {
                l.store(&mut columns[q * stride + row..], sums[q][0]);
                l.store(&mut columns[q * stride + second..], sums[q][1]);
            }
        }
    }
}

/// Operation of [`LuFactors::solve`]: forward substitution with L, then backward with U.
struct TriangularSolution<'a> {
    factors: &'a LuFactors,
    /// Right side, replaced by the solution; by contact.
    x: &'a mut [LocalVector],
}

impl LaneOperation for TriangularSolution<'_> {
    type Output = ();
    #[inline(always)]
    fn call<L: F64Arithmetic>(self, _: L) {
        let x = self.x;
        let mut y: Vec<f64> = Vec::new();
        for front in &self.factors.fronts {
            let (own, size) = front.row_counts();
            y.clear();
            front.own.iter().for_each(|&i| y.extend(x[i as usize]));
            y.resize(size, 0.0);
            for (j, column) in front.left.chunks_exact(size).enumerate() {
                if j % PANEL_COLUMNS == 0 {
                    swap_rows(&mut y, j, &front.pivots[j..own.min(j + PANEL_COLUMNS)]);
                }
                let (before, after) = y.split_at_mut(j + 1);
                subtract_multiple(after, &column[j + 1..], before[j]);
            }
            front.own.iter().zip(y.chunks_exact(3)).for_each(|(&i, y)| x[i as usize].copy_from_slice(y));
            for (&i, y) in front.later.iter().zip(y[own..].chunks_exact(3)) {
                (0..3).for_each(|k| x[i as usize][k] += y[k]);
            }
        }
        for front in self.factors.fronts.iter().rev() {
            let (own, size) = front.row_counts();
            y.clear();
            front.own.iter().for_each(|&i| y.extend(x[i as usize]));
            let later = front.later.iter().flat_map(|&i| x[i as usize]);
            front.right.chunks_exact(own).zip(later).for_each(|(column, x)| subtract_multiple(&mut y, column, x));
            for (j, column) in front.left.chunks_exact(size).enumerate().rev() {
                y[j] /= column[j];
                let (before, after) = y.split_at_mut(j);
                subtract_multiple(before, &column[..j], after[0]);
            }
            front.own.iter().zip(y.chunks_exact(3)).for_each(|(&i, y)| x[i as usize].copy_from_slice(y));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An unsymmetric matrix in which two contacts are coupled if the difference of their indices is in `near`.
    fn net(count: usize, near: &[usize]) -> Vec<BlockEntry> {
        let value = |i: usize, j: usize| (1.3 * i as f64 + 2.9 * j as f64).sin();
        let block = |i: usize, j: usize| -> MatrixBlock {
            let one = if i == j { 4.0 } else { 0.0 };
            std::array::from_fn(|k| {
                std::array::from_fn(|l| 0.5 * value(3 * i + k, 3 * j + l) + if k == l { one } else { 0.0 })
            })
        };
        let touch = |i: usize, j: usize| i == j || near.contains(&i.abs_diff(j));
        let pairs = (0..count).flat_map(|i| (0..count).map(move |j| (i, j)));
        pairs.filter(|&(i, j)| touch(i, j)).map(|(i, j)| (i, j, block(i, j))).collect()
    }

    fn product(entries: &[BlockEntry], x: &[LocalVector]) -> Vec<LocalVector> {
        let mut sum = vec![[0.0; 3]; x.len()];
        for (i, j, block) in entries {
            for k in 0..3 {
                sum[*i][k] += (0..3).map(|l| block[k][l] * x[*j][l]).sum::<f64>();
            }
        }
        sum
    }

    /// A x = b gives the x from which b was computed, with one front and with many, with the same bits at all widths.
    #[test]
    fn full_and_sparse_factors() {
        for (count, near, sparse) in [
            (1, &[][..], false),
            (2, &[1], false),
            (40, &[1, 7], false),
            (90, &[1, 10], true),
            (200, &[1, 3, 29], true),
        ] {
            let entries = net(count, near);
            assert_eq!(is_sparse(3 * count, 9 * entries.len()), sparse);
            let x: Vec<LocalVector> =
                (0..count).map(|i| std::array::from_fn(|k| (1.7 * (3 * i + k) as f64).cos())).collect();
            let right = product(&entries, &x);
            let found = LuFactors::new(count, &entries).unwrap().solve(&right);
            let error =
                found.as_flattened().iter().zip(x.as_flattened()).fold(0.0, |e: f64, (a, b)| e.max((a - b).abs()));
            // Rounding: the matrix is well conditioned.
            assert!(error < 1e-13, "{count}: {error:e}");
            for width in SimdWidth::all_widths() {
                assert_eq!(LuFactors::at_width(count, &entries, width).unwrap().solve(&right), found, "{width:?}");
            }
            let zeros: Vec<BlockEntry> = entries.iter().map(|e| (e.0, e.1, [[0.0; 3]; 3])).collect();
            assert!(LuFactors::new(count, &zeros).is_none());
            let bad: Vec<BlockEntry> = entries.iter().map(|e| (e.0, e.1, [[f64::NAN; 3]; 3])).collect();
            assert!(LuFactors::new(count, &bad).is_none());
        }
        assert!(LuFactors::new(0, &[]).is_some_and(|factors| factors.solve(&[]).is_empty()));
    }

    /// Every contact is eliminated in one front, and each front lists all later contacts coupled to its own; joined fronts
    /// have few zeros.
    #[test]
    fn fronts_hold_all_once() {
        let entries = net(200, &[1, 3, 29]);
        let fronts = elimination_fronts(200, &entries);
        let mut all: Vec<u32> = fronts.iter().flat_map(|front| front.own.iter().copied()).collect();
        for (k, front) in fronts.iter().enumerate() {
            assert!(front.later.iter().all(|i| fronts[k + 1..].iter().any(|later| later.own.contains(i))));
        }
        all.sort_unstable();
        assert!(all.iter().copied().eq(0..200) && fronts.len() > 20 && fronts.len() < 150, "{}", fronts.len());
    }
}
