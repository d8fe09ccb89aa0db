//! The stored problem, and the costs of its solvers.

use super::factors::factor_cost;
use super::types::{LocalVector, MatrixBlock};

/// Largest magnitude of a number: squares of larger ones, and of their products, are not finite.
const MAX_MAGNITUDE: f64 = 1e100;

/// Problem u = W r + q with Signorini's condition and Coulomb's law at each contact.
#[derive(Debug, Clone)]
pub struct MatrixProblem {
    /// Friction of each contact.
    pub mu: Vec<f64>,
    /// Relative velocity of each contact without impulses, m/s.
    pub q: Vec<LocalVector>,
    /// Start in `blocks` of the blocks of each row, and the end of the last.
    pub(super) starts: Vec<usize>,
    /// Column of each block.
    pub(super) columns: Vec<u32>,
    /// Blocks of W, 1/kg.
    pub(super) blocks: Vec<MatrixBlock>,
}

/// Reason why numbers are no [`MatrixProblem`].
#[derive(Debug, Clone, PartialEq)]
pub enum MatrixProblemError {
    /// The number of frictions differs from the number of contacts.
    FrictionCount { frictions: usize, contacts: usize },
    /// A block of a contact out of range, or with a number that is not finite or too large.
    Block { row: usize, column: usize, contacts: usize, w: MatrixBlock },
    /// A contact with a negative friction, or with a number that is not finite or too large.
    Contact { contact: usize, mu: f64, q: LocalVector },
}

impl std::fmt::Display for MatrixProblemError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            MatrixProblemError::FrictionCount { frictions, contacts } => {
                write!(f, "{frictions} frictions for {contacts} contacts")
            }
            MatrixProblemError::Block { row, column, contacts, w } => {
                write!(f, "block ({row}, {column}) of {contacts} contacts is {w:?}")
            }
            MatrixProblemError::Contact { contact, mu, q } => {
                write!(f, "contact {contact} has friction {mu:?} and q = {q:?}")
            }
        }
    }
}

impl std::error::Error for MatrixProblemError {}

impl MatrixProblem {
    /// Builds the problem from the blocks (row, column, block) of W in any order; blocks at the same position are added up.
    /// Numbers that are not finite or as large as 1e100, a negative friction and a contact out of range are rejected.
    pub fn new(
        mu: Vec<f64>,
        q: Vec<LocalVector>,
        blocks: impl IntoIterator<Item = (usize, usize, MatrixBlock)>,
    ) -> Result<Self, MatrixProblemError> {
        let n = q.len();
        if mu.len() != n {
            return Err(MatrixProblemError::FrictionCount { frictions: mu.len(), contacts: n });
        }
        let mut blocks: Vec<_> = blocks.into_iter().collect();
        // One block on every diagonal, as solvers require.
        blocks.extend((0..n).map(|k| (k, k, [[0.0; 3]; 3])));
        blocks.sort_by_key(|&(i, j, _)| (i, j));
        let mut problem = MatrixProblem { mu, q, starts: vec![0; n + 1], columns: Vec::new(), blocks: Vec::new() };
        let mut last = None;
        for (i, j, w) in blocks {
            if i >= n || j >= n || !w.as_flattened().iter().all(|x| x.abs() < MAX_MAGNITUDE) {
                return Err(MatrixProblemError::Block { row: i, column: j, contacts: n, w });
            }
            if last == Some((i, j)) {
                let sum = problem.blocks.last_mut().into_iter().flat_map(|sum| sum.as_flattened_mut());
                sum.zip(w.as_flattened()).for_each(|(sum, x)| *sum += x);
            } else {
                problem.columns.push(j as u32);
                problem.blocks.push(w);
                problem.starts[i + 1] = problem.blocks.len();
                last = Some((i, j));
            }
        }
        for (k, (mu, q)) in problem.mu.iter().zip(&problem.q).enumerate() {
            if !(mu.abs() < MAX_MAGNITUDE && *mu >= 0.0 && q.iter().all(|x| x.abs() < MAX_MAGNITUDE)) {
                return Err(MatrixProblemError::Contact { contact: k, mu: *mu, q: *q });
            }
        }
        Ok(problem)
    }

    /// Number of contacts.
    pub fn len(&self) -> usize {
        self.q.len()
    }

    /// Whether the problem has no contacts.
    pub fn is_empty(&self) -> bool {
        self.q.is_empty()
    }

    /// Columns and blocks of row `i`.
    pub fn row_blocks(&self, i: usize) -> impl Iterator<Item = (usize, &MatrixBlock)> {
        let range = self.starts[i]..self.starts[i + 1];
        self.columns[range.clone()].iter().map(|&j| j as usize).zip(&self.blocks[range])
    }

    /// Relative velocities u = W r + q.
    pub fn relative_velocities(&self, r: &[LocalVector]) -> Vec<LocalVector> {
        let add = |mut u: LocalVector, (j, w): (usize, &MatrixBlock)| {
            for k in 0..3 {
                u[k] += w[k][0] * r[j][0] + w[k][1] * r[j][1] + w[k][2] * r[j][2];
            }
            u
        };
        (0..self.len()).map(|i| self.row_blocks(i).fold(self.q[i], add)).collect()
    }

    /// Cost of one Newton step, see [`newton_cost`].
    pub(super) fn newton_cost(&self) -> f64 {
        step_cost(self.len(), self.blocks.len())
    }

    /// Cost of one accelerated sweep, see [`newton_cost`].
    pub(super) fn sweep_cost(&self) -> f64 {
        1e3 + 2.5 * self.blocks.len() as f64 + 25.0 * self.len() as f64
    }

    /// Diagonal blocks W_ii.
    pub fn diagonal_blocks(&self) -> impl Iterator<Item = &MatrixBlock> {
        (0..self.len()).filter_map(|i| self.row_blocks(i).find(|(j, _)| *j == i).map(|(_, w)| w))
    }
}

/// Assumed blocks of W per contact: its own block, and blocks with the other contacts of two grains with five each.
const BLOCKS_PER_CONTACT: usize = 9;

/// Cost of one Newton step of a problem with this number of contacts of grains: about 1e-9 s on one core. It is computed, not
/// measured, so that decisions based on it are the same on every machine.
pub fn newton_cost(contacts: usize) -> f64 {
    step_cost(contacts, BLOCKS_PER_CONTACT * contacts)
}

/// Cost of one Newton step with this number of blocks of W.
fn step_cost(contacts: usize, blocks: usize) -> f64 {
    5e4 + factor_cost(3 * contacts, 9 * blocks)
}
