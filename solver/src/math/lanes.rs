//! The same arithmetic on 8, 4 or 1 numbers at a time (16, 8 or 1 in single precision), chosen at run time. Every operation
//! is written once, in one order and with explicit fused multiply-add, so all widths give the same bits.

use std::ops::{Add, Sub};

use bytemuck::{Pod, Zeroable};
use pulp::NullaryFnOnce;

/// Eight numbers on one cache line: the data of a body in a sweep.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct BodyLine(pub [f64; 8]);

/// Four numbers, half a cache line: the data of a body in a sweep without friction.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C, align(32))]
pub struct BodyHalfLine(pub [f64; 4]);

/// The data of a body in a sweep in single precision, as [`BodyLine`].
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C, align(32))]
pub struct BodyLineF32(pub [f32; 8]);

/// The data of a body in a sweep in single precision without friction, as [`BodyHalfLine`].
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C, align(16))]
pub struct BodyHalfLineF32(pub [f32; 4]);

/// Numbers in double or single precision.
pub trait LaneFloat: Pod + Default + Send + Sync + Add<Output = Self> + Sub<Output = Self> {
    /// Eight and four consecutive numbers.
    type Line: Pod;
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
    type Lanes<L: F32Arithmetic>: Arithmetic<T = Self>;
    fn lanes<L: F32Arithmetic>(l: L) -> Self::Lanes<L>;
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

    type Lanes<L: F32Arithmetic> = L;
    #[inline(always)]
    fn lanes<L: F32Arithmetic>(l: L) -> L {
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

    type Lanes<L: F32Arithmetic> = F32Lanes<L>;
    #[inline(always)]
    fn lanes<L: F32Arithmetic>(l: L) -> F32Lanes<L> {
        F32Lanes(l)
    }
}

/// Arithmetic on `WIDTH` numbers at once.
pub trait Arithmetic: Copy + Send + Sync {
    type T: LaneFloat;
    const WIDTH: usize;
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
    /// Component k of the `WIDTH` lines given by `index`, for each k.
    fn gather_lines(self, lines: &[[Self::T; 8]], index: &[u32]) -> [Self::V; 8];
    /// Writes the lines given by `index`, the inverse of [`Self::gather_lines`]; equal indices must have equal lines.
    fn scatter_lines(self, lines: &mut [[Self::T; 8]], index: &[u32], columns: [Self::V; 8]);
    /// Difference a - b of the first three components and sums of the others, for pairs of lines.
    fn relative_velocity(self, lines: &[<Self::T as LaneFloat>::Line], a: &[u32], b: &[u32]) -> [Self::V; 8];
    /// With lines (v, p, w, q): adds p f to v of a and subtracts it from v of b; adds q g to w of both.
    fn apply_impulse(
        self,
        lines: &mut [<Self::T as LaneFloat>::Line],
        a: &[u32],
        b: &[u32],
        f: [Self::V; 3],
        g: [Self::V; 3],
    );
    /// [`Self::relative_velocity`] for half lines: the first four components.
    fn relative_half_velocity(self, halves: &[<Self::T as LaneFloat>::Half], a: &[u32], b: &[u32]) -> [Self::V; 4];
    /// [`Self::apply_impulse`] for half lines (v, p).
    fn apply_half_impulse(self, halves: &mut [<Self::T as LaneFloat>::Half], a: &[u32], b: &[u32], f: [Self::V; 3]);
}

/// Arithmetic in double precision.
pub trait F64Arithmetic: Arithmetic<T = f64> {
    /// Smallest number of all lanes.
    fn min_lane(self, a: Self::V) -> f64;
}

/// Arithmetic in single precision.
pub trait F32Arithmetic: F64Arithmetic {
    const WIDTH_F32: usize;
    type S: Copy + Send;

    fn splat_f32(self, x: f32) -> Self::S;
    /// First `WIDTH_F32` numbers of `x`.
    fn load_f32(self, x: &[f32]) -> Self::S;
    fn store_f32(self, x: &mut [f32], v: Self::S);
    fn add_f32(self, a: Self::S, b: Self::S) -> Self::S;
    fn sub_f32(self, a: Self::S, b: Self::S) -> Self::S;
    fn mul_f32(self, a: Self::S, b: Self::S) -> Self::S;
    fn div_f32(self, a: Self::S, b: Self::S) -> Self::S;
    fn sqrt_f32(self, a: Self::S) -> Self::S;
    /// a b + c, rounded once.
    fn mul_add_f32(self, a: Self::S, b: Self::S, c: Self::S) -> Self::S;
    /// c - a b, rounded once.
    fn neg_mul_add_f32(self, a: Self::S, b: Self::S, c: Self::S) -> Self::S;
    /// `a` where x > y, else `b`.
    fn select_greater_f32(self, x: Self::S, y: Self::S, a: Self::S, b: Self::S) -> Self::S;
    fn mask_greater_f32(self, x: Self::S, y: Self::S) -> u32;
    /// `a` where a < b, else `b`.
    fn min_f32(self, a: Self::S, b: Self::S) -> Self::S;
    /// Number whose bits are those of `magic` minus half those of `a`, as integers: approximately proportional to a^(-1/2).
    /// It is the same on every machine, unlike the results of instructions that estimate a root.
    fn rsqrt_seed_f32(self, magic: u32, a: Self::S) -> Self::S;
    /// [`Arithmetic::gather_lines`] in single precision; the following functions correspond likewise.
    fn gather_f32(self, lines: &[[f32; 8]], index: &[u32]) -> [Self::S; 8];
    fn scatter_f32(self, lines: &mut [[f32; 8]], index: &[u32], columns: [Self::S; 8]);
    fn relative_velocity_f32(self, lines: &[BodyLineF32], a: &[u32], b: &[u32]) -> [Self::S; 8];
    fn apply_impulse_f32(self, lines: &mut [BodyLineF32], a: &[u32], b: &[u32], f: [Self::S; 3], g: [Self::S; 3]);
    fn relative_half_velocity_f32(self, halves: &[BodyHalfLineF32], a: &[u32], b: &[u32]) -> [Self::S; 4];
    fn apply_half_impulse_f32(self, halves: &mut [BodyHalfLineF32], a: &[u32], b: &[u32], f: [Self::S; 3]);
}

/// The single-precision arithmetic of these lanes as [`Arithmetic`].
#[derive(Debug, Clone, Copy)]
pub struct F32Lanes<L>(pub L);

impl<L: F32Arithmetic> Arithmetic for F32Lanes<L> {
    type T = f32;
    const WIDTH: usize = L::WIDTH_F32;
    type V = L::S;

    fn run<Op: NullaryFnOnce>(self, op: Op) -> Op::Output {
        self.0.run(op)
    }

    #[inline(always)]
    fn prefetch<X: ?Sized>(self, x: &X) {
        self.0.prefetch(x);
    }

    #[inline(always)]
    fn splat(self, x: f64) -> L::S {
        self.0.splat_f32(x as f32)
    }
    #[inline(always)]
    fn load(self, x: &[f32]) -> L::S {
        self.0.load_f32(x)
    }
    #[inline(always)]
    fn store(self, x: &mut [f32], v: L::S) {
        self.0.store_f32(x, v);
    }
    #[inline(always)]
    fn add(self, a: L::S, b: L::S) -> L::S {
        self.0.add_f32(a, b)
    }
    #[inline(always)]
    fn sub(self, a: L::S, b: L::S) -> L::S {
        self.0.sub_f32(a, b)
    }
    #[inline(always)]
    fn mul(self, a: L::S, b: L::S) -> L::S {
        self.0.mul_f32(a, b)
    }
    #[inline(always)]
    fn div(self, a: L::S, b: L::S) -> L::S {
        self.0.div_f32(a, b)
    }
    #[inline(always)]
    fn sqrt(self, a: L::S) -> L::S {
        self.0.sqrt_f32(a)
    }
    #[inline(always)]
    fn mul_add(self, a: L::S, b: L::S, c: L::S) -> L::S {
        self.0.mul_add_f32(a, b, c)
    }
    #[inline(always)]
    fn neg_mul_add(self, a: L::S, b: L::S, c: L::S) -> L::S {
        self.0.neg_mul_add_f32(a, b, c)
    }
    #[inline(always)]
    fn select_greater(self, x: L::S, y: L::S, a: L::S, b: L::S) -> L::S {
        self.0.select_greater_f32(x, y, a, b)
    }
    #[inline(always)]
    fn mask_greater(self, x: L::S, y: L::S) -> u32 {
        self.0.mask_greater_f32(x, y)
    }
    #[inline(always)]
    fn min(self, a: L::S, b: L::S) -> L::S {
        self.0.min_f32(a, b)
    }
    #[inline(always)]
    fn gather_lines(self, lines: &[[f32; 8]], index: &[u32]) -> [L::S; 8] {
        self.0.gather_f32(lines, index)
    }
    #[inline(always)]
    fn scatter_lines(self, lines: &mut [[f32; 8]], index: &[u32], columns: [L::S; 8]) {
        self.0.scatter_f32(lines, index, columns);
    }
    #[inline(always)]
    fn relative_velocity(self, lines: &[BodyLineF32], a: &[u32], b: &[u32]) -> [L::S; 8] {
        self.0.relative_velocity_f32(lines, a, b)
    }
    #[inline(always)]
    fn apply_impulse(self, lines: &mut [BodyLineF32], a: &[u32], b: &[u32], f: [L::S; 3], g: [L::S; 3]) {
        self.0.apply_impulse_f32(lines, a, b, f, g);
    }
    #[inline(always)]
    fn relative_half_velocity(self, halves: &[BodyHalfLineF32], a: &[u32], b: &[u32]) -> [L::S; 4] {
        self.0.relative_half_velocity_f32(halves, a, b)
    }
    #[inline(always)]
    fn apply_half_impulse(self, halves: &mut [BodyHalfLineF32], a: &[u32], b: &[u32], f: [L::S; 3]) {
        self.0.apply_half_impulse_f32(halves, a, b, f);
    }
}

/// Two vectors at once: while one waits for a quotient or a root, the other is computed.
#[derive(Debug, Clone, Copy)]
pub struct DoubleWidth<L>(pub L);

impl<L: Arithmetic> Arithmetic for DoubleWidth<L> {
    type T = L::T;
    const WIDTH: usize = 2 * L::WIDTH;
    type V = [L::V; 2];

    fn run<Op: NullaryFnOnce>(self, op: Op) -> Op::Output {
        self.0.run(op)
    }

    #[inline(always)]
    fn prefetch<X: ?Sized>(self, x: &X) {
        self.0.prefetch(x);
    }

    #[inline(always)]
    fn splat(self, x: f64) -> Self::V {
        [self.0.splat(x); 2]
    }
    #[inline(always)]
    fn load(self, x: &[L::T]) -> Self::V {
        [self.0.load(x), self.0.load(&x[L::WIDTH..])]
    }
    #[inline(always)]
    fn store(self, x: &mut [L::T], v: Self::V) {
        self.0.store(x, v[0]);
        self.0.store(&mut x[L::WIDTH..], v[1]);
    }
    #[inline(always)]
    fn add(self, a: Self::V, b: Self::V) -> Self::V {
        [self.0.add(a[0], b[0]), self.0.add(a[1], b[1])]
    }
    #[inline(always)]
    fn sub(self, a: Self::V, b: Self::V) -> Self::V {
        [self.0.sub(a[0], b[0]), self.0.sub(a[1], b[1])]
    }
    #[inline(always)]
    fn mul(self, a: Self::V, b: Self::V) -> Self::V {
        [self.0.mul(a[0], b[0]), self.0.mul(a[1], b[1])]
    }
    #[inline(always)]
    fn div(self, a: Self::V, b: Self::V) -> Self::V {
        [self.0.div(a[0], b[0]), self.0.div(a[1], b[1])]
    }
    #[inline(always)]
    fn sqrt(self, a: Self::V) -> Self::V {
        [self.0.sqrt(a[0]), self.0.sqrt(a[1])]
    }
    #[inline(always)]
    fn mul_add(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V {
        [self.0.mul_add(a[0], b[0], c[0]), self.0.mul_add(a[1], b[1], c[1])]
    }
    #[inline(always)]
    fn neg_mul_add(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V {
        [self.0.neg_mul_add(a[0], b[0], c[0]), self.0.neg_mul_add(a[1], b[1], c[1])]
    }
    #[inline(always)]
    fn select_greater(self, x: Self::V, y: Self::V, a: Self::V, b: Self::V) -> Self::V {
        [self.0.select_greater(x[0], y[0], a[0], b[0]), self.0.select_greater(x[1], y[1], a[1], b[1])]
    }
    #[inline(always)]
    fn mask_greater(self, x: Self::V, y: Self::V) -> u32 {
        self.0.mask_greater(x[0], y[0]) | self.0.mask_greater(x[1], y[1]) << L::WIDTH
    }
    #[inline(always)]
    fn min(self, a: Self::V, b: Self::V) -> Self::V {
        [self.0.min(a[0], b[0]), self.0.min(a[1], b[1])]
    }
    #[inline(always)]
    fn gather_lines(self, lines: &[[L::T; 8]], index: &[u32]) -> [Self::V; 8] {
        zip_halves(self.0.gather_lines(lines, index), self.0.gather_lines(lines, &index[L::WIDTH..]))
    }
    #[inline(always)]
    fn scatter_lines(self, lines: &mut [[L::T; 8]], index: &[u32], columns: [Self::V; 8]) {
        let [left, right] = unzip_halves(columns);
        self.0.scatter_lines(lines, index, left);
        self.0.scatter_lines(lines, &index[L::WIDTH..], right);
    }
    #[inline(always)]
    fn relative_velocity(self, lines: &[<L::T as LaneFloat>::Line], a: &[u32], b: &[u32]) -> [Self::V; 8] {
        let w = L::WIDTH;
        zip_halves(self.0.relative_velocity(lines, a, b), self.0.relative_velocity(lines, &a[w..], &b[w..]))
    }
    #[inline(always)]
    fn apply_impulse(
        self,
        lines: &mut [<L::T as LaneFloat>::Line],
        a: &[u32],
        b: &[u32],
        f: [Self::V; 3],
        g: [Self::V; 3],
    ) {
        let (w, [f0, f1], [g0, g1]) = (L::WIDTH, unzip_halves(f), unzip_halves(g));
        self.0.apply_impulse(lines, a, b, f0, g0);
        self.0.apply_impulse(lines, &a[w..], &b[w..], f1, g1);
    }
    #[inline(always)]
    fn relative_half_velocity(self, halves: &[<L::T as LaneFloat>::Half], a: &[u32], b: &[u32]) -> [Self::V; 4] {
        let w = L::WIDTH;
        zip_halves(self.0.relative_half_velocity(halves, a, b), self.0.relative_half_velocity(halves, &a[w..], &b[w..]))
    }
    #[inline(always)]
    fn apply_half_impulse(self, halves: &mut [<L::T as LaneFloat>::Half], a: &[u32], b: &[u32], f: [Self::V; 3]) {
        let (w, [f0, f1]) = (L::WIDTH, unzip_halves(f));
        self.0.apply_half_impulse(halves, a, b, f0);
        self.0.apply_half_impulse(halves, &a[w..], &b[w..], f1);
    }
}

impl<L: F64Arithmetic> F64Arithmetic for DoubleWidth<L> {
    #[inline(always)]
    fn min_lane(self, a: Self::V) -> f64 {
        self.0.min_lane(self.0.min(a[0], a[1]))
    }
}

#[inline(always)]
fn zip_halves<V: Copy, const N: usize>(left: [V; N], right: [V; N]) -> [[V; 2]; N] {
    let mut both = [[left[0], right[0]]; N];
    let mut k = 1;
    while k < N {
        both[k] = [left[k], right[k]];
        k += 1;
    }
    both
}

#[inline(always)]
fn unzip_halves<V: Copy, const N: usize>(both: [[V; 2]; N]) -> [[V; N]; 2] {
    let mut sides = [[both[0][0]; N], [both[0][1]; N]];
    let mut k = 1;
    while k < N {
        (sides[0][k], sides[1][k]) = (both[k][0], both[k][1]);
        k += 1;
    }
    sides
}

/// Operation that can be done in vectors of any width.
pub trait LaneOperation {
    type Output;
    fn call<L: F32Arithmetic>(self, l: L) -> Self::Output;
}

struct RunInLanes<Op>(Op);

impl<Op: LaneOperation> LaneOperation for RunInLanes<Op> {
    type Output = Op::Output;
    #[inline(always)]
    fn call<L: F32Arithmetic>(self, l: L) -> Op::Output {
        l.run(BoundOperation { l, op: self.0 })
    }
}

/// Operation with the arithmetic of one width.
struct BoundOperation<L, Op> {
    l: L,
    op: Op,
}

impl<L: F32Arithmetic, Op: LaneOperation> NullaryFnOnce for BoundOperation<L, Op> {
    type Output = Op::Output;
    #[inline(always)]
    fn call(self) -> Op::Output {
        self.op.call(self.l)
    }
}

struct PrefetchMemory<'a, X: ?Sized>(&'a X);

impl<X: ?Sized> LaneOperation for PrefetchMemory<'_, X> {
    type Output = ();
    #[inline(always)]
    fn call<L: F32Arithmetic>(self, l: L) {
        l.prefetch(self.0);
    }
}

/// Number of lanes; it never changes a result.
#[derive(Debug, Clone, Copy)]
pub enum SimdWidth {
    One(Scalar),
    #[cfg(target_arch = "x86_64")]
    Four(pulp::x86::V3),
    #[cfg(target_arch = "x86_64")]
    Eight(pulp::x86::V4),
}

impl SimdWidth {
    /// The largest width of this machine.
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if let Some(wide) =
            pulp::x86::V4::try_new().map(SimdWidth::Eight).or(pulp::x86::V3::try_new().map(SimdWidth::Four))
        {
            return wide;
        }
        SimdWidth::One(Scalar)
    }

    /// All widths of this machine, smallest first.
    pub fn all_widths() -> Vec<Self> {
        let mut all = vec![SimdWidth::One(Scalar)];
        #[cfg(target_arch = "x86_64")]
        {
            all.extend(pulp::x86::V3::try_new().map(SimdWidth::Four));
            all.extend(pulp::x86::V4::try_new().map(SimdWidth::Eight));
        }
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

/// Functions of [`Arithmetic`] for one pair of bodies, under these names.
macro_rules! one_pair {
    ($number:ty, $line:ty, $half:ty, $relative:ident, $push:ident, $relative_half:ident, $push_half:ident) => {
        #[inline(always)]
        fn $relative(self, lines: &[$line], a: &[u32], b: &[u32]) -> [$number; 8] {
            let (a, b) = (&lines[a[0] as usize].0, &lines[b[0] as usize].0);
            [a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5], a[6] + b[6], a[7] + b[7]]
        }
        #[inline(always)]
        fn $push(self, lines: &mut [$line], a: &[u32], b: &[u32], f: [$number; 3], g: [$number; 3]) {
            for (line, sign) in [(a[0], 1.0), (b[0], -1.0)] {
                let line = &mut lines[line as usize].0;
                for k in 0..3 {
                    line[k] = (sign * f[k]).mul_add(line[3], line[k]);
                    line[4 + k] = g[k].mul_add(line[7], line[4 + k]);
                }
            }
        }
        #[inline(always)]
        fn $relative_half(self, halves: &[$half], a: &[u32], b: &[u32]) -> [$number; 4] {
            let (a, b) = (&halves[a[0] as usize].0, &halves[b[0] as usize].0);
            [a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] + b[3]]
        }
        #[inline(always)]
        fn $push_half(self, halves: &mut [$half], a: &[u32], b: &[u32], f: [$number; 3]) {
            for (half, sign) in [(a[0], 1.0), (b[0], -1.0)] {
                let half = &mut halves[half as usize].0;
                for k in 0..3 {
                    half[k] = (sign * f[k]).mul_add(half[3], half[k]);
                }
            }
        }
    };
}

/// One number at a time: any machine.
#[derive(Debug, Clone, Copy)]
pub struct Scalar;

impl Arithmetic for Scalar {
    type T = f64;
    const WIDTH: usize = 1;
    type V = f64;

    fn run<Op: NullaryFnOnce>(self, op: Op) -> Op::Output {
        op.call()
    }

    #[inline(always)]
    fn prefetch<X: ?Sized>(self, _: &X) {}

    #[inline(always)]
    fn splat(self, x: f64) -> f64 {
        x
    }
    #[inline(always)]
    fn load(self, x: &[f64]) -> f64 {
        x[0]
    }
    #[inline(always)]
    fn store(self, x: &mut [f64], v: f64) {
        x[0] = v;
    }
    #[inline(always)]
    fn add(self, a: f64, b: f64) -> f64 {
        a + b
    }
    #[inline(always)]
    fn sub(self, a: f64, b: f64) -> f64 {
        a - b
    }
    #[inline(always)]
    fn mul(self, a: f64, b: f64) -> f64 {
        a * b
    }
    #[inline(always)]
    fn div(self, a: f64, b: f64) -> f64 {
        a / b
    }
    #[inline(always)]
    fn sqrt(self, a: f64) -> f64 {
        a.sqrt()
    }
    #[inline(always)]
    fn mul_add(self, a: f64, b: f64, c: f64) -> f64 {
        a.mul_add(b, c)
    }
    #[inline(always)]
    fn neg_mul_add(self, a: f64, b: f64, c: f64) -> f64 {
        (-a).mul_add(b, c)
    }
    #[inline(always)]
    fn select_greater(self, x: f64, y: f64, a: f64, b: f64) -> f64 {
        if x > y { a } else { b }
    }
    #[inline(always)]
    fn mask_greater(self, x: f64, y: f64) -> u32 {
        u32::from(x > y)
    }
    #[inline(always)]
    fn min(self, a: f64, b: f64) -> f64 {
        if a < b { a } else { b }
    }
    #[inline(always)]
    fn gather_lines(self, lines: &[[f64; 8]], index: &[u32]) -> [f64; 8] {
        lines[index[0] as usize]
    }
    #[inline(always)]
    fn scatter_lines(self, lines: &mut [[f64; 8]], index: &[u32], columns: [f64; 8]) {
        lines[index[0] as usize] = columns;
    }
    one_pair!(
        f64,
        BodyLine,
        BodyHalfLine,
        relative_velocity,
        apply_impulse,
        relative_half_velocity,
        apply_half_impulse
    );
}

impl F64Arithmetic for Scalar {
    #[inline(always)]
    fn min_lane(self, a: f64) -> f64 {
        a
    }
}

impl F32Arithmetic for Scalar {
    const WIDTH_F32: usize = 1;
    type S = f32;

    #[inline(always)]
    fn splat_f32(self, x: f32) -> f32 {
        x
    }
    #[inline(always)]
    fn load_f32(self, x: &[f32]) -> f32 {
        x[0]
    }
    #[inline(always)]
    fn store_f32(self, x: &mut [f32], v: f32) {
        x[0] = v;
    }
    #[inline(always)]
    fn add_f32(self, a: f32, b: f32) -> f32 {
        a + b
    }
    #[inline(always)]
    fn sub_f32(self, a: f32, b: f32) -> f32 {
        a - b
    }
    #[inline(always)]
    fn mul_f32(self, a: f32, b: f32) -> f32 {
        a * b
    }
    #[inline(always)]
    fn div_f32(self, a: f32, b: f32) -> f32 {
        a / b
    }
    #[inline(always)]
    fn sqrt_f32(self, a: f32) -> f32 {
        a.sqrt()
    }
    #[inline(always)]
    fn mul_add_f32(self, a: f32, b: f32, c: f32) -> f32 {
        a.mul_add(b, c)
    }
    #[inline(always)]
    fn neg_mul_add_f32(self, a: f32, b: f32, c: f32) -> f32 {
        (-a).mul_add(b, c)
    }
    #[inline(always)]
    fn select_greater_f32(self, x: f32, y: f32, a: f32, b: f32) -> f32 {
        if x > y { a } else { b }
    }
    #[inline(always)]
    fn mask_greater_f32(self, x: f32, y: f32) -> u32 {
        u32::from(x > y)
    }
    #[inline(always)]
    fn min_f32(self, a: f32, b: f32) -> f32 {
        if a < b { a } else { b }
    }
    #[inline(always)]
    fn rsqrt_seed_f32(self, magic: u32, a: f32) -> f32 {
        f32::from_bits(magic.wrapping_sub(a.to_bits() >> 1))
    }
    #[inline(always)]
    fn gather_f32(self, lines: &[[f32; 8]], index: &[u32]) -> [f32; 8] {
        lines[index[0] as usize]
    }
    #[inline(always)]
    fn scatter_f32(self, lines: &mut [[f32; 8]], index: &[u32], columns: [f32; 8]) {
        lines[index[0] as usize] = columns;
    }
    one_pair!(
        f32,
        BodyLineF32,
        BodyHalfLineF32,
        relative_velocity_f32,
        apply_impulse_f32,
        relative_half_velocity_f32,
        apply_half_impulse_f32
    );
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::{__m128, __m256, __m256d, __m256i, __m512, __m512d, __m512i, _MM_HINT_T1};

    use pulp::core_arch::x86::Sse;
    use pulp::x86::{V3, V4};
    use pulp::{NullaryFnOnce, cast};

    use super::{Arithmetic, BodyHalfLine, BodyHalfLineF32, BodyLine, BodyLineF32, F32Arithmetic, F64Arithmetic};

    /// Predicate of a comparison: greater than, ordered, quiet.
    const GREATER: i32 = 30;

    /// Factors of line b in [`LaneFloat::relative_velocity`].
    const SIGNS: [f64; 8] = [-1.0, -1.0, -1.0, 1.0, 1.0, 1.0, 1.0, 1.0];

    const SIGNS_F32: [f32; 8] = [-1.0, -1.0, -1.0, 1.0, 1.0, 1.0, 1.0, 1.0];

    /// Indices that take, from two vectors of sixteen, the first half of quarters alternately, and the second half, as pairs
    /// of numbers.
    const FIRST_QUARTERS: [u64; 8] = [0, 1, 8, 9, 2, 3, 10, 11];
    const LAST_QUARTERS: [u64; 8] = [4, 5, 12, 13, 6, 7, 14, 15];

    // No closures and no iterators below: they are functions of their own, which a compiler may leave
    // outside the instruction set that their caller is compiled for.

    #[inline(always)]
    fn first_eight(x: &[f64]) -> [f64; 8] {
        // One check of the length, so that it compiles to one load.
        let x: &[f64; 8] = x[..8].try_into().unwrap_or(&[f64::NAN; 8]);
        *x
    }

    #[inline(always)]
    fn first_four(x: &[f64]) -> [f64; 4] {
        let x: &[f64; 4] = x[..4].try_into().unwrap_or(&[f64::NAN; 4]);
        *x
    }

    #[inline(always)]
    fn prefetch_lines<X: ?Sized>(sse: Sse, x: &X) {
        let (start, size) = (std::ptr::from_ref(x).cast::<i8>(), size_of_val(x));
        let mut byte = 0;
        while byte < size {
            sse._mm_prefetch::<_MM_HINT_T1>(start.wrapping_add(byte));
            byte += size_of::<BodyLine>();
        }
        // Memory that does not begin with a line may extend over one more.
        if align_of_val(x) < align_of::<BodyLine>() {
            sse._mm_prefetch::<_MM_HINT_T1>(start.wrapping_add(size.saturating_sub(1)));
        }
    }

    /// Eight numbers at a time, AVX-512.
    impl Arithmetic for V4 {
        type T = f64;
        const WIDTH: usize = 8;
        type V = __m512d;

        #[inline(always)]
        fn run<Op: NullaryFnOnce>(self, op: Op) -> Op::Output {
            self.vectorize(op)
        }

        #[inline(always)]
        fn prefetch<X: ?Sized>(self, x: &X) {
            prefetch_lines(self.sse, x);
        }

        #[inline(always)]
        fn splat(self, x: f64) -> __m512d {
            self.avx512f._mm512_set1_pd(x)
        }
        #[inline(always)]
        fn load(self, x: &[f64]) -> __m512d {
            cast(first_eight(x))
        }
        #[inline(always)]
        fn store(self, x: &mut [f64], v: __m512d) {
            x[..8].copy_from_slice(&cast::<_, [f64; 8]>(v));
        }
        #[inline(always)]
        fn add(self, a: __m512d, b: __m512d) -> __m512d {
            self.avx512f._mm512_add_pd(a, b)
        }
        #[inline(always)]
        fn sub(self, a: __m512d, b: __m512d) -> __m512d {
            self.avx512f._mm512_sub_pd(a, b)
        }
        #[inline(always)]
        fn mul(self, a: __m512d, b: __m512d) -> __m512d {
            self.avx512f._mm512_mul_pd(a, b)
        }
        #[inline(always)]
        fn div(self, a: __m512d, b: __m512d) -> __m512d {
            self.avx512f._mm512_div_pd(a, b)
        }
        #[inline(always)]
        fn sqrt(self, a: __m512d) -> __m512d {
            self.avx512f._mm512_sqrt_pd(a)
        }
        #[inline(always)]
        fn mul_add(self, a: __m512d, b: __m512d, c: __m512d) -> __m512d {
            self.avx512f._mm512_fmadd_pd(a, b, c)
        }
        #[inline(always)]
        fn neg_mul_add(self, a: __m512d, b: __m512d, c: __m512d) -> __m512d {
            self.avx512f._mm512_fnmadd_pd(a, b, c)
        }
        #[inline(always)]
        fn select_greater(self, x: __m512d, y: __m512d, a: __m512d, b: __m512d) -> __m512d {
            let mask = self.avx512f._mm512_cmp_pd_mask::<GREATER>(x, y);
            self.avx512f._mm512_mask_blend_pd(mask, b, a)
        }
        #[inline(always)]
        fn mask_greater(self, x: __m512d, y: __m512d) -> u32 {
            u32::from(self.avx512f._mm512_cmp_pd_mask::<GREATER>(x, y))
        }
        #[inline(always)]
        fn min(self, a: __m512d, b: __m512d) -> __m512d {
            self.avx512f._mm512_min_pd(a, b)
        }
        #[inline(always)]
        fn gather_lines(self, lines: &[[f64; 8]], index: &[u32]) -> [__m512d; 8] {
            let mut rows = [self.splat(0.0); 8];
            for k in 0..8 {
                rows[k] = cast(lines[index[k] as usize]);
            }
            transpose8(self, rows)
        }
        #[inline(always)]
        fn scatter_lines(self, lines: &mut [[f64; 8]], index: &[u32], columns: [__m512d; 8]) {
            let rows = transpose8(self, columns);
            for k in 0..8 {
                lines[index[k] as usize] = cast(rows[k]);
            }
        }
        #[inline(always)]
        fn relative_velocity(self, lines: &[BodyLine], a: &[u32], b: &[u32]) -> [__m512d; 8] {
            let signs: __m512d = cast(SIGNS);
            let mut rows = [self.splat(0.0); 8];
            for k in 0..8 {
                rows[k] = self.mul_add(cast(lines[b[k] as usize].0), signs, cast(lines[a[k] as usize].0));
            }
            transpose8(self, rows)
        }
        #[inline(always)]
        fn apply_impulse(self, lines: &mut [BodyLine], a: &[u32], b: &[u32], f: [__m512d; 3], g: [__m512d; 3]) {
            let (signs, zero): (__m512d, _) = (cast(SIGNS), self.splat(0.0));
            let rows = transpose8(self, [f[0], f[1], f[2], zero, g[0], g[1], g[2], zero]);
            for k in 0..8 {
                let (a, b) = (a[k] as usize, b[k] as usize);
                // (p, p, p, p, q, q, q, q)
                let line: __m512d = cast(lines[a].0);
                lines[a].0 = cast(self.mul_add(self.avx512f._mm512_permutex_pd::<0xff>(line), rows[k], line));
                let line: __m512d = cast(lines[b].0);
                let row = self.mul(rows[k], signs);
                lines[b].0 = cast(self.mul_add(self.avx512f._mm512_permutex_pd::<0xff>(line), row, line));
            }
        }
        #[inline(always)]
        fn relative_half_velocity(self, halves: &[BodyHalfLine], a: &[u32], b: &[u32]) -> [__m512d; 4] {
            let avx = self.avx512f;
            let signs: __m512d = cast([-1.0, -1.0, -1.0, 1.0, -1.0, -1.0, -1.0, 1.0]);
            // Rows 0 and 2, 1 and 3 ... so that the unpacked pairs are in order.
            let mut pairs = [self.splat(0.0); 4];
            for (k, pair) in pairs.iter_mut().enumerate() {
                let first = k % 2 + 4 * (k / 2);
                let (x, y) = (halves[a[first] as usize].0, halves[a[first + 2] as usize].0);
                let plus = cast([x[0], x[1], x[2], x[3], y[0], y[1], y[2], y[3]]);
                let (x, y) = (halves[b[first] as usize].0, halves[b[first + 2] as usize].0);
                *pair = self.mul_add(cast([x[0], x[1], x[2], x[3], y[0], y[1], y[2], y[3]]), signs, plus);
            }
            let (e0, o0) = (avx._mm512_unpacklo_pd(pairs[0], pairs[1]), avx._mm512_unpackhi_pd(pairs[0], pairs[1]));
            let (e1, o1) = (avx._mm512_unpacklo_pd(pairs[2], pairs[3]), avx._mm512_unpackhi_pd(pairs[2], pairs[3]));
            [
                avx._mm512_shuffle_f64x2::<0x88>(e0, e1),
                avx._mm512_shuffle_f64x2::<0x88>(o0, o1),
                avx._mm512_shuffle_f64x2::<0xdd>(e0, e1),
                avx._mm512_shuffle_f64x2::<0xdd>(o0, o1),
            ]
        }
        #[inline(always)]
        fn apply_half_impulse(self, halves: &mut [BodyHalfLine], a: &[u32], b: &[u32], f: [__m512d; 3]) {
            let avx = self.avx512f;
            let zero = self.splat(0.0);
            // Halves of the even rows and of the odd ones; pairs of rows; rows.
            let (e, o) = (avx._mm512_unpacklo_pd(f[0], f[1]), avx._mm512_unpackhi_pd(f[0], f[1]));
            let (z, p) = (avx._mm512_unpacklo_pd(f[2], zero), avx._mm512_unpackhi_pd(f[2], zero));
            let (e02, e46) = (avx._mm512_shuffle_f64x2::<0x44>(e, z), avx._mm512_shuffle_f64x2::<0xee>(e, z));
            let (o13, o57) = (avx._mm512_shuffle_f64x2::<0x44>(o, p), avx._mm512_shuffle_f64x2::<0xee>(o, p));
            let pairs = [e02, o13, e46, o57];
            for (k, pair) in pairs.into_iter().enumerate() {
                let rows: [__m256d; 2] = cast(avx._mm512_shuffle_f64x2::<0xd8>(pair, pair));
                let first = k % 2 + 4 * (k / 2);
                for (row, k) in [(rows[0], first), (rows[1], first + 2)] {
                    add_to_slice(*self, &mut halves[a[k] as usize].0, row);
                    subtract_from_slice(*self, &mut halves[b[k] as usize].0, row);
                }
            }
        }
    }

    #[inline(always)]
    fn least_of_four(a: __m256d) -> f64 {
        let [a, b, c, d]: [f64; 4] = cast(a);
        let smaller = |a: f64, b: f64| if b < a { b } else { a };
        smaller(smaller(a, c), smaller(b, d))
    }

    impl F64Arithmetic for V4 {
        #[inline(always)]
        fn min_lane(self, a: __m512d) -> f64 {
            let [low, high]: [__m256d; 2] = cast(a);
            least_of_four(self.avx._mm256_min_pd(high, low))
        }
    }

    impl F32Arithmetic for V4 {
        const WIDTH_F32: usize = 16;
        type S = __m512;

        #[inline(always)]
        fn splat_f32(self, x: f32) -> __m512 {
            self.avx512f._mm512_set1_ps(x)
        }
        #[inline(always)]
        fn load_f32(self, x: &[f32]) -> __m512 {
            let x: &[f32; 16] = x[..16].try_into().unwrap_or(&[f32::NAN; 16]);
            cast(*x)
        }
        #[inline(always)]
        fn store_f32(self, x: &mut [f32], v: __m512) {
            x[..16].copy_from_slice(&cast::<_, [f32; 16]>(v));
        }
        #[inline(always)]
        fn add_f32(self, a: __m512, b: __m512) -> __m512 {
            self.avx512f._mm512_add_ps(a, b)
        }
        #[inline(always)]
        fn sub_f32(self, a: __m512, b: __m512) -> __m512 {
            self.avx512f._mm512_sub_ps(a, b)
        }
        #[inline(always)]
        fn mul_f32(self, a: __m512, b: __m512) -> __m512 {
            self.avx512f._mm512_mul_ps(a, b)
        }
        #[inline(always)]
        fn div_f32(self, a: __m512, b: __m512) -> __m512 {
            self.avx512f._mm512_div_ps(a, b)
        }
        #[inline(always)]
        fn sqrt_f32(self, a: __m512) -> __m512 {
            self.avx512f._mm512_sqrt_ps(a)
        }
        #[inline(always)]
        fn mul_add_f32(self, a: __m512, b: __m512, c: __m512) -> __m512 {
            self.avx512f._mm512_fmadd_ps(a, b, c)
        }
        #[inline(always)]
        fn neg_mul_add_f32(self, a: __m512, b: __m512, c: __m512) -> __m512 {
            self.avx512f._mm512_fnmadd_ps(a, b, c)
        }
        #[inline(always)]
        fn select_greater_f32(self, x: __m512, y: __m512, a: __m512, b: __m512) -> __m512 {
            let mask = self.avx512f._mm512_cmp_ps_mask::<GREATER>(x, y);
            self.avx512f._mm512_mask_blend_ps(mask, b, a)
        }
        #[inline(always)]
        fn mask_greater_f32(self, x: __m512, y: __m512) -> u32 {
            u32::from(self.avx512f._mm512_cmp_ps_mask::<GREATER>(x, y))
        }
        #[inline(always)]
        fn min_f32(self, a: __m512, b: __m512) -> __m512 {
            self.avx512f._mm512_min_ps(a, b)
        }
        #[inline(always)]
        fn rsqrt_seed_f32(self, magic: u32, a: __m512) -> __m512 {
            let half: __m512i = self.avx512f._mm512_srli_epi32::<1>(cast(a));
            cast(self.avx512f._mm512_sub_epi32(self.avx512f._mm512_set1_epi32(magic as i32), half))
        }
        #[inline(always)]
        fn gather_f32(self, lines: &[[f32; 8]], index: &[u32]) -> [__m512; 8] {
            let mut r = [self.splat_f32(0.0); 8];
            for (k, r) in r.iter_mut().enumerate() {
                let row = k % 4 + 8 * (k / 4);
                *r = cast([lines[index[row] as usize], lines[index[row + 4] as usize]]);
            }
            columns_of_sixteen(self, r)
        }
        #[inline(always)]
        fn scatter_f32(self, lines: &mut [[f32; 8]], index: &[u32], columns: [__m512; 8]) {
            let avx = self.avx512f;
            // Quarters of the columns of one half and of the other alternately, as in `apply_impulse_f32`.
            let (first, last): (__m512i, __m512i) = (cast(FIRST_QUARTERS), cast(LAST_QUARTERS));
            let zero = self.splat_f32(0.0);
            let (mut low, mut high) = ([zero; 4], [zero; 4]);
            for k in 0..4 {
                low[k] = cast(avx._mm512_permutex2var_pd(cast(columns[k]), first, cast(columns[k + 4])));
                high[k] = cast(avx._mm512_permutex2var_pd(cast(columns[k]), last, cast(columns[k + 4])));
            }
            let (low, high) = (transpose_quarters(self, low), transpose_quarters(self, high));
            for (rows, from) in [(low, 0), (high, 8)] {
                for (k, pair) in rows.into_iter().enumerate() {
                    let pair: [[f32; 8]; 2] = cast(pair);
                    lines[index[from + k] as usize] = pair[0];
                    lines[index[from + k + 4] as usize] = pair[1];
                }
            }
        }
        #[inline(always)]
        fn relative_velocity_f32(self, lines: &[BodyLineF32], a: &[u32], b: &[u32]) -> [__m512; 8] {
            let signs: __m512 = cast([SIGNS_F32, SIGNS_F32]);
            // Rows k and k + 4 in one vector, so that quarters are in order.
            let mut r = [self.splat_f32(0.0); 8];
            for (k, r) in r.iter_mut().enumerate() {
                let row = k % 4 + 8 * (k / 4);
                let of_a = cast([lines[a[row] as usize].0, lines[a[row + 4] as usize].0]);
                let of_b = cast([lines[b[row] as usize].0, lines[b[row + 4] as usize].0]);
                *r = self.mul_add_f32(of_b, signs, of_a);
            }
            columns_of_sixteen(self, r)
        }
        #[inline(always)]
        fn apply_impulse_f32(self, lines: &mut [BodyLineF32], a: &[u32], b: &[u32], f: [__m512; 3], g: [__m512; 3]) {
            let avx = self.avx512f;
            // Quarters of f and of g alternately: the first and second of both, the third and fourth.
            let (first, last): (__m512i, __m512i) = (cast(FIRST_QUARTERS), cast(LAST_QUARTERS));
            let zero = self.splat_f32(0.0);
            let (mut low, mut high) = ([zero; 4], [zero; 4]);
            for k in 0..3 {
                low[k] = cast(avx._mm512_permutex2var_pd(cast(f[k]), first, cast(g[k])));
                high[k] = cast(avx._mm512_permutex2var_pd(cast(f[k]), last, cast(g[k])));
            }
            let (low, high) = (transpose_quarters(self, low), transpose_quarters(self, high));
            for (rows, from) in [(low, 0), (high, 8)] {
                for (k, pair) in rows.into_iter().enumerate() {
                    let pair: [__m256; 2] = cast(pair);
                    for (row, k) in [(pair[0], from + k), (pair[1], from + k + 4)] {
                        push_row(*self, lines, a[k] as usize, b[k] as usize, row);
                    }
                }
            }
        }
        #[inline(always)]
        fn relative_half_velocity_f32(self, halves: &[BodyHalfLineF32], a: &[u32], b: &[u32]) -> [__m512; 4] {
            let signs: __m512 = cast([SIGNS_F32, SIGNS_F32]);
            let signs = self.avx512f._mm512_shuffle_f32x4::<0>(signs, signs);
            let mut r = [self.splat_f32(0.0); 4];
            for k in 0..4 {
                let mut of = [[[0.0; 4]; 4]; 2];
                for q in 0..4 {
                    of[0][q] = halves[a[4 * q + k] as usize].0;
                    of[1][q] = halves[b[4 * q + k] as usize].0;
                }
                r[k] = self.mul_add_f32(cast(of[1]), signs, cast(of[0]));
            }
            transpose_quarters(self, r)
        }
        #[inline(always)]
        fn apply_half_impulse_f32(self, halves: &mut [BodyHalfLineF32], a: &[u32], b: &[u32], f: [__m512; 3]) {
            let rows = transpose_quarters(self, [f[0], f[1], f[2], self.splat_f32(0.0)]);
            for k in 0..4 {
                let quarters: [__m128; 4] = cast(rows[k]);
                for q in 0..4 {
                    push_quarter(*self, halves, a[4 * q + k] as usize, b[4 * q + k] as usize, quarters[q]);
                }
            }
        }
    }

    /// Columns of sixteen rows: rows k and k + 4 share a vector for k = 0 to 3, then for k = 8 to 11.
    #[inline(always)]
    fn columns_of_sixteen(simd: V4, r: [__m512; 8]) -> [__m512; 8] {
        let avx = simd.avx512f;
        let [c0, c1, c2, c3] = transpose_quarters(simd, [r[0], r[1], r[2], r[3]]);
        let [d0, d1, d2, d3] = transpose_quarters(simd, [r[4], r[5], r[6], r[7]]);
        [
            avx._mm512_shuffle_f32x4::<0x88>(c0, d0),
            avx._mm512_shuffle_f32x4::<0x88>(c1, d1),
            avx._mm512_shuffle_f32x4::<0x88>(c2, d2),
            avx._mm512_shuffle_f32x4::<0x88>(c3, d3),
            avx._mm512_shuffle_f32x4::<0xdd>(c0, d0),
            avx._mm512_shuffle_f32x4::<0xdd>(c1, d1),
            avx._mm512_shuffle_f32x4::<0xdd>(c2, d2),
            avx._mm512_shuffle_f32x4::<0xdd>(c3, d3),
        ]
    }

    /// The 4 x 4 transpose in each quarter.
    #[inline(always)]
    fn transpose_quarters(simd: V4, [r0, r1, r2, r3]: [__m512; 4]) -> [__m512; 4] {
        let avx = simd.avx512f;
        let (t0, t1) = (cast(avx._mm512_unpacklo_ps(r0, r1)), cast(avx._mm512_unpackhi_ps(r0, r1)));
        let (t2, t3) = (cast(avx._mm512_unpacklo_ps(r2, r3)), cast(avx._mm512_unpackhi_ps(r2, r3)));
        [
            cast(avx._mm512_unpacklo_pd(t0, t2)),
            cast(avx._mm512_unpackhi_pd(t0, t2)),
            cast(avx._mm512_unpacklo_pd(t1, t3)),
            cast(avx._mm512_unpackhi_pd(t1, t3)),
        ]
    }

    #[inline(always)]
    fn transpose8(simd: V4, r: [__m512d; 8]) -> [__m512d; 8] {
        let avx = simd.avx512f;
        // Pairs of rows, then of their halves, then of quarters.
        let (e0, o0) = (avx._mm512_unpacklo_pd(r[0], r[1]), avx._mm512_unpackhi_pd(r[0], r[1]));
        let (e1, o1) = (avx._mm512_unpacklo_pd(r[2], r[3]), avx._mm512_unpackhi_pd(r[2], r[3]));
        let (e2, o2) = (avx._mm512_unpacklo_pd(r[4], r[5]), avx._mm512_unpackhi_pd(r[4], r[5]));
        let (e3, o3) = (avx._mm512_unpacklo_pd(r[6], r[7]), avx._mm512_unpackhi_pd(r[6], r[7]));
        let [c0, c2, c4, c6] = transpose_pairs(simd, e0, e1, e2, e3);
        let [c1, c3, c5, c7] = transpose_pairs(simd, o0, o1, o2, o3);
        [c0, c1, c2, c3, c4, c5, c6, c7]
    }

    /// The 4 x 4 transpose of pairs of numbers.
    #[inline(always)]
    fn transpose_pairs(simd: V4, t0: __m512d, t1: __m512d, t2: __m512d, t3: __m512d) -> [__m512d; 4] {
        let avx = simd.avx512f;
        let (s0, s1) = (avx._mm512_shuffle_f64x2::<0x88>(t0, t1), avx._mm512_shuffle_f64x2::<0xdd>(t0, t1));
        let (s2, s3) = (avx._mm512_shuffle_f64x2::<0x88>(t2, t3), avx._mm512_shuffle_f64x2::<0xdd>(t2, t3));
        [
            avx._mm512_shuffle_f64x2::<0x88>(s0, s2),
            avx._mm512_shuffle_f64x2::<0x88>(s1, s3),
            avx._mm512_shuffle_f64x2::<0xdd>(s0, s2),
            avx._mm512_shuffle_f64x2::<0xdd>(s1, s3),
        ]
    }

    /// Four numbers at a time, AVX2 and FMA.
    impl Arithmetic for V3 {
        type T = f64;
        const WIDTH: usize = 4;
        type V = __m256d;

        #[inline(always)]
        fn run<Op: NullaryFnOnce>(self, op: Op) -> Op::Output {
            self.vectorize(op)
        }

        #[inline(always)]
        fn prefetch<X: ?Sized>(self, x: &X) {
            prefetch_lines(self.sse, x);
        }

        #[inline(always)]
        fn splat(self, x: f64) -> __m256d {
            self.avx._mm256_set1_pd(x)
        }
        #[inline(always)]
        fn load(self, x: &[f64]) -> __m256d {
            cast(first_four(x))
        }
        #[inline(always)]
        fn store(self, x: &mut [f64], v: __m256d) {
            x[..4].copy_from_slice(&cast::<_, [f64; 4]>(v));
        }
        #[inline(always)]
        fn add(self, a: __m256d, b: __m256d) -> __m256d {
            self.avx._mm256_add_pd(a, b)
        }
        #[inline(always)]
        fn sub(self, a: __m256d, b: __m256d) -> __m256d {
            self.avx._mm256_sub_pd(a, b)
        }
        #[inline(always)]
        fn mul(self, a: __m256d, b: __m256d) -> __m256d {
            self.avx._mm256_mul_pd(a, b)
        }
        #[inline(always)]
        fn div(self, a: __m256d, b: __m256d) -> __m256d {
            self.avx._mm256_div_pd(a, b)
        }
        #[inline(always)]
        fn sqrt(self, a: __m256d) -> __m256d {
            self.avx._mm256_sqrt_pd(a)
        }
        #[inline(always)]
        fn mul_add(self, a: __m256d, b: __m256d, c: __m256d) -> __m256d {
            self.fma._mm256_fmadd_pd(a, b, c)
        }
        #[inline(always)]
        fn neg_mul_add(self, a: __m256d, b: __m256d, c: __m256d) -> __m256d {
            self.fma._mm256_fnmadd_pd(a, b, c)
        }
        #[inline(always)]
        fn select_greater(self, x: __m256d, y: __m256d, a: __m256d, b: __m256d) -> __m256d {
            let mask = self.avx._mm256_cmp_pd::<GREATER>(x, y);
            self.avx._mm256_blendv_pd(b, a, mask)
        }
        #[inline(always)]
        fn mask_greater(self, x: __m256d, y: __m256d) -> u32 {
            let mask = self.avx._mm256_cmp_pd::<GREATER>(x, y);
            self.avx._mm256_movemask_pd(mask) as u32
        }
        #[inline(always)]
        fn min(self, a: __m256d, b: __m256d) -> __m256d {
            self.avx._mm256_min_pd(a, b)
        }
        #[inline(always)]
        fn gather_lines(self, lines: &[[f64; 8]], index: &[u32]) -> [__m256d; 8] {
            let (mut low, mut high) = ([self.splat(0.0); 4], [self.splat(0.0); 4]);
            for k in 0..4 {
                let line = &lines[index[k] as usize];
                low[k] = cast(first_four(&line[..4]));
                high[k] = cast(first_four(&line[4..]));
            }
            let ([c0, c1, c2, c3], [c4, c5, c6, c7]) = (transpose4(self, low), transpose4(self, high));
            [c0, c1, c2, c3, c4, c5, c6, c7]
        }
        #[inline(always)]
        fn scatter_lines(self, lines: &mut [[f64; 8]], index: &[u32], c: [__m256d; 8]) {
            let low = transpose4(self, [c[0], c[1], c[2], c[3]]);
            let high = transpose4(self, [c[4], c[5], c[6], c[7]]);
            for k in 0..4 {
                let line = &mut lines[index[k] as usize];
                self.store(&mut line[..4], low[k]);
                self.store(&mut line[4..], high[k]);
            }
        }
        #[inline(always)]
        fn relative_velocity(self, lines: &[BodyLine], a: &[u32], b: &[u32]) -> [__m256d; 8] {
            let signs: __m256d = cast(first_four(&SIGNS));
            let (mut low, mut high) = ([self.splat(0.0); 4], [self.splat(0.0); 4]);
            for k in 0..4 {
                let (a, b) = (&lines[a[k] as usize].0, &lines[b[k] as usize].0);
                low[k] = self.mul_add(cast(first_four(b)), signs, cast(first_four(a)));
                high[k] = self.add(cast(first_four(&a[4..])), cast(first_four(&b[4..])));
            }
            let ([d0, d1, d2, d3], [s0, s1, s2, s3]) = (transpose4(self, low), transpose4(self, high));
            [d0, d1, d2, d3, s0, s1, s2, s3]
        }
        #[inline(always)]
        fn apply_impulse(self, lines: &mut [BodyLine], a: &[u32], b: &[u32], f: [__m256d; 3], g: [__m256d; 3]) {
            let zero = self.splat(0.0);
            let f = transpose4(self, [f[0], f[1], f[2], zero]);
            let g = transpose4(self, [g[0], g[1], g[2], zero]);
            for k in 0..4 {
                let (a, b) = (a[k] as usize, b[k] as usize);
                add_to_slice(self, &mut lines[a].0[..4], f[k]);
                subtract_from_slice(self, &mut lines[b].0[..4], f[k]);
                add_to_slice(self, &mut lines[a].0[4..], g[k]);
                add_to_slice(self, &mut lines[b].0[4..], g[k]);
            }
        }
        #[inline(always)]
        fn relative_half_velocity(self, halves: &[BodyHalfLine], a: &[u32], b: &[u32]) -> [__m256d; 4] {
            let signs: __m256d = cast(first_four(&SIGNS));
            let mut rows = [self.splat(0.0); 4];
            for k in 0..4 {
                rows[k] = self.mul_add(cast(halves[b[k] as usize].0), signs, cast(halves[a[k] as usize].0));
            }
            transpose4(self, rows)
        }
        #[inline(always)]
        fn apply_half_impulse(self, halves: &mut [BodyHalfLine], a: &[u32], b: &[u32], f: [__m256d; 3]) {
            let rows = transpose4(self, [f[0], f[1], f[2], self.splat(0.0)]);
            for k in 0..4 {
                add_to_slice(self, &mut halves[a[k] as usize].0, rows[k]);
                subtract_from_slice(self, &mut halves[b[k] as usize].0, rows[k]);
            }
        }
    }

    impl F64Arithmetic for V3 {
        #[inline(always)]
        fn min_lane(self, a: __m256d) -> f64 {
            least_of_four(a)
        }
    }

    /// Adds p f to v of (v, p).
    #[inline(always)]
    fn add_to_slice(simd: V3, half: &mut [f64], f: __m256d) {
        simd.store(half, simd.mul_add(simd.splat(half[3]), f, cast(first_four(half))));
    }

    /// Subtracts p f from v of (v, p).
    #[inline(always)]
    fn subtract_from_slice(simd: V3, half: &mut [f64], f: __m256d) {
        simd.store(half, simd.neg_mul_add(simd.splat(half[3]), f, cast(first_four(half))));
    }

    impl F32Arithmetic for V3 {
        const WIDTH_F32: usize = 8;
        type S = __m256;

        #[inline(always)]
        fn splat_f32(self, x: f32) -> __m256 {
            self.avx._mm256_set1_ps(x)
        }
        #[inline(always)]
        fn load_f32(self, x: &[f32]) -> __m256 {
            let x: &[f32; 8] = x[..8].try_into().unwrap_or(&[f32::NAN; 8]);
            cast(*x)
        }
        #[inline(always)]
        fn store_f32(self, x: &mut [f32], v: __m256) {
            x[..8].copy_from_slice(&cast::<_, [f32; 8]>(v));
        }
        #[inline(always)]
        fn add_f32(self, a: __m256, b: __m256) -> __m256 {
            self.avx._mm256_add_ps(a, b)
        }
        #[inline(always)]
        fn sub_f32(self, a: __m256, b: __m256) -> __m256 {
            self.avx._mm256_sub_ps(a, b)
        }
        #[inline(always)]
        fn mul_f32(self, a: __m256, b: __m256) -> __m256 {
            self.avx._mm256_mul_ps(a, b)
        }
        #[inline(always)]
        fn div_f32(self, a: __m256, b: __m256) -> __m256 {
            self.avx._mm256_div_ps(a, b)
        }
        #[inline(always)]
        fn sqrt_f32(self, a: __m256) -> __m256 {
            self.avx._mm256_sqrt_ps(a)
        }
        #[inline(always)]
        fn mul_add_f32(self, a: __m256, b: __m256, c: __m256) -> __m256 {
            self.fma._mm256_fmadd_ps(a, b, c)
        }
        #[inline(always)]
        fn neg_mul_add_f32(self, a: __m256, b: __m256, c: __m256) -> __m256 {
            self.fma._mm256_fnmadd_ps(a, b, c)
        }
        #[inline(always)]
        fn select_greater_f32(self, x: __m256, y: __m256, a: __m256, b: __m256) -> __m256 {
            let mask = self.avx._mm256_cmp_ps::<GREATER>(x, y);
            self.avx._mm256_blendv_ps(b, a, mask)
        }
        #[inline(always)]
        fn mask_greater_f32(self, x: __m256, y: __m256) -> u32 {
            let mask = self.avx._mm256_cmp_ps::<GREATER>(x, y);
            self.avx._mm256_movemask_ps(mask) as u32
        }
        #[inline(always)]
        fn min_f32(self, a: __m256, b: __m256) -> __m256 {
            self.avx._mm256_min_ps(a, b)
        }
        #[inline(always)]
        fn rsqrt_seed_f32(self, magic: u32, a: __m256) -> __m256 {
            let half: __m256i = self.avx2._mm256_srli_epi32::<1>(cast(a));
            cast(self.avx2._mm256_sub_epi32(self.avx._mm256_set1_epi32(magic as i32), half))
        }
        #[inline(always)]
        fn gather_f32(self, lines: &[[f32; 8]], index: &[u32]) -> [__m256; 8] {
            let mut rows = [self.splat_f32(0.0); 8];
            for k in 0..8 {
                rows[k] = cast(lines[index[k] as usize]);
            }
            transpose_short8(self, rows)
        }
        #[inline(always)]
        fn scatter_f32(self, lines: &mut [[f32; 8]], index: &[u32], columns: [__m256; 8]) {
            let rows = transpose_short8(self, columns);
            for k in 0..8 {
                lines[index[k] as usize] = cast(rows[k]);
            }
        }
        #[inline(always)]
        fn relative_velocity_f32(self, lines: &[BodyLineF32], a: &[u32], b: &[u32]) -> [__m256; 8] {
            let signs: __m256 = cast(SIGNS_F32);
            let mut r = [self.splat_f32(0.0); 8];
            for k in 0..8 {
                let (a, b) = (cast(lines[a[k] as usize].0), cast(lines[b[k] as usize].0));
                r[k] = self.mul_add_f32(b, signs, a);
            }
            transpose_short8(self, r)
        }
        #[inline(always)]
        fn apply_impulse_f32(self, lines: &mut [BodyLineF32], a: &[u32], b: &[u32], f: [__m256; 3], g: [__m256; 3]) {
            let (avx, zero) = (self.avx, self.splat_f32(0.0));
            let (mut low, mut high) = ([zero; 4], [zero; 4]);
            for k in 0..3 {
                low[k] = avx._mm256_permute2f128_ps::<0x20>(f[k], g[k]);
                high[k] = avx._mm256_permute2f128_ps::<0x31>(f[k], g[k]);
            }
            let (low, high) = (transpose_halves(self, low), transpose_halves(self, high));
            for k in 0..4 {
                push_row(self, lines, a[k] as usize, b[k] as usize, low[k]);
            }
            for k in 0..4 {
                push_row(self, lines, a[4 + k] as usize, b[4 + k] as usize, high[k]);
            }
        }
        #[inline(always)]
        fn relative_half_velocity_f32(self, halves: &[BodyHalfLineF32], a: &[u32], b: &[u32]) -> [__m256; 4] {
            let signs: __m256 = cast(SIGNS_F32);
            let signs = self.avx._mm256_permute2f128_ps::<0>(signs, signs);
            let mut r = [self.splat_f32(0.0); 4];
            for k in 0..4 {
                let of_a = cast([halves[a[k] as usize].0, halves[a[k + 4] as usize].0]);
                let of_b = cast([halves[b[k] as usize].0, halves[b[k + 4] as usize].0]);
                r[k] = self.mul_add_f32(of_b, signs, of_a);
            }
            transpose_halves(self, r)
        }
        #[inline(always)]
        fn apply_half_impulse_f32(self, halves: &mut [BodyHalfLineF32], a: &[u32], b: &[u32], f: [__m256; 3]) {
            let rows = transpose_halves(self, [f[0], f[1], f[2], self.splat_f32(0.0)]);
            for k in 0..4 {
                let pair: [__m128; 2] = cast(rows[k]);
                push_quarter(self, halves, a[k] as usize, b[k] as usize, pair[0]);
                push_quarter(self, halves, a[4 + k] as usize, b[4 + k] as usize, pair[1]);
            }
        }
    }

    #[inline(always)]
    fn transpose_short8(simd: V3, r: [__m256; 8]) -> [__m256; 8] {
        let avx = simd.avx;
        let [c0, c1, c2, c3] = transpose_halves(simd, [r[0], r[1], r[2], r[3]]);
        let [d0, d1, d2, d3] = transpose_halves(simd, [r[4], r[5], r[6], r[7]]);
        [
            avx._mm256_permute2f128_ps::<0x20>(c0, d0),
            avx._mm256_permute2f128_ps::<0x20>(c1, d1),
            avx._mm256_permute2f128_ps::<0x20>(c2, d2),
            avx._mm256_permute2f128_ps::<0x20>(c3, d3),
            avx._mm256_permute2f128_ps::<0x31>(c0, d0),
            avx._mm256_permute2f128_ps::<0x31>(c1, d1),
            avx._mm256_permute2f128_ps::<0x31>(c2, d2),
            avx._mm256_permute2f128_ps::<0x31>(c3, d3),
        ]
    }

    /// The 4 x 4 transpose in each half.
    #[inline(always)]
    fn transpose_halves(simd: V3, [r0, r1, r2, r3]: [__m256; 4]) -> [__m256; 4] {
        let avx = simd.avx;
        let (t0, t1) = (cast(avx._mm256_unpacklo_ps(r0, r1)), cast(avx._mm256_unpackhi_ps(r0, r1)));
        let (t2, t3) = (cast(avx._mm256_unpacklo_ps(r2, r3)), cast(avx._mm256_unpackhi_ps(r2, r3)));
        [
            cast(avx._mm256_unpacklo_pd(t0, t2)),
            cast(avx._mm256_unpackhi_pd(t0, t2)),
            cast(avx._mm256_unpacklo_pd(t1, t3)),
            cast(avx._mm256_unpackhi_pd(t1, t3)),
        ]
    }

    /// [`Arithmetic::apply_impulse`] of one pair, with f and g in one vector.
    #[inline(always)]
    fn push_row(simd: V3, lines: &mut [BodyLineF32], a: usize, b: usize, row: __m256) {
        let line: __m256 = cast(lines[a].0);
        lines[a].0 = cast(simd.mul_add_f32(simd.avx._mm256_permute_ps::<0xff>(line), row, line));
        let line: __m256 = cast(lines[b].0);
        let row = simd.mul_f32(row, cast(SIGNS_F32));
        lines[b].0 = cast(simd.mul_add_f32(simd.avx._mm256_permute_ps::<0xff>(line), row, line));
    }

    /// [`Arithmetic::apply_half_impulse`] of one pair.
    #[inline(always)]
    fn push_quarter(simd: V3, halves: &mut [BodyHalfLineF32], a: usize, b: usize, f: __m128) {
        let half: __m128 = cast(halves[a].0);
        halves[a].0 = cast(simd.fma._mm_fmadd_ps(simd.avx._mm_permute_ps::<0xff>(half), f, half));
        let half: __m128 = cast(halves[b].0);
        halves[b].0 = cast(simd.fma._mm_fnmadd_ps(simd.avx._mm_permute_ps::<0xff>(half), f, half));
    }

    #[inline(always)]
    fn transpose4(simd: V3, [r0, r1, r2, r3]: [__m256d; 4]) -> [__m256d; 4] {
        let avx = simd.avx;
        let (t0, t1) = (avx._mm256_unpacklo_pd(r0, r1), avx._mm256_unpackhi_pd(r0, r1));
        let (t2, t3) = (avx._mm256_unpacklo_pd(r2, r3), avx._mm256_unpackhi_pd(r2, r3));
        [
            avx._mm256_permute2f128_pd::<0x20>(t0, t2),
            avx._mm256_permute2f128_pd::<0x20>(t1, t3),
            avx._mm256_permute2f128_pd::<0x31>(t0, t2),
            avx._mm256_permute2f128_pd::<0x31>(t1, t3),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Transposed reading, arithmetic and writing agree with the scalar to the last bit.
    fn agrees<L: F64Arithmetic>(lanes: L) {
        struct Op<'a, L> {
            lanes: L,
            lines: &'a mut [BodyLine],
            halves: &'a mut [BodyHalfLine],
        }
        impl<L: F64Arithmetic> NullaryFnOnce for Op<'_, L> {
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
                for from in (0..16).step_by(L::WIDTH_F32) {
                    let (a, b) = (l.load_f32(&x[from..]), l.load_f32(&x[16 + from..]));
                    let y = l.rsqrt_seed_f32(0x5f1ffff9, l.mul_add_f32(a, a, l.splat_f32(0.1)));
                    let y = l.sub_f32(l.neg_mul_add_f32(y, b, a), l.mul_f32(y, b));
                    l.store_f32(&mut x[from..], l.min_f32(y, l.splat_f32(0.8)));
                }
            }
        }
        let sample = || std::array::from_fn(|i| (i as f32 * 0.7).sin());
        let (mut expected, mut got) = (sample(), sample());
        Scalar.run(Op { l: Scalar, x: &mut expected });
        lanes.run(Op { l: lanes, x: &mut got });
        assert_eq!(got, expected);
    }

    /// As [`agrees`], for bodies in single precision.
    fn agrees_on_short_bodies<L: F32Arithmetic>(lanes: L) {
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
        let scalar = F32Lanes(Scalar);
        scalar.run(Op { l: scalar, lines: &mut expected.0, halves: &mut expected.1 });
        let wide = F32Lanes(lanes);
        wide.run(Op { l: wide, lines: &mut got.0, halves: &mut got.1 });
        assert_eq!(got, expected);
        assert_ne!(got, sample());
    }

    #[test]
    fn all_widths_give_the_same_bits() {
        #[cfg(target_arch = "x86_64")]
        {
            pulp::x86::V3::try_new().into_iter().for_each(agrees_on_short_bodies);
            pulp::x86::V4::try_new().into_iter().for_each(agrees_on_short_bodies);
            pulp::x86::V3::try_new().into_iter().for_each(agrees_f32);
            pulp::x86::V4::try_new().into_iter().for_each(agrees_f32);
        }
        agrees(Scalar);
        agrees(DoubleWidth(Scalar));
        #[cfg(target_arch = "x86_64")]
        {
            pulp::x86::V3::try_new().into_iter().for_each(agrees);
            pulp::x86::V3::try_new().map(DoubleWidth).into_iter().for_each(agrees);
            pulp::x86::V4::try_new().into_iter().for_each(agrees);
        }
    }
}
