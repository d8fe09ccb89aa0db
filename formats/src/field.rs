//! External fields of the option `fields`: attraction of a primary, and inertial forces in rotating axes. cd-solve
//! accelerates bodies by them, cd-post computes their energy.

use std::path::Path;
use std::sync::Arc;

use nalgebra::{UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::compute::ExternalField;
use crate::error::{Fault, Faults};
use crate::geometry::polyhedron_gravity::PolyhedronGravity;
use crate::obj;
use crate::surface::Surface;

type Vec3 = Vector3<f64>;

/// External field, in the form in which it is evaluated.
#[derive(Debug, Clone, PartialEq)]
pub enum FieldModel {
    /// Attraction by a body at rest or, relative to freely falling axes, by a body on an orbit.
    Primary {
        /// G M, m^3/s^2
        strength: f64,
        /// Position of the centre, m.
        centre: Vec3,
        /// Point that falls in the attraction of the primary, as of a point mass, and with which these axes fall, m; `None`
        /// if the primary is at rest.
        falling_point: Option<Vec3>,
        /// Displacement of the primary from its orbit by its response to the bodies, part of `centre`, m.
        displacement: Vec3,
        /// J2 R^2, m^2: zonal harmonic and equatorial radius squared; 0 for a sphere.
        oblateness: f64,
        /// Unit vector.
        axis: Vec3,
    },
    /// Attraction by a homogeneous polyhedron.
    Polyhedron {
        /// G times density, 1/s^2.
        strength: f64,
        shape: Arc<PolyhedronGravity>,
        /// Position of the origin of the shape, on an orbit of its centre of mass, m.
        position: Vec3,
        /// Rotation from the axes of the shape to the world's; `None` of a shape that never turns.
        rotation: Option<UnitQuaternion<f64>>,
        /// Point that falls in the attraction of the body, as of a point mass, and with which these axes fall, m; `None` of a
        /// body that is not on an orbit.
        falling_point: Option<Vec3>,
        /// Displacement of the body from its orbit by its response to the bodies, part of `position`, m.
        displacement: Vec3,
    },
    /// Axes that rotate about a point.
    RotatingAxes {
        /// Angular velocity, rad/s.
        rate: Vec3,
        /// Centre of rotation, m.
        centre: Vec3,
    },
}

/// Response of a primary on an orbit to the attraction of the bodies.
///
/// The orbit is that of two point masses about each other, the mass of the bodies in the origin. The primary deviates from it by
/// the tide on the bodies: what these gain of momentum relative to the origin the primary loses. With the masses m_i and M, the
/// velocities v_i, and the deviation d,
///
/// ```text
/// M d(d')/dt = -Σ m_i a_i,   hence   Σ m_i v_i + M d' = const.
/// ```
///
/// where a_i is [`FieldModel::acceleration_and_potential`]: the remaining momentum, that of the two point masses, is constant.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct PrimaryResponse {
    /// Mass of the bodies, kg.
    pub bodies_mass: f64,
    /// Deviation of the primary from its orbit, m.
    pub displacement: [f64; 3],
    /// Rate of change of `displacement`, m/s.
    pub velocity: [f64; 3],
}

impl PrimaryResponse {
    /// Response after `time` (s) without forces.
    pub fn free_motion(&self, time: f64) -> PrimaryResponse {
        let displacement = [0, 1, 2].map(|k| self.displacement[k] + self.velocity[k] * time);
        PrimaryResponse { displacement, ..*self }
    }
}

/// Displacement (m) of a primary from its orbit and the mass (kg) of its companion, 0 without a response.
fn deviation(response: Option<&PrimaryResponse>) -> (Vec3, f64) {
    response.map_or((Vec3::zeros(), 0.0), |response| (response.displacement.into(), response.bodies_mass))
}

impl FieldModel {
    /// Models of the fields, with the shapes of the polyhedra among them, at a time, s; `gravity_constant` in
    /// m^3 kg^-1 s^-2; with the `response` of the primary at this time, if it has one; see [`primary_motions`].
    pub fn from_fields(
        fields: &[ExternalField],
        shapes: &FieldShapes,
        gravity_constant: f64,
        time: f64,
        response: Option<&PrimaryResponse>,
    ) -> Vec<Self> {
        let motions = primary_motions(fields, shapes, gravity_constant, time, response);
        let mut shapes = shapes.0.iter();
        // Point that falls in the attraction of the next primary on an orbit: the origin, then the primary before.
        let mut orbit_origin = Vec3::zeros();
        let model = |(field, motion): (&ExternalField, Option<(Vec3, Vec3)>)| {
            let centre = motion.map_or(Vec3::zeros(), |(position, _)| position);
            let falling_point = field.orbit().is_some().then(|| std::mem::replace(&mut orbit_origin, centre));
            let (mass, oblateness, axis) = match field {
                ExternalField::PointMass { mass, .. } => (mass, 0.0, Vec3::z()),
                ExternalField::Oblate { mass, radius, j2, axis, .. } => {
                    (mass, j2 * radius * radius, Vec3::from(*axis).normalize())
                }
                ExternalField::Polyhedron { density, position, rate, .. } => {
                    let turns = *rate != [0.0; 3];
                    return FieldModel::Polyhedron {
                        strength: gravity_constant * density,
                        shape: Arc::clone(shapes.next().expect("FieldShapes::read has a shape for each polyhedron")),
                        position: if falling_point.is_some() { centre } else { (*position).into() },
                        rotation: turns.then(|| UnitQuaternion::from_scaled_axis(Vec3::from(*rate) * time)),
                        falling_point,
                        displacement: deviation(response).0,
                    };
                }
                ExternalField::RotatingFrame { rate, centre } => {
                    return FieldModel::RotatingAxes { rate: (*rate).into(), centre: (*centre).into() };
                }
            };
            let displacement = deviation(response).0;
            FieldModel::Primary {
                strength: gravity_constant * mass,
                centre,
                falling_point,
                displacement,
                oblateness,
                axis,
            }
        };
        fields.iter().zip(motions).map(model).collect()
    }

    /// Acceleration of a body at rest in these axes, m/s^2, and its potential, J/kg. With r from the centre, s =
    /// r.axis/|r| and e = J2 R^2/|r|^2:
    ///
    /// ```text
    /// primary:      phi = -G M/|r| (1 - e (3 s^2 - 1)/2),   a = -G M/|r|^3 (r (1 + 3/2 e (1 - 5 s^2)) + 3 e s |r| axis)
    /// on an orbit:  phi = 0,                                a + G M r_0/|r_0|^3, r_0 of the falling point
    /// polyhedron:   see [`PolyhedronGravity`]; phi = 0 if it turns or moves
    /// turning axes: phi = -|W x r|^2/2,                     a = -W x (W x r)
    /// ```
    ///
    /// The force is 0 at a primary's centre. A moving or turning primary does external work and has no potential.
    pub fn acceleration_and_potential(&self, x: &Vec3) -> (Vec3, f64) {
        match self {
            &FieldModel::Primary { strength, centre, falling_point, displacement, oblateness, axis } => {
                let r = x - centre;
                let distance = r.norm();
                if distance == 0.0 {
                    return (Vec3::zeros(), 0.0);
                }
                let (s, e) = (r.dot(&axis) / distance, oblateness / (distance * distance));
                let factor = -strength / (distance * distance * distance);
                let flattening = r * (1.5 * e * (1.0 - 5.0 * s * s)) + axis * (3.0 * e * s * distance);
                if let Some(falling_point) = falling_point {
                    let tide =
                        tide(strength, &(falling_point - (centre - displacement)), &(x - displacement - falling_point));
                    return (tide + flattening * factor, 0.0);
                }
                let potential = -strength / distance * (1.0 - 0.5 * e * (3.0 * s * s - 1.0));
                ((r + flattening) * factor, potential)
            }
            FieldModel::Polyhedron { .. } => self.accelerations_and_potentials(std::slice::from_ref(x))[0],
            FieldModel::RotatingAxes { rate, centre } => {
                let frame_velocity = rate.cross(&(x - centre));
                (-rate.cross(&frame_velocity), -0.5 * frame_velocity.norm_squared())
            }
        }
    }

    /// [`acceleration_and_potential`](Self::acceleration_and_potential) at each of the points `x`, the same numbers in less time
    /// for polyhedra.
    pub fn accelerations_and_potentials(&self, x: &[Vec3]) -> Vec<(Vec3, f64)> {
        let FieldModel::Polyhedron { strength, shape, position, rotation, falling_point, displacement } = self else {
            return x.iter().map(|x| self.acceleration_and_potential(x)).collect();
        };
        let to_shape = |x: &Vec3| {
            let from_position = x - position;
            let point = rotation.map_or(from_position, |rotation| rotation.inverse_transform_vector(&from_position));
            if falling_point.is_some() { point + shape.centre() } else { point }
        };
        let points: Vec<Vec3> = x.iter().map(to_shape).collect();
        let mut values = shape.attractions_and_potentials(&points);
        for ((x, point), (attraction, potential)) in x.iter().zip(&points).zip(&mut values) {
            let to_world = |vector: Vec3| rotation.map_or(vector, |rotation| rotation * vector) * *strength;
            *attraction = match falling_point {
                Some(falling_point) => {
                    let orbit_position = position - displacement;
                    tide(
                        strength * shape.volume(),
                        &(falling_point - orbit_position),
                        &(x - displacement - falling_point),
                    ) + to_world(shape.attraction_of_shape(point, attraction))
                }
                None => to_world(*attraction),
            };
            *potential = if self.is_moving() { 0.0 } else { *potential * strength };
        }
        values
    }

    /// Whether the field is that of a polyhedron, for which
    /// [`accelerations_and_potentials`](Self::accelerations_and_potentials) takes less time than a point at a time.
    pub fn is_polyhedron(&self) -> bool {
        matches!(self, FieldModel::Polyhedron { .. })
    }

    /// Whether the field is that of a moving or turning primary, whose work is external work.
    pub fn is_moving(&self) -> bool {
        match self {
            FieldModel::Primary { falling_point, .. } => falling_point.is_some(),
            FieldModel::Polyhedron { rotation, falling_point, .. } => rotation.is_some() || falling_point.is_some(),
            FieldModel::RotatingAxes { .. } => false,
        }
    }

    /// Potential energy of a body beyond its mass times the potential at its centre, J. In rotating axes it is -W.(J
    /// W)/2, due to the extent of the body, where `inertia_times` gives J W (kg m^2/s) in fixed axes. It is 0 for a primary.
    pub fn tidal_energy(&self, inertia_times: impl Fn(&Vec3) -> Vec3) -> f64 {
        match self {
            FieldModel::RotatingAxes { rate, .. } => -0.5 * inertia_times(rate).dot(rate),
            FieldModel::Primary { .. } | FieldModel::Polyhedron { .. } => 0.0,
        }
    }
}

/// Shapes of the polyhedra among the fields of a case, in their order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FieldShapes(Vec<Arc<PolyhedronGravity>>);

impl FieldShapes {
    /// Reads the surfaces of the fields from the folder `datbox`. Errors: all faults of the files.
    pub fn read(fields: &[ExternalField], datbox: &Path) -> Result<Self, Faults> {
        let mut faults = Faults::default();
        let mut shapes = Vec::new();
        for field in fields {
            let ExternalField::Polyhedron { surface, scale, .. } = field else { continue };
            let read = obj::read_surface(&datbox.join(surface));
            let Some(unscaled) = faults.gather_result(read) else { continue };
            let vertices: Vec<[f64; 3]> = unscaled.vertices().iter().map(|v| v.map(|x| scale * x)).collect();
            match Surface::new(&vertices, unscaled.triangles()) {
                Ok(surface) => shapes.push(Arc::new(PolyhedronGravity::new(&surface))),
                Err(_) => {
                    let found = format!("scaled by {scale:e} it has no finite volume");
                    faults.push(Fault::new(&datbox.join(surface), None, "surface", found, "expected another scale"));
                }
            }
        }
        faults.into_result(FieldShapes(shapes))
    }

    /// Mass of the primary of each of the fields of these shapes, kg; 0 of turning axes.
    pub fn primary_masses(&self, fields: &[ExternalField]) -> Vec<f64> {
        let mut shapes = self.0.iter();
        let mass_of = |field: &ExternalField| match field {
            ExternalField::PointMass { mass, .. } | ExternalField::Oblate { mass, .. } => *mass,
            ExternalField::Polyhedron { density, .. } => density * shapes.next().map_or(0.0, |shape| shape.volume()),
            ExternalField::RotatingFrame { .. } => 0.0,
        };
        fields.iter().map(mass_of).collect()
    }
}

/// Attraction at `r` + `d` less that at `r` from a mass with G M = `strength` (m^3/s^2), m/s^2, without cancellation. With q =
/// (2 r.d + d^2)/r^2 and w = sqrt(1 + q):
///
/// ```text
/// a = -G M/|r|^3 (d - (r + d) q (3 + 3 q + q^2)/(w^3 (1 + w^3)))
/// ```
///
/// Source: Battin (1999), An Introduction to the Mathematics and Methods of Astrodynamics, section 8.4.
fn tide(strength: f64, r: &Vec3, d: &Vec3) -> Vec3 {
    let square = r.norm_squared();
    let q = (2.0 * r.dot(d) + d.norm_squared()) / square;
    let cube = (1.0 + q) * (1.0 + q).sqrt();
    let change = q * (3.0 + 3.0 * q + q * q) / (cube * (1.0 + cube));
    (d - (r + d) * change) * (-strength / (square * square.sqrt()))
}

/// Position (m) and velocity (m/s) of the primary of each field at a time, s; `None` of turning axes and of polyhedra without an
/// orbit. `shapes`: those of the polyhedra. `gravity_constant` in m^3 kg^-1 s^-2.
///
/// The first orbit is that of the origin about its mass, the next one that of this mass about the next mass, and so on: the
/// axes fall freely with the origin. A primary with a `response` deviates from the orbit about the mass of the bodies.
pub fn primary_motions(
    fields: &[ExternalField],
    shapes: &FieldShapes,
    gravity_constant: f64,
    time: f64,
    response: Option<&PrimaryResponse>,
) -> Vec<Option<(Vec3, Vec3)>> {
    let (displacement, bodies_mass) = deviation(response);
    let velocity: Vec3 = response.map_or([0.0; 3], |response| response.velocity).into();
    // Motion of the origin, then of the last primary on an orbit.
    let (mut position_before, mut velocity_before) = (Vec3::zeros(), Vec3::zeros());
    let motion_of = |(field, mass): (&ExternalField, f64)| {
        let position = match field {
            ExternalField::PointMass { position, .. } | ExternalField::Oblate { position, .. } => *position,
            ExternalField::Polyhedron { .. } | ExternalField::RotatingFrame { .. } => None,
        };
        let Some(orbit) = field.orbit() else { return position.map(|position| (position.into(), Vec3::zeros())) };
        let (r, v) = orbit.to_orbit(gravity_constant * (mass + bodies_mass)).position_and_velocity(time);
        (position_before, velocity_before) = (position_before - r, velocity_before - v);
        Some((position_before + displacement, velocity_before + velocity))
    };
    fields.iter().zip(shapes.primary_masses(fields)).map(motion_of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orbit::OrbitSpec;

    #[test]
    fn acceleration_is_the_slope_of_the_potential() {
        let centre = Vec3::new(1.0, -2.0, 0.5);
        let axis = Vec3::new(1.0, 2.0, 2.0) / 3.0;
        let displacement = Vec3::zeros();
        let fields = [
            FieldModel::Primary { strength: 7.0, centre, falling_point: None, displacement, oblateness: 0.0, axis },
            FieldModel::Primary { strength: 7.0, centre, falling_point: None, displacement, oblateness: 0.3, axis },
            FieldModel::RotatingAxes { rate: Vec3::new(0.3, -0.1, 0.7), centre },
        ];
        let x = Vec3::new(3.0, 1.0, -1.0);
        for field in &fields {
            let h = 1e-5;
            let slope = Vec3::from_fn(|k, _| {
                let step = Vec3::ith(k, h);
                (field.acceleration_and_potential(&(x + step)).1 - field.acceleration_and_potential(&(x - step)).1)
                    / (2.0 * h)
            });
            // Central differences of numbers near 1: h^2 and 1e-16 / h.
            assert!((field.acceleration_and_potential(&x).0 + slope).norm() < 1e-9, "{field:?}");
        }
    }

    #[test]
    fn a_tide_is_the_difference_of_two_attractions() {
        let (centre, axis) = (Vec3::new(3.0, -4.0, 1.0), Vec3::z());
        let displacement = Vec3::zeros();
        let primary = |falling_point, oblateness| FieldModel::Primary {
            strength: 7.0,
            centre,
            falling_point,
            displacement,
            oblateness,
            axis,
        };
        let point = Vec3::new(0.5, 0.2, -0.3);
        for x in [Vec3::new(0.6, 0.1, -0.2), Vec3::new(-40.0, 2.0, 9.0), Vec3::new(3.1, -4.0, 1.0), point] {
            let at = |field: FieldModel, x: &Vec3| field.acceleration_and_potential(x);
            let expected = at(primary(None, 0.3), &x).0 - at(primary(None, 0.0), &point).0;
            let (found, potential) = at(primary(Some(point), 0.3), &x);
            assert!((found - expected).norm() < 1e-14 * (1.0 + expected.norm()), "{x}: {found} {expected}");
            assert_eq!(potential, 0.0);
        }
        // A primary that has moved attracts from where it is; the axes fall as to its orbit.
        let moved = Vec3::new(0.1, 0.2, -0.1);
        let displaced = FieldModel::Primary {
            strength: 7.0,
            centre: centre + moved,
            falling_point: Some(point),
            displacement: moved,
            oblateness: 0.0,
            axis,
        };
        let at_rest = FieldModel::Primary {
            strength: 7.0,
            centre: centre + moved,
            falling_point: None,
            displacement,
            oblateness: 0.0,
            axis,
        };
        let x = Vec3::new(0.6, 0.1, -0.2);
        let found = displaced.acceleration_and_potential(&x).0;
        let expected =
            at_rest.acceleration_and_potential(&x).0 - primary(None, 0.0).acceleration_and_potential(&point).0;
        assert!((found - expected).norm() < 1e-14, "{found} {expected}"); // roundings of numbers near 1
        // 1 m from the point that falls at 1e8 m: G M d/r^3 (3 cos^2 - 1) keeps its digits.
        let far = FieldModel::Primary {
            strength: 4e14,
            centre: Vec3::x() * 1e8,
            falling_point: Some(Vec3::zeros()),
            displacement,
            oblateness: 0.0,
            axis,
        };
        let along = far.acceleration_and_potential(&Vec3::x()).0.x;
        // To first order in d/r = 1e-8: 2 G M d/r^3 (1 + 3/2 d/r).
        assert!((along / (2.0 * 4e14 / 1e24) - 1.0 - 1.5e-8).abs() < 1e-14, "{along:e}");
    }

    #[test]
    fn masses_follow_each_other_on_their_orbits() {
        let circle = |r: f64, periapsis_time: f64| {
            Some(OrbitSpec::Elements {
                periapsis: Some(r),
                semi_major_axis: None,
                eccentricity: Some(0.0),
                v_infinity: None,
                inclination: 0.0,
                node: 0.0,
                argument: 0.0,
                periapsis_time,
            })
        };
        let (planet, sun) = (1e3, 1e6);
        let fields = [(planet, circle(2.0, 0.0)), (sun, circle(500.0, 0.0))]
            .map(|(mass, orbit)| ExternalField::PointMass { mass, position: None, orbit, response: false });
        let at = |time: f64| {
            let centre = |field: &FieldModel| match field {
                FieldModel::Primary { centre, .. } => *centre,
                other => unreachable!("{other:?} has no orbit"),
            };
            FieldModel::from_fields(&fields, &FieldShapes::default(), 1.0, time, None)
                .iter()
                .map(centre)
                .collect::<Vec<_>>()
        };
        // At 0 both are at their periapsis, on the x axis; after half a turn about the planet this one is on the other side.
        assert!((at(0.0)[0] - Vec3::new(-2.0, 0.0, 0.0)).norm() < 1e-14);
        assert!((at(0.0)[1] - Vec3::new(-502.0, 0.0, 0.0)).norm() < 1e-12);
        let half_turn = std::f64::consts::PI * (8.0 / planet).sqrt();
        assert!((at(half_turn)[0] - Vec3::new(2.0, 0.0, 0.0)).norm() < 1e-13);
    }
}
