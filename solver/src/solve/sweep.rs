//! One Gauss-Seidel sweep over the batches, with momentum.

use pulp::NullaryFnOnce;

use crate::math::lanes::{Lanes, Line, Width};
use crate::solve::batches::{BATCH, Batch, Batches, Impulses, Problem, Range, Sums};
use crate::solve::local::{cross_add, dot, signorini_coulomb, triple};

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
    let Problem { lines, previous, ranges, between, frictional } = problem;
    if *frictional {
        side_by_side::<L, true>(ranges, lines, previous, lanes, beta);
    } else {
        side_by_side::<L, false>(ranges, lines, previous, lanes, beta);
    }
    let mut sums = Sums::default();
    ranges.iter().for_each(|range| sums.add(&range.sums));
    let mut last = Sums::default();
    if *frictional {
        run::<L, true>(lanes, lines, between, beta, &mut last);
    } else {
        run::<L, false>(lanes, lines, between, beta, &mut last);
    }
    sums.add(&last);
    sums
}

/// Halves the ranges until one is left to each task.
fn side_by_side<L: Lanes, const FRICTION: bool>(
    ranges: &mut [Range],
    lines: &mut [Line],
    previous: &mut [Line],
    lanes: L,
    beta: f64,
) {
    if let [range] = ranges {
        let moving =
            CarryOn { lanes, lines: &mut lines[..range.moving], previous: &mut previous[..range.moving], beta };
        lanes.run(moving);
        range.sums = Sums::default();
        run::<L, FRICTION>(lanes, &mut lines[..range.lines], &mut range.inside, beta, &mut range.sums);
        return;
    }
    let (left, right) = ranges.split_at_mut(ranges.len() / 2);
    let cut = left.iter().map(|range| range.lines).sum();
    let (lines_left, lines_right) = lines.split_at_mut(cut);
    let (previous_left, previous_right) = previous.split_at_mut(cut);
    rayon::join(
        || side_by_side::<L, FRICTION>(left, lines_left, previous_left, lanes, beta),
        || side_by_side::<L, FRICTION>(right, lines_right, previous_right, lanes, beta),
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

fn run<L: Lanes, const FRICTION: bool>(l: L, lines: &mut [Line], batches: &mut Batches, beta: f64, sums: &mut Sums) {
    struct Op<'a, L, const FRICTION: bool> {
        lanes: L,
        lines: &'a mut [Line],
        batches: &'a mut Batches,
        beta: f64,
        sums: &'a mut Sums,
    }
    impl<L: Lanes, const FRICTION: bool> NullaryFnOnce for Op<'_, L, FRICTION> {
        type Output = ();
        #[inline(always)]
        fn call(self) {
            let Op { lanes, lines, batches, beta, sums } = self;
            for (batch, impulses) in batches.batches.iter().zip(&mut batches.impulses) {
                for from in (0..BATCH).step_by(L::WIDTH) {
                    solve_batch::<L, FRICTION>(lanes, lines, batch, impulses, beta, sums, from);
                }
            }
        }
    }
    l.run(Op::<L, FRICTION> { lanes: l, lines, batches, beta, sums });
}

/// Solves the `WIDTH` contacts of a batch that start at place `from`.
#[inline(always)]
fn solve_batch<L: Lanes, const FRICTION: bool>(
    l: L,
    lines: &mut [Line],
    batch: &Batch,
    impulses: &mut Impulses,
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
    let index = [&batch.bodies[0][places.clone()], &batch.bodies[1][places.clone()]];
    let n = load3!(batch.n);
    let shift = load3!(batch.shift);

    if FRICTION {
        let mut a = l.gather(lines, index[0]);
        let mut b = l.gather(lines, index[1]);
        let levers = [load!(batch.levers[0]), load!(batch.levers[1])];
        // û = v_a - v_b + n x (l_a w_a + l_b w_b) + shift
        let spin = triple!(k => l.mul_add(a[4 + k], levers[0], l.mul(b[4 + k], levers[1])));
        let u = cross_add(l, n, spin, triple!(k => l.add(l.sub(a[k], b[k]), shift[k])));
        let r = load3!(impulses.r);
        let before = load3!(impulses.previous);
        let y = triple!(k => l.mul_add(l.splat(beta), l.sub(r[k], before[k]), r[k]));
        let inverse_w = [load!(batch.inverse_w[0]), load!(batch.inverse_w[1])];
        let new = signorini_coulomb(l, n, u, y, inverse_w, load!(batch.friction));
        for k in 0..3 {
            l.store(&mut impulses.previous[k][places.clone()], r[k]);
            l.store(&mut impulses.r[k][places.clone()], new[k]);
        }
        // The change goes to the bodies at once.
        let change = triple!(k => l.sub(new[k], y[k]));
        let turn = cross_add(l, change, n, [zero; 3]);
        let arms = [l.mul(levers[0], a[7]), l.mul(levers[1], b[7])];
        let w_n = l.add(a[3], b[3]);
        for k in 0..3 {
            a[k] = l.mul_add(change[k], a[3], a[k]);
            b[k] = l.neg_mul_add(change[k], b[3], b[k]);
            a[4 + k] = l.mul_add(turn[k], arms[0], a[4 + k]);
            b[4 + k] = l.mul_add(turn[k], arms[1], b[4 + k]);
        }
        l.scatter(lines, index[0], a);
        l.scatter(lines, index[1], b);
        let moved = triple!(k => l.sub(new[k], r[k]));
        let uphill = l.neg_mul_add(w_n, dot(l, change, moved), load!(sums.uphill));
        let change2 = l.add(dot(l, change, change), load!(sums.change2));
        l.store(&mut sums.uphill[places.clone()], uphill);
        l.store(&mut sums.change2[places], change2);
    } else {
        // One unknown a contact, r̂_n, kept as the first component; spheres do not turn.
        let mut a = l.gather_half(lines, index[0]);
        let mut b = l.gather_half(lines, index[1]);
        let u_n = dot(l, n, triple!(k => l.add(l.sub(a[k], b[k]), shift[k])));
        let r = load!(impulses.r[0]);
        let y = l.mul_add(l.splat(beta), l.sub(r, load!(impulses.previous[0])), r);
        let stopping = l.neg_mul_add(u_n, load!(batch.inverse_w[0]), y);
        let new = l.select_greater(stopping, zero, stopping, zero);
        l.store(&mut impulses.previous[0][places.clone()], r);
        l.store(&mut impulses.r[0][places.clone()], new);
        let change = l.sub(new, y);
        let w_n = l.add(a[3], b[3]);
        let (to_a, to_b) = (l.mul(change, a[3]), l.mul(change, b[3]));
        for k in 0..3 {
            a[k] = l.mul_add(n[k], to_a, a[k]);
            b[k] = l.neg_mul_add(n[k], to_b, b[k]);
        }
        l.scatter_half(lines, index[0], a);
        l.scatter_half(lines, index[1], b);
        let uphill = l.neg_mul_add(l.mul(w_n, change), l.sub(new, r), load!(sums.uphill));
        let change2 = l.mul_add(change, change, load!(sums.change2));
        l.store(&mut sums.uphill[places.clone()], uphill);
        l.store(&mut sums.change2[places], change2);
    }
}
