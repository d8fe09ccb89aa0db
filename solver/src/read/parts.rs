//! A record of BODIES.DAT to a body: its contactors, mass, centre and principal axes.

use cd_formats::bodies::{self, Contactor, LocalFrame};
use cd_formats::bulk_behav::BulkBehav;
use cd_formats::mass::Inert;
use cd_formats::surface::{MassProperties, Surface};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};

use crate::geometry::Polyhedron;
use crate::math::{Quat, Vec3};
use crate::scene::{Body, Geometry, Part, Shape};

/// A body as it is computed, and where it stands in the frame of the file.
pub struct Made {
    pub body: Body,
    /// Its contactors; `body` and `class` are not set yet.
    pub parts: Vec<Part>,
    /// From the position in the file to the centre of mass, m.
    pub shift: Vec3,
    /// Body to world where DOF.INI does not say it.
    pub axes: Quat,
}

/// What stands there and what was expected.
pub type Refusal = (String, String);

/// A contactor with what its mass would be at density 1.
struct Piece {
    geometry: Geometry,
    /// In the frame of the file.
    centre: Vec3,
    axes: Quat,
    radius: f64,
    /// In the frame of the file.
    mass: MassProperties,
    colour: u16,
}

pub fn make(record: &bodies::Body, bulk: &BulkBehav, colours: &mut Vec<String>) -> Result<Made, Refusal> {
    let Some(material) = bulk.materials.iter().position(|m| m.name == record.material) else {
        let names: Vec<&str> = bulk.materials.iter().map(|m| m.name.as_str()).collect();
        return Err((
            format!("material '{}' is not defined", record.material),
            if names.is_empty() { "none is defined".into() } else { format!("defined are {}", names.join(", ")) },
        ));
    };
    let density = bulk.materials[material].density;
    if density <= 0.0 {
        return Err((
            format!("material '{}' has the density {density}", record.material),
            "expected more than 0".into(),
        ));
    }
    let mut pieces = record.contactors.iter().map(|c| piece(c, colours)).collect::<Result<Vec<_>, _>>()?;
    let lone = pieces.len() == 1;
    let avrd = record.equivalent_radius;
    if let (true, Geometry::Sphere { radius }) = (lone, &pieces[0].geometry) {
        // The files hold 7 or 8 digits.
        if avrd != 0.0 && (avrd - radius).abs() > 1e-6 * radius {
            let expected =
                format!("expected 0 or the contactor's radius {radius}: a sphere's mass follows from its own size");
            return Err((format!("avrd {avrd}"), expected));
        }
    }
    let simple = lone && !matches!(pieces[0].geometry, Geometry::Polyhedron(_));

    // Where the centre of mass is, in the frame of the file.
    let of_pieces: Vec<MassProperties> = pieces.iter().map(|piece| piece.mass).collect();
    let own = MassProperties::together(&of_pieces);
    let off_centre = matches!(record.contactors[0].shape, bodies::Shape::OffsetSphere { .. });
    let shift = Vec3::from(record.shift(&own));
    pieces.iter_mut().for_each(|piece| piece.centre -= shift);
    let axes = match record.inertia {
        // Of a lone sphere, plate or cylinder the axes are its own, so that its orientation keeps its meaning.
        _ if simple => pieces[0].axes,
        Some(inertia) if inertia != [0.0; 3] => Quat::identity(),
        _ => principal(&own),
    };
    let Inert { mass, inertia, radius } = record.inert(&own, density);
    let sound = |x: f64| x.is_finite() && x > 0.0;
    if !sound(mass) || !inertia.into_iter().all(sound) {
        let found =
            if sound(mass) { format!("principal inertia {inertia:?} kg m²") } else { format!("mass {mass} kg") };
        return Err((found, "expected mass and inertia above 0 that a number can hold".into()));
    }
    let [i, j, k] = inertia;
    if i + j < 0.999_999 * k || j + k < 0.999_999 * i || k + i < 0.999_999 * j {
        let found = format!("principal inertia {i:e}, {j:e}, {k:e} kg m²");
        return Err((found, "expected each to be at most the sum of the others, as every body has them".into()));
    }

    let shape = match &pieces[0].geometry {
        Geometry::Sphere { radius } if lone && !off_centre => Shape::Sphere { radius: *radius },
        Geometry::Plane { half_lengths, .. } if lone => Shape::Plane { half_lengths: *half_lengths },
        _ => Shape::Parts,
    };
    let body = Body {
        shape,
        radius,
        mass,
        inertia,
        driven: false,
        pushed: [true; 3],
        material: material as u16,
        colour: pieces[0].colour,
        class: 0,
    };
    let part = |(rank, piece): (usize, Piece)| Part {
        body: 0,
        rank: rank as u16,
        geometry: piece.geometry,
        offset: axes.inverse_transform_vector(&piece.centre),
        axes: axes.inverse() * piece.axes,
        radius: piece.radius,
        colour: piece.colour,
        class: 0,
    };
    Ok(Made { body, parts: pieces.into_iter().enumerate().map(part).collect(), shift, axes })
}

fn piece(contactor: &Contactor, colours: &mut Vec<String>) -> Result<Piece, Refusal> {
    let colour = colours.iter().position(|c| *c == contactor.colour).unwrap_or_else(|| {
        colours.push(contactor.colour.clone());
        colours.len() - 1
    }) as u16;
    let (centre, axes) = match &contactor.local_frame {
        Some(LocalFrame { axes, offset }) => {
            let columns = Matrix3::from_fn(|i, j| axes[j][i]);
            let turn = Rotation3::from_matrix_eps(&columns, 1e-15, 100, Rotation3::identity());
            let whole = *axes == [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            (Vec3::from(*offset), if whole { Quat::identity() } else { UnitQuaternion::from_rotation_matrix(&turn) })
        }
        None => (Vec3::zeros(), Quat::identity()),
    };
    let refuse = |fault: String| (format!("contactor POLYR: {fault}"), "expected a closed convex surface".into());
    let (geometry, centre, radius) = match &contactor.shape {
        bodies::Shape::Sphere { radius } => (Geometry::Sphere { radius: *radius }, centre, *radius),
        bodies::Shape::OffsetSphere { radius, offset } => {
            (Geometry::Sphere { radius: *radius }, Vec3::from(*offset), *radius)
        }
        bodies::Shape::Plane { half_lengths } => {
            let half_lengths = Vec3::from(*half_lengths);
            let geometry = Geometry::Plane { half_lengths, cuboid: Polyhedron::cuboid(&half_lengths) };
            (geometry, centre, half_lengths.norm())
        }
        bodies::Shape::Cylinder { half_height, radius, hollow } => {
            let (half_height, radius, hollow) = (*half_height, *radius, *hollow);
            (Geometry::Cylinder { half_height, radius, hollow }, centre, radius.hypot(half_height))
        }
        bodies::Shape::Polyhedron { vertices, triangles } => {
            let surface = Surface::new(vertices, triangles).map_err(|faults| refuse(faults.join("; ")))?;
            let mass = surface.mass_properties();
            let centre = Vec3::from(mass.centre);
            let local: Vec<Vec3> = surface.vertices().iter().map(|v| Vec3::from(*v) - centre).collect();
            let shape = Polyhedron::with_flatness(&local, surface.triangles(), Polyhedron::FLATNESS_OF_FILES)
                .map_err(refuse)?;
            let radius = shape.circumradius();
            return Ok(Piece { geometry: Geometry::Polyhedron(shape), centre, axes, radius, mass, colour });
        }
        bodies::Shape::Point { .. } => {
            return Err(("contactor PT3Dx".into(), "computed are SPHER, SPHEb, PLANx, POLYR, CYLND and DNLYC".into()));
        }
    };
    let mass = contactor.mass_properties().map_err(|faults| refuse(faults.join("; ")))?;
    Ok(Piece { geometry, centre, axes, radius, mass, colour })
}

/// Principal axes, of ascending moments.
fn principal(mass: &MassProperties) -> Quat {
    let (_, axes) = mass.principal();
    let columns = Matrix3::from_fn(|i, j| axes[j][i]);
    let turn = Rotation3::from_matrix_eps(&columns, 1e-15, 100, Rotation3::identity());
    UnitQuaternion::from_rotation_matrix(&turn)
}
