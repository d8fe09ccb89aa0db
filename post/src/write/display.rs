//! `DISPLAY/`: VTK files of polygonal data for ParaView, and the collections that give their times; or a VTKHDF file for
//! each kind, `KIND.vtkhdf`, with the same data at all times.
//!
//! Large files may be in pieces, `KIND-NNNNNN-part-KKKKKK.vtp`, which `KIND-NNNNNN.pvtp` names.
//!
//! | file | cells |
//! |---|---|
//! | `grains-NNNNNN.vtp` | a vertex a grain |
//! | `polyhedra-NNNNNN.vtp` | the faces of the grains that are polyhedra |
//! | `contacts-NNNNNN.vtp` | a line a contact |
//! | `walls-NNNNNN.vtp` | six quadrilaterals a plate, the faces of a driven polyhedron, cylinder or triangulated wall, a vertex a driven ball |
//!
//! `view.py` shows them all in ParaView.
//!
//! The arrays, with units, are in `docs/reference/observables/paraview.md`. The collections `grains.pvd`, `polyhedra.pvd`,
//! `contacts.pvd`, `walls.pvd` have the times, and so has the field data of each file.

use std::fmt::Write;
use std::path::Path;

use cd_formats::field::FieldModel;
use cd_formats::wall_mesh::triangle_of;
use vtkio::model::{Attribute, Attributes, DataArray, IOBuffer, PolyDataPiece, VertexNumbers};

use crate::derive::coordination::{contact_counts, neighbour_counts};
use crate::derive::energy::{KineticEnergy, external_fields};
use crate::derive::fabric::mobilised_share;
use crate::derive::fragments::{Fragment, fragment_numbers};
use crate::derive::motion::AggregateSums;
use crate::derive::stress::{grain_stresses, kinetic_stress, pressure};
use crate::frame::{ContactBody, Frame, Grain, WallId, WallShape};
use crate::math::{Mat3, Vec3};
use crate::write::fields::{self, IndexNames};
use crate::write::view::drawn_position;
use crate::write::vtp::vtp_text;

/// Kinds of files, each with its collection.
pub const FILE_KINDS: [&str; 4] = ["grains", "polyhedra", "contacts", "walls"];

/// `grains-000012.vtp`
pub fn file_name(kind: &str, step: u64) -> String {
    format!("{kind}-{step:06}.vtp")
}

/// `grains-000012.pvtp`
pub fn index_name(kind: &str, step: u64) -> String {
    format!("{kind}-{step:06}.pvtp")
}

/// `grains-000012-part-000003.vtp`; `number` counts from 0.
pub fn part_name(kind: &str, step: u64, number: usize) -> String {
    format!("{kind}-{step:06}-part-{number:06}.vtp")
}

/// `grains.vtkhdf`
pub fn vtkhdf_name(kind: &str) -> String {
    format!("{kind}.vtkhdf")
}

/// Whether this program writes a file of this name in `DISPLAY`.
pub fn is_display_file(name: &str) -> bool {
    FILE_KINDS.iter().any(|kind| {
        let rest = name.strip_prefix(kind).unwrap_or_default();
        let is_number = |digits: &str| digits.len() >= 6 && digits.bytes().all(|b| b.is_ascii_digit());
        let numbered = rest.strip_prefix('-').and_then(|rest| rest.split_once('.'));
        [".pvd", ".vtkhdf"].contains(&rest)
            || numbered.is_some_and(|(step, end)| match (step.split_once("-part-"), end) {
                (None, "vtp" | "pvtp") => is_number(step),
                (Some((step, part)), "vtp") => is_number(step) && is_number(part),
                _ => false,
            })
    })
}

/// Whether the frame has data of a kind: polyhedra or walls only if there are any, grains and contacts always, possibly none.
pub fn has_piece(frame: &Frame, kind: &str) -> bool {
    match kind {
        "polyhedra" => frame.grains.iter().any(|grain| grain.solid.is_some()),
        "walls" => !frame.walls.is_empty(),
        _ => true,
    }
}

/// Data of one kind, if there are any, see [`has_piece`]; `fragments`: all fragments of the frame.
pub fn display_piece(frame: &Frame, fragments: &[Fragment], kind: &str) -> Option<PolyDataPiece> {
    has_piece(frame, kind).then(|| match kind {
        "grains" => grains_piece(frame, fragments),
        "polyhedra" => polyhedra_piece(frame, fragments),
        "contacts" => contacts_piece(frame),
        _ => walls_piece(frame),
    })
}

/// The grains as points with their state, contact count and stress.
fn grains_piece(frame: &Frame, fragments: &[Fragment]) -> PolyDataPiece {
    let rows: Vec<usize> = (0..frame.grains.len()).collect();
    PolyDataPiece {
        points: written_points(frame, frame.grains.iter().map(|g| g.x)),
        verts: vertex_numbers(rows.iter().map(|&k| [k as u64])),
        data: Attributes { point: grain_arrays(frame, fragments, &rows), cell: vec![] },
        ..Default::default()
    }
}

/// The faces of the polyhedral grains; each has the arrays of its grain in [`grains_piece`].
fn polyhedra_piece(frame: &Frame, fragments: &[Fragment]) -> PolyDataPiece {
    let (mut points, mut faces, mut rows) = (vec![], vec![], vec![]);
    for (row, grain) in frame.grains.iter().enumerate() {
        let Some(solid) = &grain.solid else { continue };
        let first = points.len() as u64;
        let (vertices, polygons) = solid.drawn_mesh();
        points.extend(vertices.iter().map(|v| grain.x + grain.rotation * v));
        faces.extend(polygons.iter().map(|face| face.iter().map(|&k| first + u64::from(k)).collect::<Vec<u64>>()));
        rows.resize(faces.len(), row);
    }
    PolyDataPiece {
        points: written_points(frame, points.into_iter()),
        polys: vertex_numbers(faces.into_iter()),
        data: Attributes { point: vec![], cell: grain_arrays(frame, fragments, &rows) },
        ..Default::default()
    }
}

/// Arrays of the grains in `rows`.
fn grain_arrays(frame: &Frame, fragments: &[Fragment], rows: &[usize]) -> Vec<Attribute> {
    let grains: Vec<&Grain> = rows.iter().map(|&row| &frame.grains[row]).collect();
    let (stresses, contacts) = (grain_stresses(frame), contact_counts(frame));
    let (neighbours, fragments) = (neighbour_counts(frame), fragment_numbers(fragments, frame.grains.len()));
    let velocity = AggregateSums::from_grains(&frame.grains).velocity();
    let motion: Vec<Mat3> =
        grains.iter().map(|g| kinetic_stress(std::slice::from_ref(*g), velocity, g.volume())).collect();
    let stresses: Vec<Mat3> = rows.iter().map(|&row| stresses[row]).collect();
    let counts_of_rows = |counts: &[u32]| rows.iter().map(|&row| counts[row]).collect::<Vec<u32>>();
    let energy = |grain: &&Grain| KineticEnergy::of_grain(grain).total();
    let orientation = |grain: &&Grain| {
        let q = grain.rotation.quaternion();
        [q.w, q.i, q.j, q.k]
    };
    let numbers = |value: &dyn Fn(&&Grain) -> f64| grains.iter().map(value).collect::<Vec<f64>>();
    vec![
        scalar_attribute("radius", numbers(&|g| g.radius)),
        scalar_attribute("id", grains.iter().map(|g| g.id).collect::<Vec<u64>>()),
        vector_attribute("velocity", grains.iter().map(|g| frame.origin.written_velocity(g.v))),
        vector_attribute("spin", grains.iter().map(|g| g.w)),
        scalar_attribute("contacts", counts_of_rows(&contacts)),
        tensor_attribute("stress", &stresses),
        scalar_attribute("pressure", stresses.iter().map(pressure).collect::<Vec<f64>>()),
        scalar_attribute("material", grains.iter().map(|g| g.material).collect::<Vec<u16>>()),
        scalar_attribute("colour", grains.iter().map(|g| g.colour).collect::<Vec<u16>>()),
        scalar_attribute("mass", numbers(&|g| g.mass)),
        scalar_attribute("kinetic_energy", numbers(&|g| energy(g))),
        scalar_attribute("neighbours", counts_of_rows(&neighbours)),
        scalar_attribute("fragment", counts_of_rows(&fragments)),
        tensor_attribute("kinetic_stress", &motion),
        component_attribute("orientation", 4, grains.iter().flat_map(orientation).collect::<Vec<f64>>()),
        scalar_attribute("polyhedron", grains.iter().map(|g| u8::from(g.solid.is_some())).collect::<Vec<u8>>()),
    ]
}

/// Points and lines of the contacts: the grains in their order, then points on walls and the centres of images. Lines end
/// exactly at the grains of `grains-NNNNNN.vtp`; the candidate is first.
fn contact_lines(frame: &Frame) -> (Vec<Vec3>, Vec<[u64; 2]>) {
    let mut points: Vec<Vec3> = frame.grains.iter().map(|g| g.x).collect();
    let lines = frame
        .contacts
        .iter()
        .map(|contact| {
            // A contact of a wall with an image of a grain is drawn at the grain.
            let (image, wall_shift) = match contact.candidate {
                ContactBody::Grain(_) => (contact.image, Vec3::zeros()),
                ContactBody::Wall(_) => (Vec3::zeros(), contact.image),
            };
            let mut end = |body: ContactBody, image: Vec3| match body {
                ContactBody::Grain(grain) if image == Vec3::zeros() => grain.index() as u64,
                ContactBody::Grain(grain) => {
                    points.push(frame.grains[grain].x + image);
                    points.len() as u64 - 1
                }
                ContactBody::Wall(_) => {
                    points.push(contact.point - wall_shift);
                    points.len() as u64 - 1
                }
            };
            [end(contact.candidate, Vec3::zeros()), end(contact.antagonist, image)]
        })
        .collect();
    (points, lines)
}

/// The contacts as lines between the centres of two grains, or from a grain to the point on a wall.
fn contacts_piece(frame: &Frame) -> PolyDataPiece {
    let (points, lines) = contact_lines(frame);
    let id = |body: ContactBody| match body {
        ContactBody::Grain(grain) => frame.grains[grain].id,
        ContactBody::Wall(wall) => frame.walls[wall].id,
    };
    let (all, laws) = (&frame.contacts, &frame.laws);
    let cell = vec![
        scalar_attribute("normal_force", all.iter().map(|c| c.normal_force).collect::<Vec<f64>>()),
        scalar_attribute("tangential_force", all.iter().map(|c| c.tangential_force).collect::<Vec<f64>>()),
        vector_attribute("force", all.iter().map(|c| c.force)),
        scalar_attribute(
            "mobilised",
            all.iter().map(|c| mobilised_share(c, laws).unwrap_or(0.0)).collect::<Vec<f64>>(),
        ),
        scalar_attribute("gap", all.iter().map(|c| c.gap).collect::<Vec<f64>>()),
        scalar_attribute("status", all.iter().map(|c| c.status).collect::<Vec<u8>>()),
        scalar_attribute("active", all.iter().map(|c| u8::from(c.active)).collect::<Vec<u8>>()),
        scalar_attribute("bonded", all.iter().map(|c| u8::from(c.bonded)).collect::<Vec<u8>>()),
        scalar_attribute("law", all.iter().map(|c| c.law).collect::<Vec<u8>>()),
        scalar_attribute("candidate", all.iter().map(|c| id(c.candidate)).collect::<Vec<u64>>()),
        scalar_attribute("antagonist", all.iter().map(|c| id(c.antagonist)).collect::<Vec<u64>>()),
    ];
    PolyDataPiece {
        points: written_points(frame, points.into_iter()),
        lines: vertex_numbers(lines.into_iter()),
        data: Attributes { point: vec![], cell },
        ..Default::default()
    }
}

/// Faces of a box, outward, by corners; the bits of a corner's number are its sides along x, y and z.
const BOX_FACES: [[u64; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// Force of the grains on each wall, N, and its moment about the position of the wall, N m.
fn wall_loads(frame: &Frame) -> Vec<(Vec3, Vec3)> {
    let mut loads = vec![(Vec3::zeros(), Vec3::zeros()); frame.walls.len()];
    for contact in &frame.contacts {
        let sides =
            [(contact.candidate, contact.force, Vec3::zeros()), (contact.antagonist, -contact.force, contact.image)];
        for (body, force, image) in sides {
            if let ContactBody::Wall(wall) = body {
                let (total, moment) = &mut loads[wall.index()];
                *total += force;
                *moment += (contact.point - (frame.walls[wall].x + image)).cross(&force);
            }
        }
    }
    loads
}

/// Force of the grains on each triangle of a triangulated wall, N; a contact at an edge or corner acts on the lowest triangle
/// that has it.
fn triangle_forces(frame: &Frame, wall: usize, count: usize) -> Vec<Vec3> {
    let mut forces = vec![Vec3::zeros(); count];
    for contact in &frame.contacts {
        if contact.antagonist == ContactBody::Wall(WallId::new(wall))
            && let Some(force) = forces.get_mut(triangle_of(contact.antagonist_feature) as usize)
        {
            *force -= contact.force;
        }
    }
    forces
}

/// Angle (degrees) between the normal of a face and the direction against uniform gravity and the fields at the middle of its
/// first three corners; `None` where there is no acceleration.
fn face_slope(frame: &Frame, fields: &[FieldModel], corners: [Vec3; 3]) -> Option<f64> {
    let [a, b, c] = corners;
    let middle = (a + b + c) / 3.0;
    let from_fields: Vec3 = fields.iter().map(|field| field.acceleration_and_potential(&middle).0).sum();
    let up = (-(Vec3::from(frame.meta.parameters.uniform_gravity) + from_fields)).try_normalize(0.0)?;
    let normal = (b - a).cross(&(c - a));
    Some(normal.cross(&up).norm().atan2(normal.dot(&up)).to_degrees())
}

/// The walls: plates as boxes, driven polyhedra and triangulated walls by their faces, driven balls as points with a radius.
fn walls_piece(frame: &Frame) -> PolyDataPiece {
    let cell = frame.cell();
    let (mut points, mut radii, mut balls, mut faces) = (vec![], vec![], vec![], vec![]);
    // Walls of the cells.
    let (mut ball_walls, mut face_walls) = (vec![], vec![]);
    // Forces on the faces of triangulated walls, N, their pressures, Pa, and slopes, degrees; 0 of other walls.
    let (mut face_forces, mut face_pressures, mut face_slopes) = (vec![], vec![], vec![]);
    let fields = external_fields(frame);
    for (k, wall) in frame.walls.iter().enumerate() {
        let first = points.len() as u64;
        let x = drawn_position(wall, &cell);
        match &wall.shape {
            WallShape::Ball(radius) => {
                points.push(x);
                radii.push(*radius);
                balls.push([first]);
                ball_walls.push(k);
            }
            WallShape::Plate(half) => {
                for corner in 0..8 {
                    let sign = |axis: usize| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
                    let local = Vec3::from_fn(|axis, _| sign(axis) * half[axis]);
                    points.push(x + wall.rotation * local);
                    radii.push(0.0);
                }
                faces.extend(BOX_FACES.map(|face| face.map(|corner| first + corner).to_vec()));
                face_walls.extend([k; 6]);
            }
            WallShape::Polyhedron(solid) => {
                let (vertices, polygons) = solid.drawn_mesh();
                points.extend(vertices.iter().map(|v| x + wall.rotation * v));
                radii.resize(points.len(), 0.0);
                faces.extend(polygons.iter().map(|face| face.iter().map(|&k| first + u64::from(k)).collect()));
                face_walls.resize(faces.len(), k);
                if solid.is_mesh {
                    face_forces.resize(faces.len() - polygons.len(), Vec3::zeros());
                    face_pressures.resize(faces.len() - polygons.len(), 0.0);
                    face_slopes.resize(faces.len() - polygons.len(), Some(0.0));
                    for (face, force) in polygons.iter().zip(triangle_forces(frame, k, polygons.len())) {
                        let [a, b, c] = [0, 1, 2].map(|corner| vertices[face[corner] as usize]);
                        let doubled_area = wall.rotation * (b - a).cross(&(c - a));
                        face_forces.push(force);
                        face_slopes.push(face_slope(frame, &fields, [a, b, c].map(|v| x + wall.rotation * v)));
                        face_pressures.push(2.0 * force.dot(&doubled_area).abs() / doubled_area.norm_squared());
                    }
                }
            }
        }
    }
    // Cell data go in the order of VTK's cells: vertices, then polygons.
    let (ball_count, rows) = (ball_walls.len(), [ball_walls, face_walls].concat());
    let loads = wall_loads(frame);
    let mut cell_data = vec![
        scalar_attribute("id", rows.iter().map(|&k| frame.walls[k].id).collect::<Vec<u64>>()),
        vector_attribute("force", rows.iter().map(|&k| loads[k].0)),
        vector_attribute("moment", rows.iter().map(|&k| loads[k].1)),
    ];
    if !face_forces.is_empty() {
        face_forces.splice(0..0, vec![Vec3::zeros(); ball_count]);
        face_pressures.splice(0..0, vec![0.0; ball_count]);
        face_forces.resize(rows.len(), Vec3::zeros());
        face_pressures.resize(rows.len(), 0.0);
        cell_data.push(vector_attribute("face_force", face_forces.into_iter()));
        cell_data.push(scalar_attribute("face_pressure", face_pressures));
        if let Some(mut slopes) = face_slopes.into_iter().collect::<Option<Vec<f64>>>() {
            slopes.splice(0..0, vec![0.0; ball_count]);
            slopes.resize(rows.len(), 0.0);
            cell_data.push(scalar_attribute("face_slope", slopes));
        }
    }
    PolyDataPiece {
        points: written_points(frame, points.into_iter()),
        verts: vertex_numbers(balls.into_iter()),
        polys: vertex_numbers(faces.into_iter()),
        data: Attributes { point: vec![scalar_attribute("radius", radii)], cell: cell_data },
        ..Default::default()
    }
}

/// `view.py`: script that shows the files of this folder in ParaView, with names for materials, colours and laws. If the
/// name of the folder is not UTF-8, the script uses the folder in which ParaView is started.
pub fn view_script(folder: &Path, names: &IndexNames) -> String {
    // Python reads JSON text as the same strings and lists.
    let path = serde_json::to_string(folder.to_str().unwrap_or(".")).expect("a text");
    let names: std::collections::BTreeMap<&str, &[String]> = names.by_array().into_iter().collect();
    let names = serde_json::to_string(&names).expect("lists of texts");
    include_str!("view.py").replace("\"@FOLDER@\"", &path).replace("\"@NAMES@\"", &names)
}

/// A ParaView collection: the files of one kind, by name, with their times, s.
pub fn pvd_collection(files: &[(String, f64)]) -> String {
    let mut text = String::from(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n<Collection>\n",
    );
    for (file, time) in files {
        writeln!(text, "<DataSet timestep=\"{time:?}\" part=\"0\" file=\"{file}\"/>").expect("writing to a string");
    }
    text + "</Collection>\n</VTKFile>\n"
}

/// Attribute with a number for each point or cell.
pub(crate) fn scalar_attribute<T>(name: &str, values: Vec<T>) -> Attribute
where
    IOBuffer: From<Vec<T>>,
{
    component_attribute(name, 1, values)
}

/// Attribute with `count` numbers for each point or cell.
fn component_attribute<T>(name: &str, count: u32, values: Vec<T>) -> Attribute
where
    IOBuffer: From<Vec<T>>,
{
    Attribute::DataArray(DataArray::scalars(name, count).with_data(IOBuffer::from(values)))
}

/// Attribute with a vector for each point or cell.
pub(crate) fn vector_attribute(name: &str, values: impl Iterator<Item = Vec3>) -> Attribute {
    Attribute::DataArray(DataArray::vectors(name).with_data(IOBuffer::from(flat_components(values))))
}

/// Attribute of tensors, row by row.
fn tensor_attribute(name: &str, values: &[Mat3]) -> Attribute {
    let rows: Vec<f64> = values.iter().flat_map(|m| m.transpose().as_slice().to_vec()).collect();
    Attribute::DataArray(DataArray::tensors(name).with_data(IOBuffer::from(rows)))
}

/// Coordinates of points in the axes in which the frame is written.
fn written_points(frame: &Frame, points: impl Iterator<Item = Vec3>) -> IOBuffer {
    flat_components(points.map(|x| frame.origin.written_position(x))).into()
}

/// Components of vectors one after the other.
pub(crate) fn flat_components(vectors: impl Iterator<Item = Vec3>) -> Vec<f64> {
    vectors.flat_map(|v| [v.x, v.y, v.z]).collect()
}

/// Vertices of cells in VTK's form: all numbers, and the end of each cell among them.
pub(crate) fn vertex_numbers<C: AsRef<[u64]>>(cells: impl Iterator<Item = C>) -> Option<VertexNumbers> {
    let (mut connectivity, mut offsets) = (Vec::new(), Vec::new());
    for cell in cells {
        connectivity.extend_from_slice(cell.as_ref());
        offsets.push(connectivity.len() as u64);
    }
    Some(VertexNumbers::XML { connectivity, offsets })
}

/// File of a kind at one time, with [field data](fields).
pub fn display_bytes(piece: PolyDataPiece, frame: &Frame) -> Vec<u8> {
    let arrays = piece.data.point.iter().chain(&piece.data.cell).filter_map(|attribute| match attribute {
        Attribute::DataArray(array) => Some(array.name.clone()),
        Attribute::Field { .. } => None,
    });
    let arrays: Vec<String> = arrays.collect();
    let fields = fields::field_data(frame, &arrays.iter().map(String::as_str).collect::<Vec<&str>>());
    vtp_text(&piece, &fields).into_bytes()
}

#[cfg(test)]
mod tests {
    #[cfg(unix)]
    use std::os::unix::ffi::OsStrExt;

    use cd_formats::snapshot::DRIVEN_ALL;
    use cd_formats::wall_mesh::feature_of;

    use super::*;
    use crate::samples::Scene;
    use crate::shapes::SolidShape;

    #[test]
    fn an_empty_file_still_says_that_it_has_no_points() {
        let frame = Scene::default().frame();
        let pieces =
            [grains_piece(&frame, &[]), polyhedra_piece(&frame, &[]), contacts_piece(&frame), walls_piece(&frame)];
        for piece in pieces {
            let text = vtp_text(&piece, "");
            assert_eq!(text.matches("NumberOfPoints=\"0\"").count(), 1, "{text}");
        }
    }

    #[test]
    fn only_files_of_this_program_are_its_own() {
        let ours = [
            "grains-000012.vtp",
            "walls-1234567.vtp",
            "contacts.pvd",
            "walls.vtkhdf",
            "grains-000012.pvtp",
            "grains-000012-part-000003.vtp",
        ];
        let others = [
            "grains.vtp",
            "grains-12.vtp",
            "grains-a00012.vtp",
            "view.pvsm",
            "grains-000012.vtu",
            "grains-000012-part-3.vtp",
            "grains-000012-part-000003.pvtp",
            "my.pvd",
            "my.vtkhdf",
        ];
        assert!(ours.into_iter().all(is_display_file) && !others.into_iter().any(is_display_file));
    }

    #[test]
    fn what_is_driven_beyond_the_cell_is_drawn_in_it() {
        // A ball and a short plate, in the cell and three periods beyond; a plate that spans the cell stays where it is.
        let frame = |periods: f64| {
            let mut scene = Scene::default();
            scene.snapshot.meta.parameters.xperiode = Some(2.0);
            let grain = scene.grain([0.9, 0.0, 0.0], 0.5);
            let ball = scene.grain([-0.6 + 2.0 * periods, 0.0, 0.0], 0.5);
            scene.snapshot.bodies.body_driven[ball] = DRIVEN_ALL;
            scene.plate([0.5 + 2.0 * periods, 0.0, 3.0], [0.2, 5.0, 0.1]);
            scene.contact_at(ball, grain, [-0.85 + 2.0 * periods, 0.0, 0.0], Vec3::x());
            scene.frame()
        };
        let [inside, beyond] = [0.0, 3.0].map(frame);
        // Rounding of a sum of periods.
        let near = |a: &Vec3, b: &Vec3| (a - b).norm() < 1e-14;
        for (wall, other) in inside.walls.iter().zip(&beyond.walls) {
            assert!(
                near(&drawn_position(other, &beyond.cell()), &wall.x) && drawn_position(wall, &inside.cell()) == wall.x
            );
        }
        let mut long = beyond.walls[1].clone();
        long.shape = WallShape::Plate(Vec3::new(1.0, 5.0, 0.1));
        assert_eq!(drawn_position(&long, &beyond.cell()), long.x);
        // The line of the contact ends at the image of the ball that touches, not at the ball that is drawn.
        for frame in [inside, beyond] {
            let (points, lines) = contact_lines(&frame);
            let [ball, grain] = lines[0].map(|k| points[k as usize]);
            assert!(near(&ball, &Vec3::new(1.15, 0.0, 0.0)) && grain == frame.grains[0].x, "{ball} {grain}");
        }
    }

    #[test]
    fn walls_have_the_forces_of_the_grains() {
        // Two grains push a plate by 2 N and 3 N, 1 m and -2 m along x from its centre; the plate is the candidate of a
        // third contact, which pulls it up by 1 N above its centre.
        let mut scene = Scene::default();
        let floor = scene.plate([10.0, 0.0, -0.1], [5.0, 5.0, 0.1]);
        let grains = [11.0, 8.0, 10.0].map(|x| scene.grain([x, 0.0, 1.0], 1.0));
        scene.contact_at(grains[0], floor, [11.0, 0.0, 0.0], Vec3::new(0.0, 0.0, 2.0));
        scene.contact_at(grains[1], floor, [8.0, 0.0, 0.0], Vec3::new(0.0, 0.0, 3.0));
        scene.contact_at(floor, grains[2], [10.0, 0.0, 0.0], Vec3::new(0.0, 0.0, 1.0));
        let frame = scene.frame();
        // The moment of -2 N at 1 m is +2 N m about y, that of -3 N at -2 m is -6 N m.
        assert_eq!(wall_loads(&frame), [(Vec3::new(0.0, 0.0, -4.0), Vec3::new(0.0, -4.0, 0.0))]);
        let total: Vec3 = frame.contacts.iter().flat_map(|c| c.on_grains()).map(|(_, force, _)| force).sum();
        assert_eq!(total, Vec3::new(0.0, 0.0, 4.0));
    }

    #[test]
    fn triangles_have_the_forces_of_the_grains_on_them() {
        // Two triangles of 2 m by 1 m and a plate: 2 N across the face of the second triangle, 3 N on its edge, 5 N on the plate.
        let mut scene = Scene::default();
        let walls = [0.0, 9.0].map(|x| scene.plate([x, 0.0, 0.0], [1.0, 1.0, 0.1]));
        let grains = [0.0, 0.5, 9.0].map(|x| scene.grain([x, 0.0, 1.0], 1.0));
        for (k, (wall, force)) in [(walls[0], 2.0), (walls[0], 3.0), (walls[1], 5.0)].into_iter().enumerate() {
            scene.contact_at(grains[k], wall, [0.0; 3], Vec3::new(0.0, 0.0, force));
        }
        let mut frame = scene.frame();
        let vertices = vec![Vec3::zeros(), Vec3::x() * 2.0, Vec3::new(2.0, 1.0, 0.0), Vec3::y()];
        let faces = vec![vec![0, 1, 2], vec![0, 2, 3]];
        let mesh = SolidShape { vertices, faces, is_mesh: true, ..SolidShape::default() };
        frame.walls[0].shape = WallShape::Polyhedron(mesh.into());
        frame.contacts[0].antagonist_feature = feature_of(1, 0);
        frame.contacts[1].antagonist_feature = feature_of(1, 2);
        let down = |force: f64| Vec3::new(0.0, 0.0, -force);
        assert_eq!(triangle_forces(&frame, 0, 2), [Vec3::zeros(), down(5.0)]);
        let cells = walls_piece(&frame).data.cell;
        let values = |name: &str| {
            let array = cells.iter().find_map(|attribute| match attribute {
                Attribute::DataArray(array) if array.name == name => array.data.clone().into_vec::<f64>(),
                _ => None,
            });
            array.unwrap()
        };
        // Two triangles of the mesh, then six faces of the plate, which have the force on the whole wall alone.
        let forces = values("face_force");
        assert_eq!((forces.len(), &forces[3..6]), (24, &[0.0, 0.0, -5.0][..]));
        assert!(forces[..3].iter().chain(&forces[6..]).all(|force| *force == 0.0));
        assert_eq!(values("face_pressure")[..2], [0.0, 5.0]);
        // The faces look up: without gravity they have no slope, with gravity along x and -z one of 45 degrees.
        let is_slope =
            |attribute: &Attribute| matches!(attribute, Attribute::DataArray(array) if array.name == "face_slope");
        assert!(!cells.iter().any(is_slope));
        frame.meta.parameters.uniform_gravity = [1.0, 0.0, -1.0];
        let cells = walls_piece(&frame).data.cell;
        let slopes = cells.iter().find_map(|attribute| match attribute {
            Attribute::DataArray(array) if array.name == "face_slope" => array.data.clone().into_vec::<f64>(),
            _ => None,
        });
        let slopes = slopes.unwrap();
        assert!(slopes[..2].iter().all(|slope| (slope - 45.0).abs() < 1e-12) && slopes[2..] == [0.0; 6]);
    }

    #[test]
    fn python_reads_the_path_of_any_folder() {
        let names = IndexNames::from_frame(&Scene::default().frame());
        let script = view_script(Path::new("/a"), &names);
        assert!(
            script.contains(r#"NAMES = {"colour":["BLUEx","REDxx"],"law":["iqsc0 IQS_CLB"],"material":["ROCKx"]}"#),
            "{script}"
        );
        for (folder, text) in
            [("/a/cafe\u{301}\u{ad}", "\"/a/cafe\u{301}\u{ad}\""), ("/a\"b\\c\n", "\"/a\\\"b\\\\c\\n\"")]
        {
            assert!(view_script(Path::new(folder), &names).contains(&format!(" else {text}\n")), "{folder}");
        }
        #[cfg(unix)]
        {
            let nameless = std::ffi::OsStr::from_bytes(b"/a/bad\xff");
            assert!(view_script(Path::new(nameless), &names).contains(" else \".\"\n"));
        }
    }

    #[test]
    fn faces_of_a_plate_point_outward_and_share_its_corners() {
        let corner = |k: u64| Vec3::from_fn(|axis, _| if k >> axis & 1 == 0 { -1.0 } else { 1.0 });
        let mut uses = [0; 8];
        for face in BOX_FACES {
            let [a, b, c, d] = face.map(corner);
            assert!((b - a).cross(&(c - b)).dot(&(a + b + c + d)) > 0.0);
            assert_eq!(a + c, b + d); // a parallelogram, its corners in turn
            face.iter().for_each(|k| uses[*k as usize] += 1);
        }
        assert_eq!(uses, [3; 8]);
    }
}
