//! One Gauss-Seidel sweep over the batches of pairs, with momentum.

use pulp::NullaryFnOnce;

use crate::math::lanes::{Lanes, Twice, Width};
use crate::solve::batches::{BATCH, Sums};
use crate::solve::full::batches::{Batch, Batches, Impulses, Line, Point, Problem, Range};
use crate::solve::full::local::{Block, signorini_coulomb};
use crate::solve::local::{cross_add, dot, triple};

/// Sweeps all contacts once, each from y = r + beta (r - r_before).
pub fn sweep(problem: &mut Problem, width: Width, beta: f64) -> Sums {
    match width {
        Width::One(lanes) => sweep_with(problem, lanes, beta),
        #[cfg(target_arch = "x86_64")]
        Width::Four(simd) => sweep_with(problem, simd, beta),
        #[cfg(target_arch = "x86_64")]
        Width::Eight(simd) => sweep_with(problem, simd, beta),
    }
}

fn sweep_with<L: Lanes>(problem: &mut Problem, lanes: L, beta: f64) -> Sums {
    let Problem { lines, previous, inertia, ranges, between } = problem;
    side_by_side(ranges, lines, previous, inertia, lanes, beta);
    let mut sums = Sums::default();
    ranges.iter().for_each(|range| sums.add(&range.sums));
    let mut last = Sums::default();
    lanes.run(Run { lanes: Twice(lanes), lines, inertia, batches: between, beta, sums: &mut last });
    sums.add(&last);
    sums
}

/// Halves the ranges until one is left to each task.
fn side_by_side<L: Lanes>(
    ranges: &mut [Range],
    lines: &mut [Line],
    previous: &mut [Line],
    inertia: &[Line],
    lanes: L,
    beta: f64,
) {
    if let [range] = ranges {
        lanes.run(CarryOn { lanes, lines, previous, beta });
        range.sums = Sums::default();
        lanes.run(Run { lanes: Twice(lanes), lines, inertia, batches: &mut range.inside, beta, sums: &mut range.sums });
        return;
    }
    let (left, right) = ranges.split_at_mut(ranges.len() / 2);
    let cut = left.iter().map(|range| range.lines).sum();
    let (lines_left, lines_right) = lines.split_at_mut(cut);
    let (previous_left, previous_right) = previous.split_at_mut(cut);
    let (inertia_left, inertia_right) = inertia.split_at(cut);
    rayon::join(
        || side_by_side(left, lines_left, previous_left, inertia_left, lanes, beta),
        || side_by_side(right, lines_right, previous_right, inertia_right, lanes, beta),
    );
}

/// Velocities are linear in the impulses, so momentum takes one pass over the bodies.
struct CarryOn<'a, L> {
    lanes: L,
    lines: &'a mut [Line],
    previous: &'a mut [Line],
    beta: f64,
}

impl<L: Lanes> NullaryFnOnce for CarryOn<'_, L> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let l = self.lanes;
        let beta = l.splat(self.beta);
        for (line, previous) in self.lines.iter_mut().zip(self.previous) {
            for from in (0..8).step_by(L::WIDTH) {
                let (now, before) = (l.load(&line[from..]), l.load(&previous[from..]));
                // Masses do not change, so they stay.
                l.store(&mut line[from..], l.mul_add(beta, l.sub(now, before), now));
                l.store(&mut previous[from..], now);
            }
        }
    }
}

struct Run<'a, L> {
    lanes: L,
    lines: &'a mut [Line],
    inertia: &'a [Line],
    batches: &'a mut Batches,
    beta: f64,
    sums: &'a mut Sums,
}

impl<L: Lanes> NullaryFnOnce for Run<'_, L> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let Run { lanes, lines, inertia, batches, beta, sums } = self;
        let Batches { batches, points, impulses, .. } = batches;
        for batch in batches.iter() {
            let [first, end] = batch.points;
            for from in (0..BATCH).step_by(L::WIDTH) {
                let (points, impulses) = (&points[first..end], &mut impulses[first..end]);
                solve_batch(lanes, lines, inertia, batch, points, impulses, beta, sums, from);
            }
        }
    }
}

/// I⁻¹ a + c, I⁻¹ by its six numbers.
#[inline(always)]
fn answer<L: Lanes>(l: L, m: [L::V; 8], a: [L::V; 3], c: [L::V; 3]) -> [L::V; 3] {
    [
        l.mul_add(m[0], a[0], l.mul_add(m[1], a[1], l.mul_add(m[2], a[2], c[0]))),
        l.mul_add(m[1], a[0], l.mul_add(m[3], a[1], l.mul_add(m[4], a[2], c[1]))),
        l.mul_add(m[2], a[0], l.mul_add(m[4], a[1], l.mul_add(m[5], a[2], c[2]))),
    ]
}

/// Solves the contacts of the `WIDTH` pairs of a batch that start at place `from`.
#[allow(clippy::too_many_arguments)]
#[inline(always)]
fn solve_batch<L: Lanes>(
    l: L,
    lines: &mut [Line],
    inertia: &[Line],
    batch: &Batch,
    points: &[Point],
    impulses: &mut [Impulses],
    beta: f64,
    sums: &mut Sums,
    from: usize,
) {
    let places = from..from + L::WIDTH;
    macro_rules! load {
        ($x:expr) => {
            l.load(&$x[places.clone()])
        };
    }
    macro_rules! load3 {
        ($x:expr) => {
            triple!(k => load!($x[k]))
        };
    }
    let zero = l.splat(0.0);
    let beta = l.splat(beta);
    let index = [&batch.bodies[0][places.clone()], &batch.bodies[1][places.clone()]];
    let a = l.gather(lines, index[0]);
    let b = l.gather(lines, index[1]);
    let (inertia_a, inertia_b) = (l.gather(inertia, index[0]), l.gather(inertia, index[1]));
    let (mut va, mut wa) = ([a[0], a[1], a[2]], [a[4], a[5], a[6]]);
    let (mut vb, mut wb) = ([b[0], b[1], b[2]], [b[4], b[5], b[6]]);
    let mut uphill = load!(sums.uphill);
    let mut change2 = load!(sums.change2);
    for (point, values) in points.iter().zip(impulses) {
        let axes = [load3!(point.axes[0]), load3!(point.axes[1]), load3!(point.axes[2])];
        let (arm_a, arm_b) = (load3!(point.arms[0]), load3!(point.arms[1]));
        let (ua, ub) = (cross_add(l, wa, arm_a, va), cross_add(l, wb, arm_b, vb));
        let between = triple!(k => l.sub(ua[k], ub[k]));
        let u = triple!(k => l.add(dot(l, axes[k], between), load!(point.shift[k])));
        let r = load3!(values.r);
        let before = load3!(values.previous);
        let y = triple!(k => l.mul_add(beta, l.sub(r[k], before[k]), r[k]));
        let block = Block {
            inverse_nn: load!(point.inverse_nn),
            c: [load!(point.c[0]), load!(point.c[1])],
            s: [load!(point.s[0]), load!(point.s[1])],
            inverse_s: [load!(point.inverse_s[0]), load!(point.inverse_s[1])],
            friction: load!(point.friction),
        };
        let (new, multiplier) = signorini_coulomb(l, &block, u, y, load!(values.multiplier));
        for k in 0..3 {
            l.store(&mut values.previous[k][places.clone()], r[k]);
            l.store(&mut values.r[k][places.clone()], new[k]);
        }
        l.store(&mut values.multiplier[places.clone()], multiplier);
        // The change goes to the bodies at once.
        let change = triple!(k => l.sub(new[k], y[k]));
        let world = triple!(k => l.mul_add(axes[0][k], change[0], l.mul_add(axes[1][k], change[1], l.mul(axes[2][k], change[2]))));
        va = triple!(k => l.mul_add(world[k], a[3], va[k]));
        vb = triple!(k => l.neg_mul_add(world[k], b[3], vb[k]));
        wa = answer(l, inertia_a, cross_add(l, arm_a, world, [zero; 3]), wa);
        wb = answer(l, inertia_b, cross_add(l, world, arm_b, [zero; 3]), wb);
        let moved = triple!(k => l.sub(new[k], r[k]));
        uphill = l.neg_mul_add(load!(point.weight), dot(l, change, moved), uphill);
        change2 = l.add(dot(l, change, change), change2);
    }
    l.store(&mut sums.uphill[places.clone()], uphill);
    l.store(&mut sums.change2[places], change2);
    l.scatter(lines, index[0], [va[0], va[1], va[2], a[3], wa[0], wa[1], wa[2], a[7]]);
    l.scatter(lines, index[1], [vb[0], vb[1], vb[2], b[3], wb[0], wb[1], wb[2], b[7]]);
}
