//! External fields: attraction of a primary, and inertial forces in rotating axes.

use nalgebra::Vector3;

use crate::compute::ExternalField;

type Vec3 = Vector3<f64>;

/// External field, in the form in which it is evaluated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FieldModel {
    /// Attraction by a body at rest.
    Primary {
        /// G M, m^3/s^2
        strength: f64,
        /// Position of the centre, m.
        centre: Vec3,
        /// J2 R^2, m^2: zonal harmonic and equatorial radius squared; 0 for a sphere.
        oblateness: f64,
        /// Unit vector.
        axis: Vec3,
    },
    /// Axes that rotate about a point.
    Turning {
        /// Angular velocity, rad/s.
        rate: Vec3,
        /// Centre of rotation, m.
        centre: Vec3,
    },
}

impl FieldModel {
    /// Acceleration of a body at rest in these axes, m/s^2, and its potential, J/kg. With r from the centre, s =
    /// r.axis/|r| and e = J2 R^2/|r|^2:
    ///
    /// ```text
    /// primary:      phi = -G M/|r| (1 - e (3 s^2 - 1)/2),   a = -G M/|r|^3 (r (1 + 3/2 e (1 - 5 s^2)) + 3 e s |r| axis)
    /// turning axes: phi = -|W x r|^2/2,                     a = -W x (W x r)
    /// ```
    ///
    /// The force is 0 at a primary's centre.
    pub fn acceleration_and_potential(&self, x: &Vec3) -> (Vec3, f64) {
        match *self {
            FieldModel::Primary { strength, centre, oblateness, axis } => {
                let r = x - centre;
                let distance = r.norm();
                if distance == 0.0 {
                    return (Vec3::zeros(), 0.0);
                }
                let (s, e) = (r.dot(&axis) / distance, oblateness / (distance * distance));
                let along = r * (1.0 + 1.5 * e * (1.0 - 5.0 * s * s)) + axis * (3.0 * e * s * distance);
                let potential = -strength / distance * (1.0 - 0.5 * e * (3.0 * s * s - 1.0));
                (along * (-strength / (distance * distance * distance)), potential)
            }
            FieldModel::Turning { rate, centre } => {
                let moving = rate.cross(&(x - centre));
                (-rate.cross(&moving), -0.5 * moving.norm_squared())
            }
        }
    }

    /// Potential energy of a body beyond its mass times the potential at its centre, J. In rotating axes it is -W.(J
    /// W)/2, due to the extent of the body, where `turns` gives J W (kg m^2/s) in fixed axes. It is 0 for a primary.
    pub fn tidal_energy(&self, turns: impl Fn(&Vec3) -> Vec3) -> f64 {
        match self {
            FieldModel::Turning { rate, .. } => -0.5 * turns(rate).dot(rate),
            FieldModel::Primary { .. } => 0.0,
        }
    }

    /// Angular velocity of the axes, rad/s.
    pub fn rotation_rate(&self) -> Vec3 {
        match *self {
            FieldModel::Turning { rate, .. } => rate,
            FieldModel::Primary { .. } => Vec3::zeros(),
        }
    }
}

impl ExternalField {
    /// Model of the field for the Newtonian constant `constant`, m^3 kg^-1 s^-2.
    pub fn to_model(&self, constant: f64) -> FieldModel {
        let primary = |mass: f64, position: [f64; 3], oblateness: f64, axis: [f64; 3]| FieldModel::Primary {
            strength: constant * mass,
            centre: position.into(),
            oblateness,
            axis: Vec3::from(axis).normalize(),
        };
        match *self {
            ExternalField::PointMass { mass, position } => primary(mass, position, 0.0, [0.0, 0.0, 1.0]),
            ExternalField::Oblate { mass, position, radius, j2, axis } => {
                primary(mass, position, j2 * radius * radius, axis)
            }
            ExternalField::RotatingFrame { rate, centre } => {
                FieldModel::Turning { rate: rate.into(), centre: centre.into() }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn acceleration_is_the_slope_of_the_potential() {
        let centre = Vec3::new(1.0, -2.0, 0.5);
        let axis = Vec3::new(1.0, 2.0, 2.0) / 3.0;
        let fields = [
            FieldModel::Primary { strength: 7.0, centre, oblateness: 0.0, axis },
            FieldModel::Primary { strength: 7.0, centre, oblateness: 0.3, axis },
            FieldModel::Turning { rate: Vec3::new(0.3, -0.1, 0.7), centre },
        ];
        let x = Vec3::new(3.0, 1.0, -1.0);
        for field in fields {
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
}
