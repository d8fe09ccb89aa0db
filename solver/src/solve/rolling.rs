//! Contacts with rolling and spinning friction: Gauss-Seidel sweeps in which a contact's moment follows its impulse.
//!
//! With the other impulses frozen the moment m of two spheres sees their relative angular velocity w = W_r m + b, W_r =
//! 1/I_a + 1/I_b. Its part in the tangent plane resists rolling and is at most mu_r R r̂_n, its part along n resists
//! spinning and is at most mu_s R r̂_n; below these bounds nothing rolls or spins, at them the moment is opposite to
//! w_T, or to w_n. As Coulomb's law of the sliding friction, with r̂_n of the same contact, just solved.
//!
//! A scene without such contacts never comes here.

use crate::assemble::{Record, Roll, System};
use crate::math::Vec3;
use crate::math::lanes::{Scalar, Width};
use crate::solve::local::signorini_coulomb;
use crate::solve::nlgs::{Momentum, Solution, Until, closing_outside};
use crate::solve::residual::{Judge, Residual};

/// Solves until E is reached or all sweeps are spent, as [`crate::solve::nlgs`].
pub fn nlgs(system: &System, until: Until, width: Width) -> Solution {
    let Until { tol, max_sweeps, .. } = until;
    let mut active: Vec<u32> = (0..system.rows.len() as u32).filter(|&k| system.rows[k as usize].can_close).collect();
    let mut sweeper = Sweeper::new(system);
    sweeper.start(&active);
    let mut sweeps = 0;
    loop {
        let judge = Judge::new(system, &active, width);
        let residual = sweep_until(&mut sweeper, &judge, &active, until, &mut sweeps);
        let records = sweeper.exact_records(&judge);
        let missed = closing_outside(system, &active, &records);
        if missed.is_empty() || sweeps >= max_sweeps {
            return Solution {
                impulses: sweeper.r,
                moments: sweeper.m,
                records,
                sweeps,
                residual: residual.value,
                converged: residual.value <= tol && missed.is_empty(),
                worst: residual.worst.or(missed.first().copied()),
                active: active.len(),
                taken_over: false,
                replaced: None,
            };
        }
        active.extend(missed);
        active.sort_unstable();
    }
}

/// Judging costs about two sweeps.
const JUDGED_EVERY: u64 = 4;

fn sweep_until(sweeper: &mut Sweeper, judge: &Judge, active: &[u32], until: Until, sweeps: &mut u64) -> Residual {
    let Until { tol, max_sweeps, check_every } = until;
    let first = *sweeps;
    let mut momentum = Momentum::new(sweeper.system.rows.iter().any(|row| row.friction > 0.0));
    let mut best: Option<(Residual, Vec<Vec3>, Vec<Vec3>)> = None;
    sweeper.rest(judge);
    loop {
        let due = match check_every {
            Some(block) => *sweeps > first && (*sweeps - first).is_multiple_of(block),
            None => sweeps.is_multiple_of(JUDGED_EVERY),
        };
        if due || *sweeps >= max_sweeps {
            let residual = judge.residual_with(&sweeper.r, &sweeper.m, &judge.motions_with(&sweeper.r, &sweeper.m));
            if best.as_ref().is_none_or(|best| residual.value < best.0.value) {
                best = Some((residual, sweeper.r.clone(), sweeper.m.clone()));
            }
            if residual.value <= tol || *sweeps >= max_sweeps {
                break;
            }
        }
        let (uphill, change) = sweeper.sweep(active, momentum.beta);
        momentum.after(uphill, change);
        *sweeps += 1;
    }
    let (residual, r, m) = best.unwrap_or((Residual { value: f64::INFINITY, worst: None }, vec![], vec![]));
    (sweeper.r, sweeper.m) = (r, m);
    residual
}

/// Impulses, moments and the velocities that they lead to, now and a sweep before.
struct Sweeper<'a> {
    system: &'a System,
    /// Place of each row's roll.
    rolls: Vec<Option<usize>>,
    r: Vec<Vec3>,
    /// One for each of the system's rolls, N m s, world frame, on the candidate.
    m: Vec<Vec3>,
    before: (Vec<Vec3>, Vec<Vec3>),
    records: Vec<Record>,
    records_before: Vec<Record>,
}

impl<'a> Sweeper<'a> {
    fn new(system: &'a System) -> Self {
        let mut rolls = vec![None; system.rows.len()];
        system.rolls.iter().enumerate().for_each(|(place, roll)| rolls[roll.row as usize] = Some(place));
        let (r, m) = (vec![Vec3::zeros(); system.rows.len()], vec![Vec3::zeros(); system.rolls.len()]);
        let records = system.records.clone();
        let before = (r.clone(), m.clone());
        Sweeper { system, rolls, r, m, before, records_before: records.clone(), records }
    }

    /// The warm start.
    fn start(&mut self, active: &[u32]) {
        for &k in active {
            self.r[k as usize] = self.system.rows[k as usize].start;
        }
        for (m, roll) in self.m.iter_mut().zip(&self.system.rolls) {
            *m = if self.r[roll.row as usize] == Vec3::zeros() { Vec3::zeros() } else { roll.start };
        }
    }

    /// V_free + M⁻¹ (H r + m) from the beginning.
    fn exact_records(&self, judge: &Judge) -> Vec<Record> {
        judge.records(&judge.motions_with(&self.r, &self.m))
    }

    /// Takes the last change away: the next sweep has no momentum.
    fn rest(&mut self, judge: &Judge) {
        self.records = self.exact_records(judge);
        self.records_before.clone_from(&self.records);
        self.before = (self.r.clone(), self.m.clone());
    }

    /// Sweeps the rows `active` from y = r + beta (r - r_before); whether the change points uphill, and its size, N s.
    fn sweep(&mut self, active: &[u32], beta: f64) -> (bool, f64) {
        let Sweeper { system, rolls, r, m, before, records, records_before } = self;
        for (record, before) in records.iter_mut().zip(records_before) {
            let now = *record;
            record.v += (now.v - before.v) * beta;
            record.w += (now.w - before.w) * beta;
            *before = now;
        }
        let (mut uphill, mut change2) = (0.0, 0.0);
        for &k in active {
            let (row, k) = (&system.rows[k as usize], k as usize);
            let y = r[k] + (r[k] - before.0[k]) * beta;
            let u = row.velocity(records);
            let new =
                signorini_coulomb(Scalar, row.normal.into(), u.into(), y.into(), [row.w_n, row.w_t], row.friction);
            let new = Vec3::from(new);
            row.apply(records, &(new - y));
            uphill -= row.w_n * (new - y).dot(&(new - r[k]));
            change2 += (new - y).norm_squared();
            (before.0[k], r[k]) = (r[k], new);
            let Some(place) = rolls[k] else { continue };
            let roll = &system.rolls[place];
            let y = m[place] + (m[place] - before.1[place]) * beta;
            let new = roll.solve(row.normal, roll.velocity(system, records), y, row.normal.dot(&new));
            roll.apply(system, records, &(new - y));
            (before.1[place], m[place]) = (m[place], new);
        }
        (uphill > 0.0, change2.sqrt())
    }
}

impl Roll {
    /// Angular velocity of the candidate against the antagonist, rad/s.
    fn velocity(&self, system: &System, records: &[Record]) -> Vec3 {
        let [a, b] = system.rows[self.row as usize].bodies.map(|i| &records[i as usize]);
        a.w - b.w + self.shift
    }

    /// Gives the candidate the moment `m` and the antagonist -m, N m s.
    fn apply(&self, system: &System, records: &mut [Record], m: &Vec3) {
        let [a, b] = system.rows[self.row as usize].bodies.map(|i| i as usize);
        let inverse = records[a].inverse_inertia;
        records[a].w += m * inverse;
        let inverse = records[b].inverse_inertia;
        records[b].w -= m * inverse;
    }

    /// The moment that solves this contact: `w` is the relative angular velocity with `m` at work.
    fn solve(&self, n: Vec3, w: Vec3, m: Vec3, r_n: f64) -> Vec3 {
        self.project(n, m - w * self.inverse_w, r_n)
    }

    /// The nearest moment within the bounds of a normal impulse `r_n`.
    fn project(&self, n: Vec3, m: Vec3, r_n: f64) -> Vec3 {
        let along = n.dot(&m);
        let across = m - n * along;
        let (spin, roll) = (self.spinning * self.radius * r_n, self.rolling * self.radius * r_n);
        let size = across.norm();
        let across = if size > roll { across * (roll / size) } else { across };
        n * along.max(-spin).min(spin) + across
    }
}
