//! Nanoseconds per contact and sweep, on synthetic packings of touching spheres.
//!
//!     cargo bench -p cd-solve --bench sweep
//!
//! `items` are contacts: 300 Mitem/s are 3.3 ns per contact and sweep.

use cd_solve::assemble::{Record, Row, System};
use cd_solve::math::Vec3;
use cd_solve::math::lanes::Width;
use cd_solve::solve::batches::Problem;
use cd_solve::solve::sweep::sweep;
use divan::Bencher;
use divan::counter::ItemsCount;

const SIDES: [usize; 4] = [7, 15, 32, 70];
const SWEEPS: usize = 20;

fn main() {
    divan::main();
}

/// side^3 spheres on a cubic lattice, each touching its neighbours, pressed together by random velocities.
fn packing(side: usize, friction: f64) -> System {
    let random = |k: usize, f: f64| ((k as f64 + 0.5) * f).sin();
    let count = side.pow(3);
    let records = (0..count)
        .map(|k| Record {
            v: Vec3::new(random(k, 12.9898), random(k, 78.233), random(k, 37.719)) * 0.1,
            inverse_mass: 1.0,
            w: Vec3::zeros(),
            inverse_inertia: 2.5,
        })
        .collect();
    let mut rows = Vec::new();
    for k in 0..count {
        let place = [k / side / side, k / side % side, k % side];
        for (axis, stride) in [(0, side * side), (1, side), (2, 1)] {
            if place[axis] + 1 == side {
                continue;
            }
            let mut normal = Vec3::new(random(k, 3.1), random(k, 5.7), random(k, 7.3)) * 0.2;
            normal[axis] -= 1.0;
            rows.push(Row {
                bodies: [k as u32, (k + stride) as u32],
                normal: normal.normalize(),
                levers: [1.0, 1.0],
                shift: Vec3::zeros(),
                w_n: 2.0,
                w_t: 7.0,
                friction,
                impulse_shift: 0.0,
                contact: rows.len() as u32,
                can_close: true,
                start: Vec3::zeros(),
                u_before: Vec3::zeros(),
                bond: None,
            });
        }
    }
    System { rows, full: None, records, order: (0..count as u32).collect() }
}

fn problem(side: usize, friction: f64) -> Problem {
    let system = packing(side, friction);
    let active: Vec<u32> = (0..system.rows.len() as u32).collect();
    let start = vec![Vec3::zeros(); system.rows.len()];
    Problem::new(&system, &active, &start, &system.records)
}

fn sweeps(bencher: Bencher, side: usize, friction: f64, beta: f64, width: Width, threads: usize) {
    let mut problem = problem(side, friction);
    let contacts = 3 * side * side * (side - 1);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    // As in a step: entering the pool once for many sweeps.
    bencher
        .counter(ItemsCount::new(contacts * SWEEPS))
        .bench_local(|| pool.install(|| (0..SWEEPS).map(|_| sweep(&mut problem, width, beta).change()).sum::<f64>()));
}

#[divan::bench(args = SIDES, sample_count = 20)]
fn frictional(bencher: Bencher, side: usize) {
    sweeps(bencher, side, 0.4, 0.0, Width::detect(), 1);
}

#[divan::bench(args = SIDES, sample_count = 20)]
fn frictional_momentum(bencher: Bencher, side: usize) {
    sweeps(bencher, side, 0.4, 0.8, Width::detect(), 1);
}

#[divan::bench(args = SIDES, sample_count = 20)]
fn frictional_two_threads(bencher: Bencher, side: usize) {
    sweeps(bencher, side, 0.4, 0.0, Width::detect(), 2);
}

#[divan::bench(args = SIDES, sample_count = 20)]
fn frictional_four_wide(bencher: Bencher, side: usize) {
    if let Some(width) = Width::all().get(1) {
        sweeps(bencher, side, 0.4, 0.0, *width, 1);
    }
}

#[divan::bench(args = SIDES, sample_count = 20)]
fn frictionless(bencher: Bencher, side: usize) {
    sweeps(bencher, side, 0.0, 0.0, Width::detect(), 1);
}

/// Colouring and batching, once a step.
#[divan::bench(args = SIDES, sample_count = 20)]
fn layout(bencher: Bencher, side: usize) {
    let system = packing(side, 0.4);
    let active: Vec<u32> = (0..system.rows.len() as u32).collect();
    let start = vec![Vec3::zeros(); system.rows.len()];
    bencher
        .counter(ItemsCount::new(active.len()))
        .bench_local(|| Problem::new(&system, &active, &start, &system.records));
}
