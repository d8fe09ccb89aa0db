//! The same arithmetic on 8, 4, 2 or 1 numbers at a time (16, 8, 4 or 1 in single precision), chosen at run time. Every
//! operation is written once, in one order and with explicit fused multiply-add, so all widths give the same bits.
//!
//! | module | contents |
//! |---|---|
//! | `arithmetic` | traits of the arithmetic, lines of bodies |
//! | `scalar` | one number at a time |
//! | `vectors` | vectors of an instruction set, on pulp's `Simd` |
//! | `x86`, `neon` | exchange of these vectors with the lines of bodies |
//! | `adapters` | vectors made of vectors |

mod adapters;
mod arithmetic;
#[cfg(target_arch = "aarch64")]
mod neon;
mod scalar;
mod vectors;
#[cfg(target_arch = "x86_64")]
mod x86;

use std::sync::OnceLock;

use pulp::NullaryFnOnce;

pub use adapters::DoubleWidth;
pub use arithmetic::{
    Arithmetic, BodyHalfLine, BodyHalfLineF32, BodyLine, BodyLineF32, F32Arithmetic, F64Arithmetic, LaneFloat,
    LaneOperation,
};
pub use scalar::{Scalar, ScalarF32};
pub use vectors::SimdLanes;

/// Operation that is compiled for the instruction set of the arithmetic with which it is called.
struct RunInLanes<Op>(Op);

impl<Op: LaneOperation> LaneOperation for RunInLanes<Op> {
    type Output = Op::Output;
    #[inline(always)]
    fn call<L: F64Arithmetic>(self, l: L) -> Op::Output {
        l.run(BoundOperation { l, op: self.0 })
    }
}

/// Operation with the arithmetic of one width, in the form that [`Arithmetic::run`] takes.
struct BoundOperation<L, Op> {
    l: L,
    op: Op,
}

impl<L: F64Arithmetic, Op: LaneOperation> NullaryFnOnce for BoundOperation<L, Op> {
    type Output = Op::Output;
    #[inline(always)]
    fn call(self) -> Op::Output {
        self.op.call(self.l)
    }
}

/// Prefetch of a value, see [`Arithmetic::prefetch`].
struct PrefetchMemory<'a, X: ?Sized>(&'a X);

impl<X: ?Sized> LaneOperation for PrefetchMemory<'_, X> {
    type Output = ();
    #[inline(always)]
    fn call<L: F64Arithmetic>(self, l: L) {
        l.prefetch(self.0);
    }
}

/// Number of lanes; it never changes a result.
#[derive(Debug, Clone, Copy)]
pub enum SimdWidth {
    One(Scalar),
    #[cfg(target_arch = "aarch64")]
    Two(SimdLanes<pulp::aarch64::Neon, f64>),
    #[cfg(target_arch = "x86_64")]
    Four(SimdLanes<pulp::x86::V3, f64>),
    #[cfg(target_arch = "x86_64")]
    Eight(SimdLanes<pulp::x86::V4, f64>),
}

/// Width set by [`SimdWidth::set_for_process`].
static PROCESS_WIDTH: OnceLock<SimdWidth> = OnceLock::new();

impl SimdWidth {
    /// Width for the kernels of this process: the largest of this machine unless [`Self::set_for_process`] has set another.
    pub fn detect() -> Self {
        PROCESS_WIDTH.get().copied().unwrap_or_else(Self::largest)
    }

    /// Makes [`Self::detect`] return this width. To be called once, before the first kernel.
    pub fn set_for_process(self) {
        PROCESS_WIDTH.set(self).expect("called once");
    }

    /// Name of the instruction set.
    pub fn name(self) -> &'static str {
        match self {
            SimdWidth::One(_) => "scalar",
            #[cfg(target_arch = "aarch64")]
            SimdWidth::Two(_) => "neon",
            #[cfg(target_arch = "x86_64")]
            SimdWidth::Four(_) => "avx2",
            #[cfg(target_arch = "x86_64")]
            SimdWidth::Eight(_) => "avx512",
        }
    }

    fn largest() -> Self {
        #[cfg(target_arch = "x86_64")]
        if let Some(simd) = pulp::x86::V4::try_new() {
            return SimdWidth::Eight(SimdLanes::new(simd));
        } else if let Some(simd) = pulp::x86::V3::try_new() {
            return SimdWidth::Four(SimdLanes::new(simd));
        }
        #[cfg(target_arch = "aarch64")]
        if let Some(simd) = pulp::aarch64::Neon::try_new() {
            return SimdWidth::Two(SimdLanes::new(simd));
        }
        SimdWidth::One(Scalar)
    }

    /// All widths of this machine, smallest first.
    pub fn all_widths() -> Vec<Self> {
        let mut all = vec![SimdWidth::One(Scalar)];
        #[cfg(target_arch = "x86_64")]
        {
            all.extend(pulp::x86::V3::try_new().map(|simd| SimdWidth::Four(SimdLanes::new(simd))));
            all.extend(pulp::x86::V4::try_new().map(|simd| SimdWidth::Eight(SimdLanes::new(simd))));
        }
        #[cfg(target_arch = "aarch64")]
        all.extend(pulp::aarch64::Neon::try_new().map(|simd| SimdWidth::Two(SimdLanes::new(simd))));
        all
    }

    /// Calls `op` with the arithmetic of this width, compiled for its instruction set; functions that `op` calls must be
    /// inlined into it.
    pub fn run<Op: LaneOperation>(self, op: Op) -> Op::Output {
        self.dispatch(RunInLanes(op))
    }

    /// Calls `op` with the arithmetic of this width, not compiled for its instruction set: for operations that call
    /// [`Arithmetic::run`] themselves.
    #[inline(always)]
    pub fn dispatch<Op: LaneOperation>(self, op: Op) -> Op::Output {
        match self {
            SimdWidth::One(l) => op.call(l),
            #[cfg(target_arch = "aarch64")]
            SimdWidth::Two(l) => op.call(l),
            #[cfg(target_arch = "x86_64")]
            SimdWidth::Four(l) => op.call(l),
            #[cfg(target_arch = "x86_64")]
            SimdWidth::Eight(l) => op.call(l),
        }
    }

    /// Prefetches `x`, see [`Arithmetic::prefetch`].
    #[inline(always)]
    pub fn prefetch<X: ?Sized>(self, x: &X) {
        self.dispatch(PrefetchMemory(x));
    }
}

/// Name that is none of [`SimdWidth::all_widths`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UnknownWidth;

impl std::fmt::Display for UnknownWidth {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let names: Vec<&str> = SimdWidth::all_widths().into_iter().map(SimdWidth::name).collect();
        write!(f, "expected a width of this machine: {}", names.join(", "))
    }
}

impl std::error::Error for UnknownWidth {}

impl std::str::FromStr for SimdWidth {
    type Err = UnknownWidth;
    fn from_str(name: &str) -> Result<Self, UnknownWidth> {
        SimdWidth::all_widths().into_iter().find(|width| width.name() == name).ok_or(UnknownWidth)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Transposed reading, arithmetic and writing agree with the scalar to the last bit.
    fn agrees<L: Arithmetic<T = f64>>(lanes: L) {
        struct Op<'a, L> {
            lanes: L,
            lines: &'a mut [BodyLine],
            halves: &'a mut [BodyHalfLine],
        }
        impl<L: Arithmetic<T = f64>> NullaryFnOnce for Op<'_, L> {
            type Output = ();
            #[inline(always)]
            fn call(self) {
                let Op { lanes: l, lines, halves } = self;
                let (index, other) = ([3, 0, 5, 7, 1, 8, 2, 6], [18, 4, 9, 10, 12, 11, 17, 13]);
                for from in (0..8).step_by(L::WIDTH) {
                    let (index, other) = (&index[from..from + L::WIDTH], &other[from..from + L::WIDTH]);
                    let c = l.relative_velocity(lines, index, other);
                    let q = l.div(l.mul_add(c[0], c[1], c[2]), l.sqrt(l.mul(c[3], c[3])));
                    let q = l.sub(l.add(q, c[4]), l.neg_mul_add(c[5], c[6], c[7]));
                    let q = l.select_greater(q, l.splat(0.3), q, l.sub(l.splat(0.0), q));
                    let mut mask = [0.0; 8];
                    (0..L::WIDTH).for_each(|k| mask[k] = f64::from(l.mask_greater(q, c[1]) >> k & 1));
                    let q = l.add(l.min(q, c[2]), l.load(&mask));
                    l.apply_impulse(lines, index, other, [q, c[1], c[2]], [c[4], q, c[6]]);
                    let [x, y, z, p] = l.relative_half_velocity(halves, index, other);
                    l.apply_half_impulse(halves, other, index, [z, l.mul(x, p), y]);
                    let mut rows: Vec<[f64; 8]> = lines.iter().map(|line| line.0).collect();
                    let moved = l.gather_lines(&rows, index);
                    l.scatter_lines(&mut rows, other, moved);
                    let c = l.gather_lines(&rows, other);
                    l.apply_impulse(lines, other, index, [c[0], c[1], c[2]], [c[3], c[4], c[7]]);
                }
            }
        }
        let sample = || -> Vec<BodyLine> {
            (0..19).map(|i| BodyLine(std::array::from_fn(|k| ((i * 8 + k) as f64 * 0.7).sin() + 0.01))).collect()
        };
        let halves = || -> Vec<BodyHalfLine> {
            sample().iter().map(|line| BodyHalfLine([0, 6, 2, 5].map(|k| line.0[k]))).collect()
        };
        let (mut expected, mut got) = ((sample(), halves()), (sample(), halves()));
        Scalar.run(Op { lanes: Scalar, lines: &mut expected.0, halves: &mut expected.1 });
        lanes.run(Op { lanes, lines: &mut got.0, halves: &mut got.1 });
        assert_eq!(got, expected);
    }

    /// Relative velocities read from a pair of lines, and velocities written, in numbers.
    #[test]
    fn pairs_of_lines() {
        let mut lines =
            [[1.0, 2.0, 3.0, 0.5, 4.0, 5.0, 6.0, 2.0], [7.0, 9.0, 2.0, 1.0, 1.0, 2.0, 3.0, 4.0]].map(BodyLine);
        assert_eq!(Scalar.relative_velocity(&lines, &[0], &[1]), [-6.0, -7.0, 1.0, 1.5, 5.0, 7.0, 9.0, 6.0]);
        Scalar.apply_impulse(&mut lines, &[0], &[1], [2.0, 4.0, 6.0], [1.0, 0.0, -1.0]);
        assert_eq!(lines[0].0, [2.0, 4.0, 6.0, 0.5, 6.0, 5.0, 4.0, 2.0]);
        assert_eq!(lines[1].0, [5.0, 5.0, -4.0, 1.0, 5.0, 2.0, -1.0, 4.0]);
    }

    /// As [`agrees`], for single precision.
    fn agrees_f32<L: F32Arithmetic>(lanes: L) {
        struct Op<'a, L> {
            l: L,
            x: &'a mut [f32; 32],
        }
        impl<L: F32Arithmetic> NullaryFnOnce for Op<'_, L> {
            type Output = ();
            #[inline(always)]
            fn call(self) {
                let Op { l, x } = self;
                for from in (0..16).step_by(L::WIDTH) {
                    let (a, b) = (l.load(&x[from..]), l.load(&x[16 + from..]));
                    let y = l.rsqrt_seed(0x5f1ffff9, l.mul_add(a, a, l.splat(0.1)));
                    let y = l.sub(l.neg_mul_add(y, b, a), l.mul(y, b));
                    l.store(&mut x[from..], l.min(y, l.splat(0.8)));
                }
            }
        }
        let sample = || std::array::from_fn(|i| (i as f32 * 0.7).sin());
        let (mut expected, mut got) = (sample(), sample());
        ScalarF32.run(Op { l: ScalarF32, x: &mut expected });
        lanes.run(Op { l: lanes, x: &mut got });
        assert_eq!(got, expected);
    }

    /// As [`agrees`], for bodies in single precision.
    fn agrees_on_short_bodies<L: Arithmetic<T = f32>>(lanes: L) {
        struct Op<'a, L> {
            l: L,
            lines: &'a mut [BodyLineF32],
            halves: &'a mut [BodyHalfLineF32],
        }
        impl<L: Arithmetic<T = f32>> NullaryFnOnce for Op<'_, L> {
            type Output = ();
            #[inline(always)]
            fn call(self) {
                let Op { l, lines, halves } = self;
                let index = [3, 0, 5, 7, 1, 8, 2, 6, 30, 31, 22, 25, 29, 20, 33, 21];
                let other = [18, 4, 9, 10, 12, 11, 17, 13, 19, 34, 23, 28, 24, 26, 32, 27];
                for from in (0..16).step_by(L::WIDTH) {
                    let (a, b) = (&index[from..from + L::WIDTH], &other[from..from + L::WIDTH]);
                    let c = l.relative_velocity(lines, a, b);
                    let q = l.div(l.mul_add(c[0], c[1], c[2]), l.sqrt(l.mul(c[3], c[3])));
                    let q = l.select_greater(q, l.splat(0.3), q, l.sub(c[5], l.min(q, c[4])));
                    l.apply_impulse(lines, a, b, [q, c[1], c[2]], [c[4], q, c[6]]);
                    let [x, y, z, p] = l.relative_half_velocity(halves, a, b);
                    l.apply_half_impulse(halves, b, a, [z, l.mul(x, p), y]);
                    let mut rows: Vec<[f32; 8]> = lines.iter().map(|line| line.0).collect();
                    let moved = l.gather_lines(&rows, a);
                    l.scatter_lines(&mut rows, b, moved);
                    let c = l.gather_lines(&rows, b);
                    l.apply_impulse(lines, b, a, [c[0], c[1], c[2]], [c[3], c[4], c[7]]);
                }
            }
        }
        let number = |i: usize| ((i as f64 * 0.7).sin() + 0.01) as f32;
        let line = |i: usize| BodyLineF32(std::array::from_fn(|k| number(8 * i + k)));
        let half = |i: usize| BodyHalfLineF32(std::array::from_fn(|k| number(4 * i + k)));
        let sample = || ((0..35).map(line).collect::<Vec<_>>(), (0..35).map(half).collect::<Vec<_>>());
        let (mut expected, mut got) = (sample(), sample());
        ScalarF32.run(Op { l: ScalarF32, lines: &mut expected.0, halves: &mut expected.1 });
        lanes.run(Op { l: lanes, lines: &mut got.0, halves: &mut got.1 });
        assert_eq!(got, expected);
        assert_ne!(got, sample());
    }

    /// All of them, for one width.
    struct AllAgree;

    impl LaneOperation for AllAgree {
        type Output = ();
        fn call<L: F64Arithmetic>(self, l: L) {
            agrees(l);
            agrees_f32(l.single());
            agrees_on_short_bodies(l.single());
            smallest_lane(l);
            if L::WIDTH < 8 {
                agrees(DoubleWidth(l));
            }
        }
    }

    fn smallest_lane<L: F64Arithmetic>(l: L) {
        for k in 0..L::WIDTH {
            let numbers: [f64; 8] = std::array::from_fn(|i| if i == k { -2.5 } else { 1.0 + i as f64 });
            assert_eq!(l.min_lane(l.load(&numbers)), -2.5);
        }
    }

    #[test]
    fn all_widths_give_the_same_bits() {
        SimdWidth::all_widths().into_iter().for_each(|width| width.dispatch(AllAgree));
    }
}
