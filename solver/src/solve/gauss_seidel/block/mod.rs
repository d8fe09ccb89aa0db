//! Contacts whose own block of W is full: bodies of any shape and inertia.
//!
//! | module | contents |
//! |---|---|
//! | [`local`] | one contact, exactly |
//! | [`batches`] | bodies and contacts laid out for sweeping |
//! | [`sweep`] | one sweep, in vectors of pairs of bodies |

pub mod batches;
pub mod local;
pub mod sweep;

#[cfg(test)]
mod tests {
    use cd_formats::compute::SweepPrecision;
    use nalgebra::Matrix3;

    use crate::assemble::{BlockData, ContactConstraint, ContactProblem, SolverBody, stored_problem};
    use crate::math::simd::SimdWidth;
    use crate::math::{Vec3, to_local, to_world};
    use crate::scene::BodyId;
    use crate::solve::gauss_seidel::block::local::{delassus_block_of_row, full_matrix};
    use crate::solve::residual::ResidualEvaluator;
    use crate::solve::{StoppingCriteria, solve_nlgs};
    use crate::state::Contact;
    use crate::state::ContactId;

    /// A stack of `count` bodies with arms and inertia from arithmetic alone, on a ground that does not move: up to five
    /// contacts between neighbours, and contacts of every third body with the one two below.
    fn heap(count: u32, friction: f64) -> ContactProblem {
        let noise =
            |k: u32, j: u32| (f64::from(k) * 12.9898 + f64::from(j) * 78.233).sin().rem_euclid(0.37) / 0.37 - 0.5;
        let record = |k: u32| SolverBody {
            v: Vec3::new(noise(k, 1), noise(k, 2), -1.0 + noise(k, 3)),
            inverse_mass: if k == 0 { 0.0 } else { 1.0 + noise(k, 4) },
            w: Vec3::new(noise(k, 5), noise(k, 6), noise(k, 7)),
            inverse_inertia: 0.0,
            radius: 0.0,
        };
        let inertia = |k: u32| {
            let l = Matrix3::from_fn(|i, j| noise(k, 10 + 3 * i as u32 + j as u32)) + Matrix3::identity() * 2.0;
            l * l.transpose() * if k == 0 { 0.0 } else { 1.0 }
        };
        let mut pairs: Vec<[u32; 2]> = (1..count).flat_map(|k| vec![[k, k - 1]; 1 + (k % 5) as usize]).collect();
        pairs.extend((1..count / 3).map(|k| [3 * k, 3 * k - 2]));
        pairs.sort_unstable();
        // Some bodies are not moved by impulses along one axis.
        let held = |k: u32| if k % 7 == 3 { Vec3::x() } else { Vec3::zeros() };
        let mut block_data = BlockData {
            arms: Vec::new(),
            friction_offsets: Vec::new(),
            locked_axes: (0..count).map(held).collect(),
            inverse_inertia: (0..count).map(inertia).collect(),
        };
        let solver_bodies: Vec<SolverBody> = (0..count).map(record).collect();
        let mut rows = Vec::new();
        for (k, bodies) in pairs.into_iter().enumerate() {
            let k = k as u32;
            let arm = |side: f64| Vec3::new(noise(k, 31), noise(k, 32), side * 0.5 + 0.1 * noise(k, 33));
            block_data.arms.push([arm(-1.0), arm(1.0)]);
            let row = ContactConstraint {
                bodies: bodies.map(BodyId),
                normal: Vec3::new(0.6 * noise(k, 41), 0.6 * noise(k, 42), 1.0).normalize(),
                arm: 1.0,
                shift: Vec3::new(0.0, 0.0, 0.05 * noise(k, 43)),
                friction,
                acts: true,
                can_close: true,
                ..ContactConstraint::default()
            };
            // Friction offsets as in faces, for two pairs in three.
            let offset =
                Vec3::new(noise(k, 51), noise(k, 52), noise(k, 53)) * if bodies[0] % 3 == 0 { 0.0 } else { 0.4 };
            block_data.friction_offsets.push(offset - row.normal * row.normal.dot(&offset));
            rows.push(row);
        }
        let mut contact_problem = ContactProblem {
            rows,
            rolling_constraints: vec![],
            memories: vec![],
            pair_attractions: vec![],
            regularised: vec![],
            block_data: Some(block_data),
            bodies: solver_bodies,
            order: (0..count).collect(),
        };
        for k in 0..contact_problem.rows.len() {
            let block_data = contact_problem.block_data.as_ref().unwrap();
            let w = full_matrix(delassus_block_of_row(&contact_problem, block_data, k));
            let row = &mut contact_problem.rows[k];
            row.w_n = row.normal.dot(&(w * row.normal));
            row.w_t = 0.5 * (w.trace() - row.w_n);
        }
        contact_problem
    }

    /// The own block of each row, its diagonal and all of the stored matrix are the responses of the bodies, friction offsets
    /// included.
    #[test]
    fn blocks_are_what_bodies_do() {
        let mut contact_problem = heap(12, 0.3);
        let contact = |k: usize| Contact {
            candidate: contact_problem.rows[k].bodies[0],
            antagonist: contact_problem.rows[k].bodies[1],
            normal: contact_problem.rows[k].normal,
            ..Contact::default()
        };
        let contacts: Vec<Contact> = (0..contact_problem.rows.len()).map(contact).collect();
        let problem = stored_problem(&contact_problem, &contacts);
        let free = contact_problem.clone();
        let mut seen = 0;
        for (k, contact) in contacts.iter().enumerate() {
            let r = to_world(&contact.frame(), &Vec3::new(0.7, -0.4, 0.9));
            contact_problem.bodies.clone_from(&free.bodies);
            contact_problem.apply_impulse(k, &r);
            let change = |i: usize| {
                contact_problem.shifted_velocity(i, &contact_problem.bodies) - free.shifted_velocity(i, &free.bodies)
            };
            let block_data = free.block_data.as_ref().unwrap();
            let w = full_matrix(delassus_block_of_row(&free, block_data, k));
            // Some roundings of numbers up to 10.
            assert!((change(k) - w * r).norm() < 1e-13, "{k}: {} {}", change(k), w * r);
            let (row, n) = (&free.rows[k], contact.normal);
            let (w_n, w_t) = block_data.delassus_diagonal(k, row, &free.bodies);
            assert!((w_n - n.dot(&(w * n))).abs() < 1e-13 && (w_n + 2.0 * w_t - w.trace()).abs() < 1e-13, "{k}");
            for (i, _, w) in problem.blocks.iter().filter(|(_, j, _)| *j == k) {
                let expected = to_local(&contacts[*i].frame(), &change(*i));
                let found = Vec3::from(w.map(|row| row[0] * 0.7 - row[1] * 0.4 + row[2] * 0.9));
                assert!((found - expected).norm() < 1e-13, "{i} {k}: {found} {expected}");
                seen += usize::from(*i != k);
            }
        }
        assert!(seen > 50);
    }

    /// Friction stops sweeps short of the last digits in such heaps, see docs/explanation/performance.md; without it they
    /// converge.
    #[test]
    fn a_judge_that_solves_nothing_finds_it_solved() {
        for (friction, tol) in [(0.0, 1e-9), (0.3, 1e-6)] {
            let contact_problem = heap(60, friction);
            let solution = solve_nlgs(&contact_problem, StoppingCriteria::new(tol, 100_000), SimdWidth::detect());
            assert!(solution.converged, "{friction}: {:e} after {}", solution.residual, solution.sweeps);
            let all: Vec<ContactId> = (0..contact_problem.rows.len()).map(ContactId::new).collect();
            assert!(
                ResidualEvaluator::new(&contact_problem, &all, SimdWidth::detect()).residual(&solution.impulses).value
                    <= tol
            );
        }
    }

    /// The solution has no friction, and is that of the three unknowns with nearly none.
    #[test]
    fn one_unknown_finds_what_three_find() {
        let solved = |friction: f64| {
            solve_nlgs(&heap(40, friction), StoppingCriteria::new(1e-11, 100_000), SimdWidth::detect()).solver_bodies
        };
        let (one, three) = (solved(0.0), solved(1e-13));
        for (a, b) in one.iter().zip(&three) {
            // Velocities near 1, solved to 1e-11 in a heap that amplifies the error of a contact some hundred times.
            assert!((a.v - b.v).norm() < 1e-8 && (a.w - b.w).norm() < 1e-8, "{} {}", a.v - b.v, a.w - b.w);
        }
    }

    fn in_single(tol: f64, max_sweeps: u64) -> StoppingCriteria {
        StoppingCriteria { precision: SweepPrecision::Single, ..StoppingCriteria::new(tol, max_sweeps) }
    }

    #[test]
    fn single_precision_reaches_what_is_sought_with_it() {
        for friction in [0.0, 0.3] {
            let contact_problem = heap(60, friction);
            let solution = solve_nlgs(&contact_problem, in_single(1e-4, 100_000), SimdWidth::detect());
            assert!(solution.single_precision && solution.converged, "{friction}: {:e}", solution.residual);
            let all: Vec<ContactId> = (0..contact_problem.rows.len()).map(ContactId::new).collect();
            assert!(
                ResidualEvaluator::new(&contact_problem, &all, SimdWidth::detect()).residual(&solution.impulses).value
                    <= 1e-4
            );
            let double = solve_nlgs(&contact_problem, StoppingCriteria::new(1e-4, 100_000), SimdWidth::detect());
            // Noise of 1e-7 is small against the remaining residual: about as many sweeps.
            assert!(solution.sweeps < 2 * double.sweeps, "{friction}: {} {}", solution.sweeps, double.sweeps);
        }
    }

    /// Sliding contacts are on their cone to the rounding of double precision.
    #[test]
    fn impulses_of_single_precision_keep_to_their_cones() {
        let contact_problem = heap(60, 0.3);
        let solution = solve_nlgs(&contact_problem, in_single(1e-4, 100_000), SimdWidth::detect());
        let mut sliding = 0;
        for (row, r) in contact_problem.rows.iter().zip(&solution.impulses) {
            let normal = row.normal.dot(r);
            let share = (r - row.normal * normal).norm() / (0.3 * normal);
            assert!(normal >= -1e-6 && (normal <= 1e-6 || share <= 1.0 + 1e-12), "{normal} {share}");
            sliding += usize::from(share > 1.0 - 1e-12);
        }
        assert!(sliding > 5, "{sliding}");
    }

    /// Powers of two: a system of light grains that move fast has the same solution as the one of heavy slow ones, bit for
    /// bit.
    #[test]
    fn no_unit_matters_in_single_precision() {
        let solved = |mass: f64, speed: f64| {
            let mut contact_problem = heap(60, 0.3);
            for record in &mut contact_problem.bodies {
                (record.v, record.w) = (record.v * speed, record.w * speed);
                record.inverse_mass /= mass;
            }
            contact_problem.block_data.as_mut().unwrap().inverse_inertia.iter_mut().for_each(|m| *m /= mass);
            for row in &mut contact_problem.rows {
                (row.w_n, row.w_t, row.shift) = (row.w_n / mass, row.w_t / mass, row.shift * speed);
            }
            let unit = mass * speed;
            solve_nlgs(&contact_problem, in_single(1e-4, 50), SimdWidth::detect())
                .impulses
                .into_iter()
                .map(|r| r / unit)
                .collect::<Vec<_>>()
        };
        let (power, expected) = (|k: i32| 2f64.powi(k), solved(1.0, 1.0));
        assert!(expected.iter().any(|r| r.norm() > 0.1));
        for (mass, speed) in [(power(-80), power(-40)), (power(100), power(30))] {
            assert_eq!(solved(mass, speed), expected, "{mass} {speed}");
        }
    }

    /// 1500 bodies are divided into ranges.
    #[test]
    fn no_width_and_no_number_of_threads_changes_a_bit() {
        for criteria in [StoppingCriteria::new(1e-12, 30), in_single(1e-12, 30)] {
            [0.4, 0.0]
                .into_iter()
                .for_each(|friction| no_width_and_no_number_of_threads_changes_a_bit_at(friction, criteria));
        }
    }

    fn no_width_and_no_number_of_threads_changes_a_bit_at(friction: f64, criteria: StoppingCriteria) {
        let contact_problem = heap(1500, friction);
        let solve = |width, threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| solve_nlgs(&contact_problem, criteria, width).impulses)
        };
        let first = solve(SimdWidth::all_widths()[0], 1);
        assert!(first.iter().any(|r| r.norm() > 0.1));
        for width in SimdWidth::all_widths() {
            for threads in [1, 3] {
                assert_eq!(solve(width, threads), first, "{width:?} {threads}");
            }
        }
    }
}
