//! LMGC90's stopping criteria, for comparison: the change by one more local solution of each contact.
//!
//! With r, u of contact k as they are and r', u' after one more solution of its local problem, du = u - u', m = (r + r')/2, W
//! its own block, and <> the mean over the contacts that act:
//!
//! ```text
//! Q² = <½ (|W r|² + |W r'|²)>,   M = <½ (r.W r + r'.W r')>
//! QuadDV  = sqrt <|du|²> / Q          MaxmDV  = max |du| / Q
//! QuadDVR = sqrt <|du|² |m|²> / M     MaxmDVR = max (|du| |m|) / M
//! MeanDVoR = <m.du> / M
//! ```
//!
//! LMGC90 divides each by its tolerance and stops when |MeanDVoR| < 1 and: `Quad `, both Quad < 1; `Maxm `, both Maxm <
//! 1; `QM/16`, both Quad < 1 and both Maxm < 16.666.
//!
//! Source: the names in LMGC90's output and its documented stopping test; M. Jean, Comput. Methods Appl. Mech. Engrg.
//! 177 (1999) 235-257, section 7.

use nalgebra::Matrix3;

use crate::assemble::{ContactProblem, SolverBody};
use crate::math::Vec3;
use crate::math::simd::Scalar;
use crate::solve::gauss_seidel::block;
use crate::solve::gauss_seidel::diagonal::local::signorini_coulomb;

/// Criteria before division by a tolerance; zeros if no contact acts.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Lmgc90Norms {
    pub quad_dv: f64,
    pub quad_dvr: f64,
    pub maxm_dv: f64,
    pub maxm_dvr: f64,
    pub mean_dvor: f64,
}

/// Scales below this count as no load, as in LMGC90.
const NEGLIGIBLE_SCALE: f64 = 1e-18;

/// Criteria for the impulses `impulses` (one per row, N s) and the velocities `solver_bodies` that result from them. As in a sweep,
/// each contact uses the velocities changed by those before it.
pub fn lmgc90_norms(problem: &ContactProblem, impulses: &[Vec3], solver_bodies: &[SolverBody]) -> Lmgc90Norms {
    let mut problem = ContactProblem { bodies: solver_bodies.to_vec(), ..problem.clone() };
    let (mut count, mut q2, mut m, mut mean) = (0, 0.0, 0.0, 0.0);
    let (mut dv2, mut dvr2, mut largest_dv, mut largest_dvr) = (0.0, 0.0, 0.0f64, 0.0f64);
    for (k, r) in impulses.iter().enumerate() {
        if !problem.rows[k].can_close {
            continue;
        }
        let u = problem.shifted_velocity(k, &problem.bodies);
        let (w, new) = solve_local_block(&problem, k, &u, r);
        problem.apply_impulse(k, &(new - r));
        let (change, middle) = (w * (r - new), (r + new) * 0.5);
        count += 1;
        q2 += 0.5 * ((w * r).norm_squared() + (w * new).norm_squared());
        m += 0.5 * (r.dot(&(w * r)) + new.dot(&(w * new)));
        mean += middle.dot(&change);
        let (dv, dvr) = (change.norm(), change.norm() * middle.norm());
        dv2 += dv * dv;
        dvr2 += dvr * dvr;
        largest_dv = largest_dv.max(dv);
        largest_dvr = largest_dvr.max(dvr);
    }
    let n = f64::from(count.max(1));
    let (q, m) = ((q2 / n).sqrt(), m / n);
    if count == 0 || q < NEGLIGIBLE_SCALE || m < NEGLIGIBLE_SCALE {
        return Lmgc90Norms::default();
    }
    Lmgc90Norms {
        quad_dv: (dv2 / n).sqrt() / q,
        quad_dvr: (dvr2 / n).sqrt() / m,
        maxm_dv: largest_dv / q,
        maxm_dvr: largest_dvr / m,
        mean_dvor: mean / n / m,
    }
}

/// Own block of row `k`, and the impulse that solves it alone, if û is `u` with the impulse `r`.
fn solve_local_block(problem: &ContactProblem, k: usize, u: &Vec3, r: &Vec3) -> (Matrix3<f64>, Vec3) {
    let row = &problem.rows[k];
    let n = row.normal;
    if let Some(bodies) = &problem.block_data {
        let w = block::local::delassus_block_of_row(problem, bodies, k);
        return (block::local::full_matrix(w), block::local::solve_contact_block(w, n, row.friction, u, r));
    }
    let along = n * n.transpose();
    let w = (Matrix3::identity() - along) * row.w_t + along * row.w_n;
    let new = signorini_coulomb(Scalar, n.into(), (*u).into(), (*r).into(), [row.w_n, row.w_t], row.friction);
    (w, new.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assemble::{BlockData, ContactConstraint};
    use crate::scene::BodyId;

    /// A body of 1/2 kg that does not turn, on the ground, under 3 N s, shared by the contacts.
    fn problem(contacts: u32) -> ContactProblem {
        let record = |v: Vec3, inverse_mass: f64| SolverBody {
            v,
            inverse_mass,
            w: Vec3::zeros(),
            inverse_inertia: 0.0,
            radius: 0.0,
        };
        let row = |_| ContactConstraint {
            bodies: [BodyId(0), BodyId(1)],
            normal: Vec3::z(),
            arm: 1.0,
            w_n: 2.0,
            w_t: 2.0,
            friction: 0.5,
            acts: true,
            can_close: true,
            ..ContactConstraint::default()
        };
        let solver_bodies = vec![record(Vec3::z() * -6.0, 2.0), record(Vec3::zeros(), 0.0)];
        ContactProblem {
            rows: (0..contacts).map(row).collect(),
            rolling_constraints: vec![],
            memories: vec![],
            pair_attractions: vec![],
            regularised: vec![],
            block_data: None,
            bodies: solver_bodies,
            order: vec![0, 1],
        }
    }

    fn velocities(problem: &ContactProblem, impulses: &[Vec3]) -> Vec<SolverBody> {
        let mut solver_bodies = problem.bodies.clone();
        problem.rows.iter().zip(impulses).for_each(|(row, r)| row.apply_impulse(&mut solver_bodies, r));
        solver_bodies
    }

    #[test]
    fn one_contact_by_hand() {
        let problem = problem(1);
        let solved = [Vec3::z() * 3.0];
        let velocities = |r: &[Vec3]| velocities(&problem, r);
        assert_eq!(lmgc90_norms(&problem, &solved, &velocities(&solved)), Lmgc90Norms::default());
        // From 1 N s the next local solution is 3: du = 2 (1 - 3) = -4, m = 2, Q² = ½ (2² + 6²) = 20, M = ½ (2 + 18) = 10.
        let early = [Vec3::z()];
        let found = lmgc90_norms(&problem, &early, &velocities(&early));
        let quad_dv = 4.0 / 20f64.sqrt();
        assert_eq!((found.quad_dv, found.maxm_dv), (quad_dv, quad_dv));
        assert_eq!((found.quad_dvr, found.maxm_dvr, found.mean_dvor), (0.8, 0.8, -0.8));
    }

    #[test]
    fn the_second_contact_sees_what_the_first_has_changed() {
        let problem = problem(2);
        let early = [Vec3::z(), Vec3::z()];
        let found = lmgc90_norms(&problem, &early, &velocities(&problem, &early));
        // The first contact takes all of the missing 1 N s and leaves none for the second. du = -2, m = 3/2.
        let (q, m) = (((0.5 * (4.0 + 16.0) + 4.0) / 2f64).sqrt(), (0.5 * (2.0 + 8.0) + 2.0) / 2.0);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-15, "{a} {b}"); // a few roundings
        near(found.quad_dv, 2f64.sqrt() / q);
        near(found.maxm_dv, 2.0 / q);
        near(found.quad_dvr, (9.0 / 2f64).sqrt() / m);
        near(found.maxm_dvr, 3.0 / m);
        near(found.mean_dvor, -1.5 / m);
    }

    #[test]
    fn a_sphere_is_a_body_of_any_shape() {
        // Arms along the normal and equal moments of inertia make the diagonal block of a sphere.
        let mut sphere = problem(1);
        sphere.rows[0].w_t = 2.0 + 5.0;
        (sphere.bodies[0].radius, sphere.bodies[0].inverse_inertia) = (1.0, 5.0);
        (sphere.bodies[0].v, sphere.bodies[0].w) = (Vec3::new(0.5, -1.0, -6.0), Vec3::new(0.3, 0.2, 0.1));
        let inverse_inertia = vec![Matrix3::identity() * 5.0, Matrix3::zeros()];
        let block_data = BlockData {
            arms: vec![[-Vec3::z(), Vec3::zeros()]],
            friction_offsets: vec![],
            locked_axes: vec![],
            inverse_inertia,
        };
        let other = ContactProblem { block_data: Some(block_data), ..sphere.clone() };
        let early = [Vec3::new(0.1, 0.2, 1.0)];
        let (a, b) = (lmgc90_norms(&sphere, &early, &sphere.bodies), lmgc90_norms(&other, &early, &other.bodies));
        for (a, b) in
            [(a.quad_dv, b.quad_dv), (a.quad_dvr, b.quad_dvr), (a.maxm_dvr, b.maxm_dvr), (a.mean_dvor, b.mean_dvor)]
        {
            assert!(a != 0.0 && (a - b).abs() < 1e-14, "{a} {b}"); // some roundings
        }
    }
}
