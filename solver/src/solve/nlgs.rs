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
        let mut records = velocities(system, &impulses);
        let mut next_check = sweeps;
        let residual = loop {
            if sweeps >= next_check || sweeps >= max_sweeps {
                let residual = judge.residual(&impulses);
                if residual.value <= tol || sweeps >= max_sweeps {
                    break residual;
                }
                // A check costs about a sweep: seldom enough not to matter, often enough not to overshoot by much.
                next_check = sweeps + 2 + sweeps / 8;
            }
            sweep(system, &active, &mut impulses, &mut records);
            sweeps += 1;
        };
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

fn sweep(system: &System, active: &[u32], impulses: &mut [Vec3], records: &mut [Record]) {
    for &k in active {
        let row = &system.rows[k as usize];
        let r = &mut impulses[k as usize];
        let new = signorini_coulomb(row, &row.velocity(records), r);
        row.apply(records, &(new - *r));
        *r = new;
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
