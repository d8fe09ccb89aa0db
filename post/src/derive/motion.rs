//! The grains as one body: centre of mass, momenta, inertia, spin.

use cd_formats::compute::ExternalField;
use nalgebra::SymmetricEigen;

use crate::frame::{Frame, Grain};
use crate::math::{Mat3, Vec3};

/// The axes from which a snapshot's motion is seen: rate W (rad/s) and centre c (m) of each field that turns them.
#[derive(Debug, Clone, PartialEq)]
pub struct RotatingAxes(Vec<(Vec3, Vec3)>);

impl RotatingAxes {
    /// Axes of the fields of a run; none if no field rotates them.
    pub fn from_frame(frame: &Frame) -> RotatingAxes {
        let rate_and_centre = |field: &ExternalField| match *field {
            ExternalField::RotatingFrame { rate, centre } => Some((rate.into(), centre.into())),
            _ => None,
        };
        RotatingAxes(frame.meta.parameters.fields.iter().filter_map(rate_and_centre).collect())
    }

    /// Rate of rotation of the axes, rad/s: is added to an angular velocity to express it in fixed axes.
    pub fn rotation_rate(&self) -> Vec3 {
        self.0.iter().map(|(rate, _)| rate).sum()
    }

    /// W x (x - c), m/s: is added to a velocity at `x` to express it in fixed axes.
    pub fn velocity(&self, x: Vec3) -> Vec3 {
        self.0.iter().map(|(rate, centre)| rate.cross(&(x - centre))).sum()
    }
}

/// Sums over all grains.
#[derive(Debug, Clone, PartialEq)]
pub struct AggregateSums {
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass, m.
    pub x: Vec3,
    /// Momentum, kg m/s.
    pub momentum: Vec3,
    /// Angular momentum about the centre of mass, kg m^2/s: sum m (x - x_com) x (v - v_com) + I w.
    pub angular_momentum: Vec3,
    /// Inertia about the centre of mass, kg m^2: sum m (d.d - d (x) d) + I, d = x - x_com.
    pub inertia: Mat3,
}

/// Angular momentum below this share of its terms counts as zero: some units in the last place of each.
const RELATIVE_ROUNDING: f64 = 4.0 * f64::EPSILON;

impl AggregateSums {
    /// Sums over some grains; means over none are NaN.
    pub fn from_grains<'a>(grains: impl IntoIterator<Item = &'a Grain, IntoIter: Clone>) -> AggregateSums {
        let all = grains.into_iter();
        let grains = || all.clone();
        let mass: f64 = grains().map(|g| g.mass).sum();
        let x = grains().map(|g| g.mass * g.x).sum::<Vec3>() / mass;
        let momentum: Vec3 = grains().map(|g| g.mass * g.v).sum();
        let velocity = momentum / mass;
        let angular_momentum: Vec3 =
            grains().map(|g| g.mass * (g.x - x).cross(&(g.v - velocity)) + g.inertia * g.w).sum();
        // Rounding of a zero rotation would give an arbitrary axis.
        let rounding = |g: &Grain| {
            let (arm, speed) = ((g.x - x).norm(), (g.v - velocity).norm());
            g.mass * (arm * (g.v.norm() + velocity.norm()) + speed * (g.x.norm() + x.norm()))
        };
        let turns = angular_momentum.norm() > RELATIVE_ROUNDING * grains().map(rounding).sum::<f64>();
        let angular_momentum = if turns { angular_momentum } else { Vec3::zeros() };
        let inertia = grains().map(|g| g.inertia + point_inertia(g.mass, g.x - x)).sum();
        AggregateSums { mass, x, momentum, angular_momentum, inertia }
    }

    /// Returns the motion in fixed axes of sums taken in `axes`: P + M W x (x_com - c) and L + I W.
    pub fn in_fixed_axes(self, axes: &RotatingAxes) -> AggregateSums {
        let momentum = self.momentum + self.mass * axes.velocity(self.x);
        let angular_momentum = self.angular_momentum + self.inertia * axes.rotation_rate();
        AggregateSums { momentum, angular_momentum, ..self }
    }

    /// Velocity of the centre of mass, m/s.
    pub fn velocity(&self) -> Vec3 {
        self.momentum / self.mass
    }

    /// Angular velocity of the rigid body that has this inertia and angular momentum, rad/s: I^-1 L.
    pub fn spin(&self) -> Vec3 {
        self.inertia.try_inverse().map_or(Vec3::repeat(f64::NAN), |inverse| inverse * self.angular_momentum)
    }

    /// Kinetic energy of the rigid motion, J: M v_com^2 / 2 + L.(I^-1 L) / 2, the lower bound for any motion with these
    /// momenta.
    pub fn rigid_energy(&self) -> f64 {
        0.5 * (self.mass * self.velocity().norm_squared() + self.angular_momentum.dot(&self.spin()))
    }

    /// Semi-axes a >= b >= c of the uniform ellipsoid of this mass and these principal moments, m.
    ///
    /// See [`semi_axes`]; of a single sphere, its radius.
    pub fn semi_axes(&self) -> [f64; 3] {
        if self.mass == 0.0 {
            return [f64::NAN; 3];
        }
        semi_axes(SymmetricEigen::new(self.inertia).eigenvalues.into(), self.mass)
    }
}

/// Inertia about the origin of a point of mass m at d, kg m^2.
fn point_inertia(mass: f64, d: Vec3) -> Mat3 {
    mass * (Mat3::from_diagonal_element(d.norm_squared()) - d * d.transpose())
}

/// Semi-axes a >= b >= c, m, of the uniform ellipsoid with principal moments A <= B <= C.
///
/// a^2 = 5 (B + C - A) / 2M, b^2 = 5 (A + C - B) / 2M, c^2 = 5 (A + B - C) / 2M, from
/// A = M (b^2 + c^2) / 5 and cyclic. `moments` in any order, kg m^2; `mass` M, kg. A square that
/// round-off makes negative (a disc, whose A + B = C) counts as 0.
///
/// ```
/// // 5 kg with semi-axes 3, 2, 1 m: A = 4 + 1, B = 9 + 1, C = 9 + 4.
/// assert_eq!(cd_post::derive::motion::semi_axes([13.0, 5.0, 10.0], 5.0), [3.0, 2.0, 1.0]);
/// ```
pub fn semi_axes(mut moments: [f64; 3], mass: f64) -> [f64; 3] {
    moments.sort_by(f64::total_cmp);
    let [a, b, c] = moments;
    [b + c - a, a + c - b, a + b - c].map(|sum| (2.5 * sum.max(0.0) / mass).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Scene;

    #[test]
    fn a_single_sphere_is_its_own_ellipsoid() {
        let mut scene = Scene::default();
        scene.grain([7.0, 8.0, 9.0], 0.3);
        for axis in AggregateSums::from_grains(&scene.frame().grains).semi_axes() {
            assert!((axis - 0.3).abs() < 1e-16 * 4.0);
        }
    }

    #[test]
    fn two_spheres_side_by_side() {
        // A = 2 (2/5) m r^2; B = C = A + 2 m r^2. So a^2 = 5 (A + 4 m r^2) / 4m = 6 r^2, b = c = r.
        let mut scene = Scene::default();
        scene.grain([0.0, -2.0, 0.0], 2.0);
        scene.grain([0.0, 2.0, 0.0], 2.0);
        let [a, b, c] = AggregateSums::from_grains(&scene.frame().grains).semi_axes();
        assert!((a - 2.0 * 6f64.sqrt()).abs() < 1e-14 && (b - 2.0).abs() < 1e-14 && (c - 2.0).abs() < 1e-14);
    }

    #[test]
    fn a_lattice_in_an_ellipsoid_has_its_axes() {
        // Small equal spheres on a fine cubic lattice: the uniform ellipsoid within the lattice's
        // roughness at the surface, under 1 % at 10 grains along the shortest axis.
        let axes = [30.0, 20.0, 10.0];
        let mut scene = Scene::default();
        for (i, j, k) in (-30..=30).flat_map(|i| (-20..=20).flat_map(move |j| (-10..=10).map(move |k| (i, j, k)))) {
            let x = [i as f64, j as f64, k as f64];
            if x.iter().zip(axes).map(|(x, a)| (x / a).powi(2)).sum::<f64>() <= 1.0 {
                scene.grain(x, 0.5);
            }
        }
        let found = AggregateSums::from_grains(&scene.frame().grains).semi_axes();
        for (found, expected) in found.iter().zip(axes) {
            assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
        }
    }

    #[test]
    fn rigid_rotation_is_recovered() {
        let (spin, velocity) = (Vec3::new(0.1, -0.2, 0.5), Vec3::new(3.0, 0.0, -1.0));
        let mut scene = Scene::default();
        for (k, r) in [0.5, 1.0, 0.2, 0.8].into_iter().enumerate() {
            let k = k as f64;
            scene.grain([k, 0.3 * k * k, (5.0 * k).sin()], r);
        }
        let x = AggregateSums::from_grains(&scene.frame().grains).x;
        for row in 0..4 {
            let arm = Vec3::from(scene.snapshot.bodies.body_x[row]) - x;
            scene.snapshot.bodies.body_v[row] = (velocity + spin.cross(&arm)).into();
            scene.snapshot.bodies.body_w_world[row] = spin.into();
        }
        let grains = scene.frame().grains;
        let whole = AggregateSums::from_grains(&grains);
        assert!((whole.spin() - spin).norm() < 1e-14);
        assert!((whole.velocity() - velocity).norm() < 1e-14);
        let kinetic_energy = crate::derive::energy::KineticEnergy::of_grains(&grains);
        assert!((whole.rigid_energy() / kinetic_energy.total() - 1.0).abs() < 1e-14);
    }

    #[test]
    fn turning_axes_show_less_motion_than_there_is() {
        let (rate, centre) = (Vec3::new(0.3, -0.2, 0.5), Vec3::new(2.0, 1.0, -1.0));
        let mut scene = Scene::default();
        for (k, r) in [0.5, 1.0, 0.2].into_iter().enumerate() {
            let k = k as f64;
            scene.grain([k, 0.3 * k * k, (5.0 * k).sin()], r);
        }
        let bodies = &mut scene.snapshot.bodies;
        (bodies.body_v, bodies.body_w_world) =
            (vec![[0.1, 0.2, 0.3], [-0.4, 0.0, 1.0], [0.7, 0.5, -0.2]], vec![[0.0, 0.6, 0.1]; 3]);
        let fixed = scene.frame();
        let bodies = &mut scene.snapshot.bodies;
        for row in 0..3 {
            let x = Vec3::from(bodies.body_x[row]);
            bodies.body_v[row] = (Vec3::from(bodies.body_v[row]) - rate.cross(&(x - centre))).into();
            bodies.body_w_world[row] = (Vec3::from(bodies.body_w_world[row]) - rate).into();
        }
        scene.snapshot.meta.parameters.fields =
            vec![ExternalField::RotatingFrame { rate: rate.into(), centre: centre.into() }];
        let seen = scene.frame();
        let (expected, found) = (AggregateSums::from_grains(&fixed.grains), AggregateSums::from_grains(&seen.grains));
        assert!((found.spin() - expected.spin()).norm() > 0.5);
        let found = found.in_fixed_axes(&RotatingAxes::from_frame(&seen));
        // Rounding of sums of a few numbers near 10.
        assert!((found.momentum - expected.momentum).norm() < 1e-13);
        assert!((found.angular_momentum - expected.angular_momentum).norm() < 1e-13);
        assert!((found.spin() - expected.spin()).norm() < 1e-13);
        assert_eq!(expected.clone().in_fixed_axes(&RotatingAxes::from_frame(&fixed)), expected);
    }

    #[test]
    fn a_disc_has_no_thickness_rather_than_nan() {
        assert_eq!(semi_axes([1.0, 1.0, 2.0 + 1e-15], 1.0)[2], 0.0);
    }
}
