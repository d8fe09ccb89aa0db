//! A contact problem has one solution to the last bit, on any number of threads and ranks and with vectors of any width.

#[path = "../benches/packing.rs"]
mod packing;

use std::sync::Mutex;

use cd_formats::compute::{ContactSolver, SweepPrecision};
use cd_solve::assemble::{ContactProblem, SolverBody};
use cd_solve::math::Vec3;
use cd_solve::math::simd::SimdWidth;
use cd_solve::ranks::threads::run_as_ranks;
use cd_solve::ranks::{part_range, traffic};
use cd_solve::solve::gauss_seidel::layout::{division_counts, pack_in_blocks, pack_problem, smallest_block};
use cd_solve::solve::gauss_seidel::packed::PackSource;
use cd_solve::solve::gauss_seidel::row_division::RowDivision;
use cd_solve::solve::residual::ResidualEvaluator;
use cd_solve::solve::{ContactReactions, ContactSolution, SolveRequest, StoppingCriteria, solve_in_parts, solve_nlgs};
use cd_solve::state::ContactId;

/// Enough bodies for four blocks of spheres and eight of cuboids, and sweeps for momentum to grow and, without friction, to start again.
#[test]
fn neither_threads_nor_vectors_change_a_solution() {
    let (spheres, smooth, cuboids) = (packing::packing(17, 0.4), packing::packing(17, 0.0), packing::blocks(17, 0.4));
    let resisting = packing::resisting(spheres.clone());
    let (single, double) = (SweepPrecision::Single, SweepPrecision::Double);
    let problems = [
        (&spheres, 120, double),
        (&smooth, 120, double),
        (&cuboids, 40, double),
        (&resisting, 120, double),
        (&spheres, 120, single),
        (&smooth, 120, single),
        (&cuboids, 40, single),
    ];
    for (system, sweeps, precision) in problems {
        let solve = |width, threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let until = StoppingCriteria { precision, ..StoppingCriteria::new(1e-12, sweeps) };
            let solution = pool.install(|| solve_nlgs(system, until, width));
            (
                solution.impulses,
                solution.moments,
                solution.solver_bodies,
                solution.residual,
                solution.sweeps,
                solution.worst,
            )
        };
        let plain = solve(SimdWidth::all_widths()[0], 1);
        assert!(plain.3 < 0.5, "{}", plain.3); // of 1 where nothing is solved
        for width in SimdWidth::all_widths() {
            for threads in [1, 2, 3, 8] {
                assert!(solve(width, threads) == plain, "{width:?} on {threads} threads");
            }
        }
    }
}

/// Lock of the tests with ranks, whose traffic is counted for the whole process.
static ONE_SET_OF_RANKS: Mutex<()> = Mutex::new(());

/// Four blocks of spheres and eight of cuboids on up to five ranks. Sweeps in single precision begin anew where it ends, and
/// moments are gathered in the same way as impulses.
#[test]
fn ranks_change_no_solution() {
    let _alone = ONE_SET_OF_RANKS.lock();
    let (spheres, cuboids) = (packing::packing(17, 0.4), packing::blocks(17, 0.4));
    let resisting = packing::resisting(spheres.clone());
    let (single, double) = (SweepPrecision::Single, SweepPrecision::Double);
    let problems = [(&spheres, 20, double), (&spheres, 20, single), (&resisting, 20, double), (&cuboids, 6, single)];
    for (system, sweeps, precision) in problems {
        let solve = || {
            let until = StoppingCriteria { precision, ..StoppingCriteria::new(1e-12, sweeps) };
            let solution = solve_nlgs(system, until, SimdWidth::detect());
            (solution.impulses, solution.moments, solution.solver_bodies, solution.residual, solution.sweeps)
        };
        let alone = solve();
        assert!(alone.3 < 1.0 && alone.4 == sweeps, "{} {}", alone.3, alone.4);
        for size in [2, 3, 5] {
            let found = run_as_ranks(size, |_| solve());
            assert!(found.iter().all(|found| *found == alone), "{size} ranks");
        }
    }
}

/// Ranks that each have a part of the rows, one of them none, find the solution of one that has all: in single and in double
/// precision, with and without friction, and from rows of which some can close only by the solution.
#[test]
fn ranks_with_a_part_of_the_rows_find_the_same_solution() {
    let _alone = ONE_SET_OF_RANKS.lock();
    let (spheres, mut smooth) = (packing::packing(17, 0.4), packing::packing(17, 0.0));
    smooth.rows.iter_mut().step_by(7).for_each(|row| row.can_close = false);
    let (single, double) = (SweepPrecision::Single, SweepPrecision::Double);
    for (system, sweeps, precision) in [(&spheres, 20, double), (&spheres, 20, single), (&smooth, 40, double)] {
        let request = SolveRequest {
            solver: ContactSolver::Nlgs,
            criteria: StoppingCriteria { precision, ..StoppingCriteria::new(1e-12, sweeps) },
            width: SimdWidth::detect(),
            fallback_suppressed: false,
        };
        let parts = |ContactSolution { solver_bodies, residual, sweeps, worst, active_rows, left_out, .. }| {
            (solver_bodies, residual, sweeps, worst, active_rows, left_out)
        };
        let alone = solve_nlgs(system, request.criteria, request.width);
        let (impulses, alone) = (alone.impulses.clone(), parts(alone));
        assert!(alone.1 < 1.0 && alone.2 == sweeps, "{} {}", alone.1, alone.2);
        for size in [2, 3, 5] {
            let found = run_as_ranks(size, |communicator| {
                // Rank 1 has no rows, the others about the same number.
                let rows = match communicator.rank() {
                    0 => part_range(system.rows.len(), 0, size - 1),
                    1 => 0..0,
                    rank => part_range(system.rows.len(), rank - 1, size - 1),
                };
                let mut part = ContactProblem { rows: system.rows[rows].to_vec(), ..system.clone() };
                let solution = solve_in_parts(&mut part, request).expect("a solution by sweeps");
                assert_eq!(part.bodies, system.bodies);
                (solution.impulses.clone(), parts(solution))
            });
            assert!(found.iter().all(|(_, found)| *found == alone), "{size} ranks");
            assert_eq!(found.into_iter().flat_map(|(impulses, _)| impulses).collect::<Vec<_>>(), impulses);
        }
    }
}

/// Messages of ranks are those that a plan counts: at most one for each neighbour and colour, with few bodies twice.
#[test]
fn ranks_send_what_a_plan_counts() {
    let _alone = ONE_SET_OF_RANKS.lock();
    let width = SimdWidth::detect();
    let sweep = |system: &ContactProblem, active: &[ContactId], single: bool| {
        let reactions = ContactReactions::zeros(system);
        let solver_bodies = &system.bodies;
        let source =
            PackSource { problem: system, active, reactions: &reactions, solver_bodies, width, associated: &[] };
        pack_problem(&source, single).sweep_contacts(width, 0.0);
    };
    for (system, single) in [(packing::packing(17, 0.4), true), (packing::blocks(17, 0.4), false)] {
        let active: Vec<ContactId> = (0..system.rows.len()).map(ContactId::new).collect();
        for size in [2, 4, 8] {
            let counts = division_counts(&system, &active, size);
            // Traffic counts all ranks, as they share this process.
            let before = traffic();
            run_as_ranks(size, |_| sweep(&system, &active, single));
            let after = traffic();
            let (messages, lines): (u64, u64) = (counts.messages.iter().sum(), counts.lines.iter().sum());
            let line_bytes = if single { 24 } else { 48 };
            assert_eq!(after.messages - before.messages, messages, "{size}");
            assert_eq!(after.message_bytes - before.message_bytes, lines * line_bytes, "{size}");
            let ghosts: u64 = counts.ghosts.iter().sum();
            println!("{size} ranks, {} blocks, {} colours: {counts:?}", counts.blocks, counts.colours);
            assert!(counts.colours <= 18 && lines as f64 * 24.0 <= 1.3 * 28.0 * ghosts as f64, "{lines} {ghosts}");
            let bound = |neighbours: &u64| neighbours * counts.colours as u64;
            assert!(counts.messages.iter().zip(&counts.neighbours).all(|(sent, others)| *sent <= bound(others)));
        }
    }
}

/// Ranks that each have a part of the rows send in every sweep what a plan counts, and sweep the rows that it counts, the
/// fullest at most 1.1 of the mean; several ranks sweep a row of a border between them.
#[test]
fn ranks_with_a_part_of_the_rows_send_what_a_plan_counts() {
    let _alone = ONE_SET_OF_RANKS.lock();
    let system = packing::packing(22, 0.4);
    let active: Vec<ContactId> = (0..system.rows.len()).map(ContactId::new).collect();
    for (precision, line_bytes) in [(SweepPrecision::Double, 48), (SweepPrecision::Single, 24)] {
        for size in [2, 4, 8] {
            let counts = division_counts(&system, &active, size);
            let before = traffic();
            let swept_rows = run_as_ranks(size, |communicator| {
                let rows = part_range(system.rows.len(), communicator.rank(), size);
                let mut part = ContactProblem { rows: system.rows[rows].to_vec(), ..system.clone() };
                let own: Vec<ContactId> = (0..part.rows.len()).map(ContactId::new).collect();
                let impulses = vec![Vec3::zeros(); own.len()];
                let swept_rows = RowDivision::new(&part, &own, &impulses, smallest_block(false)).1.len();
                let request = SolveRequest {
                    solver: ContactSolver::Nlgs,
                    criteria: StoppingCriteria { precision, ..StoppingCriteria::new(1e-12, 5) },
                    width: SimdWidth::detect(),
                    fallback_suppressed: false,
                };
                solve_in_parts(&mut part, request).expect("a solution by sweeps");
                swept_rows
            });
            let after = traffic();
            // Each rank counts each sweep.
            let sweeps = (after.divided_sweeps - before.divided_sweeps) / size as u64;
            let (messages, lines): (u64, u64) = (counts.messages.iter().sum(), counts.lines.iter().sum());
            assert!(sweeps >= 5 && messages > 0, "{sweeps} {messages}");
            assert_eq!(after.messages - before.messages, sweeps * messages, "{size}");
            assert_eq!(after.message_bytes - before.message_bytes, sweeps * lines * line_bytes, "{size}");
            let (largest, sum) = (swept_rows.iter().max().unwrap(), swept_rows.iter().sum::<usize>());
            assert!((largest * size) as f64 <= 1.1 * sum as f64, "{size} ranks: {swept_rows:?}");
            assert_eq!(swept_rows, counts.work.iter().map(|&rows| rows as usize).collect::<Vec<_>>());
        }
    }
}

/// Bodies of other ranks with which a rank sweeps borders are a surface: at most 15 % of its own if these are 100 000, and of
/// n bodies a part that grows as n^(-1/3). The blocks of these ranks are boxes; other numbers of ranks have longer borders. With
/// CD_TESTS_LONG=1 each of eight ranks has 100 000 bodies.
#[test]
fn ghosts_are_a_surface() {
    let side = if std::env::var_os("CD_TESTS_LONG").is_some() { 93 } else { 40 };
    let mut system = packing::packing(side, 0.4);
    // Keys of the curve are those of a box that fits, as in a run.
    let curve_key = |&body: &u32| {
        let body = body as usize;
        let cell = [body / side / side, body / side % side, body % side].map(|k| k * 1024 / side);
        (0..10).rev().flat_map(|bit| cell.map(|k| k >> bit & 1)).fold(0, |key, bit| key << 1 | bit)
    };
    system.order.sort_by_cached_key(curve_key);
    let active: Vec<ContactId> = (0..system.rows.len()).map(ContactId::new).collect();
    for size in [2, 4, 8] {
        let bodies = (side.pow(3) / size) as f64;
        let ghosts = *division_counts(&system, &active, size).ghosts.iter().max().unwrap() as f64;
        println!("{size} ranks of {bodies} bodies: {ghosts} ghosts, {:.1} %", 100.0 * ghosts / bodies);
        let bound = 0.15 * (1e5 / bodies).cbrt();
        assert!(ghosts > 0.0 && ghosts <= bound * bodies, "{size} ranks: {ghosts} of {bodies}");
    }
}

/// Work of ten thousand spheres in eight blocks, and of two thousand cuboids in four, by the points of their faces. Blocks
/// are of equal size, and ranks whose number does not divide that of the blocks have fewer or more of them.
#[test]
fn ranks_have_equal_work() {
    for (system, sizes) in [(packing::packing(22, 0.4), &[2, 4, 8][..]), (packing::blocks(13, 0.4), &[2, 4])] {
        let active: Vec<ContactId> = (0..system.rows.len()).map(ContactId::new).collect();
        for &size in sizes {
            let work = division_counts(&system, &active, size).work;
            let (largest, sum) = (work.iter().max().unwrap(), work.iter().sum::<u64>());
            assert!((largest * size as u64) as f64 <= 1.1 * sum as f64, "{size} ranks: {work:?}");
        }
    }
}

/// Number of sweeps without momentum from no impulses to a residual of 0.1, in blocks of `min_bodies` or more.
fn sweeps_in_blocks(system: &ContactProblem, single: bool, min_bodies: usize) -> usize {
    let width = SimdWidth::detect();
    let active: Vec<ContactId> = (0..system.rows.len()).map(ContactId::new).collect();
    let evaluator = ResidualEvaluator::new(system, &active, width);
    let mut reactions = ContactReactions::zeros(system);
    let source = PackSource {
        problem: system,
        active: &active,
        reactions: &reactions.clone(),
        solver_bodies: &system.bodies,
        width,
        associated: &[],
    };
    let mut problem = pack_in_blocks(&source, single, min_bodies);
    for sweeps in 1..1000 {
        problem.sweep_contacts(width, 0.0);
        problem.read_back(width, system, &mut reactions);
        if evaluator.residual(&reactions.impulses).value <= 0.1 {
            return sweeps;
        }
    }
    panic!("no residual of 0.1 in 1000 sweeps");
}

/// The order of contacts in sixteen blocks of 578 spheres, and in four of 686 cuboids, costs no more than a twentieth of the
/// sweeps.
#[test]
fn blocks_take_as_many_sweeps_as_one() {
    for (system, single) in [(packing::packing(21, 0.4), false), (packing::blocks(14, 0.4), true)] {
        let [one, many] = [usize::MAX, 512].map(|min_bodies| sweeps_in_blocks(&system, single, min_bodies));
        // Sweeps are counted to the next whole one.
        assert!(many as f64 <= 1.05 * one as f64 + 1.0, "{many} sweeps, and {one} of one block");
    }
}

/// Velocities of all bodies, m/s.
fn velocities(solution: &ContactSolution) -> Vec<f64> {
    solution.solver_bodies.iter().flat_map(|record| [record.v, record.w]).flat_map(|v| [v.x, v.y, v.z]).collect()
}

fn in_precision(system: &ContactProblem, precision: SweepPrecision, tol: f64) -> ContactSolution {
    solve_nlgs(system, StoppingCriteria { precision, ..StoppingCriteria::new(tol, 20_000) }, SimdWidth::detect())
}

#[test]
fn single_precision_finds_the_solution_of_double_precision() {
    for friction in [0.4, 0.0] {
        let system = packing::packing(17, friction);
        let exact = velocities(&in_precision(&system, SweepPrecision::Double, 1e-12));
        let norm = |v: &mut dyn Iterator<Item = f64>| v.map(|x| x * x).sum::<f64>().sqrt();
        let error = |found: &ContactSolution| norm(&mut velocities(found).iter().zip(&exact).map(|(a, b)| a - b));
        // 1e-10 takes the step from single to double precision where rounding stops the sweeps.
        for tol in [1e-2, 1e-4, 1e-10] {
            let [found, in_double] =
                [SweepPrecision::Single, SweepPrecision::Double].map(|p| in_precision(&system, p, tol));
            assert!(found.converged && found.residual <= tol, "{friction} {tol}: {}", found.residual);
            // As far from the solution as what double precision stops at; ten times, as sweeps end where they may.
            let (single, double) = (error(&found), error(&in_double));
            assert!(single <= 10.0 * double && double > 0.0, "{friction} {tol}: {single} {double}");
            // On the cone as in double precision: what slides is at its bound, what has no friction along the normal.
            for (row, r) in system.rows.iter().zip(&found.impulses) {
                let normal = row.normal.dot(r);
                let (tangential, bound) = ((r - row.normal * normal).norm(), friction * normal);
                assert!(normal >= 0.0 && tangential <= bound * (1.0 + 1e-12) + 1e-15 * normal, "{tangential} {bound}");
                assert!(tangential >= bound * (1.0 - 1e-12) || tangential <= bound * (1.0 - 1e-6));
            }
            // Impulses are equal and opposite to the last bit, so only their sums are rounded.
            let momentum = |records: &[SolverBody]| records.iter().map(|record| record.v).sum::<Vec3>();
            let drift = (momentum(&found.solver_bodies) - momentum(&system.bodies)).norm();
            assert!(drift <= 1e-12, "{drift}"); // of 5000 velocities of 0.1 m/s
        }
    }
}

#[test]
fn single_precision_knows_no_units() {
    // Powers of two, far beyond the squares of single precision.
    let (mass, speed) = (2f64.powi(200), 2f64.powi(-150));
    let system = packing::packing(10, 0.4);
    let mut scaled = system.clone();
    for record in &mut scaled.bodies {
        (record.v, record.w) = (record.v * speed, record.w * speed);
        (record.inverse_mass, record.inverse_inertia) = (record.inverse_mass / mass, record.inverse_inertia / mass);
    }
    for row in &mut scaled.rows {
        (row.w_n, row.w_t, row.shift) = (row.w_n / mass, row.w_t / mass, row.shift * speed);
    }
    let [found, of_scaled] = [&system, &scaled].map(|system| in_precision(system, SweepPrecision::Single, 1e-4));
    assert!(found.converged && found.sweeps > 5);
    assert_eq!((found.sweeps, found.residual), (of_scaled.sweeps, of_scaled.residual));
    for (r, scaled) in found.impulses.iter().zip(&of_scaled.impulses) {
        assert_eq!(r * (mass * speed), *scaled);
    }
}
