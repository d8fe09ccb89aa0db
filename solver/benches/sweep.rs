//! Nanoseconds per contact and sweep, on synthetic packings of touching spheres and cuboids.
//!
//!     cargo bench -p cd-solve --bench sweep
//!
//! `items` are contacts: 300 Mitem/s are 3.3 ns per contact and sweep.

mod packing;

use cd_solve::assemble::ContactProblem;
use cd_solve::math::simd::SimdWidth;
use cd_solve::solve::ContactReactions;
use cd_solve::solve::gauss_seidel::layout::pack_problem;
use cd_solve::solve::gauss_seidel::packed::PackSource;
use cd_solve::solve::residual::ResidualEvaluator;
use cd_solve::state::ContactId;
use divan::Bencher;
use divan::counter::ItemsCount;
use packing::{blocks, packing, resisting};

/// 882, 9450, 95 232 and 1 014 300 contacts.
const SIDES: [usize; 4] = [7, 15, 32, 70];
/// 1200, 10 800, 105 840 and 998 976 contacts.
const SIDES_OF_BLOCKS: [usize; 4] = [5, 10, 21, 44];
const SWEEPS: usize = 20;

fn main() {
    divan::main();
}

/// Input for packing these rows.
fn source<'a>(
    system: &'a ContactProblem,
    (active, reactions): &'a (Vec<ContactId>, ContactReactions),
    width: SimdWidth,
) -> PackSource<'a> {
    PackSource { problem: system, active, reactions, solver_bodies: &system.bodies, width, associated: &[] }
}

/// All rows of a packing, and impulses of 0.
fn start(system: &ContactProblem) -> (Vec<ContactId>, ContactReactions) {
    ((0..system.rows.len()).map(ContactId::new).collect(), ContactReactions::zeros(system))
}

fn sweeps(bencher: Bencher, system: ContactProblem, width: SimdWidth, threads: usize) {
    swept(bencher, system, width, threads, false);
}

fn swept(bencher: Bencher, system: ContactProblem, width: SimdWidth, threads: usize, single: bool) {
    let start = start(&system);
    let mut problem = pack_problem(&source(&system, &start, width), single);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    // As in a step: entering the pool once for many sweeps, with momentum.
    bencher
        .counter(ItemsCount::new(start.0.len() * SWEEPS))
        .bench_local(|| pool.install(|| (0..SWEEPS).map(|_| problem.sweep_contacts(width, 0.8).change).sum::<f64>()));
}

#[divan::bench(args = SIDES, sample_count = 20)]
fn frictional(bencher: Bencher, side: usize) {
    sweeps(bencher, packing(side, 0.4), SimdWidth::detect(), 1);
}

#[divan::bench(args = SIDES, sample_count = 20)]
fn frictional_two_threads(bencher: Bencher, side: usize) {
    sweeps(bencher, packing(side, 0.4), SimdWidth::detect(), 2);
}

#[divan::bench(args = SIDES, sample_count = 20)]
fn frictional_four_wide(bencher: Bencher, side: usize) {
    if let Some(width) = SimdWidth::all_widths().get(1) {
        sweeps(bencher, packing(side, 0.4), *width, 1);
    }
}

#[divan::bench(args = SIDES, sample_count = 5)]
fn frictional_one_wide(bencher: Bencher, side: usize) {
    sweeps(bencher, packing(side, 0.4), SimdWidth::all_widths()[0], 1);
}

#[divan::bench(args = SIDES, sample_count = 20)]
fn single(bencher: Bencher, side: usize) {
    swept(bencher, packing(side, 0.4), SimdWidth::detect(), 1, true);
}

#[divan::bench(args = SIDES, sample_count = 20)]
fn single_two_threads(bencher: Bencher, side: usize) {
    swept(bencher, packing(side, 0.4), SimdWidth::detect(), 2, true);
}

#[divan::bench(args = SIDES, sample_count = 20)]
fn single_eight_wide(bencher: Bencher, side: usize) {
    if let Some(width) = SimdWidth::all_widths().get(1) {
        swept(bencher, packing(side, 0.4), *width, 1, true);
    }
}

#[divan::bench(args = SIDES, sample_count = 20)]
fn single_frictionless(bencher: Bencher, side: usize) {
    swept(bencher, packing(side, 0.0), SimdWidth::detect(), 1, true);
}

#[divan::bench(args = SIDES, sample_count = 20)]
fn rolling(bencher: Bencher, side: usize) {
    sweeps(bencher, resisting(packing(side, 0.4)), SimdWidth::detect(), 1);
}

#[divan::bench(args = SIDES, sample_count = 20)]
fn rolling_two_threads(bencher: Bencher, side: usize) {
    sweeps(bencher, resisting(packing(side, 0.4)), SimdWidth::detect(), 2);
}

#[divan::bench(args = SIDES, sample_count = 20)]
fn frictionless(bencher: Bencher, side: usize) {
    sweeps(bencher, packing(side, 0.0), SimdWidth::detect(), 1);
}

#[divan::bench(args = SIDES, sample_count = 20)]
fn frictionless_two_threads(bencher: Bencher, side: usize) {
    sweeps(bencher, packing(side, 0.0), SimdWidth::detect(), 2);
}

#[divan::bench(args = SIDES_OF_BLOCKS, sample_count = 10)]
fn polyhedra(bencher: Bencher, side: usize) {
    sweeps(bencher, blocks(side, 0.4), SimdWidth::detect(), 1);
}

#[divan::bench(args = SIDES_OF_BLOCKS, sample_count = 10)]
fn polyhedra_two_threads(bencher: Bencher, side: usize) {
    sweeps(bencher, blocks(side, 0.4), SimdWidth::detect(), 2);
}

#[divan::bench(args = SIDES_OF_BLOCKS, sample_count = 10)]
fn polyhedra_four_wide(bencher: Bencher, side: usize) {
    if let Some(width) = SimdWidth::all_widths().get(1) {
        sweeps(bencher, blocks(side, 0.4), *width, 1);
    }
}

#[divan::bench(args = SIDES_OF_BLOCKS, sample_count = 10)]
fn single_polyhedra(bencher: Bencher, side: usize) {
    swept(bencher, blocks(side, 0.4), SimdWidth::detect(), 1, true);
}

#[divan::bench(args = SIDES_OF_BLOCKS, sample_count = 10)]
fn single_polyhedra_two_threads(bencher: Bencher, side: usize) {
    swept(bencher, blocks(side, 0.4), SimdWidth::detect(), 2, true);
}

#[divan::bench(args = SIDES_OF_BLOCKS, sample_count = 10)]
fn single_polyhedra_eight_wide(bencher: Bencher, side: usize) {
    if let Some(width) = SimdWidth::all_widths().get(1) {
        swept(bencher, blocks(side, 0.4), *width, 1, true);
    }
}

#[divan::bench(args = SIDES_OF_BLOCKS, sample_count = 10)]
fn polyhedra_frictionless(bencher: Bencher, side: usize) {
    sweeps(bencher, blocks(side, 0.0), SimdWidth::detect(), 1);
}

#[divan::bench(args = SIDES_OF_BLOCKS, sample_count = 10)]
fn single_polyhedra_frictionless(bencher: Bencher, side: usize) {
    swept(bencher, blocks(side, 0.0), SimdWidth::detect(), 1, true);
}

/// Colouring and batching, once a step, on one thread.
#[divan::bench(args = SIDES, sample_count = 20)]
fn layout(bencher: Bencher, side: usize) {
    let system = packing(side, 0.4);
    let start = start(&system);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let source = source(&system, &start, SimdWidth::detect());
    bencher.counter(ItemsCount::new(start.0.len())).bench_local(|| pool.install(|| pack_problem(&source, false)));
}

/// A residual, a few times a step, on one thread.
#[divan::bench(args = SIDES, sample_count = 20)]
fn judge(bencher: Bencher, side: usize) {
    let system = packing(side, 0.4);
    let (active, reactions) = start(&system);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let judge = ResidualEvaluator::new(&system, &active, SimdWidth::detect());
    bencher.counter(ItemsCount::new(active.len())).bench_local(|| pool.install(|| judge.residual(&reactions.impulses)));
}
