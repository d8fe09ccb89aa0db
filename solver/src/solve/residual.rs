//! Judges a solution of the contact problem; never solves, and shares no arithmetic with what solves.
//!
//! E = |F(r)|/|F(0)| with the natural map F(r) = r - P_K(r - rho (û + mu |û_T| n)), rho = 3N/trace W, over
//! the contacts that can close in the step: 1 when nothing is solved, 0 exactly at a solution, the same
//! in any units and whatever the alert distance.
//!
//! Source: V. Acary, B. Brogliato, Numerical Methods for Nonsmooth Dynamical Systems (2008), ch. 13.

use pulp::NullaryFnOnce;
use rayon::prelude::*;

use crate::assemble::{Record, System};
use crate::math::Vec3;
use crate::math::lanes::{Lanes, Width};

/// Below this share of the bodies' own velocities a residual is their rounding: steps in which
/// nothing closes count as solved.
const FLOOR: f64 = 1e-15;

/// Contacts judged at once.
const EIGHT: usize = 8;

/// Groups of eight contacts that one task judges.
const TASK: usize = 128;

/// Eight contacts by columns; in the last group places are left over, without n, shift and friction.
#[derive(Debug, Clone, Copy)]
struct Eight {
    n: [[f64; EIGHT]; 3],
    shift: [[f64; EIGHT]; 3],
    /// From the centres of candidate and antagonist to the contact point, m.
    arms: [[[f64; EIGHT]; 3]; 2],
    friction: [f64; EIGHT],
    bodies: [[u32; EIGHT]; 2],
}

/// Velocity (m/s), 0, angular velocity (rad/s), 0 of a body; world frame.
pub type Motion = [f64; 8];

pub(super) fn motion(v: &Vec3, w: &Vec3) -> Motion {
    [v.x, v.y, v.z, 0.0, w.x, w.y, w.z, 0.0]
}

pub struct Judge<'a> {
    system: &'a System,
    pub(super) width: Width,
    /// Rows that are judged.
    rows: &'a [u32],
    contacts: Vec<Eight>,
    pub(super) rho: f64,
    at_zero: f64,
    floor: f64,
}

/// E and the row that has the largest part in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    pub value: f64,
    pub worst: Option<u32>,
}

impl<'a> Judge<'a> {
    pub fn new(system: &'a System, rows: &'a [u32], width: Width) -> Self {
        let contacts = rows.par_chunks(EIGHT).with_min_len(TASK).map(|rows| eight(system, rows)).collect();
        let of_some = |rows: &[u32]| {
            rows.iter().fold((0.0, 0.0), |(trace, speeds), &k| {
                let row = &system.rows[k as usize];
                let [a, b] = row.bodies.map(|i| system.records[i as usize].v.norm());
                (trace + row.w_n + 2.0 * row.w_t, speeds + (a + b) * (a + b))
            })
        };
        let parts: Vec<(f64, f64)> = rows.par_chunks(TASK * EIGHT).map(of_some).collect();
        let (trace, speeds) = parts.iter().fold((0.0, 0.0), |sum, part| (sum.0 + part.0, sum.1 + part.1));
        let rho = if rows.is_empty() { 0.0 } else { 3.0 * rows.len() as f64 / trace };
        let floor = FLOOR * rho * speeds.sqrt();
        let mut judge = Judge { system, width, rows, contacts, rho, at_zero: 0.0, floor };
        let free: Vec<Motion> = system.records.iter().map(|record| motion(&record.v, &record.w)).collect();
        judge.at_zero = judge.norm(&vec![Vec3::zeros(); system.rows.len()], &free).0;
        judge
    }

    /// Share of |F(0)| that is rounding.
    pub fn least(&self) -> f64 {
        if self.at_zero > 0.0 { self.floor / self.at_zero } else { 0.0 }
    }

    /// E of the impulses r̂ (one a row of the system, world frame, N s; 0 in rows that are not judged).
    pub fn residual(&self, impulses: &[Vec3]) -> Residual {
        self.residual_at(impulses, &self.motions(impulses))
    }

    /// The same, where the motions that the impulses lead to are known.
    pub fn residual_at(&self, impulses: &[Vec3], motions: &[Motion]) -> Residual {
        self.residual_with(impulses, motions, 0.0)
    }

    /// The same, with a further part `others` of |F|^2, N^2 s^2.
    pub(super) fn residual_with(&self, impulses: &[Vec3], motions: &[Motion], others: f64) -> Residual {
        let (norm, worst) = self.norm(impulses, motions);
        let norm = if others > 0.0 { (norm * norm + others).sqrt() } else { norm };
        if norm <= self.floor {
            return Residual { value: 0.0, worst: None };
        }
        Residual { value: norm / self.at_zero.max(self.floor), worst }
    }

    /// V_free + M⁻¹ H r̂ from the beginning.
    pub fn motions(&self, impulses: &[Vec3]) -> Vec<Motion> {
        // On each body the sums of the impulses and of their moments about its centre, in parts that the number of
        // contacts alone decides.
        let bodies = self.system.records.len();
        let half =
            if self.contacts.len() < TASK { self.contacts.len().max(1) } else { self.contacts.len().div_ceil(2) };
        let of_part = |(contacts, rows): (&[Eight], &[u32])| sums(contacts, rows, impulses, bodies);
        let parts: Vec<Vec<[f64; 6]>> =
            self.contacts.par_chunks(half).zip(self.rows.par_chunks(half * EIGHT)).map(of_part).collect();
        let moved = |(body, record): (usize, &Record)| {
            let mut sum = [0.0; 6];
            for part in &parts {
                (0..6).for_each(|k| sum[k] += part[body][k]);
            }
            let v = record.v + Vec3::new(sum[0], sum[1], sum[2]) * record.inverse_mass;
            let w = record.w + self.system.spin(body as u32, &Vec3::new(sum[3], sum[4], sum[5]));
            motion(&v, &w)
        };
        self.system.records.par_iter().with_min_len(TASK * EIGHT).enumerate().map(moved).collect()
    }

    /// The system's records with these motions.
    pub fn records(&self, motions: &[Motion]) -> Vec<Record> {
        let of = |(record, m): (&Record, &Motion)| Record {
            v: Vec3::new(m[0], m[1], m[2]),
            w: Vec3::new(m[4], m[5], m[6]),
            ..*record
        };
        self.system.records.par_iter().with_min_len(TASK * EIGHT).zip(motions).map(of).collect()
    }

    /// |F| and the row with the largest part in it.
    fn norm(&self, impulses: &[Vec3], motions: &[Motion]) -> (f64, Option<u32>) {
        let of_task = |(rows, contacts): (&[u32], &[Eight])| match self.width {
            Width::One(lanes) => self.judge(lanes, rows, contacts, impulses, motions),
            #[cfg(target_arch = "x86_64")]
            Width::Four(lanes) => self.judge(lanes, rows, contacts, impulses, motions),
            #[cfg(target_arch = "x86_64")]
            Width::Eight(lanes) => self.judge(lanes, rows, contacts, impulses, motions),
        };
        let tasks = self.rows.par_chunks(EIGHT * TASK).zip(self.contacts.par_chunks(TASK));
        let parts: Vec<(f64, f64, Option<u32>)> = tasks.map(of_task).collect();
        let (mut sum, mut largest, mut worst) = (0.0, 0.0, None);
        for (part, size2, row) in parts {
            sum += part;
            if size2 > largest {
                (largest, worst) = (size2, row);
            }
        }
        (sum.sqrt(), worst)
    }

    /// Sum of |F|^2 of some contacts, the largest and its row.
    fn judge<L: Lanes>(
        &self,
        lanes: L,
        rows: &[u32],
        contacts: &[Eight],
        impulses: &[Vec3],
        motions: &[Motion],
    ) -> (f64, f64, Option<u32>) {
        let (mut sum, mut largest, mut worst) = (0.0, 0.0, None);
        let mut sizes2 = [0.0; EIGHT * TASK];
        lanes.run(Map { lanes, rows, contacts, impulses, motions, rho: self.rho, sizes2: &mut sizes2 });
        for (&k, size2) in rows.iter().zip(sizes2) {
            sum += size2;
            if size2 > largest {
                (largest, worst) = (size2, Some(k));
            }
        }
        (sum, largest, worst)
    }
}

/// On each of `bodies` the sums of the impulses and of their moments about its centre.
fn sums(contacts: &[Eight], rows: &[u32], impulses: &[Vec3], bodies: usize) -> Vec<[f64; 6]> {
    let mut sums = vec![[0.0; 6]; bodies];
    for (eight, rows) in contacts.iter().zip(rows.chunks(EIGHT)) {
        for (lane, &k) in rows.iter().enumerate() {
            let r = &impulses[k as usize];
            for (side, sign) in [(0, 1.0), (1, -1.0)] {
                let sum = &mut sums[eight.bodies[side][lane] as usize];
                let [x, y, z] = [0, 1, 2].map(|axis| eight.arms[side][axis][lane]);
                let moment = [y * r.z - z * r.y, z * r.x - x * r.z, x * r.y - y * r.x];
                for axis in 0..3 {
                    sum[axis] += sign * r[axis];
                    sum[3 + axis] += sign * moment[axis];
                }
            }
        }
    }
    sums
}

fn eight(system: &System, rows: &[u32]) -> Eight {
    let zero = [0.0; EIGHT];
    let (three, bodies) = ([zero; 3], [[0; EIGHT]; 2]);
    let mut eight = Eight { n: three, shift: three, arms: [three; 2], friction: zero, bodies };
    for (lane, &k) in rows.iter().enumerate() {
        let row = &system.rows[k as usize];
        for axis in 0..3 {
            eight.n[axis][lane] = row.normal[axis];
            eight.shift[axis][lane] = row.shift[axis];
        }
        eight.friction[lane] = row.friction;
        for side in 0..2 {
            eight.bodies[side][lane] = row.bodies[side];
            let arm = system.arm(k as usize, side);
            for axis in 0..3 {
                eight.arms[side][axis][lane] = arm[axis];
            }
        }
    }
    eight
}

/// |F|^2 of contacts, N^2 s^2.
struct Map<'a, L> {
    lanes: L,
    rows: &'a [u32],
    contacts: &'a [Eight],
    impulses: &'a [Vec3],
    motions: &'a [Motion],
    rho: f64,
    sizes2: &'a mut [f64],
}

impl<L: Lanes> NullaryFnOnce for Map<'_, L> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let Map { lanes: l, rows, contacts, impulses, motions, rho, sizes2 } = self;
        for ((eight, rows), sizes2) in contacts.iter().zip(rows.chunks(EIGHT)).zip(sizes2.chunks_mut(EIGHT)) {
            let mut r = [[0.0; EIGHT]; 3];
            for (lane, &k) in rows.iter().enumerate() {
                let impulse = &impulses[k as usize];
                (r[0][lane], r[1][lane], r[2][lane]) = (impulse.x, impulse.y, impulse.z);
            }
            for from in (0..EIGHT).step_by(L::WIDTH) {
                natural_map2(l, eight, &r, motions, rho, from, &mut sizes2[from..]);
            }
        }
    }
}

/// Stores |F|^2 of `WIDTH` contacts from the place `from` on. In the plane of n and the tangential part of r - rho û,
/// where the projection lies too, no frame is needed.
#[inline(always)]
fn natural_map2<L: Lanes>(
    l: L,
    eight: &Eight,
    r: &[[f64; EIGHT]; 3],
    motions: &[Motion],
    rho: f64,
    from: usize,
    size2: &mut [f64],
) {
    let places = from..from + L::WIDTH;
    let mut n = [l.splat(0.0); 3];
    let mut u = n;
    let mut impulse = n;
    let a = l.gather(motions, &eight.bodies[0][places.clone()]);
    let b = l.gather(motions, &eight.bodies[1][places.clone()]);
    for k in 0..3 {
        n[k] = l.load(&eight.n[k][places.clone()]);
        impulse[k] = l.load(&r[k][places.clone()]);
    }
    for (k, u) in u.iter_mut().enumerate() {
        let shift = l.load(&eight.shift[k][places.clone()]);
        *u = l.add(l.sub(at_point(l, eight, &a, 0, k, from), at_point(l, eight, &b, 1, k, from)), shift);
    }
    let (zero, rho, mu) = (l.splat(0.0), l.splat(rho), l.load(&eight.friction[places]));
    let u_n = product(l, n, u);
    let mut z = n;
    let mut u_t2 = zero;
    for k in 0..3 {
        z[k] = l.sub(impulse[k], l.mul(rho, u[k]));
        let u_t = l.sub(u[k], l.mul(n[k], u_n));
        u_t2 = l.add(u_t2, l.mul(u_t, u_t));
    }
    let along = product(l, n, z);
    for k in 0..3 {
        z[k] = l.sub(z[k], l.mul(n[k], along));
    }
    let z_n = l.sub(along, l.mul(l.mul(rho, mu), l.sqrt(u_t2)));
    let size = l.sqrt(product(l, z, z));
    let (p_n, p_t) = project_on_cone(l, z_n, size, mu);
    let share = l.select_greater(size, zero, l.div(p_t, size), zero);
    let mut sum = zero;
    for k in 0..3 {
        let f = l.sub(l.sub(impulse[k], l.mul(n[k], p_n)), l.mul(z[k], share));
        sum = l.add(sum, l.mul(f, f));
    }
    l.store(size2, sum);
}

/// Component k of v + w x arm of the bodies on one side.
#[inline(always)]
fn at_point<L: Lanes>(l: L, eight: &Eight, motion: &[L::V; 8], side: usize, k: usize, from: usize) -> L::V {
    let (i, j) = ((k + 1) % 3, (k + 2) % 3);
    let arm_i = l.load(&eight.arms[side][i][from..from + L::WIDTH]);
    let arm_j = l.load(&eight.arms[side][j][from..from + L::WIDTH]);
    l.add(motion[k], l.sub(l.mul(motion[4 + i], arm_j), l.mul(motion[4 + j], arm_i)))
}

#[inline(always)]
fn product<L: Lanes>(l: L, a: [L::V; 3], b: [L::V; 3]) -> L::V {
    l.add(l.add(l.mul(a[0], b[0]), l.mul(a[1], b[1])), l.mul(a[2], b[2]))
}

/// The nearest point of Coulomb's cone { |r_T| <= mu r_n } to a vector of normal part `z_n` and of
/// tangential size `z_t` >= 0: its normal part and its tangential size.
///
/// ```
/// # use cd_solve::{math::lanes::Scalar, solve::residual::project_on_cone};
/// assert_eq!(project_on_cone(Scalar, 2.0, 1.0, 1.0), (2.0, 1.0)); // inside
/// assert_eq!(project_on_cone(Scalar, -2.0, 1.0, 1.0), (0.0, 0.0)); // in the polar cone
/// assert_eq!(project_on_cone(Scalar, 0.0, 2.0, 1.0), (1.0, 1.0)); // on the side
/// ```
#[inline(always)]
pub fn project_on_cone<L: Lanes>(l: L, z_n: L::V, z_t: L::V, mu: L::V) -> (L::V, L::V) {
    let (zero, one) = (l.splat(0.0), l.splat(1.0));
    let side = l.div(l.add(z_n, l.mul(mu, z_t)), l.add(one, l.mul(mu, mu)));
    let below = l.sub(zero, z_n);
    let normal = l.select_greater(l.mul(mu, z_t), below, side, zero);
    let edge = l.mul(mu, z_n);
    (l.select_greater(z_t, edge, normal, z_n), l.select_greater(z_t, edge, l.mul(mu, normal), z_t))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::lanes::Scalar;
    use proptest::prelude::*;

    proptest! {
        /// The projection is in the cone and no nearby point of the cone is nearer.
        #[test]
        fn projection_is_the_nearest_point(z_n in -5.0..5.0f64, z_t in 0.0..5.0f64, mu in 0.0..2.0f64, tries in prop::collection::vec((0.0..6.0f64, 0.0..1.0f64), 50)) {
            let (p_n, p_t) = project_on_cone(Scalar, z_n, z_t, mu);
            // Rounding of numbers up to 10.
            prop_assert!(p_t <= mu * p_n + 1e-14);
            for (normal, share) in tries {
                let distance = |n: f64, t: f64| (z_n - n).hypot(z_t - t);
                prop_assert!(distance(p_n, p_t) <= distance(normal, mu * normal * share) + 1e-13);
            }
        }
    }
}
