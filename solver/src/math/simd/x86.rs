//! Exchange of vectors with the lines of bodies in AVX-512 and AVX2.
//!
//! Transposes are shuffles of the instruction set, which pulp's `Simd` does not have; through arrays in memory a sweep takes
//! almost twice as long, see docs/development/log.md.

use std::arch::x86_64::{__m128, __m256, __m256d, __m512, __m512d, __m512i, _MM_HINT_T1};

use pulp::cast;
use pulp::core_arch::x86::Sse;
use pulp::x86::{V3, V4};

use super::arithmetic::{Arithmetic, BodyHalfLine, BodyHalfLineF32, BodyLine, BodyLineF32};
use super::vectors::{InstructionSet, LaneMemory, SimdLanes};

/// Predicate of a comparison: greater than, ordered, quiet.
const GREATER: i32 = 30;

/// Factors of line b in [`Arithmetic::relative_velocity`].
const SIGNS: [f64; 8] = [-1.0, -1.0, -1.0, 1.0, 1.0, 1.0, 1.0, 1.0];

/// [`SIGNS`] in single precision.
const SIGNS_F32: [f32; 8] = [-1.0, -1.0, -1.0, 1.0, 1.0, 1.0, 1.0, 1.0];

/// Indices that take, from two vectors of sixteen, the first half of quarters alternately, and the second half, as pairs
/// of numbers.
const FIRST_QUARTERS: [u64; 8] = [0, 1, 8, 9, 2, 3, 10, 11];
const LAST_QUARTERS: [u64; 8] = [4, 5, 12, 13, 6, 7, 14, 15];

// No closures and no iterators below: they are functions of their own, which a compiler may leave
// outside the instruction set that their caller is compiled for.

#[inline(always)]
fn first_four(x: &[f64]) -> [f64; 4] {
    // One check of the length, so that it compiles to one load.
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

impl InstructionSet for V4 {
    #[inline(always)]
    fn prefetch<X: ?Sized>(self, x: &X) {
        prefetch_lines(self.sse, x);
    }
}

impl InstructionSet for V3 {
    #[inline(always)]
    fn prefetch<X: ?Sized>(self, x: &X) {
        prefetch_lines(self.sse, x);
    }
}

/// Eight numbers at a time.
impl LaneMemory<f64> for V4 {
    type Register = __m512d;

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
        let l = SimdLanes::<_, f64>::new(self);
        let mut rows = [l.splat(0.0); 8];
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
        let l = SimdLanes::<_, f64>::new(self);
        let signs: __m512d = cast(SIGNS);
        let mut rows = [l.splat(0.0); 8];
        for k in 0..8 {
            rows[k] = l.mul_add(cast(lines[b[k] as usize].0), signs, cast(lines[a[k] as usize].0));
        }
        transpose8(self, rows)
    }
    #[inline(always)]
    fn apply_impulse(self, lines: &mut [BodyLine], a: &[u32], b: &[u32], f: [__m512d; 3], g: [__m512d; 3]) {
        let l = SimdLanes::<_, f64>::new(self);
        let (signs, zero): (__m512d, _) = (cast(SIGNS), l.splat(0.0));
        let rows = transpose8(self, [f[0], f[1], f[2], zero, g[0], g[1], g[2], zero]);
        for k in 0..8 {
            let (a, b) = (a[k] as usize, b[k] as usize);
            // (p, p, p, p, q, q, q, q)
            let line: __m512d = cast(lines[a].0);
            lines[a].0 = cast(l.mul_add(self.avx512f._mm512_permutex_pd::<0xff>(line), rows[k], line));
            let line: __m512d = cast(lines[b].0);
            let row = l.mul(rows[k], signs);
            lines[b].0 = cast(l.mul_add(self.avx512f._mm512_permutex_pd::<0xff>(line), row, line));
        }
    }
    #[inline(always)]
    fn relative_half_velocity(self, halves: &[BodyHalfLine], a: &[u32], b: &[u32]) -> [__m512d; 4] {
        let l = SimdLanes::<_, f64>::new(self);
        let avx = self.avx512f;
        let signs: __m512d = cast([-1.0, -1.0, -1.0, 1.0, -1.0, -1.0, -1.0, 1.0]);
        // Rows 0 and 2, 1 and 3 ... so that the unpacked pairs are in order.
        let mut pairs = [l.splat(0.0); 4];
        for (k, pair) in pairs.iter_mut().enumerate() {
            let first = k % 2 + 4 * (k / 2);
            let (x, y) = (halves[a[first] as usize].0, halves[a[first + 2] as usize].0);
            let plus = cast([x[0], x[1], x[2], x[3], y[0], y[1], y[2], y[3]]);
            let (x, y) = (halves[b[first] as usize].0, halves[b[first + 2] as usize].0);
            *pair = l.mul_add(cast([x[0], x[1], x[2], x[3], y[0], y[1], y[2], y[3]]), signs, plus);
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
        let l = SimdLanes::<_, f64>::new(self);
        let avx = self.avx512f;
        let zero = l.splat(0.0);
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

/// Sixteen numbers at a time.
impl LaneMemory<f32> for V4 {
    type Register = __m512;

    #[inline(always)]
    fn mask_greater(self, x: __m512, y: __m512) -> u32 {
        u32::from(self.avx512f._mm512_cmp_ps_mask::<GREATER>(x, y))
    }
    #[inline(always)]
    fn min(self, a: __m512, b: __m512) -> __m512 {
        self.avx512f._mm512_min_ps(a, b)
    }
    #[inline(always)]
    fn gather_lines(self, lines: &[[f32; 8]], index: &[u32]) -> [__m512; 8] {
        let l = SimdLanes::<_, f32>::new(self);
        let mut r = [l.splat(0.0); 8];
        for (k, r) in r.iter_mut().enumerate() {
            let row = k % 4 + 8 * (k / 4);
            *r = cast([lines[index[row] as usize], lines[index[row + 4] as usize]]);
        }
        columns_of_sixteen(self, r)
    }
    #[inline(always)]
    fn scatter_lines(self, lines: &mut [[f32; 8]], index: &[u32], columns: [__m512; 8]) {
        let l = SimdLanes::<_, f32>::new(self);
        let avx = self.avx512f;
        // Quarters of the columns of one half and of the other alternately, as in `apply_impulse`.
        let (first, last): (__m512i, __m512i) = (cast(FIRST_QUARTERS), cast(LAST_QUARTERS));
        let zero = l.splat(0.0);
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
    fn relative_velocity(self, lines: &[BodyLineF32], a: &[u32], b: &[u32]) -> [__m512; 8] {
        let l = SimdLanes::<_, f32>::new(self);
        let signs: __m512 = cast([SIGNS_F32, SIGNS_F32]);
        // Rows k and k + 4 in one vector, so that quarters are in order.
        let mut r = [l.splat(0.0); 8];
        for (k, r) in r.iter_mut().enumerate() {
            let row = k % 4 + 8 * (k / 4);
            let line_a = cast([lines[a[row] as usize].0, lines[a[row + 4] as usize].0]);
            let line_b = cast([lines[b[row] as usize].0, lines[b[row + 4] as usize].0]);
            *r = l.mul_add(line_b, signs, line_a);
        }
        columns_of_sixteen(self, r)
    }
    #[inline(always)]
    fn apply_impulse(self, lines: &mut [BodyLineF32], a: &[u32], b: &[u32], f: [__m512; 3], g: [__m512; 3]) {
        let l = SimdLanes::<_, f32>::new(self);
        let avx = self.avx512f;
        // Quarters of f and of g alternately: the first and second of both, the third and fourth.
        let (first, last): (__m512i, __m512i) = (cast(FIRST_QUARTERS), cast(LAST_QUARTERS));
        let zero = l.splat(0.0);
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
    fn relative_half_velocity(self, halves: &[BodyHalfLineF32], a: &[u32], b: &[u32]) -> [__m512; 4] {
        let l = SimdLanes::<_, f32>::new(self);
        let signs: __m512 = cast([SIGNS_F32, SIGNS_F32]);
        let signs = self.avx512f._mm512_shuffle_f32x4::<0>(signs, signs);
        let mut r = [l.splat(0.0); 4];
        for k in 0..4 {
            let mut of = [[[0.0; 4]; 4]; 2];
            for q in 0..4 {
                of[0][q] = halves[a[4 * q + k] as usize].0;
                of[1][q] = halves[b[4 * q + k] as usize].0;
            }
            r[k] = l.mul_add(cast(of[1]), signs, cast(of[0]));
        }
        transpose_quarters(self, r)
    }
    #[inline(always)]
    fn apply_half_impulse(self, halves: &mut [BodyHalfLineF32], a: &[u32], b: &[u32], f: [__m512; 3]) {
        let l = SimdLanes::<_, f32>::new(self);
        let rows = transpose_quarters(self, [f[0], f[1], f[2], l.splat(0.0)]);
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

/// Four numbers at a time.
impl LaneMemory<f64> for V3 {
    type Register = __m256d;

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
        let l = SimdLanes::<_, f64>::new(self);
        let (mut low, mut high) = ([l.splat(0.0); 4], [l.splat(0.0); 4]);
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
        let l = SimdLanes::<_, f64>::new(self);
        let low = transpose4(self, [c[0], c[1], c[2], c[3]]);
        let high = transpose4(self, [c[4], c[5], c[6], c[7]]);
        for k in 0..4 {
            let line = &mut lines[index[k] as usize];
            l.store(&mut line[..4], low[k]);
            l.store(&mut line[4..], high[k]);
        }
    }
    #[inline(always)]
    fn relative_velocity(self, lines: &[BodyLine], a: &[u32], b: &[u32]) -> [__m256d; 8] {
        let l = SimdLanes::<_, f64>::new(self);
        let signs: __m256d = cast(first_four(&SIGNS));
        let (mut low, mut high) = ([l.splat(0.0); 4], [l.splat(0.0); 4]);
        for k in 0..4 {
            let (a, b) = (&lines[a[k] as usize].0, &lines[b[k] as usize].0);
            low[k] = l.mul_add(cast(first_four(b)), signs, cast(first_four(a)));
            high[k] = l.add(cast(first_four(&a[4..])), cast(first_four(&b[4..])));
        }
        let ([d0, d1, d2, d3], [s0, s1, s2, s3]) = (transpose4(self, low), transpose4(self, high));
        [d0, d1, d2, d3, s0, s1, s2, s3]
    }
    #[inline(always)]
    fn apply_impulse(self, lines: &mut [BodyLine], a: &[u32], b: &[u32], f: [__m256d; 3], g: [__m256d; 3]) {
        let l = SimdLanes::<_, f64>::new(self);
        let zero = l.splat(0.0);
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
        let l = SimdLanes::<_, f64>::new(self);
        let signs: __m256d = cast(first_four(&SIGNS));
        let mut rows = [l.splat(0.0); 4];
        for k in 0..4 {
            rows[k] = l.mul_add(cast(halves[b[k] as usize].0), signs, cast(halves[a[k] as usize].0));
        }
        transpose4(self, rows)
    }
    #[inline(always)]
    fn apply_half_impulse(self, halves: &mut [BodyHalfLine], a: &[u32], b: &[u32], f: [__m256d; 3]) {
        let l = SimdLanes::<_, f64>::new(self);
        let rows = transpose4(self, [f[0], f[1], f[2], l.splat(0.0)]);
        for k in 0..4 {
            add_to_slice(self, &mut halves[a[k] as usize].0, rows[k]);
            subtract_from_slice(self, &mut halves[b[k] as usize].0, rows[k]);
        }
    }
}

/// Adds p f to v of (v, p).
#[inline(always)]
fn add_to_slice(simd: V3, half: &mut [f64], f: __m256d) {
    let l = SimdLanes::<_, f64>::new(simd);
    l.store(half, l.mul_add(l.splat(half[3]), f, cast(first_four(half))));
}

/// Subtracts p f from v of (v, p).
#[inline(always)]
fn subtract_from_slice(simd: V3, half: &mut [f64], f: __m256d) {
    let l = SimdLanes::<_, f64>::new(simd);
    l.store(half, l.neg_mul_add(l.splat(half[3]), f, cast(first_four(half))));
}

/// Eight numbers at a time.
impl LaneMemory<f32> for V3 {
    type Register = __m256;

    #[inline(always)]
    fn mask_greater(self, x: __m256, y: __m256) -> u32 {
        let mask = self.avx._mm256_cmp_ps::<GREATER>(x, y);
        self.avx._mm256_movemask_ps(mask) as u32
    }
    #[inline(always)]
    fn min(self, a: __m256, b: __m256) -> __m256 {
        self.avx._mm256_min_ps(a, b)
    }
    #[inline(always)]
    fn gather_lines(self, lines: &[[f32; 8]], index: &[u32]) -> [__m256; 8] {
        let l = SimdLanes::<_, f32>::new(self);
        let mut rows = [l.splat(0.0); 8];
        for k in 0..8 {
            rows[k] = cast(lines[index[k] as usize]);
        }
        transpose_short8(self, rows)
    }
    #[inline(always)]
    fn scatter_lines(self, lines: &mut [[f32; 8]], index: &[u32], columns: [__m256; 8]) {
        let rows = transpose_short8(self, columns);
        for k in 0..8 {
            lines[index[k] as usize] = cast(rows[k]);
        }
    }
    #[inline(always)]
    fn relative_velocity(self, lines: &[BodyLineF32], a: &[u32], b: &[u32]) -> [__m256; 8] {
        let l = SimdLanes::<_, f32>::new(self);
        let signs: __m256 = cast(SIGNS_F32);
        let mut r = [l.splat(0.0); 8];
        for k in 0..8 {
            let (a, b) = (cast(lines[a[k] as usize].0), cast(lines[b[k] as usize].0));
            r[k] = l.mul_add(b, signs, a);
        }
        transpose_short8(self, r)
    }
    #[inline(always)]
    fn apply_impulse(self, lines: &mut [BodyLineF32], a: &[u32], b: &[u32], f: [__m256; 3], g: [__m256; 3]) {
        let l = SimdLanes::<_, f32>::new(self);
        let (avx, zero) = (self.avx, l.splat(0.0));
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
    fn relative_half_velocity(self, halves: &[BodyHalfLineF32], a: &[u32], b: &[u32]) -> [__m256; 4] {
        let l = SimdLanes::<_, f32>::new(self);
        let signs: __m256 = cast(SIGNS_F32);
        let signs = self.avx._mm256_permute2f128_ps::<0>(signs, signs);
        let mut r = [l.splat(0.0); 4];
        for k in 0..4 {
            let half_a = cast([halves[a[k] as usize].0, halves[a[k + 4] as usize].0]);
            let half_b = cast([halves[b[k] as usize].0, halves[b[k + 4] as usize].0]);
            r[k] = l.mul_add(half_b, signs, half_a);
        }
        transpose_halves(self, r)
    }
    #[inline(always)]
    fn apply_half_impulse(self, halves: &mut [BodyHalfLineF32], a: &[u32], b: &[u32], f: [__m256; 3]) {
        let l = SimdLanes::<_, f32>::new(self);
        let rows = transpose_halves(self, [f[0], f[1], f[2], l.splat(0.0)]);
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
    let l = SimdLanes::<_, f32>::new(simd);
    let line: __m256 = cast(lines[a].0);
    lines[a].0 = cast(l.mul_add(simd.avx._mm256_permute_ps::<0xff>(line), row, line));
    let line: __m256 = cast(lines[b].0);
    let row = l.mul(row, cast(SIGNS_F32));
    lines[b].0 = cast(l.mul_add(simd.avx._mm256_permute_ps::<0xff>(line), row, line));
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
