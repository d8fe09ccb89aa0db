//! Factors of a square matrix: with full columns, or sparse ones where most of it is zero.

use faer::Mat;
use faer::linalg::solvers::{PartialPivLu, Solve};
use faer::sparse::{SparseColMat, Triplet};

/// Rows below which full columns are always the faster.
const SMALL: usize = 200;
/// Share of a matrix that is not zero above which full columns are the faster: factors fill up.
const FULL: f64 = 0.2;

/// Whether sparse factors are the faster.
fn is_sparse(size: usize, entries: usize) -> bool {
    size >= SMALL && (entries as f64) < FULL * (size as f64).powi(2)
}

/// Cost of the factors of a matrix with that number of entries, in units of [`super::newton_cost`].
pub fn cost(size: usize, entries: usize) -> f64 {
    let rows = size as f64;
    if is_sparse(size, entries) { entries as f64 * (50.0 + 0.03 * rows) } else { 0.025 * rows.powi(3) }
}

/// Cost of a solution with them.
pub fn solution_cost(size: usize, entries: usize) -> f64 {
    if is_sparse(size, entries) { entries as f64 } else { 0.3 * (size as f64).powi(2) }
}

/// A value and its row and column, each place once.
pub type Entry = Triplet<usize, usize, f64>;

/// L U with rows exchanged: matrices need not be symmetric or definite.
pub enum Factors {
    Full(PartialPivLu<f64>),
    Sparse(faer::sparse::linalg::solvers::Lu<usize, f64>),
}

impl Factors {
    /// Of the matrix with these entries; none where no sparse factors are found, as where it is singular.
    pub fn new(size: usize, entries: &[Entry]) -> Option<Self> {
        if !is_sparse(size, entries.len()) {
            let mut matrix = Mat::<f64>::zeros(size, size);
            for &Triplet { row, col, val } in entries {
                matrix[(row, col)] = val;
            }
            return Some(Factors::Full(matrix.partial_piv_lu()));
        }
        let matrix = SparseColMat::<usize, f64>::try_new_from_triplets(size, size, entries).ok()?;
        matrix.sp_lu().ok().map(Factors::Sparse)
    }

    /// x of A x = `right`; not finite where A is singular.
    pub fn solve(&self, right: &Mat<f64>) -> Mat<f64> {
        match self {
            Factors::Full(factors) => factors.solve(right),
            Factors::Sparse(factors) => factors.solve(right),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chain, unsymmetric: A x = b for the x that b was made from; singular matrices give no finite x.
    #[test]
    fn full_and_sparse_factors() {
        for size in [SMALL / 2, 3 * SMALL] {
            let entry = |i: usize, j: usize| match j as isize - i as isize {
                0 => 3.0 + (i as f64).sin(),
                1 => -1.0,
                -1 => 0.5,
                _ => 0.0,
            };
            let near = |i: usize| i.saturating_sub(1)..(i + 2).min(size);
            let entries: Vec<Entry> =
                (0..size).flat_map(|i| near(i).map(move |j| Entry::new(i, j, entry(i, j)))).collect();
            assert_eq!(is_sparse(size, entries.len()), size > SMALL);
            let x = Mat::from_fn(size, 1, |i, _| (1.3 * i as f64).cos());
            let right = Mat::from_fn(size, 1, |i, _| near(i).map(|j| entry(i, j) * x[(j, 0)]).sum::<f64>());
            let found = Factors::new(size, &entries).unwrap().solve(&right);
            // Rounding: the matrix is well conditioned.
            assert!((0..size).all(|i| (found[(i, 0)] - x[(i, 0)]).abs() < 1e-13));

            let zeros: Vec<Entry> = entries.iter().map(|e| Entry::new(e.row, e.col, 0.0)).collect();
            let none = Factors::new(size, &zeros).map(|factors| factors.solve(&right));
            assert!(none.is_none_or(|x| (0..size).any(|i| !x[(i, 0)].is_finite())));
        }
    }
}
