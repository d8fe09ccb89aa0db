//! Exchange of vectors with the lines of bodies in NEON, the vectors of every aarch64 processor.

use std::arch::aarch64::{float32x4_t, float64x2_t};

use pulp::aarch64::Neon;
use pulp::cast;

use super::arithmetic::{Arithmetic, BodyHalfLine, BodyHalfLineF32, BodyLine, BodyLineF32};
use super::vectors::{InstructionSet, LaneMemory, SimdLanes};

/// Factors of line b in [`Arithmetic::relative_velocity`].
const SIGNS: [f64; 8] = [-1.0, -1.0, -1.0, 1.0, 1.0, 1.0, 1.0, 1.0];

/// [`SIGNS`] in single precision.
const SIGNS_F32: [f32; 8] = [-1.0, -1.0, -1.0, 1.0, 1.0, 1.0, 1.0, 1.0];

impl InstructionSet for Neon {
    /// Does nothing: prefetches of aarch64 are not stable in Rust.
    #[inline(always)]
    fn prefetch<X: ?Sized>(self, _: &X) {}
}

/// Two numbers at a time.
impl LaneMemory<f64> for Neon {
    type Register = float64x2_t;

    #[inline(always)]
    fn mask_greater(self, x: float64x2_t, y: float64x2_t) -> u32 {
        let (x, y): ([f64; 2], [f64; 2]) = (cast(x), cast(y));
        u32::from(x[0] > y[0]) | u32::from(x[1] > y[1]) << 1
    }
    /// NEON's own minimum is another one for zeros of different sign and for NaN.
    #[inline(always)]
    fn min(self, a: float64x2_t, b: float64x2_t) -> float64x2_t {
        SimdLanes::<_, f64>::new(self).select_greater(b, a, a, b)
    }
    #[inline(always)]
    fn gather_lines(self, lines: &[[f64; 8]], index: &[u32]) -> [float64x2_t; 8] {
        let (a, b) = (&lines[index[0] as usize], &lines[index[1] as usize]);
        let mut columns = [pair_at(a, 0); 8];
        for k in 0..4 {
            [columns[2 * k], columns[2 * k + 1]] = transpose_pairs(pair_at(a, 2 * k), pair_at(b, 2 * k));
        }
        columns
    }
    #[inline(always)]
    fn scatter_lines(self, lines: &mut [[f64; 8]], index: &[u32], columns: [float64x2_t; 8]) {
        let l = SimdLanes::<_, f64>::new(self);
        for k in 0..4 {
            let rows = transpose_pairs(columns[2 * k], columns[2 * k + 1]);
            for i in 0..2 {
                l.store(&mut lines[index[i] as usize][2 * k..], rows[i]);
            }
        }
    }
    #[inline(always)]
    fn relative_velocity(self, lines: &[BodyLine], a: &[u32], b: &[u32]) -> [float64x2_t; 8] {
        let l = SimdLanes::<_, f64>::new(self);
        let mut columns = [l.splat(0.0); 8];
        for k in 0..4 {
            let mut rows = [l.splat(0.0); 2];
            for i in 0..2 {
                let (a, b) = (&lines[a[i] as usize].0, &lines[b[i] as usize].0);
                rows[i] = l.mul_add(pair_at(b, 2 * k), pair_at(&SIGNS, 2 * k), pair_at(a, 2 * k));
            }
            [columns[2 * k], columns[2 * k + 1]] = transpose_pairs(rows[0], rows[1]);
        }
        columns
    }
    #[inline(always)]
    fn apply_impulse(self, lines: &mut [BodyLine], a: &[u32], b: &[u32], f: [float64x2_t; 3], g: [float64x2_t; 3]) {
        let l = SimdLanes::<_, f64>::new(self);
        let zero = l.splat(0.0);
        let (xy, z) = (transpose_pairs(f[0], f[1]), transpose_pairs(f[2], zero));
        let (turn_xy, turn_z) = (transpose_pairs(g[0], g[1]), transpose_pairs(g[2], zero));
        for i in 0..2 {
            let line = &mut lines[a[i] as usize].0;
            add_scaled(l, &mut line[..4], xy[i], z[i]);
            add_scaled(l, &mut line[4..], turn_xy[i], turn_z[i]);
            let line = &mut lines[b[i] as usize].0;
            subtract_scaled(l, &mut line[..4], xy[i], z[i]);
            add_scaled(l, &mut line[4..], turn_xy[i], turn_z[i]);
        }
    }
    #[inline(always)]
    fn relative_half_velocity(self, halves: &[BodyHalfLine], a: &[u32], b: &[u32]) -> [float64x2_t; 4] {
        let l = SimdLanes::<_, f64>::new(self);
        let mut columns = [l.splat(0.0); 4];
        for k in 0..2 {
            let mut rows = [l.splat(0.0); 2];
            for i in 0..2 {
                let (a, b) = (&halves[a[i] as usize].0, &halves[b[i] as usize].0);
                rows[i] = l.mul_add(pair_at(b, 2 * k), pair_at(&SIGNS, 2 * k), pair_at(a, 2 * k));
            }
            [columns[2 * k], columns[2 * k + 1]] = transpose_pairs(rows[0], rows[1]);
        }
        columns
    }
    #[inline(always)]
    fn apply_half_impulse(self, halves: &mut [BodyHalfLine], a: &[u32], b: &[u32], f: [float64x2_t; 3]) {
        let l = SimdLanes::<_, f64>::new(self);
        let (xy, z) = (transpose_pairs(f[0], f[1]), transpose_pairs(f[2], l.splat(0.0)));
        for i in 0..2 {
            add_scaled(l, &mut halves[a[i] as usize].0, xy[i], z[i]);
            subtract_scaled(l, &mut halves[b[i] as usize].0, xy[i], z[i]);
        }
    }
}

#[inline(always)]
fn pair_at(x: &[f64], from: usize) -> float64x2_t {
    cast([x[from], x[from + 1]])
}

#[inline(always)]
fn transpose_pairs(r0: float64x2_t, r1: float64x2_t) -> [float64x2_t; 2] {
    let (a, b): ([f64; 2], [f64; 2]) = (cast(r0), cast(r1)); // compiled to two instructions
    [cast([a[0], b[0]]), cast([a[1], b[1]])]
}

/// Adds p f to v of (v, p); f is given as (x, y) and (z, 0).
#[inline(always)]
fn add_scaled(l: SimdLanes<Neon, f64>, half: &mut [f64], xy: float64x2_t, z: float64x2_t) {
    let (p, v, v_z) = (l.splat(half[3]), pair_at(half, 0), pair_at(half, 2));
    l.store(half, l.mul_add(p, xy, v));
    l.store(&mut half[2..], l.mul_add(p, z, v_z));
}

/// Subtracts p f from v of (v, p).
#[inline(always)]
fn subtract_scaled(l: SimdLanes<Neon, f64>, half: &mut [f64], xy: float64x2_t, z: float64x2_t) {
    let (p, v, v_z) = (l.splat(half[3]), pair_at(half, 0), pair_at(half, 2));
    l.store(half, l.neg_mul_add(p, xy, v));
    l.store(&mut half[2..], l.neg_mul_add(p, z, v_z));
}

/// Four numbers at a time.
impl LaneMemory<f32> for Neon {
    type Register = float32x4_t;

    #[inline(always)]
    fn mask_greater(self, x: float32x4_t, y: float32x4_t) -> u32 {
        let (x, y): ([f32; 4], [f32; 4]) = (cast(x), cast(y));
        let mut mask = 0;
        for k in 0..4 {
            mask |= u32::from(x[k] > y[k]) << k;
        }
        mask
    }
    #[inline(always)]
    fn min(self, a: float32x4_t, b: float32x4_t) -> float32x4_t {
        SimdLanes::<_, f32>::new(self).select_greater(b, a, a, b)
    }
    #[inline(always)]
    fn gather_lines(self, lines: &[[f32; 8]], index: &[u32]) -> [float32x4_t; 8] {
        let (mut low, mut high) = ([cast([0.0f32; 4]); 4], [cast([0.0f32; 4]); 4]);
        for k in 0..4 {
            [low[k], high[k]] = cast(lines[index[k] as usize]);
        }
        let ([c0, c1, c2, c3], [c4, c5, c6, c7]) = (transpose_four(low), transpose_four(high));
        [c0, c1, c2, c3, c4, c5, c6, c7]
    }
    #[inline(always)]
    fn scatter_lines(self, lines: &mut [[f32; 8]], index: &[u32], c: [float32x4_t; 8]) {
        let (low, high) = (transpose_four([c[0], c[1], c[2], c[3]]), transpose_four([c[4], c[5], c[6], c[7]]));
        for k in 0..4 {
            lines[index[k] as usize] = cast([low[k], high[k]]);
        }
    }
    #[inline(always)]
    fn relative_velocity(self, lines: &[BodyLineF32], a: &[u32], b: &[u32]) -> [float32x4_t; 8] {
        let l = SimdLanes::<_, f32>::new(self);
        let signs: [float32x4_t; 2] = cast(SIGNS_F32);
        let (mut low, mut high) = ([signs[0]; 4], [signs[0]; 4]);
        for k in 0..4 {
            let a: [float32x4_t; 2] = cast(lines[a[k] as usize].0);
            let b: [float32x4_t; 2] = cast(lines[b[k] as usize].0);
            low[k] = l.mul_add(b[0], signs[0], a[0]);
            high[k] = l.add(a[1], b[1]);
        }
        let ([c0, c1, c2, c3], [c4, c5, c6, c7]) = (transpose_four(low), transpose_four(high));
        [c0, c1, c2, c3, c4, c5, c6, c7]
    }
    #[inline(always)]
    fn apply_impulse(self, lines: &mut [BodyLineF32], a: &[u32], b: &[u32], f: [float32x4_t; 3], g: [float32x4_t; 3]) {
        let l = SimdLanes::<_, f32>::new(self);
        let zero = l.splat(0.0);
        let (f, g) = (transpose_four([f[0], f[1], f[2], zero]), transpose_four([g[0], g[1], g[2], zero]));
        for k in 0..4 {
            let line = &mut lines[a[k] as usize].0;
            let [v, w]: [float32x4_t; 2] = cast(*line);
            let (p, q) = (l.splat(line[3].into()), l.splat(line[7].into()));
            *line = cast([l.mul_add(p, f[k], v), l.mul_add(q, g[k], w)]);
            let line = &mut lines[b[k] as usize].0;
            let [v, w]: [float32x4_t; 2] = cast(*line);
            let (p, q) = (l.splat(line[3].into()), l.splat(line[7].into()));
            *line = cast([l.neg_mul_add(p, f[k], v), l.mul_add(q, g[k], w)]);
        }
    }
    #[inline(always)]
    fn relative_half_velocity(self, halves: &[BodyHalfLineF32], a: &[u32], b: &[u32]) -> [float32x4_t; 4] {
        let l = SimdLanes::<_, f32>::new(self);
        let signs: [float32x4_t; 2] = cast(SIGNS_F32);
        let mut rows = [signs[0]; 4];
        for k in 0..4 {
            rows[k] = l.mul_add(cast(halves[b[k] as usize].0), signs[0], cast(halves[a[k] as usize].0));
        }
        transpose_four(rows)
    }
    #[inline(always)]
    fn apply_half_impulse(self, halves: &mut [BodyHalfLineF32], a: &[u32], b: &[u32], f: [float32x4_t; 3]) {
        let l = SimdLanes::<_, f32>::new(self);
        let rows = transpose_four([f[0], f[1], f[2], l.splat(0.0)]);
        for k in 0..4 {
            let half = &mut halves[a[k] as usize].0;
            *half = cast(l.mul_add(l.splat(half[3].into()), rows[k], cast(*half)));
            let half = &mut halves[b[k] as usize].0;
            *half = cast(l.neg_mul_add(l.splat(half[3].into()), rows[k], cast(*half)));
        }
    }
}

/// Even and odd elements of two vectors alternately.
#[inline(always)]
fn interleave_pairs(r0: float32x4_t, r1: float32x4_t) -> [float64x2_t; 2] {
    let (a, b): ([f32; 4], [f32; 4]) = (cast(r0), cast(r1)); // compiled to two instructions
    [cast([a[0], b[0], a[2], b[2]]), cast([a[1], b[1], a[3], b[3]])]
}

#[inline(always)]
fn transpose_four([r0, r1, r2, r3]: [float32x4_t; 4]) -> [float32x4_t; 4] {
    let ([t0, t1], [t2, t3]) = (interleave_pairs(r0, r1), interleave_pairs(r2, r3));
    let ([c0, c2], [c1, c3]) = (transpose_pairs(t0, t2), transpose_pairs(t1, t3));
    [cast(c0), cast(c1), cast(c2), cast(c3)]
}
