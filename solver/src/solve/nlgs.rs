//! Nonlinear Gauss-Seidel: sweeps over the contacts, each solved exactly against the bodies' current
//! velocities, which change at once.
//!
//! Sources: M. Jean (1999); F. Jourdan, P. Alart, M. Jean (1998).

use crate::assemble::{Record, System};
use crate::math::Vec3;
use crate::solve::local::signorini_coulomb;
use crate::solve::residual::{Judge, velocities};

/// Impulses r̂ of all rows (world frame, N s), the velocities they lead to, and how good they are.
pub struct Solution {
    pub impulses: Vec<Vec3>,
    pub records: Vec<Record>,
    pub sweeps: u64,
    /// E of [`crate::solve::residual`].
    pub residual: f64,
    pub converged: bool,
    /// Row with the largest part in the residual.
    pub worst: Option<u32>,
    /// Rows that took part.
    pub active: usize,
}

/// Largest share of the last change that is carried on where there is friction: uncapped momentum
/// bounces on dense frictional packings; 0.7 to 0.85 are alike. Without friction the problem is convex
/// and needs no cap.
const FRICTIONAL_CAP: f64 = 0.8;

/// Solves to E <= `tol`, or stops after `max_sweeps`.
///
/// Only rows that can close within the step are swept. A row left out that the solution would close
/// nevertheless - a body may become faster than its free velocity - is taken in, and sweeping goes on.
pub fn nlgs(system: &System, tol: f64, max_sweeps: u64) -> Solution {
    let mut active: Vec<u32> = (0..system.rows.len() as u32).filter(|&k| system.rows[k as usize].can_close).collect();
    let mut impulses = vec![Vec3::zeros(); system.rows.len()];
    for &k in &active {
        impulses[k as usize] = system.rows[k as usize].start;
    }
    let mut sweeps = 0;
    loop {
        let judge = Judge::new(system, &active);
        let mut iteration = Iteration::new(system, &active, impulses);
        let mut next_check = sweeps;
        let residual = loop {
            if sweeps >= next_check || sweeps >= max_sweeps {
                let residual = judge.residual(&iteration.impulses);
                if residual.value <= tol || sweeps >= max_sweeps {
                    break residual;
                }
                // A check costs about a sweep: seldom enough not to matter, often enough not to overshoot by much.
                next_check = sweeps + 2 + sweeps / 8;
            }
            iteration.sweep();
            sweeps += 1;
        };
        impulses = iteration.impulses;
        // From the impulses anew: the records have gathered the sweeps' rounding.
        let records = velocities(system, &impulses);
        let missed = closing_outside(system, &active, &records);
        if missed.is_empty() || sweeps >= max_sweeps {
            return Solution {
                impulses,
                records,
                sweeps,
                residual: residual.value,
                converged: residual.value <= tol && missed.is_empty(),
                worst: residual.worst.or(missed.first().copied()),
                active: active.len(),
            };
        }
        active.extend(missed);
        active.sort_unstable();
    }
}

/// Sweeps with momentum: each starts from y = r + beta (r - r_previous), beta growing as Nesterov's
/// up to a cap and from 0 again when the last change points uphill.
///
/// Sources: Y. Nesterov, Soviet Math. Dokl. 27 (1983) 372-376; B. O'Donoghue, E. Candes, Found. Comput.
/// Math. 15 (2015) 715-732 (restart); H. Mazhar et al., ACM Trans. Graph. 34 (2015) (in contact dynamics).
struct Iteration<'a> {
    system: &'a System,
    active: &'a [u32],
    impulses: Vec<Vec3>,
    previous: Vec<Vec3>,
    records: Vec<Record>,
    previous_records: Vec<Record>,
    t: f64,
    beta: f64,
    cap: f64,
}

impl<'a> Iteration<'a> {
    fn new(system: &'a System, active: &'a [u32], impulses: Vec<Vec3>) -> Self {
        let records = velocities(system, &impulses);
        let frictional = active.iter().any(|&k| system.rows[k as usize].friction > 0.0);
        Iteration {
            system,
            active,
            previous: impulses.clone(),
            impulses,
            previous_records: records.clone(),
            records,
            t: 1.0,
            beta: 0.0,
            cap: if frictional { FRICTIONAL_CAP } else { 1.0 },
        }
    }

    fn sweep(&mut self) {
        let beta = self.beta;
        // The velocities are linear in the impulses: carrying them on is one pass over the bodies.
        for (record, previous) in self.records.iter_mut().zip(&mut self.previous_records) {
            let (v, w) = (record.v, record.w);
            record.v += (v - previous.v) * beta;
            record.w += (w - previous.w) * beta;
            (previous.v, previous.w) = (v, w);
        }
        let mut uphill = 0.0;
        for &k in self.active {
            let row = &self.system.rows[k as usize];
            let (r, previous) = (&mut self.impulses[k as usize], &mut self.previous[k as usize]);
            let start = *r + (*r - *previous) * beta;
            let new = signorini_coulomb(row, &row.velocity(&self.records), &start);
            row.apply(&mut self.records, &(new - start));
            uphill += row.w_n * (start - new).dot(&(new - *r));
            *previous = *r;
            *r = new;
        }
        if uphill > 0.0 {
            (self.t, self.beta) = (1.0, 0.0);
        } else {
            let t = 0.5 * (1.0 + (1.0 + 4.0 * self.t * self.t).sqrt());
            self.beta = ((self.t - 1.0) / t).min(self.cap);
            self.t = t;
        }
    }
}

/// Rows outside `active` (sorted) that these velocities close.
fn closing_outside(system: &System, active: &[u32], records: &[Record]) -> Vec<u32> {
    let mut inside = active.iter().peekable();
    (0..system.rows.len() as u32)
        .filter(|k| inside.next_if_eq(&k).is_none())
        .filter(|&k| {
            let row = &system.rows[k as usize];
            row.normal.dot(&row.velocity(records)) < 0.0
        })
        .collect()
}
