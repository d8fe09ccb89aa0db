//! Nanoseconds per pair of convex polyhedra, processed together as in a step: direction and manifold.
//!
//!     cargo bench -p cd-solve --bench polyhedra
//!
//! `items` are pairs: 2 Mitem/s are 500 ns per pair. Warm pairs have moved by 1e-3 of their size since the last time.

use cd_solve::geometry::{
    CachedFeature, NarrowPhaseMode, PairBatch, PairRequest, PairResult, Polyhedron, PosedPolyhedron,
    polyhedron_polyhedron,
};
use cd_solve::math::simd::SimdWidth;
use cd_solve::math::{Quat, Vec3};
use divan::counter::ItemsCount;
use divan::{Bencher, black_box};

/// Gap over the size: apart beyond the alert distance, near, touching, overlapping.
const GAPS: [f64; 5] = [0.5, 0.02, 0.0, -0.02, -0.1];
const ALERT: f64 = 0.05;
const PAIRS: usize = 200;

fn main() {
    divan::main();
}

struct Pair {
    shapes: [Polyhedron; 2],
    turned: [Quat; 2],
    c: Vec3,
    memory: CachedFeature,
}

/// Numbers in -1..1 that look random, and are the same on every run.
struct Numbers(f64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 += 1.0;
        let x = (self.0 * 12.9898).sin() * 43758.5453;
        2.0 * (x - x.floor()) - 1.0
    }

    fn direction(&mut self) -> Vec3 {
        loop {
            let v = Vec3::new(self.next(), self.next(), self.next());
            if (0.1..1.0).contains(&v.norm()) {
                return v.normalize();
            }
        }
    }

    fn turn(&mut self, most: f64) -> Quat {
        Quat::from_scaled_axis(self.direction() * (most * self.next()))
    }
}

/// The hull of points on a sphere of radius 1 m.
fn rock(numbers: &mut Numbers, vertices: usize) -> Polyhedron {
    let points: Vec<_> = (0..vertices)
        .map(|_| {
            let p = numbers.direction();
            parry3d_f64::math::Vector::new(p.x, p.y, p.z)
        })
        .collect();
    let (vertices, triangles) = parry3d_f64::transformation::convex_hull(&points);
    let vertices: Vec<Vec3> = vertices.iter().map(|v| Vec3::new(v.x, v.y, v.z)).collect();
    let middle = vertices.iter().sum::<Vec3>() / vertices.len() as f64;
    let vertices: Vec<Vec3> = vertices.iter().map(|v| v - middle).collect();
    Polyhedron::new(&vertices, &triangles).expect("points on a sphere have a hull")
}

/// Pairs at a gap; `moved`: since they were last processed.
fn pairs(vertices: usize, gap: f64, moved: f64) -> Vec<Pair> {
    let mut numbers = Numbers(vertices as f64 * 1e4);
    (0..PAIRS)
        .map(|_| {
            let shapes = [rock(&mut numbers, vertices), rock(&mut numbers, vertices)];
            let q = [numbers.turn(3.0), numbers.turn(3.0)];
            let mut c = numbers.direction() * 2.5;
            let mut memory = CachedFeature::default();
            for _ in 0..6 {
                let [a, b] = [shapes[0].posed_by(&q[0]), shapes[1].posed_by(&q[1])];
                let found = polyhedron_polyhedron(&a, &b, &c, 10.0, NarrowPhaseMode::Accurate, &mut memory)
                    .expect("all is within ten radii");
                c -= found.normal * (gap - found.gap());
            }
            let mut memory = CachedFeature::default();
            let [a, b] = [shapes[0].posed_by(&q[0]), shapes[1].posed_by(&q[1])];
            polyhedron_polyhedron(&a, &b, &c, ALERT, NarrowPhaseMode::Accurate, &mut memory);
            let turned = [numbers.turn(moved) * q[0], numbers.turn(moved) * q[1]];
            let c = c + numbers.direction() * moved;
            Pair { shapes, turned, c, memory }
        })
        .collect()
}

fn run(bencher: Bencher, pairs: Vec<Pair>, narrow: NarrowPhaseMode, warm: bool) {
    bencher.counter(ItemsCount::new(PAIRS)).bench_local(|| {
        let posed: Vec<[PosedPolyhedron; 2]> =
            pairs.iter().map(|pair| [0, 1].map(|k| pair.shapes[k].posed_by(&pair.turned[k]))).collect();
        let mut together = PairBatch::new(SimdWidth::detect());
        let mut take = |(), sight: PairResult| _ = black_box(sight.is_ok());
        for (pair, [a, b]) in pairs.iter().zip(&posed) {
            let memory = black_box(if warm { pair.memory } else { CachedFeature::default() });
            let range = ALERT.into();
            let request = PairRequest { shapes: [a, b], centre_offset: pair.c, range, narrow, memory, hint: None };
            together.push_pair((), request, &mut take);
        }
        together.flush(&mut take);
    });
}

#[divan::bench(args = GAPS, consts = [12, 20, 40])]
fn cold<const VERTICES: usize>(bencher: Bencher, gap: f64) {
    run(bencher, pairs(VERTICES, gap, 1e-3), NarrowPhaseMode::Accurate, false);
}

#[divan::bench(args = GAPS, consts = [12, 20, 40])]
fn warm<const VERTICES: usize>(bencher: Bencher, gap: f64) {
    run(bencher, pairs(VERTICES, gap, 1e-3), NarrowPhaseMode::Accurate, true);
}

#[divan::bench(args = GAPS, consts = [12, 20, 40])]
fn fast<const VERTICES: usize>(bencher: Bencher, gap: f64) {
    run(bencher, pairs(VERTICES, gap, 1e-3), NarrowPhaseMode::Fast, true);
}
