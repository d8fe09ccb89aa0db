//! Arithmetic in the vectors of an instruction set.
//!
//! [`Arithmetic`] is implemented once, on pulp's [`Simd`], which has fused multiply-add for AVX-512, AVX2 and NEON. An
//! instruction set adds how it exchanges vectors with the lines of bodies, [`LaneMemory`].

use std::marker::PhantomData;

use bytemuck::{Pod, bytes_of, cast_slice, must_cast as cast, pod_read_unaligned};
use pulp::{NullaryFnOnce, Simd, WithSimd};

use super::arithmetic::{Arithmetic, F32Arithmetic, F64Arithmetic, LaneFloat};

/// Instruction set with fused multiply-add.
pub trait InstructionSet: Simd {
    /// See [`Arithmetic::prefetch`].
    fn prefetch<X: ?Sized>(self, x: &X);
}

/// Operations of an instruction set on vectors of `T` that pulp does not have.
pub trait LaneMemory<T: LaneFloat>: InstructionSet {
    const WIDTH: usize = size_of::<Self::Register>() / size_of::<T>();
    /// Vector with the alignment of a register, unlike pulp's.
    type Register: Pod + Send + Sync;

    /// See [`Arithmetic::mask_greater`].
    fn mask_greater(self, x: Self::Register, y: Self::Register) -> u32;
    /// See [`Arithmetic::min`].
    fn min(self, a: Self::Register, b: Self::Register) -> Self::Register;
    /// See [`Arithmetic::gather_lines`].
    fn gather_lines(self, lines: &[[T; 8]], index: &[u32]) -> [Self::Register; 8];
    /// See [`Arithmetic::scatter_lines`].
    fn scatter_lines(self, lines: &mut [[T; 8]], index: &[u32], columns: [Self::Register; 8]);
    /// See [`Arithmetic::relative_velocity`].
    fn relative_velocity(self, lines: &[T::Line], a: &[u32], b: &[u32]) -> [Self::Register; 8];
    /// See [`Arithmetic::apply_impulse`].
    fn apply_impulse(self, lines: &mut [T::Line], a: &[u32], b: &[u32], f: [Self::Register; 3], g: [Self::Register; 3]);
    /// See [`Arithmetic::relative_half_velocity`].
    fn relative_half_velocity(self, halves: &[T::Half], a: &[u32], b: &[u32]) -> [Self::Register; 4];
    /// See [`Arithmetic::apply_half_impulse`].
    fn apply_half_impulse(self, halves: &mut [T::Half], a: &[u32], b: &[u32], f: [Self::Register; 3]);
}

/// Vectors of `T` of the instruction set `S`.
#[derive(Debug, Clone, Copy)]
pub struct SimdLanes<S, T> {
    simd: S,
    number: PhantomData<T>,
}

impl<S, T> SimdLanes<S, T> {
    /// Lanes of a width that the processor has, which `simd` proves.
    #[inline(always)]
    pub fn new(simd: S) -> Self {
        SimdLanes { simd, number: PhantomData }
    }
}

/// Operation in the form that pulp runs.
struct SimdOperation<Op>(Op);

impl<Op: NullaryFnOnce> WithSimd for SimdOperation<Op> {
    type Output = Op::Output;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Op::Output {
        self.0.call()
    }
}

/// Implements [`Arithmetic`] with the names that pulp has for the operations on these numbers.
macro_rules! simd_lanes {
    ($number:ty, $splat:ident, $add:ident, $sub:ident, $mul:ident, $div:ident, $sqrt:ident, $mul_add:ident,
     $neg_mul_add:ident, $greater:ident, $select:ident) => {
        impl<S: LaneMemory<$number>> Arithmetic for SimdLanes<S, $number> {
            type T = $number;
            const WIDTH: usize = S::WIDTH;
            type V = S::Register;

            #[inline(always)]
            fn run<Op: NullaryFnOnce>(self, op: Op) -> Op::Output {
                Simd::vectorize(self.simd, SimdOperation(op))
            }
            #[inline(always)]
            fn prefetch<X: ?Sized>(self, x: &X) {
                self.simd.prefetch(x);
            }

            #[inline(always)]
            fn splat(self, x: f64) -> S::Register {
                cast(self.simd.$splat(<$number>::from_f64(x)))
            }
            #[inline(always)]
            fn load(self, x: &[$number]) -> S::Register {
                pod_read_unaligned(cast_slice(&x[..S::WIDTH]))
            }
            #[inline(always)]
            fn store(self, x: &mut [$number], v: S::Register) {
                x[..S::WIDTH].copy_from_slice(cast_slice(bytes_of(&v)));
            }
            #[inline(always)]
            fn add(self, a: S::Register, b: S::Register) -> S::Register {
                cast(self.simd.$add(cast(a), cast(b)))
            }
            #[inline(always)]
            fn sub(self, a: S::Register, b: S::Register) -> S::Register {
                cast(self.simd.$sub(cast(a), cast(b)))
            }
            #[inline(always)]
            fn mul(self, a: S::Register, b: S::Register) -> S::Register {
                cast(self.simd.$mul(cast(a), cast(b)))
            }
            #[inline(always)]
            fn div(self, a: S::Register, b: S::Register) -> S::Register {
                cast(self.simd.$div(cast(a), cast(b)))
            }
            #[inline(always)]
            fn sqrt(self, a: S::Register) -> S::Register {
                cast(self.simd.$sqrt(cast(a)))
            }
            #[inline(always)]
            fn mul_add(self, a: S::Register, b: S::Register, c: S::Register) -> S::Register {
                cast(self.simd.$mul_add(cast(a), cast(b), cast(c)))
            }
            #[inline(always)]
            fn neg_mul_add(self, a: S::Register, b: S::Register, c: S::Register) -> S::Register {
                cast(self.simd.$neg_mul_add(cast(a), cast(b), cast(c)))
            }
            #[inline(always)]
            fn select_greater(self, x: S::Register, y: S::Register, a: S::Register, b: S::Register) -> S::Register {
                cast(self.simd.$select(self.simd.$greater(cast(x), cast(y)), cast(a), cast(b)))
            }
            #[inline(always)]
            fn mask_greater(self, x: S::Register, y: S::Register) -> u32 {
                self.simd.mask_greater(x, y)
            }
            #[inline(always)]
            fn min(self, a: S::Register, b: S::Register) -> S::Register {
                self.simd.min(a, b)
            }
            #[inline(always)]
            fn gather_lines(self, lines: &[[$number; 8]], index: &[u32]) -> [S::Register; 8] {
                self.simd.gather_lines(lines, index)
            }
            #[inline(always)]
            fn scatter_lines(self, lines: &mut [[$number; 8]], index: &[u32], columns: [S::Register; 8]) {
                self.simd.scatter_lines(lines, index, columns);
            }
            #[inline(always)]
            fn relative_velocity(
                self,
                lines: &[<$number as LaneFloat>::Line],
                a: &[u32],
                b: &[u32],
            ) -> [S::Register; 8] {
                self.simd.relative_velocity(lines, a, b)
            }
            #[inline(always)]
            fn apply_impulse(
                self,
                lines: &mut [<$number as LaneFloat>::Line],
                a: &[u32],
                b: &[u32],
                f: [S::Register; 3],
                g: [S::Register; 3],
            ) {
                self.simd.apply_impulse(lines, a, b, f, g);
            }
            #[inline(always)]
            fn relative_half_velocity(
                self,
                halves: &[<$number as LaneFloat>::Half],
                a: &[u32],
                b: &[u32],
            ) -> [S::Register; 4] {
                self.simd.relative_half_velocity(halves, a, b)
            }
            #[inline(always)]
            fn apply_half_impulse(
                self,
                halves: &mut [<$number as LaneFloat>::Half],
                a: &[u32],
                b: &[u32],
                f: [S::Register; 3],
            ) {
                self.simd.apply_half_impulse(halves, a, b, f);
            }
        }
    };
}

simd_lanes!(
    f64,
    splat_f64s,
    add_f64s,
    sub_f64s,
    mul_f64s,
    div_f64s,
    sqrt_f64s,
    mul_add_f64s,
    negate_mul_add_e_f64s,
    greater_than_f64s,
    select_f64s
);
simd_lanes!(
    f32,
    splat_f32s,
    add_f32s,
    sub_f32s,
    mul_f32s,
    div_f32s,
    sqrt_f32s,
    mul_add_f32s,
    negate_mul_add_e_f32s,
    greater_than_f32s,
    select_f32s
);

impl<S: LaneMemory<f64> + LaneMemory<f32>> F64Arithmetic for SimdLanes<S, f64> {
    type Single = SimdLanes<S, f32>;

    #[inline(always)]
    fn single(self) -> SimdLanes<S, f32> {
        SimdLanes::new(self.simd)
    }
    #[inline(always)]
    fn min_lane(self, a: Self::V) -> f64 {
        self.simd.reduce_min_f64s(cast(a))
    }
}

impl<S: LaneMemory<f32>> F32Arithmetic for SimdLanes<S, f32> {
    #[inline(always)]
    fn rsqrt_seed(self, magic: u32, a: Self::V) -> Self::V {
        let s = self.simd;
        let half = s.wrapping_dyn_shr_u32s(cast(a), s.splat_u32s(1));
        cast(s.sub_u32s(s.splat_u32s(magic), half))
    }
}
