//! Nonlinear Gauss-Seidel over stored blocks, plain and with Anderson's acceleration.
//!
//! Sources: M. Jean, Comput. Methods Appl. Mech. Engrg. 177 (1999) 235-257; H. Walker, P. Ni, SIAM J.
//! Numer. Anal. 49 (2011) 1715-1735 (acceleration by differences of the last sweeps).

use super::{Local, Problem, Run, Triple};

/// Number of past sweeps that Anderson's acceleration combines.
pub const DEPTH: usize = 10;

/// Sweeps until the run is over.
pub fn nlgs(run: &mut Run, depth: usize) {
    let mut sweeper = Sweeper::new(run.problem);
    let mut anderson = Anderson::new(depth, 3 * run.problem.len());
    let mut x = run.best.0.clone();
    let mut g = x.clone();
    let mut patience = 0;
    let mut scale = None;
    while !run.is_over() {
        g.copy_from_slice(&x);
        sweeper.sweep(&mut g);
        run.sweeps += 1;
        patience += 1;
        let change = anderson.next(&mut x, &g);
        // Judging costs a sweep; the change of a sweep falls as the residual does and tells when.
        if scale.is_none_or(|scale| change <= scale) || patience > 10 + run.sweeps / 4 {
            let residual = run.judge(&g);
            scale = Some(0.8 * change * run.limits.tol / residual);
            patience = 0;
        }
    }
}

/// A problem laid out for sweeping.
pub struct Sweeper<'a> {
    problem: &'a Problem,
    locals: Vec<Local>,
    /// Place of the diagonal block of each row.
    diagonal: Vec<usize>,
}

impl<'a> Sweeper<'a> {
    pub fn new(problem: &'a Problem) -> Self {
        let locals = problem.diagonal().zip(&problem.mu).map(|(w, &mu)| Local::new(w, mu)).collect();
        let diagonal = (0..problem.len())
            .filter_map(|i| (problem.starts[i]..problem.starts[i + 1]).find(|&k| problem.columns[k] as usize == i))
            .collect();
        Sweeper { problem, locals, diagonal }
    }

    /// Solves each contact in turn against the present impulses of the others.
    pub fn sweep(&mut self, r: &mut [Triple]) {
        let Problem { q, starts, columns, blocks, .. } = self.problem;
        for (i, local) in self.locals.iter().enumerate() {
            let mut u = q[i];
            for place in [starts[i]..self.diagonal[i], self.diagonal[i] + 1..starts[i + 1]] {
                for (w, &j) in blocks[place.clone()].iter().zip(&columns[place]) {
                    let r = &r[j as usize];
                    for k in 0..3 {
                        u[k] += w[k][0] * r[0] + w[k][1] * r[1] + w[k][2] * r[2];
                    }
                }
            }
            r[i] = local.solve(u);
        }
    }
}

/// Anderson's acceleration of x -> g(x): from the residuals f = g - x of the last iterates the next is
/// g - dG y with y the least squares solution of dF y = f, d the differences of one iterate to the next.
struct Anderson {
    depth: usize,
    /// Differences of f and of g, a ring of `depth`.
    df: Vec<Vec<f64>>,
    dg: Vec<Vec<f64>>,
    /// dF' dF
    gram: Vec<Vec<f64>>,
    f: Vec<f64>,
    g: Vec<f64>,
    /// Iterates seen since the last restart.
    seen: usize,
    /// |f| of the last iterate that was kept.
    norm: f64,
}

/// The history is dropped when |f| grows beyond this multiple of what it was.
const GROWTH: f64 = 2.0;

impl Anderson {
    fn new(depth: usize, n: usize) -> Self {
        let ring = || vec![vec![0.0; n]; depth];
        let (f, g) = (vec![0.0; n], vec![0.0; n]);
        Anderson { depth, df: ring(), dg: ring(), gram: vec![vec![0.0; depth]; depth], f, g, seen: 0, norm: 0.0 }
    }

    /// Replaces `x` by the next iterate; returns |g - x|.
    fn next(&mut self, x: &mut [Triple], g: &[Triple]) -> f64 {
        let norm = norm_of_difference(g.as_flattened(), x.as_flattened());
        if self.depth == 0 {
            x.copy_from_slice(g);
            return norm;
        }
        let (x, g) = (x.as_flattened_mut(), g.as_flattened());
        if self.seen > 0 && norm > GROWTH * self.norm {
            // Back to the last sweep's plain result.
            self.seen = 0;
            x.copy_from_slice(&self.g);
            return norm;
        }
        self.norm = norm;
        let slot = self.seen.wrapping_sub(1) % self.depth;
        for k in 0..x.len() {
            let f = g[k] - x[k];
            if self.seen > 0 {
                self.df[slot][k] = f - self.f[k];
                self.dg[slot][k] = g[k] - self.g[k];
            }
            (self.f[k], self.g[k]) = (f, g[k]);
        }
        x.copy_from_slice(g);
        let columns = self.seen.min(self.depth);
        self.seen += 1;
        if columns == 0 {
            return norm;
        }
        for k in 0..columns {
            let value = dot(&self.df[slot], &self.df[k]);
            (self.gram[slot][k], self.gram[k][slot]) = (value, value);
        }
        let right: Vec<f64> = self.df[..columns].iter().map(|d| dot(d, &self.f)).collect();
        for (y, dg) in solve_gram(&self.gram, right).iter().zip(&self.dg) {
            x.iter_mut().zip(dg).for_each(|(x, d)| *x -= y * d);
        }
        norm
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
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

/// y of G y = b by Cholesky's method for G scaled to a diagonal of 1 + 1e-14; directions that
/// rounding leaves nothing of get 0.
fn solve_gram(gram: &[Vec<f64>], mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    let scale: Vec<f64> = (0..n).map(|k| if gram[k][k] > 0.0 { gram[k][k].sqrt().recip() } else { 0.0 }).collect();
    let mut l = vec![vec![0.0; n]; n];
    for i in 0..n {
        b[i] *= scale[i];
        for j in 0..=i {
            let sum: f64 = gram[i][j] * scale[i] * scale[j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
            l[i][j] = match i == j {
                true => (sum + 1e-14).max(0.0).sqrt(),
                false if l[j][j] > 0.0 => sum / l[j][j],
                false => 0.0,
            };
        }
        let sum: f64 = (0..i).map(|k| l[i][k] * b[k]).sum();
        b[i] = if l[i][i] > 1e-7 { (b[i] - sum) / l[i][i] } else { 0.0 };
    }
    for i in (0..n).rev() {
        let sum: f64 = (i + 1..n).map(|k| l[k][i] * b[k]).sum();
        b[i] = if l[i][i] > 1e-7 { (b[i] - sum) / l[i][i] } else { 0.0 };
    }
    b.iter().zip(scale).map(|(b, s)| b * s).collect()
}
