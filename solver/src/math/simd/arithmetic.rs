//! Traits of the arithmetic of one width, and the lines of memory of bodies that it gathers and scatters.

use std::ops::{Add, Sub};

use bytemuck::{Pod, Zeroable};
use pulp::NullaryFnOnce;

/// Data of a sphere in a sweep, eight numbers on one cache line: velocity v (3 numbers, m/s), 1/m (1/kg), surface speed R ω
/// (3 numbers, m/s), R²/J (1/kg); radius R, angular velocity ω, moment of inertia J, world frame.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct BodyLine(pub [f64; 8]);

/// Data of a sphere in a sweep without friction, half a cache line: velocity v (3 numbers, m/s) and 1/m (1/kg).
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C, align(32))]
pub struct BodyHalfLine(pub [f64; 4]);

/// Data of a sphere in a sweep in single precision: as [`BodyLine`], but with the changes of v and R ω by the sweeps, in the
/// units of the sweeps.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C, align(32))]
pub struct BodyLineF32(pub [f32; 8]);

/// Data of a sphere in a sweep in single precision without friction: the first four numbers of [`BodyLineF32`].
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C, align(16))]
pub struct BodyHalfLineF32(pub [f32; 4]);

/// Numbers in double or single precision.
pub trait LaneFloat: Pod + Default + Send + Sync + Add<Output = Self> + Sub<Output = Self> {
    /// Aligned data of a sphere with friction: [`BodyLine`] in this precision.
    type Line: Pod;
    /// Aligned data of a sphere without friction: [`BodyHalfLine`] in this precision.
    type Half: Pod;

    const ZERO: Self;
    const IS_SINGLE: bool;
    /// Approximate square root of the spacing of numbers near 1.
    const SQRT_EPSILON: f64;

    /// Nearest number to `x`.
    fn from_f64(x: f64) -> Self;
    fn to_f64(self) -> f64;
    /// a self + b, rounded once.
    fn fused_mul_add(self, a: Self, b: Self) -> Self;

    /// Arithmetic in this precision with the vectors of `L`.
    type Lanes<L: F64Arithmetic>: Arithmetic<T = Self>;
    fn lanes<L: F64Arithmetic>(l: L) -> Self::Lanes<L>;
}

impl LaneFloat for f64 {
    type Line = BodyLine;
    type Half = BodyHalfLine;

    const ZERO: f64 = 0.0;
    const IS_SINGLE: bool = false;
    const SQRT_EPSILON: f64 = 1e-8;

    #[inline(always)]
    fn from_f64(x: f64) -> f64 {
        x
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        self
    }
    #[inline(always)]
    fn fused_mul_add(self, a: f64, b: f64) -> f64 {
        self.mul_add(a, b)
    }

    type Lanes<L: F64Arithmetic> = L;
    #[inline(always)]
    fn lanes<L: F64Arithmetic>(l: L) -> L {
        l
    }
}

impl LaneFloat for f32 {
    type Line = BodyLineF32;
    type Half = BodyHalfLineF32;

    const ZERO: f32 = 0.0;
    const IS_SINGLE: bool = true;
    const SQRT_EPSILON: f64 = 3e-4;

    #[inline(always)]
    fn from_f64(x: f64) -> f32 {
        x as f32
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
    #[inline(always)]
    fn fused_mul_add(self, a: f32, b: f32) -> f32 {
        self.mul_add(a, b)
    }

    type Lanes<L: F64Arithmetic> = L::Single;
    #[inline(always)]
    fn lanes<L: F64Arithmetic>(l: L) -> L::Single {
        l.single()
    }
}

/// Arithmetic on `WIDTH` numbers at once.
pub trait Arithmetic: Copy + Send + Sync {
    /// Precision of the numbers.
    type T: LaneFloat;
    /// Number of lanes.
    const WIDTH: usize;
    /// Vector with a number in each lane.
    type V: Copy + Send;

    /// Runs `op` compiled for this instruction set; functions that it calls must be inlined into it.
    fn run<Op: NullaryFnOnce>(self, op: Op) -> Op::Output;

    /// Prefetches the memory of `x` into the L2 cache, so that the latency of far memory overlaps with other work. Small
    /// requests are best, as only some tens of lines can be in flight. A prefetch into the L1 cache would evict the data in
    /// use.
    fn prefetch<X: ?Sized>(self, x: &X);

    /// Nearest number to `x` in all lanes.
    fn splat(self, x: f64) -> Self::V;
    /// First `WIDTH` numbers of `x`.
    fn load(self, x: &[Self::T]) -> Self::V;
    fn store(self, x: &mut [Self::T], v: Self::V);
    fn add(self, a: Self::V, b: Self::V) -> Self::V;
    fn sub(self, a: Self::V, b: Self::V) -> Self::V;
    fn mul(self, a: Self::V, b: Self::V) -> Self::V;
    fn div(self, a: Self::V, b: Self::V) -> Self::V;
    fn sqrt(self, a: Self::V) -> Self::V;
    #[inline(always)]
    fn abs(self, a: Self::V) -> Self::V {
        let zero = self.splat(0.0);
        self.select_greater(a, zero, a, self.sub(zero, a))
    }
    /// a b + c, rounded once.
    fn mul_add(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V;
    /// c - a b, rounded once.
    fn neg_mul_add(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V;
    /// `a` where x > y, else `b`.
    fn select_greater(self, x: Self::V, y: Self::V, a: Self::V, b: Self::V) -> Self::V;
    /// Mask with bit k set where x > y in lane k.
    fn mask_greater(self, x: Self::V, y: Self::V) -> u32;
    /// The smaller one; `b` if they are equal.
    fn min(self, a: Self::V, b: Self::V) -> Self::V;
    /// Component k of the `WIDTH` lines given by `index`, for each k. These lines need no alignment, and their numbers may have
    /// any meaning: those of spheres, or the summaries and moments of the cells of self-gravity.
    fn gather_lines(self, lines: &[[Self::T; 8]], index: &[u32]) -> [Self::V; 8];
    /// Writes the lines given by `index`, the inverse of [`Self::gather_lines`]; equal indices must have equal lines.
    fn scatter_lines(self, lines: &mut [[Self::T; 8]], index: &[u32], columns: [Self::V; 8]);
    /// For pairs of spheres in lines (v, 1/m, R ω, R²/J): v_a - v_b in components 0 to 2 and R_a ω_a + R_b ω_b in 4 to 6,
    /// from which the relative velocity at the contact follows with n, and the sums of 1/m in 3 and of R²/J in 7.
    fn relative_velocity(self, lines: &[<Self::T as LaneFloat>::Line], a: &[u32], b: &[u32]) -> [Self::V; 8];
    /// Adds (1/m) f to v of a and subtracts it from v of b, and adds (R²/J) g to R ω of both, in lines (v, 1/m, R ω, R²/J).
    /// `f`: impulse on a, N s; `g`: its moment divided by R, the same for both, N s.
    fn apply_impulse(
        self,
        lines: &mut [<Self::T as LaneFloat>::Line],
        a: &[u32],
        b: &[u32],
        f: [Self::V; 3],
        g: [Self::V; 3],
    );
    /// [`Self::relative_velocity`] for half lines (v, 1/m): v_a - v_b and the sum of 1/m.
    fn relative_half_velocity(self, halves: &[<Self::T as LaneFloat>::Half], a: &[u32], b: &[u32]) -> [Self::V; 4];
    /// [`Self::apply_impulse`] for half lines (v, 1/m).
    fn apply_half_impulse(self, halves: &mut [<Self::T as LaneFloat>::Half], a: &[u32], b: &[u32], f: [Self::V; 3]);
}

/// Arithmetic in double precision.
pub trait F64Arithmetic: Arithmetic<T = f64> {
    /// Arithmetic in single precision with the same instruction set, on twice as many numbers at once if it has vectors.
    type Single: F32Arithmetic;
    fn single(self) -> Self::Single;

    /// Smallest number of all lanes.
    fn min_lane(self, a: Self::V) -> f64;
}

/// Arithmetic in single precision.
pub trait F32Arithmetic: Arithmetic<T = f32> {
    /// Number whose bits are those of `magic` minus half those of `a`, as integers: approximately proportional to a^(-1/2).
    /// It is the same on every machine, unlike the results of instructions that estimate a root.
    fn rsqrt_seed(self, magic: u32, a: Self::V) -> Self::V;
}

/// Operation that can be done in vectors of any width.
pub trait LaneOperation {
    type Output;
    fn call<L: F64Arithmetic>(self, l: L) -> Self::Output;
}
