//! Attraction of the bodies of a leaf by a packed list of near bodies, pair by pair.

use pulp::NullaryFnOnce;

use crate::math::lanes::{Lanes, Singles};

/// Targets side by side, so that a source is loaded once for all of them.
const TARGETS: usize = 4;
/// Partial sums in single precision, added up in a fixed order.
const SUMS_F32: usize = 16;
/// The same in double precision.
const SUMS: usize = 8;

/// First estimate of x^(-1/2) and one step of its own kind, u = y (STEP - x y^2); SCALE u is right to 6.5e-4.
/// Source: J. Kadlec, "Improving the fast inverse square root" (2010).
const MAGIC: u32 = 0x5f1f_fff9;
const STEP: f32 = 2.389_244_6;
const SCALE: f64 = 0.703_952_253;
/// A step of Newton, v = u (NEWTON - x u^2), with x^(-1/2) = ROOT v to +-3e-7: the step errs to one side by 0 to 6e-7,
/// and the factor takes away the mean.
const NEWTON: f32 = (3.0 / (SCALE * SCALE)) as f32;
const ROOT: f64 = 0.5 * SCALE * SCALE * SCALE * (1.0 + 3.2e-7);

/// Sums over m d/|d|^3 (three components) and m/|d|.
pub type Pull = [f64; 4];

/// Near bodies, relative to the targets' centre and over a common length, in single precision; padded far away.
#[derive(Default)]
pub struct Packed {
    columns: [Vec<f32>; 4],
    length: f64,
}

/// Packs the ranges of `bodies` about `centre` in units of `length`.
pub struct Pack<'a> {
    pub to: &'a mut Packed,
    pub bodies: &'a [Vec<f64>; 4],
    pub ranges: &'a [std::ops::Range<usize>],
    pub centre: [f64; 3],
    pub length: f64,
}

impl NullaryFnOnce for Pack<'_> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let Pack { to, bodies, ranges, centre, length } = self;
        let count: usize = ranges.iter().map(|r| r.len()).sum();
        let scale = 1.0 / length;
        to.length = length;
        for k in 0..4 {
            let (column, body) = (&mut to.columns[k], &bodies[k]);
            let (from, factor, filler) = if k < 3 { (centre[k], scale, 4.0) } else { (0.0, 1.0, 0.0) };
            column.resize(count.next_multiple_of(SUMS_F32), 0.0);
            let mut at = 0;
            for range in ranges {
                let (source, target) = (&body[range.clone()], &mut column[at..at + range.len()]);
                for i in 0..source.len().min(target.len()) {
                    target[i] = ((source[i] - from) * factor) as f32;
                }
                at += range.len();
            }
            column[at..].fill(filler);
        }
    }
}

/// Adds the pull of `packed` to that of `targets` (x, y, z as packed), in single precision; returns by target the least
/// squared distance met, in packed units.
pub struct PullF32<'a, L> {
    pub l: L,
    pub packed: &'a Packed,
    pub targets: &'a [[f32; 3]],
    pub out: &'a mut [Pull],
    pub nearest: &'a mut [f32],
}

impl<L: Singles> NullaryFnOnce for PullF32<'_, L> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let PullF32 { l, packed, targets, out, nearest } = self;
        let count = packed.columns[0].len();
        let [x, y, z, m] = &packed.columns;
        let [x, y, z, m] = [&x[..count], &y[..count], &z[..count], &m[..count]];
        let (step, newton) = (l.splat_f32(STEP), l.splat_f32(NEWTON));
        let (per_length, per_area) = (ROOT / packed.length, (ROOT / packed.length) * (ROOT / packed.length) * ROOT);
        let mut first = 0;
        while first < targets.len() {
            let here = (targets.len() - first).min(TARGETS);
            let mut p = [[l.splat_f32(0.0); 3]; TARGETS];
            for t in 0..here {
                for k in 0..3 {
                    p[t][k] = l.splat_f32(targets[first + t][k]);
                }
            }
            let mut parts = [[[0.0f32; SUMS_F32]; 5]; TARGETS];
            let mut from = 0;
            while from < SUMS_F32 {
                let mut sums = [[l.splat_f32(0.0); 4]; TARGETS];
                let mut near = [l.splat_f32(f32::MAX); TARGETS];
                let mut k = from;
                while k < count {
                    let (sx, sy, sz) = (l.load_f32(&x[k..]), l.load_f32(&y[k..]), l.load_f32(&z[k..]));
                    let sm = l.load_f32(&m[k..]);
                    for t in 0..TARGETS {
                        let [dx, dy, dz] = [l.sub_f32(sx, p[t][0]), l.sub_f32(sy, p[t][1]), l.sub_f32(sz, p[t][2])];
                        let d2 = l.mul_add_f32(dx, dx, l.mul_add_f32(dy, dy, l.mul_f32(dz, dz)));
                        near[t] = l.min_f32(d2, near[t]);
                        let y = l.magic_f32(MAGIC, d2);
                        let u = l.mul_f32(y, l.neg_mul_add_f32(d2, l.mul_f32(y, y), step));
                        let v = l.mul_f32(u, l.neg_mul_add_f32(d2, l.mul_f32(u, u), newton));
                        let potential = l.mul_f32(sm, v);
                        let strength = l.mul_f32(potential, l.mul_f32(v, v));
                        sums[t][0] = l.mul_add_f32(dx, strength, sums[t][0]);
                        sums[t][1] = l.mul_add_f32(dy, strength, sums[t][1]);
                        sums[t][2] = l.mul_add_f32(dz, strength, sums[t][2]);
                        sums[t][3] = l.mul_add_f32(sm, v, sums[t][3]);
                    }
                    k += SUMS_F32;
                }
                for t in 0..TARGETS {
                    for k in 0..4 {
                        l.store_f32(&mut parts[t][k][from..], sums[t][k]);
                    }
                    l.store_f32(&mut parts[t][4][from..], near[t]);
                }
                from += L::WIDTH_F32;
            }
            for t in 0..here {
                let [ax, ay, az, potential, near] = &parts[t];
                let to = &mut out[first + t];
                to[0] += per_area * total(ax) as f64;
                to[1] += per_area * total(ay) as f64;
                to[2] += per_area * total(az) as f64;
                to[3] += per_length * total(potential) as f64;
                let mut least = f32::MAX;
                for d2 in near {
                    least = if *d2 < least { *d2 } else { least };
                }
                nearest[first + t] = least;
            }
            first += TARGETS;
        }
    }
}

/// The sum in one order, by halves.
#[inline(always)]
fn total(parts: &[f32; SUMS_F32]) -> f32 {
    let mut sums = *parts;
    let mut half = SUMS_F32 / 2;
    while half > 0 {
        for k in 0..half {
            sums[k] += sums[k + half];
        }
        half /= 2;
    }
    sums[0]
}

/// Adds the pull of ranges of `bodies` to one target at `p`, in double precision. The same place attracts nowhere.
pub struct PullF64<'a, L> {
    pub l: L,
    pub bodies: &'a [Vec<f64>; 4],
    pub ranges: &'a [std::ops::Range<usize>],
    pub p: [f64; 3],
    pub out: &'a mut Pull,
}

impl<L: Lanes> NullaryFnOnce for PullF64<'_, L> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let PullF64 { l, bodies, ranges, p, out } = self;
        let (zero, one) = (l.splat(0.0), l.splat(1.0));
        let p = [l.splat(p[0]), l.splat(p[1]), l.splat(p[2])];
        let mut parts = [[0.0; SUMS]; 4];
        for range in ranges {
            let mut first = range.start;
            while first < range.end {
                let here = (range.end - first).min(SUMS);
                // The last block of a range is filled up with no mass.
                let mut block = [[0.0; SUMS]; 4];
                for k in 0..4 {
                    if here == SUMS {
                        block[k].copy_from_slice(&bodies[k][first..first + SUMS]);
                    } else {
                        block[k][..here].copy_from_slice(&bodies[k][first..first + here]);
                    }
                }
                let mut from = 0;
                while from < SUMS {
                    let dx = l.sub(l.load(&block[0][from..]), p[0]);
                    let dy = l.sub(l.load(&block[1][from..]), p[1]);
                    let dz = l.sub(l.load(&block[2][from..]), p[2]);
                    let d2 = l.mul_add(dx, dx, l.mul_add(dy, dy, l.mul(dz, dz)));
                    let inverse = l.select_greater(d2, zero, l.div(one, l.sqrt(d2)), zero);
                    let potential = l.mul(l.load(&block[3][from..]), inverse);
                    let strength = l.mul(potential, l.mul(inverse, inverse));
                    for (k, d) in [dx, dy, dz].into_iter().enumerate() {
                        let sum = l.mul_add(d, strength, l.load(&parts[k][from..]));
                        l.store(&mut parts[k][from..], sum);
                    }
                    let sum = l.add(potential, l.load(&parts[3][from..]));
                    l.store(&mut parts[3][from..], sum);
                    from += L::WIDTH;
                }
                first += SUMS;
            }
        }
        for k in 0..4 {
            for part in &parts[k] {
                out[k] += part;
            }
        }
    }
}
