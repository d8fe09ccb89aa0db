//! Axes of the positions and velocities that are written: those of the computation, or others that do not rotate against them.

use std::fmt;
use std::path::Path;
use std::str::FromStr;

use cd_formats::atomic;
use cd_formats::error::{Fault, Faults};
use cd_formats::field::{FieldShapes, PrimaryResponse, primary_motions};
use cd_formats::messages::print_line;
use cd_formats::snapshot::SnapshotMeta;

use crate::math::Vec3;

/// File of a folder of results with the axes of its positions and velocities, if they are not those of the computation.
const AXES_FILE: &str = "axes.txt";

/// Choice of the axes of written positions and velocities.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OutputAxes {
    /// Axes of the computation, which fall freely if the fields have orbits.
    #[default]
    Computed,
    /// Axes at rest.
    Inertial,
    /// Axes about the primary with this number in the option `fields`, from 1.
    Primary(usize),
}

/// Text of the command line that names no axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OutputAxesError;

impl fmt::Display for OutputAxesError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("expected computed, inertial or primary:N, N the number of a field from 1")
    }
}

impl std::error::Error for OutputAxesError {}

impl FromStr for OutputAxes {
    type Err = OutputAxesError;

    fn from_str(text: &str) -> Result<OutputAxes, OutputAxesError> {
        match text.split_once(':') {
            None if text == "computed" => Ok(OutputAxes::Computed),
            None if text == "inertial" => Ok(OutputAxes::Inertial),
            Some(("primary", number)) => {
                number.parse().ok().filter(|number| *number > 0).map(OutputAxes::Primary).ok_or(OutputAxesError)
            }
            _ => Err(OutputAxesError),
        }
    }
}

impl fmt::Display for OutputAxes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            OutputAxes::Computed => f.write_str("computed"),
            OutputAxes::Inertial => f.write_str("inertial"),
            OutputAxes::Primary(number) => write!(f, "primary:{number}"),
        }
    }
}

/// Origin of the axes of written positions and velocities, in the axes of the computation.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AxesOrigin {
    /// Position, m.
    pub x: Vec3,
    /// Velocity, m/s.
    pub v: Vec3,
}

impl AxesOrigin {
    /// Returns the position in the written axes of the point at `x` (m), rounded once.
    pub fn written_position(&self, x: Vec3) -> Vec3 {
        x - self.x
    }

    /// Returns the velocity in the written axes of a point that moves with `v` (m/s), rounded once.
    pub fn written_velocity(&self, v: Vec3) -> Vec3 {
        v - self.v
    }
}

impl OutputAxes {
    /// Records the axes of the files in `folder`: `axes.txt` has axes other than those of the computation, for which there is no
    /// such file.
    pub fn record(self, folder: &Path) -> Result<(), Faults> {
        let path = folder.join(AXES_FILE);
        if self != OutputAxes::Computed {
            print_line(format_args!("  axes     {self}, see {}", path.display()));
            return atomic::write(&path, format!("{self}\n").as_bytes());
        }
        if atomic::path_exists(&path) {
            std::fs::remove_file(&path).map_err(|error| Fault::from_io(&path, "removed", &error))?;
        }
        Ok(())
    }

    /// Origin of the axes at the time of a snapshot; `shapes`: those of the polyhedra among its fields.
    ///
    /// Axes at rest have their origin in the last mass of the chain of orbits, which nothing attracts. With a response they have
    /// it in the common centre of mass of the two point masses of the orbit, M and, in the origin of the computation, m: in these
    /// axes Σ m_i x_i + M x of the mass is Σ m_i x_i + M d of the computation, with its deviation d, whose rate is constant.
    ///
    /// Errors: fields without orbits, or a number that is not that of a field with an orbit.
    pub fn origin(self, meta: &SnapshotMeta, shapes: &FieldShapes) -> Result<AxesOrigin, Faults> {
        if self == OutputAxes::Computed {
            return Ok(AxesOrigin::default());
        }
        let (fields, constant) = (&meta.parameters.fields, meta.parameters.gravity_constant);
        let orbiting: Vec<usize> =
            (1..).zip(fields).filter(|(_, field)| field.orbit().is_some()).map(|(number, _)| number).collect();
        let fault = |expected: String| {
            let fault =
                Fault::new(Path::new("options"), None, "--frame", self.to_string(), format!("expected {expected}"));
            Err(fault.into())
        };
        let Some(&last) = orbiting.last() else {
            return fault("computed, as no field of the run has an orbit".into());
        };
        let response = meta.primary_response;
        let motion = |number: usize, response: Option<&PrimaryResponse>| {
            let motions = primary_motions(fields, shapes, constant, meta.time, response);
            let (x, v) = motions[number - 1].expect("a field with an orbit has a motion");
            AxesOrigin { x, v }
        };
        match self {
            OutputAxes::Primary(number) if orbiting.contains(&number) => Ok(motion(number, response.as_ref())),
            OutputAxes::Primary(_) => {
                let numbers: Vec<String> = orbiting.iter().map(|number| format!("primary:{number}")).collect();
                fault(format!("computed, inertial or {}", numbers.join(" or ")))
            }
            _ => {
                let Some(response) = response else { return Ok(motion(last, None)) };
                let on_orbit = PrimaryResponse { bodies_mass: response.bodies_mass, ..PrimaryResponse::default() };
                let mass: f64 = shapes.primary_masses(fields).into_iter().sum();
                let share = mass / (mass + response.bodies_mass);
                let AxesOrigin { x, v } = motion(last, Some(&on_orbit));
                Ok(AxesOrigin { x: x * share, v: v * share })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Scene;
    use cd_formats::orbit::OrbitSpec;

    #[test]
    fn a_mass_that_responds_and_the_bodies_move_about_a_point_at_rest() {
        let mut scene = Scene::default();
        let moving = scene.grain([0.5, -1.0, 2.0], 1.0);
        scene.snapshot.bodies.body_v[moving] = [0.2, 0.3, -0.1];
        let (m, mass) = (scene.snapshot.bodies.body_mass[moving], 20.0);
        let orbit = OrbitSpec::State { position: [300.0, 20.0, 0.0], velocity: [0.1, 0.2, 0.05], time: 0.0 };
        let meta = &mut scene.snapshot.meta;
        (meta.time, meta.parameters.gravity_constant) = (40.0, 1.0);
        let field = |response| cd_formats::compute::ExternalField::PointMass {
            mass,
            position: None,
            orbit: Some(orbit.clone()),
            response,
        };
        meta.parameters.fields = vec![field(true)];
        let response =
            PrimaryResponse { bodies_mass: m, displacement: [0.1, -0.2, 0.3], velocity: [-0.01, 0.02, 0.04] };
        meta.primary_response = Some(response);
        let [resting, about_mass] = [OutputAxes::Inertial, OutputAxes::Primary(1)]
            .map(|axes| axes.origin(&scene.snapshot.meta, &FieldShapes::default()).unwrap());
        // The mass is the origin of its own axes.
        let common = |written: Vec3, of_mass: Vec3| m * written + mass * of_mass;
        let x = Vec3::new(0.5, -1.0, 2.0);
        let v = Vec3::new(0.2, 0.3, -0.1);
        let sum_x = common(resting.written_position(x), resting.written_position(about_mass.x));
        let sum_v = common(resting.written_velocity(v), resting.written_velocity(about_mass.v));
        // Rounding of distances of 300 m and masses of 20 kg.
        assert!((sum_x - common(x, response.displacement.into())).norm() < 1e-11, "{sum_x}");
        assert!((sum_v - common(v, response.velocity.into())).norm() < 1e-13, "{sum_v}");
    }

    #[test]
    fn axes_of_a_folder_are_those_of_the_last_files() {
        let folder = tempfile::tempdir().unwrap();
        let recorded = |axes: OutputAxes| {
            axes.record(folder.path()).unwrap();
            std::fs::read_to_string(folder.path().join("axes.txt")).ok()
        };
        assert_eq!(recorded(OutputAxes::Computed), None);
        assert_eq!(recorded(OutputAxes::Primary(2)).unwrap(), "primary:2\n");
        assert_eq!(recorded(OutputAxes::Inertial).unwrap(), "inertial\n");
        assert_eq!(recorded(OutputAxes::Computed), None);
    }

    #[test]
    fn axes_are_read_as_they_are_printed() {
        for axes in [OutputAxes::Computed, OutputAxes::Inertial, OutputAxes::Primary(12)] {
            assert_eq!(axes.to_string().parse(), Ok(axes));
        }
        for text in ["", "primary", "primary:", "primary:0", "primary:x", "inertial:1"] {
            assert_eq!(text.parse::<OutputAxes>(), Err(OutputAxesError));
        }
    }
}
