//! A problem in units in which each diagonal block has trace 3.

use super::problem::MatrixProblem;
use super::types::{LocalVector, MatrixBlock};

/// Scaled problem W_ij s_i s_j, q_i s_i and r_i / s_i with s_i = (3 / trace W_ii)^1/2: one factor per contact does not change
/// the cones.
pub struct ScaledProblem {
    problem: MatrixProblem,
    /// Factor s_i of each contact, kg^1/2.
    pub s: Vec<f64>,
    /// Friction of each contact.
    pub mu: Vec<f64>,
}

impl ScaledProblem {
    /// Scales a problem.
    pub fn new(problem: &MatrixProblem) -> Self {
        let s: Vec<f64> = problem
            .diagonal_blocks()
            .map(|w| w[0][0] + w[1][1] + w[2][2])
            .map(|trace| if trace > 0.0 { (3.0 / trace).sqrt() } else { 1.0 })
            .collect();
        let mut scaled = problem.clone();
        for i in 0..problem.len() {
            scaled.q[i] = problem.q[i].map(|x| x * s[i]);
            for k in problem.starts[i]..problem.starts[i + 1] {
                let factor = s[i] * s[problem.columns[k] as usize];
                scaled.blocks[k] = problem.blocks[k].map(|row| row.map(|x| x * factor));
            }
        }
        ScaledProblem { problem: scaled, s, mu: problem.mu.clone() }
    }

    /// Converts impulses to the scaled units.
    pub fn impulses_in(&self, r: &[LocalVector]) -> Vec<LocalVector> {
        r.iter().zip(&self.s).map(|(r, s)| r.map(|x| x / s)).collect()
    }

    /// Converts impulses from the scaled units.
    pub fn impulses_out(&self, r: &[LocalVector]) -> Vec<LocalVector> {
        r.iter().zip(&self.s).map(|(r, s)| r.map(|x| x * s)).collect()
    }

    /// Relative velocities W r + q.
    pub fn relative_velocities(&self, r: &[LocalVector]) -> Vec<LocalVector> {
        self.problem.relative_velocities(r)
    }

    /// Scaled relative velocity of contact `i` without impulses.
    pub fn q(&self, i: usize) -> LocalVector {
        self.problem.q[i]
    }

    /// Columns and scaled blocks of row `i`.
    pub fn row_blocks(&self, i: usize) -> impl Iterator<Item = (usize, &MatrixBlock)> {
        self.problem.row_blocks(i)
    }
}
