//! Bench: Newtonian attraction among point masses.

pub mod direct;
mod expansion;
mod fmm;
mod pairs;
mod tree;

use crate::math::Vec3;
use crate::math::lanes::{Singles, Width};
use fmm::Walk;
use tree::Tree;

/// Highest order of an expansion.
pub const HIGHEST_ORDER: usize = 10;

/// How attraction is summed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Every pair.
    Direct,
    /// The fast multipole method.
    Fmm,
    /// The faster of the two for this many bodies and this error.
    #[default]
    Auto,
}

impl std::str::FromStr for Method {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "direct" => Ok(Method::Direct),
            "fmm" => Ok(Method::Fmm),
            "auto" => Ok(Method::Auto),
            _ => Err("expected direct, fmm or auto".into()),
        }
    }
}

/// Settings of the fast multipole method.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Expansion {
    /// Total order p of the expansions, 1 to [`HIGHEST_ORDER`].
    order: usize,
    /// Opening theta: cells are far if the sum of their radii is below theta times the distance of their centres.
    opening: f64,
    /// Most bodies in a leaf.
    leaf: usize,
    /// Pairs in single precision, but for sources nearer than this part of the leaf's radius.
    single: Option<f64>,
}

impl Expansion {
    /// Settings that bring the RMS relative error asked for.
    fn for_error(error: f64) -> Self {
        let (order, opening) = match error {
            e if e >= 1e-2 => (3, 0.9),
            e if e >= 1e-3 => (4, 0.7),
            e if e >= 1e-4 => (6, 0.6),
            e if e >= 1e-5 => (7, 0.5),
            _ => (9, 0.5),
        };
        Expansion { order, opening, leaf: 48, single: (error > 1e-6).then_some(0.01) }
    }
}

/// Attraction at each body.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Field {
    /// m/s^2
    pub acceleration: Vec<Vec3>,
    /// J/kg, negative.
    pub potential: Vec<f64>,
    /// RMS of what was taken away so that forces and torques sum to zero, over the RMS acceleration, by mass.
    pub removed: f64,
}

/// A way to sum attraction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gravity {
    pub method: Method,
    /// RMS relative error asked of the fast multipole method; order and opening follow from it.
    pub error: f64,
    /// Total order of the expansions, 1 to [`HIGHEST_ORDER`], set by hand.
    pub order: Option<usize>,
    /// Opening theta, below 1, set by hand: cells are far if the sum of their radii is below theta times the distance
    /// of their centres.
    pub opening: Option<f64>,
    /// Most bodies in a leaf, set by hand.
    pub leaf: Option<usize>,
}

impl Gravity {
    pub fn new(method: Method, error: f64) -> Self {
        Gravity { method, error, order: None, opening: None, leaf: None }
    }

    fn expansion(&self) -> Expansion {
        let Expansion { order, opening, leaf, single } = Expansion::for_error(self.error);
        Expansion {
            order: self.order.unwrap_or(order).clamp(1, HIGHEST_ORDER),
            opening: self.opening.unwrap_or(opening).clamp(0.0, 0.99),
            leaf: self.leaf.unwrap_or(leaf).max(1),
            single,
        }
    }

    /// The method taken for this many bodies: never `Auto`.
    pub fn method_for(&self, bodies: usize) -> Method {
        match self.method {
            Method::Auto if bodies < 1000 => Method::Direct,
            Method::Auto => Method::Fmm,
            method => method,
        }
    }

    /// a_i = G sum_j m_j (x_j - x_i)/|x_j - x_i|^3 and phi_i = -G sum_j m_j/|x_j - x_i|.
    pub fn field(&self, positions: &[Vec3], masses: &[f64], constant: f64) -> Field {
        self.at_width(positions, masses, constant, Width::detect())
    }

    fn at_width(&self, positions: &[Vec3], masses: &[f64], constant: f64, width: Width) -> Field {
        if positions.len() < 2 || self.method_for(positions.len()) == Method::Direct {
            let (acceleration, potential) = direct::accelerations(positions, masses, constant);
            return Field { acceleration, potential, removed: 0.0 };
        }
        let mut field = match width {
            Width::One(lanes) => self.expand(lanes, positions, masses, constant),
            #[cfg(target_arch = "x86_64")]
            Width::Four(lanes) => self.expand(lanes, positions, masses, constant),
            #[cfg(target_arch = "x86_64")]
            Width::Eight(lanes) => self.expand(lanes, positions, masses, constant),
        };
        field.removed = balance(positions, masses, &mut field.acceleration);
        field
    }

    fn expand<L: Singles>(&self, lanes: L, positions: &[Vec3], masses: &[f64], constant: f64) -> Field {
        let Expansion { order, opening, leaf, single } = self.expansion();
        let tree = Tree::new(lanes, positions, masses, order, leaf);
        let pulls = Walk { lanes, tree: &tree, opening, single }.pulls();
        let potential_unit = constant * tree.mass / tree.length;
        let unit = potential_unit / tree.length;
        let mut acceleration = vec![Vec3::zeros(); positions.len()];
        let mut potential = vec![0.0; positions.len()];
        for (&i, [x, y, z, sum]) in tree.index.iter().zip(pulls) {
            acceleration[i as usize] = Vec3::new(x, y, z) * unit;
            potential[i as usize] = -sum * potential_unit;
        }
        Field { acceleration, potential, removed: 0.0 }
    }
}

/// Takes the rigid motion out of accelerations that their own errors give: a_i -= F/M + (I^-1 T) x x_i about the centre
/// of mass, with F = sum m a, T = sum x x m a. Returns the RMS of what was removed over that of `a`, by mass.
fn balance(positions: &[Vec3], masses: &[f64], acceleration: &mut [Vec3]) -> f64 {
    let mass: f64 = masses.iter().sum();
    if mass <= 0.0 {
        return 0.0;
    }
    let origin = positions[0];
    let centre = origin + positions.iter().zip(masses).map(|(x, m)| (x - origin) * *m).sum::<Vec3>() / mass;
    let mut inertia = nalgebra::Matrix3::zeros();
    let (mut force, mut torque, mut square) = (Vec3::zeros(), Vec3::zeros(), 0.0);
    for ((x, m), a) in positions.iter().zip(masses).zip(&*acceleration) {
        let r = x - centre;
        inertia += (nalgebra::Matrix3::identity() * r.norm_squared() - r * r.transpose()) * *m;
        force += a * *m;
        torque += r.cross(a) * *m;
        square += m * a.norm_squared();
    }
    // Bodies in a line have no moment about it and no torque.
    let axes = inertia.symmetric_eigen();
    let largest = axes.eigenvalues.max();
    let mut spin = Vec3::zeros();
    for k in 0..3 {
        if axes.eigenvalues[k] > 1e-12 * largest {
            let axis: Vec3 = axes.eigenvectors.column(k).into();
            spin += axis * (axis.dot(&torque) / axes.eigenvalues[k]);
        }
    }
    let mut removed = 0.0;
    for ((x, m), a) in positions.iter().zip(masses).zip(acceleration) {
        let part = force / mass + spin.cross(&(x - centre));
        *a -= part;
        removed += m * part.norm_squared();
    }
    if square > 0.0 { (removed / square).sqrt() } else { 0.0 }
}
