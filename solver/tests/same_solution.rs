//! A contact problem has one solution to the last bit, on any number of threads and with vectors of any width.

#[path = "../benches/packing.rs"]
mod packing;

use cd_solve::math::lanes::Width;
use cd_solve::solve::{Until, nlgs};

/// Enough bodies for four ranges, and sweeps for momentum to grow and, without friction, to start again.
#[test]
fn neither_threads_nor_vectors_change_a_solution() {
    let (spheres, smooth, cuboids) = (packing::packing(17, 0.4), packing::packing(17, 0.0), packing::blocks(17, 0.4));
    let resisting = packing::resisting(spheres.clone());
    for (system, sweeps) in [(spheres, 120), (smooth, 120), (cuboids, 40), (resisting, 120)] {
        let solve = |width, threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let solution = pool.install(|| nlgs(&system, Until::new(1e-12, sweeps), width));
            (solution.impulses, solution.moments, solution.records, solution.residual, solution.sweeps, solution.worst)
        };
        let plain = solve(Width::all()[0], 1);
        assert!(plain.3 < 0.5, "{}", plain.3); // of 1 where nothing is solved
        for width in Width::all() {
            for threads in [1, 2, 3, 8] {
                assert!(solve(width, threads) == plain, "{width:?} on {threads} threads");
            }
        }
    }
}
