//! Kernel: Newtonian attraction among point masses.

mod balance;
mod cell;
pub mod direct;
pub mod overlap;
pub mod quadrupole;
pub mod sample;
// Kernels use no iterators: these are separate functions, which a compiler may compile without the instruction set of
// their caller.
#[allow(clippy::needless_range_loop)]
mod expansion;
#[allow(clippy::needless_range_loop)]
mod fmm;
#[allow(clippy::needless_range_loop)]
mod pairs;
mod settings;
#[allow(clippy::needless_range_loop)]
mod tree;
#[allow(clippy::needless_range_loop)]
mod upward;

pub use balance::balance_accelerations;

use crate::math::Vec3;
use crate::math::simd::{F64Arithmetic, LaneOperation, SimdWidth};
use fmm::TreeWalk;
use settings::{ExpansionSettings, crossover_bodies};
pub use settings::{HIGHEST_ORDER, LOWEST_ORDER, MIN_FMM_ERROR};
use tree::MassTree;

/// Method by which attraction is summed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SummationMethod {
    /// Sums every pair.
    Direct,
    /// Fast multipole method.
    Fmm,
    /// The faster of the two for this number of bodies and this error.
    #[default]
    Auto,
}

/// Name that is none of the [`SummationMethod`]s.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UnknownMethod;

impl std::fmt::Display for UnknownMethod {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("expected direct, fmm or auto")
    }
}

impl std::error::Error for UnknownMethod {}

impl std::str::FromStr for SummationMethod {
    type Err = UnknownMethod;
    fn from_str(text: &str) -> Result<Self, UnknownMethod> {
        match text {
            "direct" => Ok(SummationMethod::Direct),
            "fmm" => Ok(SummationMethod::Fmm),
            "auto" => Ok(SummationMethod::Auto),
            _ => Err(UnknownMethod),
        }
    }
}

/// Attraction at each body.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GravityField {
    /// Acceleration, m/s^2.
    pub acceleration: Vec<Vec3>,
    /// Potential, J/kg, negative; empty if only the acceleration was requested.
    pub potential: Vec<f64>,
    /// RMS of the correction that makes forces and torques sum to zero, divided by the RMS acceleration; weighted by
    /// mass.
    pub removed: f64,
}

/// Input and requested outputs of a sum, see [`GravitySolver::full_field`].
#[derive(Clone, Copy)]
struct FieldRequest<'a> {
    /// Positions, m.
    positions: &'a [Vec3],
    /// Masses, kg.
    masses: &'a [f64],
    /// G, m³/(kg s²).
    constant: f64,
    /// Whether the potential is computed, too.
    potential: bool,
    /// Indices of the bodies in an order near that along Morton's curve; may be empty.
    approximate_order: &'a [u32],
}

/// Solver for attraction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GravitySolver {
    /// Method, or `Auto`.
    pub method: SummationMethod,
    /// Target RMS relative error of the fast multipole method; determines order and opening.
    pub error: f64,
    /// Total order of the expansions, [`LOWEST_ORDER`] to [`HIGHEST_ORDER`], if set by the user.
    pub order: Option<usize>,
    /// Opening theta, below 1, if set by the user: cells are far if the sum of their radii is below theta times the
    /// distance of their centres, whatever the estimated error of the expansion.
    pub opening: Option<f64>,
    /// Largest number of bodies in a leaf, if set by the user.
    pub leaf: Option<usize>,
}

impl GravitySolver {
    /// Solver whose settings follow from the target error.
    pub fn new(method: SummationMethod, error: f64) -> Self {
        GravitySolver { method, error, order: None, opening: None, leaf: None }
    }

    /// Settings of the fast multipole method for this number of bodies.
    fn expansion_settings(&self, bodies: usize) -> ExpansionSettings {
        let measured = ExpansionSettings::for_error(self.error, bodies);
        ExpansionSettings {
            order: self.order.unwrap_or(measured.order).clamp(LOWEST_ORDER, HIGHEST_ORDER),
            opening: self.opening.unwrap_or(measured.opening).clamp(0.0, 0.99),
            // With an opening of the user, the error of the expansion decides nothing.
            share: if self.opening.is_some() { f64::MAX } else { measured.share },
            leaf: self.leaf.unwrap_or(measured.leaf).max(1),
            ..measured
        }
    }

    /// Returns the method used for this number of bodies: never `Auto`.
    pub fn method_for(&self, bodies: usize) -> SummationMethod {
        match self.method {
            SummationMethod::Auto if bodies < crossover_bodies(self.error) => SummationMethod::Direct,
            SummationMethod::Auto => SummationMethod::Fmm,
            method => method,
        }
    }

    /// Accelerations (m/s²) and potentials (J/kg) of all bodies: a_i = G sum_j m_j (x_j - x_i)/|x_j - x_i|^3 and
    /// phi_i = -G sum_j m_j/|x_j - x_i|.
    ///
    /// `positions` are in m, `masses` in kg, one of each per body; `constant` is G, m³/(kg s²).
    ///
    /// Bodies are sorted along Morton's curve, starting from the order `approximate_order`. This is faster if it is close to
    /// the sorted order, such as [`morton::morton_order`](crate::math::morton::morton_order) of the step before. It
    /// changes no result, and may be empty.
    pub fn full_field(
        &self,
        positions: &[Vec3],
        masses: &[f64],
        constant: f64,
        approximate_order: &[u32],
    ) -> GravityField {
        let request = FieldRequest { positions, masses, constant, potential: true, approximate_order };
        self.field_at_width(request, SimdWidth::detect())
    }

    /// Accelerations as from [`Self::full_field`] without the potential, which is faster.
    pub fn acceleration_field(
        &self,
        positions: &[Vec3],
        masses: &[f64],
        constant: f64,
        approximate_order: &[u32],
    ) -> GravityField {
        let request = FieldRequest { positions, masses, constant, potential: false, approximate_order };
        self.field_at_width(request, SimdWidth::detect())
    }

    fn field_at_width(&self, request: FieldRequest, width: SimdWidth) -> GravityField {
        let FieldRequest { positions, masses, constant, .. } = request;
        if positions.len() < 2 || self.method_for(positions.len()) == SummationMethod::Direct {
            let (acceleration, mut potential) = direct::accelerations(positions, masses, constant);
            if !request.potential {
                potential = Vec::new();
            }
            return GravityField { acceleration, potential, removed: 0.0 };
        }
        let mut field = width.dispatch(MultipoleField { solver: self, request });
        field.removed = balance_accelerations(positions, masses, &mut field.acceleration);
        field
    }

    fn multipole_field<L: F64Arithmetic>(&self, lanes: L, request: FieldRequest) -> GravityField {
        let settings = self.expansion_settings(request.positions.len());
        match settings.order {
            2 => multipole_field_of_order::<L, 2>(lanes, settings, request),
            3 => multipole_field_of_order::<L, 3>(lanes, settings, request),
            4 => multipole_field_of_order::<L, 4>(lanes, settings, request),
            5 => multipole_field_of_order::<L, 5>(lanes, settings, request),
            6 => multipole_field_of_order::<L, 6>(lanes, settings, request),
            7 => multipole_field_of_order::<L, 7>(lanes, settings, request),
            8 => multipole_field_of_order::<L, 8>(lanes, settings, request),
            _ => unreachable!("the order is clamped"),
        }
    }
}

/// Field by multipole expansions of order P.
fn multipole_field_of_order<L: F64Arithmetic, const P: usize>(
    lanes: L,
    settings: ExpansionSettings,
    FieldRequest { positions, masses, constant, potential: wants_potential, approximate_order }: FieldRequest,
) -> GravityField {
    let tree = MassTree::new::<L, P>(lanes, positions, masses, settings.leaf, approximate_order);
    let pulls = TreeWalk::<L, P> { lanes, tree: &tree, settings, potential: wants_potential }.body_pulls();
    // Pulls are in units M/L² (acceleration) and M/L (potential) of the tree.
    let potential_unit = constant * tree.mass / tree.length;
    let unit = potential_unit / tree.length;
    let mut acceleration = vec![Vec3::zeros(); positions.len()];
    for (&i, [x, y, z, _]) in tree.index.iter().zip(&pulls) {
        acceleration[i as usize] = Vec3::new(*x, *y, *z) * unit;
    }
    let mut potential = vec![0.0; if wants_potential { positions.len() } else { 0 }];
    if wants_potential {
        for (&i, [_, _, _, sum]) in tree.index.iter().zip(&pulls) {
            potential[i as usize] = -sum * potential_unit;
        }
    }
    GravityField { acceleration, potential, removed: 0.0 }
}

/// Field by multipole expansions.
struct MultipoleField<'a> {
    solver: &'a GravitySolver,
    request: FieldRequest<'a>,
}

impl LaneOperation for MultipoleField<'_> {
    type Output = GravityField;

    fn call<L: F64Arithmetic>(self, l: L) -> GravityField {
        self.solver.multipole_field(l, self.request)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::morton;

    /// Pseudo-random numbers in [0, 1), the same on every machine.
    struct Random(u64);

    impl Random {
        fn next(&mut self) -> f64 {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            (self.0 >> 11) as f64 / (1u64 << 53) as f64
        }

        fn in_ball(&mut self) -> Vec3 {
            loop {
                let v = Vec3::new(self.next(), self.next(), self.next()) * 2.0 - Vec3::repeat(1.0);
                if v.norm_squared() < 1.0 {
                    return v;
                }
            }
        }
    }

    type Cloud = (Vec<Vec3>, Vec<f64>);

    fn ball(n: usize) -> Cloud {
        let mut random = Random(0x9e37_79b9_7f4a_7c15);
        let x = (0..n).map(|_| random.in_ball()).collect();
        (x, (0..n).map(|_| 0.3 + 2.7 * random.next()).collect())
    }

    /// Grains on a jittered lattice: `n` nearest to its centre.
    fn rubble(n: usize) -> Cloud {
        let mut random = Random(0x2545_f491_4f6c_dd1d);
        let k = (n as f64 * 1.91).cbrt().ceil() as i32 + 2;
        let mut x = Vec::new();
        for i in 0..k * k * k {
            let at = Vec3::new((i % k) as f64, (i / k % k) as f64, (i / k / k) as f64);
            x.push(at - Vec3::repeat(0.5 * k as f64) + random.in_ball() * 0.1);
        }
        x.sort_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()));
        x.truncate(n);
        let m = x.iter().map(|_| 0.3 + 2.7 * random.next()).collect();
        (x, m)
    }

    /// Two clouds of rubble next to each other.
    fn binary(n: usize) -> Cloud {
        let ((a, mut ma), (b, mb)) = (rubble(n * 3 / 4), rubble(n - n * 3 / 4));
        let reach = |x: &[Vec3]| Vec3::x() * (x[x.len() - 1].norm() + 0.5);
        let x = a.iter().map(|x| x - reach(&a)).chain(b.iter().map(|x| x + reach(&b))).collect();
        ma.extend(mb);
        (x, ma)
    }

    fn clumps(n: usize) -> Cloud {
        let (mut x, m) = ball(n);
        let centres: Vec<Vec3> = x[..20].iter().map(|x| x * 100.0).collect();
        x.iter_mut().enumerate().for_each(|(i, x)| *x = *x * 0.1 * 3f64.powi(i as i32 % 5) + centres[i % 20]);
        (x, m)
    }

    fn fmm(error: f64) -> GravitySolver {
        GravitySolver::new(SummationMethod::Fmm, error)
    }

    /// sqrt(sum |a - b|^2 / sum |b|^2)
    fn difference(a: &[Vec3], b: &[Vec3]) -> f64 {
        let square: f64 = a.iter().zip(b).map(|(a, b)| (a - b).norm_squared()).sum();
        (square / b.iter().map(|b| b.norm_squared()).sum::<f64>()).sqrt()
    }

    /// |sum m a| / sum m |a|, and the same of torques about the centre of mass.
    fn imbalance(x: &[Vec3], m: &[f64], a: &[Vec3]) -> (f64, f64) {
        let centre = x.iter().zip(m).map(|(x, m)| x * *m).sum::<Vec3>() / m.iter().sum::<f64>();
        let (mut force, mut torque, mut scale, mut arm) = (Vec3::zeros(), Vec3::zeros(), 0.0, 0.0);
        for ((x, m), a) in x.iter().zip(m).zip(a) {
            force += a * *m;
            torque += (x - centre).cross(a) * *m;
            scale += a.norm() * m;
            arm += a.norm() * (x - centre).norm() * m;
        }
        (force.norm() / scale, torque.norm() / arm)
    }

    #[test]
    fn reaches_the_target_error_and_conserves_momentum() {
        let clouds = |n| [("ball", ball(n)), ("rubble", rubble(n)), ("binary", binary(n))];
        for (name, (x, m)) in clouds(1000).into_iter().chain(clouds(6000)) {
            let (exact, potential) = direct::accelerations(&x, &m, 1.0);
            for error in [1e-2, 1e-3, 1e-4, 1e-5, 1e-6] {
                let field = fmm(error).full_field(&x, &m, 1.0, &[]);
                let got = difference(&field.acceleration, &exact);
                assert!(got < error && got > 0.1 * error, "{name}: {got:e} for {error:e}");
                let (force, torque) = imbalance(&x, &m, &field.acceleration);
                assert!(force < 1e-15 && torque < 1e-15, "{name}: {force:e} {torque:e}");
                assert!(field.removed < error, "{name}: removed {:e}", field.removed);
                let worst =
                    field.potential.iter().zip(&potential).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max);
                assert!(worst < error, "{name}: potential off by {worst:e}");
            }
        }
    }

    #[test]
    fn attraction_alone_is_as_exact_and_the_initial_order_changes_no_bit() {
        for (name, (x, m)) in [("ball", ball(5000)), ("rubble", rubble(5000)), ("binary", binary(5000))] {
            let (exact, _) = direct::accelerations(&x, &m, 1.0);
            for error in [1e-2, 1e-3, 1e-4, 1e-5, 1e-6] {
                let field = fmm(error).acceleration_field(&x, &m, 1.0, &[]);
                let got = difference(&field.acceleration, &exact);
                assert!(got < error && got > 0.1 * error, "{name}: {got:e} for {error:e}");
                assert!(field.potential.is_empty());
                assert_eq!(field, fmm(error).acceleration_field(&x, &m, 1.0, &morton::morton_order(&x, &[])));
            }
        }
    }

    #[test]
    fn error_falls_with_order_and_opening() {
        let (x, m) = clumps(3000);
        let (exact, _) = direct::accelerations(&x, &m, 1.0);
        // f64 pairs, as for the smallest error.
        let error = |order, opening| {
            let gravity = GravitySolver { order: Some(order), opening: Some(opening), leaf: Some(16), ..fmm(1e-6) };
            difference(&gravity.full_field(&x, &m, 1.0, &[]).acceleration, &exact)
        };
        for order in 2..HIGHEST_ORDER {
            assert!(error(order + 1, 0.7) < error(order, 0.7), "order {order}");
        }
        assert!(error(5, 0.4) < error(5, 0.6) && error(5, 0.6) < error(5, 0.8));
    }

    #[test]
    fn same_bits_for_all_widths_and_threads() {
        let (x, m) = clumps(5000);
        for (error, potential) in [1e-2, 1e-4, 1e-6].into_iter().flat_map(|error| [(error, false), (error, true)]) {
            let request = FieldRequest { positions: &x, masses: &m, constant: 1.5, potential, approximate_order: &[] };
            let expected = fmm(error).field_at_width(request, SimdWidth::all_widths()[0]);
            for width in SimdWidth::all_widths() {
                assert_eq!(fmm(error).field_at_width(request, width), expected);
            }
            for threads in 1..4 {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                assert_eq!(pool.install(|| fmm(error).field_at_width(request, SimdWidth::detect())), expected);
            }
        }
    }

    #[test]
    fn virial_of_the_force_is_the_potential_energy() {
        let (x, m) = ball(4000);
        let field = fmm(1e-5).full_field(&x, &m, 2.0, &[]);
        let virial: f64 = x.iter().zip(field.acceleration.iter().zip(&m)).map(|(x, (a, m))| x.dot(a) * m).sum();
        let energy: f64 = 0.5 * field.potential.iter().zip(&m).map(|(p, m)| p * m).sum::<f64>();
        assert!((virial / energy - 1.0).abs() < 1e-6);
    }

    /// Compares the fast method with the direct sum, if that is finite and exact, too.
    fn agrees(name: &str, (x, m): &Cloud) {
        let (exact, _) = direct::accelerations(x, m, 1.0);
        for error in [1e-3, 1e-6] {
            let field = fmm(error).full_field(x, m, 1.0, &[]);
            assert!(field.acceleration.iter().all(|a| a.iter().all(|a| a.is_finite())), "{name}");
            assert!(field.potential.iter().all(|p| p.is_finite()), "{name}");
            if exact.iter().any(|a| *a != Vec3::zeros()) {
                let got = difference(&field.acceleration, &exact);
                assert!(got < error, "{name}: {got:e} for {error:e}");
            } else {
                assert_eq!(field.acceleration, exact, "{name}");
            }
        }
    }

    #[test]
    fn degenerate_clouds() {
        let (x, m) = ball(500);
        let with = |f: &dyn Fn(usize, Vec3) -> Vec3| -> Cloud {
            (x.iter().enumerate().map(|(i, x)| f(i, *x)).collect(), m.clone())
        };
        agrees("none", &(vec![], vec![]));
        agrees("one", &(vec![Vec3::x()], vec![2.0]));
        agrees("two", &(vec![Vec3::x(), Vec3::y()], vec![2.0, 1.0]));
        agrees("all at one position", &with(&|_, _| Vec3::repeat(0.3)));
        agrees("pairs at one position", &with(&|i, _| x[i / 2]));
        agrees("a hundred at one position", &with(&|i, x| if i < 100 { Vec3::zeros() } else { x }));
        agrees("line", &with(&|_, x| Vec3::new(x.x, 0.0, 0.0)));
        agrees("oblique line", &with(&|_, x| Vec3::new(1.0, 2.0, 3.0) * x.x));
        agrees("plane", &with(&|_, x| Vec3::new(x.x, x.y, 0.0)));
        agrees("small", &with(&|_, x| x * 1e-6));
        agrees("large", &with(&|_, x| x * 1e9));
        agrees("far out", &with(&|_, x| x + Vec3::new(1e9, -1e9, 1e9)));
        agrees("two, far apart", &with(&|i, x| x + Vec3::x() * if i % 2 == 0 { 1e9 } else { 0.0 }));
        agrees("ever closer", &with(&|i, x| x * 0.9f64.powi(i as i32)));
        agrees("no mass", &(x.clone(), vec![0.0; 500]));
        agrees("some without mass", &(x.clone(), (0..500).map(|i| (i % 3) as f64).collect()));
        agrees("a giant", &(x.clone(), (0..500).map(|i| if i == 7 { 1e12 } else { 1.0 }).collect()));
        agrees("dwarfs", &(x.clone(), (0..500).map(|i| 10f64.powi(-(i % 25))).collect()));
    }
}
