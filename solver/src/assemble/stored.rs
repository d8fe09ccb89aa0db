//! Contact problem of one step written out with its Delassus matrix, for inspection or for other solvers.

use super::problem::ContactProblem;
use crate::math::{Vec3, to_local};
use crate::scene::BodyId;
use crate::state::{Contact, ContactId};

/// Problem û = W r̂ + q with Signorini and Coulomb on (û, r̂), components along n, t, s of each contact: û and r̂ are the
/// relative velocity and the impulse with the shifts of the contact's law.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StoredProblem {
    pub mu: Vec<f64>,
    /// û if every r̂ were 0, m/s.
    pub q: Vec<[f64; 3]>,
    /// Blocks (i, j, w): response w of û of contact i to unit impulses at contact j, 1/kg; those not listed are 0.
    pub blocks: Vec<(usize, usize, [[f64; 3]; 3])>,
    /// Row of the system and frame (n, t, s) of each contact.
    pub rows: Vec<(ContactId, [Vec3; 3])>,
}

/// Problem of the contacts that can close, in the order of the contacts.
pub fn stored_problem(contact_problem: &ContactProblem, contacts: &[Contact]) -> StoredProblem {
    let rows: Vec<usize> = (0..contact_problem.rows.len()).filter(|&k| contact_problem.rows[k].can_close).collect();
    // Bodies that do not move couple no contacts: the contacts of a floor are not paired.
    let is_movable = |body: &&BodyId| contact_problem.bodies[body.index()].inverse_mass > 0.0;
    let mut on_body = vec![Vec::new(); contact_problem.bodies.len()];
    for (i, &k) in rows.iter().enumerate() {
        contact_problem.rows[k].bodies.iter().filter(is_movable).for_each(|&body| on_body[body.index()].push(i));
    }
    let mut problem = StoredProblem::default();
    for (i, &row) in rows.iter().enumerate() {
        let constraint = &contact_problem.rows[row];
        let frame = &contacts[row].frame();
        problem.rows.push((ContactId::new(row), *frame));
        problem.mu.push(constraint.friction);
        problem.q.push(to_local(frame, &contact_problem.shifted_velocity(row, &contact_problem.bodies)).into());
        let mut neighbours: Vec<usize> =
            constraint.bodies.iter().flat_map(|&body| &on_body[body.index()]).copied().collect();
        neighbours.sort_unstable();
        neighbours.dedup();
        for j in neighbours {
            let other = &contacts[rows[j]].frame();
            // Column k: response at contact i to a unit impulse along axis k of contact j.
            let columns =
                [0, 1, 2].map(|k| to_local(frame, &velocity_response(contact_problem, row, rows[j], &other[k])));
            if columns.iter().any(|column| column.norm_squared() > 0.0) {
                problem.blocks.push((i, j, [0, 1, 2].map(|a| [0, 1, 2].map(|k| columns[k][a]))));
            }
        }
    }
    problem
}

/// Change of velocity at `row` by the impulse `r` at `other_row`, world frame, m/s.
fn velocity_response(contact_problem: &ContactProblem, row: usize, other_row: usize, r: &Vec3) -> Vec3 {
    let sides = [(0, 1.0), (1, -1.0)];
    let body_of = |row: usize, side: usize| contact_problem.rows[row].bodies[side];
    let mut change = Vec3::zeros();
    for (side, sign) in sides {
        let body = body_of(row, side);
        for (pushed_side, pushed_sign) in sides.into_iter().filter(|(other, _)| body_of(other_row, *other) == body) {
            let impulse = r * pushed_sign;
            let angular_impulse = contact_problem.angular_impulse(other_row, pushed_side, &impulse);
            let spin = contact_problem.angular_velocity_change(body, &angular_impulse);
            change += (contact_problem.velocity_change(body, &impulse)
                + contact_problem.turning_velocity(row, side, &spin))
                * sign;
        }
    }
    change
}

#[cfg(test)]
mod tests {
    use super::super::problem::{ContactConstraint, SolverBody};
    use super::*;
    use crate::math::local_frame;
    use crate::scene::{ContactSides, LawId};

    /// W r + q equals the relative velocities of the bodies, for a chain of three spheres on the ground.
    #[test]
    fn matrix_and_bodies_agree() {
        let record = |k: f64, mobility: f64| SolverBody {
            v: Vec3::new(k.sin(), k.cos(), 0.3 * k),
            inverse_mass: mobility / (1.0 + k),
            w: Vec3::new(0.1, k, -0.2),
            inverse_inertia: mobility * 2.5 / (1.0 + k),
            radius: 0.7 + 0.1 * k,
        };
        let records = vec![record(0.0, 1.0), record(1.0, 1.0), record(2.0, 1.0), record(3.0, 0.0)];
        let normals = [Vec3::new(1.0, 0.2, 0.0), Vec3::new(0.3, 1.0, 0.1), Vec3::z(), Vec3::new(0.1, -0.5, 1.0)];
        let pairs = [[0, 1], [1, 2], [0, 3], [2, 3]];
        let frames = normals.map(|n| local_frame(n.normalize()));
        let contact = |k: usize| Contact {
            candidate: BodyId(pairs[k][0]),
            antagonist: BodyId(pairs[k][1]),
            part_numbers: ContactSides::default(),
            features: ContactSides::default(),
            point: Vec3::zeros(),
            image: Vec3::zeros(),
            normal: frames[k][0],
            gap: 0.0,
            area: 0.0,
            law: LawId::default(),
        };
        let row = |k: usize| ContactConstraint {
            bodies: pairs[k].map(BodyId),
            normal: frames[k][0],
            arm: 1.01,
            shift: Vec3::new(0.01, 0.02, k as f64),
            w_n: 1.0,
            w_t: 1.0,
            friction: 0.1 * k as f64,
            impulse_shift: 0.0,
            acts: true,
            can_close: true,
            warm_start: Vec3::zeros(),
            u_before: Vec3::zeros(),
            bond: None,
        };
        let contacts: Vec<Contact> = (0..4).map(contact).collect();
        let contact_problem = ContactProblem {
            rows: (0..4).map(row).collect(),
            rolling_constraints: vec![],
            memories: vec![],
            pair_attractions: vec![],
            regularised: vec![],
            block_data: None,
            bodies: records,
            order: vec![0, 1, 2, 3],
        };
        let problem = stored_problem(&contact_problem, &contacts);

        let local = |k: usize| Vec3::new(1.0 + k as f64, -0.5, 0.3 * k as f64);
        let mut moved = contact_problem.bodies.clone();
        for (k, row) in contact_problem.rows.iter().enumerate() {
            row.apply_impulse(&mut moved, &crate::math::to_world(&frames[k], &local(k)));
        }
        for (i, row) in contact_problem.rows.iter().enumerate() {
            let mut u = Vec3::from(problem.q[i]);
            for (_, j, w) in problem.blocks.iter().filter(|(row, _, _)| *row == i) {
                u += Vec3::from_fn(|a, _| Vec3::from(w[a]).dot(&local(*j)));
            }
            let expected = to_local(&frames[i], &row.shifted_velocity(&moved));
            assert!((u - expected).norm() < 1e-14, "contact {i}: {u} {expected}"); // a few roundings of numbers up to 10
        }
        assert_eq!(problem.mu, [0.0, 0.1, 0.2, 0.30000000000000004]);
        // Symmetric: w_ij = w_ji^T.
        for (i, j, w) in &problem.blocks {
            let (_, _, other) = problem.blocks.iter().find(|(a, b, _)| (a, b) == (j, i)).unwrap();
            assert!((0..3).all(|a| (0..3).all(|b| (w[a][b] - other[b][a]).abs() < 1e-15)));
        }
    }
}
