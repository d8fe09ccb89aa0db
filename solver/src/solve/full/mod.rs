//! Contacts whose own block of W is full: bodies of any shape and inertia.
//!
//! | module | what it knows |
//! |---|---|
//! | [`local`] | one contact, exactly |
//! | [`batches`] | bodies and contacts laid out for sweeping |
//! | [`sweep`] | one sweep, in vectors of pairs of bodies and side by side |

pub mod batches;
pub mod local;
pub mod sweep;

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use crate::assemble::{Full, Record, Row, System};
    use crate::math::Vec3;
    use crate::math::lanes::Width;
    use crate::solve::residual::Judge;
    use crate::solve::{Until, nlgs};

    /// A stack of `count` bodies with arms and inertia by arithmetic alone, on a ground that does not move: up to five
    /// contacts between neighbours, every third body also against the one two below.
    fn heap(count: u32, friction: f64) -> System {
        let noise =
            |k: u32, j: u32| (f64::from(k) * 12.9898 + f64::from(j) * 78.233).sin().rem_euclid(0.37) / 0.37 - 0.5;
        let record = |k: u32| Record {
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
        // Some are not pushed along one axis.
        let held = |k: u32| if k % 7 == 3 { Vec3::x() } else { Vec3::zeros() };
        let mut full = Full {
            arms: Vec::new(),
            held: (0..count).map(held).collect(),
            inverse_inertia: (0..count).map(inertia).collect(),
        };
        let records: Vec<Record> = (0..count).map(record).collect();
        let mut rows = Vec::new();
        for (k, bodies) in pairs.into_iter().enumerate() {
            let k = k as u32;
            let arm = |side: f64| Vec3::new(noise(k, 31), noise(k, 32), side * 0.5 + 0.1 * noise(k, 33));
            full.arms.push([arm(-1.0), arm(1.0)]);
            let mut row = Row {
                bodies,
                normal: Vec3::new(0.6 * noise(k, 41), 0.6 * noise(k, 42), 1.0).normalize(),
                arm: 1.0,
                shift: Vec3::new(0.0, 0.0, 0.05 * noise(k, 43)),
                friction,
                acts: true,
                can_close: true,
                ..Row::default()
            };
            let w = full.block(k as usize, &row, &records);
            row.w_n = row.normal.dot(&(w * row.normal));
            row.w_t = 0.5 * (w.trace() - row.w_n);
            rows.push(row);
        }
        System { rows, rolls: vec![], full: Some(full), records, order: (0..count).collect() }
    }

    /// Friction stops sweeps short of the last digits in such heaps, see docs/performance.md; without it they arrive.
    #[test]
    fn a_judge_that_solves_nothing_finds_it_solved() {
        for (friction, tol) in [(0.0, 1e-9), (0.3, 1e-6)] {
            let system = heap(60, friction);
            let solution = nlgs(&system, Until::new(tol, 100_000), Width::detect());
            assert!(solution.converged, "{friction}: {:e} after {}", solution.residual, solution.sweeps);
            let all: Vec<u32> = (0..system.rows.len() as u32).collect();
            assert!(Judge::new(&system, &all, Width::detect()).residual(&solution.impulses).value <= tol);
        }
    }

    /// The solution has no friction to give, and is that of the three unknowns with next to none.
    #[test]
    fn one_unknown_finds_what_three_find() {
        let solved = |friction: f64| nlgs(&heap(40, friction), Until::new(1e-11, 100_000), Width::detect()).records;
        let (one, three) = (solved(0.0), solved(1e-13));
        for (a, b) in one.iter().zip(&three) {
            // Velocities near 1, solved to 1e-11 in a heap that amplifies what is left of a contact some hundred times.
            assert!((a.v - b.v).norm() < 1e-8 && (a.w - b.w).norm() < 1e-8, "{} {}", a.v - b.v, a.w - b.w);
        }
    }

    /// 1500 bodies are cut into ranges.
    #[test]
    fn no_width_and_no_number_of_threads_changes_a_bit() {
        [0.4, 0.0].into_iter().for_each(no_width_and_no_number_of_threads_changes_a_bit_at);
    }

    fn no_width_and_no_number_of_threads_changes_a_bit_at(friction: f64) {
        let system = heap(1500, friction);
        let solve = |width, threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| nlgs(&system, Until::new(1e-12, 30), width).impulses)
        };
        let first = solve(Width::all()[0], 1);
        assert!(first.iter().any(|r| r.norm() > 0.1));
        for width in Width::all() {
            for threads in [1, 3] {
                assert_eq!(solve(width, threads), first, "{width:?} {threads}");
            }
        }
    }
}
