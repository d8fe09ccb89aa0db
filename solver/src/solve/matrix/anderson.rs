//! Anderson's acceleration of a fixed point iteration, with a safeguard.
//!
//! Source: H. Walker, P. Ni, SIAM J. Numer. Anal. 49 (2011) 1715-1735.

use super::types::LocalVector;

/// Anderson's acceleration of x -> g(x). From the residuals f = g - x of the last iterates the next iterate is g - dG y, with
/// y the least squares solution of dF y = f, d the differences between consecutive iterates.
pub struct AndersonAcceleration {
    /// Length of the history.
    depth: usize,
    /// Differences of f and of g, a ring of `depth` entries.
    df: Vec<Vec<f64>>,
    dg: Vec<Vec<f64>>,
    /// Gram matrix dF' dF.
    gram: Vec<Vec<f64>>,
    /// f and g of the last iterate.
    f: Vec<f64>,
    g: Vec<f64>,
    /// Number of iterates since the last restart.
    iterates: usize,
    /// |f| of the last iterate that was kept.
    norm: f64,
}

/// Growth of |f| beyond which the history is dropped, relative to the last kept |f|.
const MAX_RESIDUAL_GROWTH: f64 = 1.5;

impl AndersonAcceleration {
    /// Acceleration with a history of `depth` differences, none if 0, for `n` numbers.
    pub fn new(depth: usize, n: usize) -> Self {
        let ring = || vec![vec![0.0; n]; depth];
        let (f, g) = (vec![0.0; n], vec![0.0; n]);
        AndersonAcceleration {
            depth,
            df: ring(),
            dg: ring(),
            gram: vec![vec![0.0; depth]; depth],
            f,
            g,
            iterates: 0,
            norm: 0.0,
        }
    }

    /// Drops the history.
    pub fn clear_history(&mut self) {
        self.iterates = 0;
    }

    /// Replaces `x` by the next iterate; returns |g - x|.
    pub fn next_iterate(&mut self, x: &mut [LocalVector], g: &[LocalVector]) -> f64 {
        let norm = norm_of_difference(g.as_flattened(), x.as_flattened());
        if self.depth == 0 {
            x.copy_from_slice(g);
            return norm;
        }
        let (x, g) = (x.as_flattened_mut(), g.as_flattened());
        if self.iterates > 0 && norm > MAX_RESIDUAL_GROWTH * self.norm {
            // Return to the plain result of the last sweep.
            self.iterates = 0;
            x.copy_from_slice(&self.g);
            return norm;
        }
        self.norm = norm;
        let slot = self.iterates.wrapping_sub(1) % self.depth;
        for k in 0..x.len() {
            let f = g[k] - x[k];
            if self.iterates > 0 {
                self.df[slot][k] = f - self.f[k];
                self.dg[slot][k] = g[k] - self.g[k];
            }
            (self.f[k], self.g[k]) = (f, g[k]);
        }
        x.copy_from_slice(g);
        let columns = self.iterates.min(self.depth);
        self.iterates += 1;
        if columns == 0 {
            return norm;
        }
        for k in 0..columns {
            let value = dot_product(&self.df[slot], &self.df[k]);
            (self.gram[slot][k], self.gram[k][slot]) = (value, value);
        }
        let right_side: Vec<f64> = self.df[..columns].iter().map(|d| dot_product(d, &self.f)).collect();
        for (y, dg) in solve_gram(&self.gram, right_side).iter().zip(&self.dg) {
            x.iter_mut().zip(dg).for_each(|(x, d)| *x -= y * d);
        }
        norm
    }
}

fn dot_product(a: &[f64], b: &[f64]) -> f64 {
    // Eight sums, so that a compiler can keep them in vectors.
    let mut sums = [0.0; 8];
    let (a8, b8) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = a8.remainder().iter().zip(b8.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a8.zip(b8) {
        (0..8).for_each(|k| sums[k] += a[k] * b[k]);
    }
    sums.iter().sum::<f64>() + rest
}

fn norm_of_difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

/// Added to the diagonal of the scaled Gram matrix: more than the rounding of its sums.
const GRAM_REGULARISATION: f64 = 1e-14;

/// Square root of a pivot below which a direction is lost in the regularisation.
const MIN_PIVOT: f64 = 1e-7;

/// y of G y = b by Cholesky's method for G scaled to a diagonal of 1; directions that are lost in rounding get 0.
fn solve_gram(gram: &[Vec<f64>], mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    let scale: Vec<f64> = (0..n).map(|k| if gram[k][k] > 0.0 { gram[k][k].sqrt().recip() } else { 0.0 }).collect();
    let mut l = vec![vec![0.0; n]; n];
    for i in 0..n {
        b[i] *= scale[i];
        for j in 0..=i {
            let sum: f64 = gram[i][j] * scale[i] * scale[j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
            l[i][j] = match i == j {
                true => (sum + GRAM_REGULARISATION).max(0.0).sqrt(),
                false if l[j][j] > 0.0 => sum / l[j][j],
                false => 0.0,
            };
        }
        let sum: f64 = (0..i).map(|k| l[i][k] * b[k]).sum();
        b[i] = if l[i][i] > MIN_PIVOT { (b[i] - sum) / l[i][i] } else { 0.0 };
    }
    for i in (0..n).rev() {
        let sum: f64 = (i + 1..n).map(|k| l[k][i] * b[k]).sum();
        b[i] = if l[i][i] > MIN_PIVOT { (b[i] - sum) / l[i][i] } else { 0.0 };
    }
    b.iter().zip(scale).map(|(b, s)| b * s).collect()
}
