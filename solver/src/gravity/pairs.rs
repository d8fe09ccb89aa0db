//! Attraction of the bodies of a leaf by a packed list of near bodies, pair by pair.

use std::ops::Range;

use pulp::NullaryFnOnce;

use crate::math::simd::{F32Arithmetic, F64Arithmetic};

/// Number of targets processed at once, so that a source is loaded once for all of them.
pub const TARGETS_AT_ONCE: usize = 4;
/// Number of partial sums in single precision, added in a fixed order.
const PARTIAL_SUMS_F32: usize = 16;
/// Number of partial sums in double precision, added in a fixed order.
const PARTIAL_SUMS: usize = 8;

/// Squared distance, in the tree's units, below which bodies are at the same position and do not attract each other; the
/// inverse cube of larger distances is finite.
const COINCIDENCE_DISTANCE2: f64 = 1e-200;

/// Coordinates of the bodies without mass that fill up the last vector, in packed units, where all sources are within 1 of the
/// centre of the targets: far from these.
const FAR_PACKED_COORDINATE: f32 = 4.0;

/// Coordinates of such bodies in the units of the tree: far from all bodies of it.
const FAR_COORDINATE: f64 = 64.0;

/// Approximation in single precision of the pull of a mass m at the squared distance x.
///
/// y is the first estimate of x^(-1/2) by a magic number, and P the quadratic whose largest relative error over all y is
/// smallest.
pub trait PullKernel {
    /// Whether the potential is summed, too.
    const POTENTIAL: bool;
    /// Ratio of x^(-1/2) to its computed value.
    const ROOT: f64;

    /// m x^(-3/2) / ROOT^3, and x^(-1/2) / ROOT if the potential is computed.
    fn pull_strength<L: F32Arithmetic>(l: L, m: L::V, x: L::V) -> (L::V, L::V);
}

/// Kernel of relative error 1.7e-4: x^(-3/2) = y^3 P(x y^2), without the root.
pub struct CoarseKernel;

/// Kernel of relative error 2.5e-5: x^(-1/2) = y P(x y^2).
pub struct MediumKernel<const POTENTIAL: bool>;

/// Kernel of relative error 3e-7: a step u = y (STEP - x y^2), accurate to 6.5e-4 except for a factor SCALE, and a Newton
/// step v = u (NEWTON - x u^2), with x^(-1/2) = ROOT v. It errs to one side by 0 to 6e-7, and the factor removes the mean
/// error.
///
/// Source: J. Kadlec, "Improving the fast inverse square root" (2010).
pub struct FineKernel<const POTENTIAL: bool>;

/// Magic number of the first estimate in [`CoarseKernel`] and [`MediumKernel`].
const RSQRT_SEED: u32 = 0x5f37_59df;

impl PullKernel for CoarseKernel {
    const POTENTIAL: bool = false;
    const ROOT: f64 = 1.0;

    #[inline(always)]
    fn pull_strength<L: F32Arithmetic>(l: L, m: L::V, x: L::V) -> (L::V, L::V) {
        const P: [f32; 3] = [4.384_447, -5.261_206, 1.876_769_3];
        let y = l.rsqrt_seed(RSQRT_SEED, x);
        let y2 = l.mul(y, y);
        let z = l.mul(x, y2);
        let p = l.mul_add(l.mul_add(l.splat(P[2].into()), z, l.splat(P[1].into())), z, l.splat(P[0].into()));
        let strength = l.mul(l.mul(l.mul(m, y), y2), p);
        (strength, strength)
    }
}

impl<const POTENTIAL: bool> PullKernel for MediumKernel<POTENTIAL> {
    const POTENTIAL: bool = POTENTIAL;
    const ROOT: f64 = 1.0;

    #[inline(always)]
    fn pull_strength<L: F32Arithmetic>(l: L, m: L::V, x: L::V) -> (L::V, L::V) {
        const P: [f32; 3] = [1.876_622_9, -1.252_149_6, 0.375_526_89];
        let y = l.rsqrt_seed(RSQRT_SEED, x);
        let z = l.mul(x, l.mul(y, y));
        let p = l.mul_add(l.mul_add(l.splat(P[2].into()), z, l.splat(P[1].into())), z, l.splat(P[0].into()));
        let v = l.mul(y, p);
        (l.mul(l.mul(m, v), l.mul(v, v)), v)
    }
}

/// STEP, SCALE and NEWTON of [`FineKernel`].
const FIRST_STEP_COEFFICIENT: f32 = 2.389_244_6;
const FIRST_STEP_SCALE: f64 = 0.703_952_253;
const NEWTON_COEFFICIENT: f32 = (3.0 / (FIRST_STEP_SCALE * FIRST_STEP_SCALE)) as f32;

impl<const POTENTIAL: bool> PullKernel for FineKernel<POTENTIAL> {
    const POTENTIAL: bool = POTENTIAL;
    const ROOT: f64 = 0.5 * FIRST_STEP_SCALE * FIRST_STEP_SCALE * FIRST_STEP_SCALE * (1.0 + 3.2e-7);

    #[inline(always)]
    fn pull_strength<L: F32Arithmetic>(l: L, m: L::V, x: L::V) -> (L::V, L::V) {
        let y = l.rsqrt_seed(0x5f1f_fff9, x);
        let u = l.mul(y, l.neg_mul_add(x, l.mul(y, y), l.splat(FIRST_STEP_COEFFICIENT.into())));
        let v = l.mul(u, l.neg_mul_add(x, l.mul(u, u), l.splat(NEWTON_COEFFICIENT.into())));
        (l.mul(l.mul(m, v), l.mul(v, v)), v)
    }
}

/// Added to the squared distances between a target and a vector of sources that contains it, by the target's index in the
/// vector: 1e30 for the target itself, so that its own potential is below rounding and its own force zero, else 0.
const SELF_DISTANCE2: [[f32; PARTIAL_SUMS_F32]; PARTIAL_SUMS_F32] = {
    let mut apart = [[0.0; PARTIAL_SUMS_F32]; PARTIAL_SUMS_F32];
    let mut k = 0;
    while k < PARTIAL_SUMS_F32 {
        apart[k][k] = 1e30;
        k += 1;
    }
    apart
};

/// Sums over the sources of m d/|d|^3 (three components) and of m/|d|, m the mass of a source and d the vector to it; in the units
/// of the tree, so that G is left out.
pub type BodyPull = [f64; 4];

/// Columns x, y, z, m, filled up with far bodies of no mass to a multiple of the partial sums.
#[derive(Default)]
pub struct PackedBodies<T> {
    columns: [Vec<T>; 4],
    /// Number of bodies in a column, those that fill it up included.
    count: usize,
}

impl<T: Copy + Default> PackedBodies<T> {
    /// Makes space for `count` bodies and one more vector, and fills up the last vector.
    #[inline(always)]
    fn resize(&mut self, count: usize, sums: usize, far_coordinate: T) {
        self.count = count.next_multiple_of(sums);
        for (k, column) in self.columns.iter_mut().enumerate() {
            column.resize(column.len().max(self.count + sums), T::default());
            column[count..self.count].fill(if k < 3 { far_coordinate } else { T::default() });
        }
    }

    #[inline(always)]
    fn source_columns(&self) -> [&[T]; 4] {
        let [x, y, z, m] = &self.columns;
        [&x[..self.count], &y[..self.count], &z[..self.count], &m[..self.count]]
    }
}

/// Leaf whose bodies are sources.
pub struct SourceLeaf {
    /// Indices of its bodies in the tree's order.
    pub bodies: Range<usize>,
    /// Centre of the leaf in the targets' frame, in packed units; not used in double precision.
    pub centre: [f32; 3],
}

/// Packs leaves about the centre of another leaf: centre + scale times the bodies' offsets from their own centre.
pub struct PackF32<'a, L> {
    pub l: L,
    pub to: &'a mut PackedBodies<f32>,
    /// Offsets and masses in the tree's order, with one vector more than there are bodies.
    pub offsets: &'a [Vec<f32>; 4],
    pub sources: &'a [SourceLeaf],
    pub scale: f32,
}

impl<L: F32Arithmetic> NullaryFnOnce for PackF32<'_, L> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let PackF32 { l, to, offsets, sources, scale } = self;
        let mut count = 0;
        for leaf in sources {
            count += leaf.bodies.len();
        }
        to.resize(count, PARTIAL_SUMS_F32, FAR_PACKED_COORDINATE);
        let [to_x, to_y, to_z, to_m] = &mut to.columns;
        let [x, y, z, m] = offsets;
        let factor = l.splat(scale.into());
        let mut packed_count = 0;
        for SourceLeaf { bodies: range, centre } in sources {
            let shift = [l.splat(centre[0].into()), l.splat(centre[1].into()), l.splat(centre[2].into())];
            let mut i = 0;
            while i < range.len() {
                let (from, target) = (range.start + i, packed_count + i);
                l.store(&mut to_x[target..], l.mul_add(l.load(&x[from..]), factor, shift[0]));
                l.store(&mut to_y[target..], l.mul_add(l.load(&y[from..]), factor, shift[1]));
                l.store(&mut to_z[target..], l.mul_add(l.load(&z[from..]), factor, shift[2]));
                l.store(&mut to_m[target..], l.load(&m[from..]));
                i += L::WIDTH;
            }
            packed_count += range.len();
        }
        to.columns[0][count..to.count].fill(FAR_PACKED_COORDINATE);
        to.columns[1][count..to.count].fill(FAR_PACKED_COORDINATE);
        to.columns[2][count..to.count].fill(FAR_PACKED_COORDINATE);
        to.columns[3][count..to.count].fill(0.0);
    }
}

/// Packs ranges of bodies unchanged.
pub struct PackF64<'a> {
    pub to: &'a mut PackedBodies<f64>,
    pub bodies: &'a [Vec<f64>; 4],
    pub sources: &'a [SourceLeaf],
}

impl NullaryFnOnce for PackF64<'_> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let PackF64 { to, bodies, sources } = self;
        let count = sources.iter().map(|leaf| leaf.bodies.len()).sum();
        to.resize(count, PARTIAL_SUMS, FAR_COORDINATE);
        for (column, from) in to.columns.iter_mut().zip(bodies) {
            let mut packed_count = 0;
            for SourceLeaf { bodies: range, .. } in sources {
                column[packed_count..packed_count + range.len()].copy_from_slice(&from[range.clone()]);
                packed_count += range.len();
            }
        }
    }
}

/// Adds the pull of `packed` to that of `targets` (x, y, z as packed), which are the first of the packed bodies, in
/// single precision. `nearest` gets the smallest squared distance, in packed units, that a target or one of those
/// processed with it has from a source.
pub struct PullF32<'a, L> {
    pub l: L,
    pub packed: &'a PackedBodies<f32>,
    /// Length of a packed unit in the tree's units.
    pub length: f64,
    pub targets: &'a [[f32; 3]],
    pub out: &'a mut [BodyPull],
    pub nearest: &'a mut [f32],
}

/// Pull computed with a given kernel.
pub struct WithKernel<K, P>(pub K, pub P);

impl<L: F32Arithmetic, K: PullKernel> NullaryFnOnce for WithKernel<K, PullF32<'_, L>> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let PullF32 { l, packed, length, targets, out, nearest } = self.1;
        let ([x, y, z, m], count) = (packed.source_columns(), packed.count);
        let (per_length, per_area) = (K::ROOT / length, (K::ROOT / length) * (K::ROOT / length) * K::ROOT);
        let mut first = 0;
        while first < targets.len() {
            let count_here = (targets.len() - first).min(TARGETS_AT_ONCE);
            // Missing targets are copies of the last.
            let mut p = [[l.splat(0.0); 3]; TARGETS_AT_ONCE];
            for t in 0..TARGETS_AT_ONCE {
                for k in 0..3 {
                    p[t][k] = l.splat(targets[first + t.min(count_here - 1)][k].into());
                }
            }
            let own = first / PARTIAL_SUMS_F32 * PARTIAL_SUMS_F32;
            let mut parts = [[[0.0f32; PARTIAL_SUMS_F32]; 4]; TARGETS_AT_ONCE];
            let mut nearest_of_lanes = [0.0f32; PARTIAL_SUMS_F32];
            let mut from = 0;
            while from < PARTIAL_SUMS_F32 {
                let mut sums =
                    PullSums { pulls: [[l.splat(0.0); 4]; TARGETS_AT_ONCE], nearest: l.splat(f32::MAX.into()) };
                let mut k = from;
                while k < own {
                    let source = [l.load(&x[k..]), l.load(&y[k..]), l.load(&z[k..]), l.load(&m[k..])];
                    add_source_vector::<L, K, false>(l, source, &p, [l.splat(0.0); TARGETS_AT_ONCE], &mut sums);
                    k += PARTIAL_SUMS_F32;
                }
                let mut self_distance2 = [l.splat(0.0); TARGETS_AT_ONCE];
                for t in 0..TARGETS_AT_ONCE {
                    self_distance2[t] =
                        l.load(&SELF_DISTANCE2[first % PARTIAL_SUMS_F32 + t.min(count_here - 1)][from..]);
                }
                let source = [l.load(&x[k..]), l.load(&y[k..]), l.load(&z[k..]), l.load(&m[k..])];
                add_source_vector::<L, K, true>(l, source, &p, self_distance2, &mut sums);
                k += PARTIAL_SUMS_F32;
                while k < count {
                    let source = [l.load(&x[k..]), l.load(&y[k..]), l.load(&z[k..]), l.load(&m[k..])];
                    add_source_vector::<L, K, false>(l, source, &p, self_distance2, &mut sums);
                    k += PARTIAL_SUMS_F32;
                }
                for t in 0..TARGETS_AT_ONCE {
                    for k in 0..4 {
                        l.store(&mut parts[t][k][from..], sums.pulls[t][k]);
                    }
                }
                l.store(&mut nearest_of_lanes[from..], sums.nearest);
                from += L::WIDTH;
            }
            let mut nearest_distance2 = f32::MAX;
            for d2 in &nearest_of_lanes {
                nearest_distance2 = if *d2 < nearest_distance2 { *d2 } else { nearest_distance2 };
            }
            for t in 0..count_here {
                let [ax, ay, az, potential] = &parts[t];
                let pull = &mut out[first + t];
                pull[0] += per_area * pairwise_sum(ax) as f64;
                pull[1] += per_area * pairwise_sum(ay) as f64;
                pull[2] += per_area * pairwise_sum(az) as f64;
                if K::POTENTIAL {
                    pull[3] += per_length * pairwise_sum(potential) as f64;
                }
                nearest[first + t] = nearest_distance2;
            }
            first += TARGETS_AT_ONCE;
        }
    }
}

/// Running sums over sources, by target.
struct PullSums<S> {
    /// [`BodyPull`] of each target.
    pulls: [[S; 4]; TARGETS_AT_ONCE],
    /// Smallest squared distance of a target from a source.
    nearest: S,
}

/// Adds a vector of sources; those that are also targets get the squared distance `self_distance2` from themselves.
#[inline(always)]
fn add_source_vector<L: F32Arithmetic, K: PullKernel, const OWN: bool>(
    l: L,
    [x, y, z, m]: [L::V; 4],
    targets: &[[L::V; 3]; TARGETS_AT_ONCE],
    self_distance2: [L::V; TARGETS_AT_ONCE],
    sums: &mut PullSums<L::V>,
) {
    for t in 0..TARGETS_AT_ONCE {
        let [dx, dy, dz] = [l.sub(x, targets[t][0]), l.sub(y, targets[t][1]), l.sub(z, targets[t][2])];
        let mut d2 = l.mul_add(dx, dx, l.mul_add(dy, dy, l.mul(dz, dz)));
        if OWN {
            d2 = l.add(d2, self_distance2[t]);
        }
        sums.nearest = l.min(d2, sums.nearest);
        let (strength, root) = K::pull_strength(l, m, d2);
        let to = &mut sums.pulls[t];
        to[0] = l.mul_add(dx, strength, to[0]);
        to[1] = l.mul_add(dy, strength, to[1]);
        to[2] = l.mul_add(dz, strength, to[2]);
        if K::POTENTIAL {
            to[3] = l.mul_add(m, root, to[3]);
        }
    }
}

/// Pairwise sum, in a fixed order.
#[inline(always)]
fn pairwise_sum(parts: &[f32; PARTIAL_SUMS_F32]) -> f32 {
    let mut sums = *parts;
    let mut half = PARTIAL_SUMS_F32 / 2;
    while half > 0 {
        for k in 0..half {
            sums[k] += sums[k + half];
        }
        half /= 2;
    }
    sums[0]
}

/// Adds the pull of `packed` to that of `targets`, in double precision.
pub struct PullF64<'a, L> {
    pub l: L,
    pub packed: &'a PackedBodies<f64>,
    pub targets: &'a [[f64; 3]],
    pub out: &'a mut [BodyPull],
}

impl<L: F64Arithmetic> NullaryFnOnce for PullF64<'_, L> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let PullF64 { l, packed, targets, out } = self;
        let ([x, y, z, m], count) = (packed.source_columns(), packed.count);
        let (zero, one, same) = (l.splat(0.0), l.splat(1.0), l.splat(COINCIDENCE_DISTANCE2));
        let mut first = 0;
        while first < targets.len() {
            let count_here = (targets.len() - first).min(TARGETS_AT_ONCE);
            let mut p = [[zero; 3]; TARGETS_AT_ONCE];
            for t in 0..count_here {
                for k in 0..3 {
                    p[t][k] = l.splat(targets[first + t][k]);
                }
            }
            let mut parts = [[[0.0; PARTIAL_SUMS]; 4]; TARGETS_AT_ONCE];
            let mut from = 0;
            while from < PARTIAL_SUMS {
                let mut sums = [[zero; 4]; TARGETS_AT_ONCE];
                let mut k = from;
                while k < count {
                    let (sx, sy, sz, sm) = (l.load(&x[k..]), l.load(&y[k..]), l.load(&z[k..]), l.load(&m[k..]));
                    for t in 0..TARGETS_AT_ONCE {
                        let [dx, dy, dz] = [l.sub(sx, p[t][0]), l.sub(sy, p[t][1]), l.sub(sz, p[t][2])];
                        let d2 = l.mul_add(dx, dx, l.mul_add(dy, dy, l.mul(dz, dz)));
                        let inverse = l.select_greater(d2, same, l.div(one, l.sqrt(d2)), zero);
                        let potential = l.mul(sm, inverse);
                        let strength = l.mul(potential, l.mul(inverse, inverse));
                        sums[t][0] = l.mul_add(dx, strength, sums[t][0]);
                        sums[t][1] = l.mul_add(dy, strength, sums[t][1]);
                        sums[t][2] = l.mul_add(dz, strength, sums[t][2]);
                        sums[t][3] = l.add(potential, sums[t][3]);
                    }
                    k += PARTIAL_SUMS;
                }
                for t in 0..TARGETS_AT_ONCE {
                    for k in 0..4 {
                        l.store(&mut parts[t][k][from..], sums[t][k]);
                    }
                }
                from += L::WIDTH;
            }
            for t in 0..count_here {
                for k in 0..4 {
                    for part in &parts[t][k] {
                        out[first + t][k] += part;
                    }
                }
            }
            first += TARGETS_AT_ONCE;
        }
    }
}
