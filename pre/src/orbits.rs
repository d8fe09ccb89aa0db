//! Groups of grains that start on a Kepler orbit about a primary of `fields` or about other grains.

use std::path::Path;

use cd_formats::compute::{Compute, ExternalField};
use cd_formats::report::FaultReport;
use nalgebra::Vector3;

use crate::grain::Grain;
use crate::rounding::{round_14_columns, round_point};
use crate::scene::{OrbitCentre, Scene};
use crate::shapes::read::read_surface;

/// Mass about which a group moves, with its state.
struct AttractingMass {
    /// kg
    mass: f64,
    /// Position of its centre, m.
    position: Vector3<f64>,
    /// m/s
    velocity: Vector3<f64>,
}

/// Primary about which no group can move.
#[derive(Debug)]
enum PrimaryError {
    /// The surface of the primary cannot be read.
    UnreadSurface,
    /// No primary at rest has the requested number; `known` are the numbers of those at rest, counted among all fields.
    NotAtRest { known: Vec<usize> },
}

impl PrimaryError {
    /// Expected value, for a message.
    fn expected(&self) -> String {
        match self {
            PrimaryError::UnreadSurface => "a surface that can be read".to_string(),
            PrimaryError::NotAtRest { known } => {
                let expected = "the number of a primary at rest among compute.fields";
                match known.as_slice() {
                    [] => format!("{expected}; none of them is one"),
                    numbers => {
                        format!("{expected}: {}", numbers.iter().map(usize::to_string).collect::<Vec<_>>().join(", "))
                    }
                }
            }
        }
    }
}

impl std::fmt::Display for PrimaryError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            PrimaryError::UnreadSurface => write!(f, "the surface cannot be read"),
            PrimaryError::NotAtRest { .. } => write!(f, "no primary at rest has this number"),
        }
    }
}

impl std::error::Error for PrimaryError {}

impl AttractingMass {
    /// Sum of grains, with their common centre of mass and its velocity; `None` without grains.
    fn of_grains<'a>(grains: impl Iterator<Item = &'a Grain> + Clone) -> Option<Self> {
        let mass: f64 = grains.clone().map(|grain| grain.mass).sum();
        let mean = |value: fn(&Grain) -> Vector3<f64>| {
            grains.clone().map(|grain| value(grain) * grain.mass).sum::<Vector3<f64>>() / mass
        };
        (mass > 0.0).then(|| AttractingMass {
            mass,
            position: mean(|grain| grain.position),
            velocity: mean(|grain| grain.velocity),
        })
    }

    /// Mass of a primary at rest. Errors: no such field, or a surface that cannot be read.
    fn of_primary(options: &Compute, number: usize, folder: &Path) -> Result<Self, PrimaryError> {
        let field = number.checked_sub(1).and_then(|index| options.fields.get(index));
        let (mass, position) = match field {
            Some(
                ExternalField::PointMass { mass, position: Some(position), .. }
                | ExternalField::Oblate { mass, position: Some(position), .. },
            ) => (*mass, Vector3::from(*position)),
            Some(ExternalField::Polyhedron { surface, scale, density, position, orbit: None, .. }) => {
                let read = read_surface(&folder.join(surface)).map_err(|_| PrimaryError::UnreadSurface)?;
                let properties = read.surface.mass_properties();
                let centre = Vector3::from(properties.centre) * *scale;
                (density * properties.volume * scale.powi(3), Vector3::from(*position) + centre)
            }
            _ => {
                let fields = options.fields.iter().zip(1..).filter(|(field, _)| is_primary_at_rest(field));
                return Err(PrimaryError::NotAtRest { known: fields.map(|(_, number)| number).collect() });
            }
        };
        Ok(AttractingMass { mass, position, velocity: Vector3::zeros() })
    }
}

/// Whether a field is that of a mass at rest.
fn is_primary_at_rest(field: &ExternalField) -> bool {
    match field {
        ExternalField::PointMass { position, .. } | ExternalField::Oblate { position, .. } => position.is_some(),
        ExternalField::Polyhedron { orbit, .. } => orbit.is_none(),
        _ => false,
    }
}

/// Moves the grains of a group, placed about the origin at rest, onto the orbit of the group at time 0; `others` are the
/// grains of the groups before it. Paths of files are relative to `folder`.
///
/// The orbit is that of the two centres of mass about each other, in axes at rest; the other mass stays as it is.
pub fn place_on_orbit(
    scene: &Scene,
    folder: &Path,
    group: usize,
    grains: &mut [Grain],
    others: &[Grain],
    report: &mut FaultReport,
) {
    let Some(orbit) = &scene.grains[group].orbit else { return };
    let (path, options) = (format!("grains.{group}.orbit"), &scene.compute);
    let Some(own) = AttractingMass::of_grains(grains.iter()) else { return };
    let (centre, mass) = match &orbit.about {
        OrbitCentre::Primary(number) => match AttractingMass::of_primary(options, *number, folder) {
            Ok(primary) => {
                // The primary does not respond: the grains move about it as test particles.
                let mass = primary.mass;
                (primary, mass)
            }
            Err(error) => {
                let found = format!("Primary({number})");
                return report.add_fault(&format!("{path}.about"), found, error.expected());
            }
        },
        OrbitCentre::Colour(colour) => {
            let of_colour = others.iter().filter(|grain| scene.grains[grain.group].colour == *colour);
            let Some(centre) = AttractingMass::of_grains(of_colour) else {
                let found = format!("no grains of the colour '{colour}' before this group");
                let expected = "the colour of grains that are listed before, and that attract these";
                return report.add_fault(&format!("{path}.about"), found, expected);
            };
            if !options.self_gravity {
                let expected = "self_gravity: true in compute for an orbit about grains";
                return report.add_fault(&format!("{path}.about"), "grains do not attract each other", expected);
            }
            let mass = centre.mass + own.mass;
            (centre, mass)
        }
    };
    let mu = options.gravity_constant * mass; // m³/s²
    if let Some(expected) = orbit.path.invalid_value(mu) {
        let found = report.shown_text(&format!("{path}.path"));
        return report.add_fault(&format!("{path}.path"), found, expected);
    }
    let (relative_position, relative_velocity) = orbit.path.to_orbit(mu).position_and_velocity(0.0);
    let shift = centre.position + relative_position - own.position;
    let frame_spin: Vector3<f64> = options.fields.iter().map(|field| Vector3::from(field.rotation_rate())).sum();
    let velocity = centre.velocity + relative_velocity - frame_spin.cross(&relative_position);
    let are_polyhedra = scene.grains[group].is_polyhedral();
    for grain in grains {
        let moved = grain.position + shift;
        grain.position = if are_polyhedra { moved.map(round_14_columns) } else { round_point(&moved) };
        grain.velocity += velocity;
    }
}
