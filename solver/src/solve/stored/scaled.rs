//! A problem in units in which each diagonal block has trace 3.

use super::{Block, Problem, Triple};

/// W_ij s_i s_j, q_i s_i and r_i / s_i with s_i = (3 / trace W_ii)^1/2: one number a contact leaves the cones as they
/// are.
pub struct Scaled {
    problem: Problem,
    pub s: Vec<f64>,
    pub mu: Vec<f64>,
}

impl Scaled {
    pub fn new(problem: &Problem) -> Self {
        let s: Vec<f64> = problem
            .diagonal()
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
        Scaled { problem: scaled, s, mu: problem.mu.clone() }
    }

    /// Into the scaled units.
    pub fn impulses_in(&self, r: &[Triple]) -> Vec<Triple> {
        r.iter().zip(&self.s).map(|(r, s)| r.map(|x| x / s)).collect()
    }

    /// Out of the scaled units.
    pub fn impulses_out(&self, r: &[Triple]) -> Vec<Triple> {
        r.iter().zip(&self.s).map(|(r, s)| r.map(|x| x * s)).collect()
    }

    /// W r + q
    pub fn velocity(&self, r: &[Triple]) -> Vec<Triple> {
        self.problem.velocity(r)
    }

    pub fn q(&self, i: usize) -> Triple {
        self.problem.q[i]
    }

    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, &Block)> {
        self.problem.row(i)
    }
}
