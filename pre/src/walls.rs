//! Walls of a scene as bodies, plates, cylinders and triangulated surfaces, and their overlaps with grains.

use std::path::Path;
use std::sync::Arc;

use cd_formats::bodies::{Body, Contactor, LocalFrame, ShapeRecord};
use cd_formats::deforming_cell::AxisControl;
use cd_formats::drv_dof::{Evolution as FileFunction, table_text};
use cd_formats::report::FaultReport;
use cd_formats::surface::MassProperties;
use cd_formats::wall_mesh::{MeshSides, OrientedTriangles, WallMesh, oriented_triangles};
use nalgebra::{Matrix3, Vector2, Vector3};

use crate::rotation::rotation_matrix;
use crate::rounding::{round_8_digits, round_point};
use crate::scene::{Revolution, SceneWall, TimeFunction, WallSide};
use crate::shapes::overlap::{ConvexPiece, deepest_overlap, overlap_depth};
use crate::shapes::read::{FileTriangles, read_triangles, report_file_faults};

/// Plate, cylinder or surface; numbers have the digits of the files.
#[derive(Debug, Clone, PartialEq)]
pub struct WallBody {
    /// Index of its wall in the scene, 0-based.
    pub wall: usize,
    pub material: String,
    pub colour: String,
    /// Centre, m.
    pub centre: Vector3<f64>,
    /// First and second axis and normal, or axis of the cylinder, as rows: orthonormal, right-handed.
    pub axes: Matrix3<f64>,
    /// [`ShapeRecord::Plane`], [`ShapeRecord::Cylinder`] or [`ShapeRecord::Mesh`].
    pub shape: ShapeRecord,
    /// Velocities along the fixed axes, m/s, and angular velocities about its own axes, rad/s.
    pub motion: [TimeFunction; 6],
    /// Forces along the fixed axes, N, and moments about its own axes, N m; each replaces a velocity.
    pub loads: [Option<TimeFunction>; 6],
    pub servos: WallServos,
}

/// Servos of a wall; by default none.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct WallServos {
    /// Fixed axis along which a pressure (Pa) acts, and the pressure, > 0 in the positive direction.
    pub pressure: Option<(usize, TimeFunction)>,
    /// Fixed axis along which a strain rate (1/s) moves a plate or cylinder.
    pub strain_rate: Option<(usize, TimeFunction)>,
    /// Point about which the wall turns, m.
    pub pivot: Option<[f64; 3]>,
    /// Axes (rows) of the body of a wall that turns freely, the third along the axis, through the pivot, about which it does so;
    /// [`WallBody::motion`] and [`WallBody::loads`] are about these.
    pub hinge_axes: Option<Matrix3<f64>>,
    /// Velocity of the surface, components as of [`WallBody::motion`].
    pub surface: [Option<TimeFunction>; 6],
    /// Control of the radius of a hollow cylinder.
    pub radius: Option<AxisControl>,
}

impl WallServos {
    /// Servos along the normal of a plate or the axis of a cylinder, the third row of `axes`.
    fn normal_servos(
        axes: &Matrix3<f64>,
        pressure: Option<&TimeFunction>,
        strain_rate: Option<&TimeFunction>,
    ) -> WallServos {
        let normal = axes.row(2);
        let component = normal.transpose().iamax();
        WallServos {
            pressure: pressure.map(|pressure| (component, pressure.scaled_by(normal[component].signum()))),
            strain_rate: strain_rate.map(|rate| (component, rate.clone())),
            ..WallServos::default()
        }
    }

    /// The servos with a velocity of the surface, as of a conveyor belt, m/s.
    fn with_surface_velocity(self, velocity: &[TimeFunction; 3]) -> WallServos {
        let [x, y, z] = velocity;
        let is_still = velocity.iter().all(|component| *component == TimeFunction::default());
        let surface = [Some(x), Some(y), Some(z), None, None, None].map(|component| component.cloned());
        if is_still { self } else { WallServos { surface, ..self } }
    }
}

impl WallBody {
    /// The wall with a rotation, if there is one: its angular velocities or, of a wall that turns freely, its moment replace those
    /// about its own axes.
    fn with_revolution(mut self, revolution: Option<&Revolution>) -> WallBody {
        let Some(Revolution { axis, point, rate, moment }) = revolution else { return self };
        let (axis, point) = (Vector3::from(*axis).normalize(), Vector3::from(*point));
        if let Some(moment) = moment {
            // The point of the axis next to the centre.
            let foot = round_point(&(point + axis * axis.dot(&(self.centre - point))));
            self.servos.pivot = Some(foot.into());
            self.servos.hinge_axes = Some(axes_about(&axis, None));
            self.loads[5] = Some(moment.clone());
        } else if let Some(rate) = rate {
            let own = self.axes * axis;
            (0..3).for_each(|k| self.motion[3 + k] = rate.scaled_by(own[k]));
            self.servos.pivot = Some(point.into());
        }
        self
    }

    /// Axes (rows) of its body, in which its motion is given: its own, but of a wall that turns freely about a pivot.
    pub fn body_axes(&self) -> &Matrix3<f64> {
        self.servos.hinge_axes.as_ref().unwrap_or(&self.axes)
    }

    /// Record of BODIES.DAT, with inertia at density 1. A wall that turns freely about a pivot has its position there, with the
    /// inertia about it.
    pub fn record(&self) -> Body {
        let mut contactors = vec![self.contactor()];
        let mut properties = self.mass_properties();
        let mut position = self.centre;
        if let (Some(axes), Some(pivot)) = (&self.servos.hinge_axes, self.servos.pivot) {
            position = pivot.into();
            let own_axes = [0, 1, 2].map(|k| (axes * self.axes.row(k).transpose()).into());
            let frame = LocalFrame { axes: own_axes, offset: (axes * (self.centre - position)).into() };
            contactors[0].local_frame = Some(Box::new(frame));
            // Only polyhedra can have no mass properties.
            properties = contactors[0].mass_properties().unwrap_or_default().moved_to([0.0; 3]);
            // A second contactor, so that the first keeps its frame.
            let shape = ShapeRecord::Point { offset: [0.0; 3] };
            contactors.push(Contactor { colour: self.colour.clone(), shape, local_frame: None });
        }
        Body {
            line: 0,
            material: self.material.clone(),
            equivalent_radius: libm::cbrt(0.75 * properties.volume / std::f64::consts::PI),
            inertia: Some([0, 1, 2].map(|k| properties.inertia[k][k])),
            position: position.into(),
            contactors,
        }
    }

    /// Contactor in BODIES.DAT.
    pub fn contactor(&self) -> Contactor {
        Contactor { colour: self.colour.clone(), shape: self.shape.clone(), local_frame: None }
    }

    /// Mass properties at density 1, about its own axes.
    pub fn mass_properties(&self) -> MassProperties {
        // Only polyhedra can have none.
        self.contactor().mass_properties().unwrap_or_default()
    }

    /// Distance of the farthest point of a plate or cylinder from its centre, m; none of a surface.
    pub fn bounding_radius(&self) -> Option<f64> {
        match self.shape {
            ShapeRecord::Plane { half_lengths } => Some(Vector3::from(half_lengths).norm()),
            ShapeRecord::Cylinder { half_height, radius, .. } => Some(libm::hypot(half_height, radius)),
            _ => None,
        }
    }

    /// Triangles of a surface in its own axes, m; none of other walls.
    pub fn triangles(&self) -> Vec<[Vector3<f64>; 3]> {
        let ShapeRecord::Mesh { surface: Some(mesh), .. } = &self.shape else { return Vec::new() };
        (0..mesh.triangles().len() as u32).map(|triangle| mesh.corners(triangle)).collect()
    }

    /// Penetration of a sphere into the wall, m, see [`ball_overlap`].
    pub fn ball_overlap(&self, centre: &Vector3<f64>, radius: f64) -> f64 {
        ball_overlap(&self.shape, &(self.axes * (centre - self.centre)), radius)
    }

    /// Whether a ball may overlap the wall: of a surface, whether the box around the ball meets triangles, or its centre is
    /// inside of a solid.
    pub fn may_overlap_ball(&self, centre: &Vector3<f64>, radius: f64) -> bool {
        let ShapeRecord::Mesh { surface: Some(ref mesh), .. } = self.shape else {
            return self.ball_overlap(centre, radius) > 0.0;
        };
        let (own, reach) = (self.axes * (centre - self.centre), Vector3::repeat(radius));
        !mesh.triangles_in_box(&(own - reach), &(own + reach)).is_empty() || depth_in_solid(mesh, &own).is_some()
    }

    /// Penetration of convex pieces into the wall translated by `shift`, m, see [`pieces_overlap`].
    pub fn pieces_overlap(&self, pieces: &[ConvexPiece], shift: &Vector3<f64>, allowed: f64) -> f64 {
        pieces_overlap(&self.shape, &(self.centre + shift), &self.axes, pieces, allowed)
    }
}

/// Penetration of convex pieces into a wall with the axes `axes` (rows), m; if the depth is at most `allowed`, any value up
/// to `allowed` may be returned.
pub fn pieces_overlap(
    wall: &ShapeRecord,
    centre: &Vector3<f64>,
    axes: &Matrix3<f64>,
    pieces: &[ConvexPiece],
    allowed: f64,
) -> f64 {
    match *wall {
        ShapeRecord::Plane { half_lengths } => {
            deepest_overlap(pieces, &[ConvexPiece::cuboid(*centre, axes, &half_lengths.into())], allowed)
        }
        ShapeRecord::Cylinder { half_height, radius, hollow } => {
            let penetration = |piece: &ConvexPiece| {
                if hollow {
                    // The inside is convex: no point is farther out than some vertex.
                    let vertices = piece.vertices().map(|v| axes * (v - centre));
                    vertices.map(|v| distance_beyond(&v, half_height, radius)).fold(f64::NEG_INFINITY, f64::max)
                } else {
                    piece.overlap_of_cylinder(centre, axes, [half_height, radius], allowed)
                }
            };
            pieces.iter().map(penetration).fold(0.0, f64::max)
        }
        ShapeRecord::Mesh { surface: Some(ref mesh), .. } => {
            let penetration = |piece: &ConvexPiece| surface_overlap(mesh, centre, axes, piece, allowed);
            pieces.iter().map(penetration).fold(0.0, f64::max)
        }
        _ => 0.0,
    }
}

/// Penetration of a convex piece into a surface as [`pieces_overlap`]: the deepest one into a triangle; of a piece that is
/// inside of a solid as a whole, the depth of its middle.
fn surface_overlap(
    mesh: &WallMesh,
    centre: &Vector3<f64>,
    axes: &Matrix3<f64>,
    piece: &ConvexPiece,
    allowed: f64,
) -> f64 {
    let own: Vec<Vector3<f64>> = piece.vertices().map(|vertex| axes * (vertex - centre)).collect();
    let (low, high) = own.iter().fold((own[0], own[0]), |(low, high), vertex| (low.inf(vertex), high.sup(vertex)));
    let depth_of = |triangle: u32| {
        let corners = mesh.corners(triangle);
        let heights = || own.iter().map(|vertex| mesh.normal(triangle).dot(&(vertex - corners[0])));
        let crosses_plane = heights().any(|height| height > allowed) && heights().any(|height| height < -allowed);
        if !crosses_plane {
            return 0.0;
        }
        let corners = corners.map(|corner| axes.tr_mul(&corner));
        overlap_depth(piece, &ConvexPiece::new(*centre, corners.to_vec(), &[[0, 1, 2], [0, 2, 1]]), allowed)
    };
    let deepest = mesh.triangles_in_box(&low, &high).into_iter().map(depth_of).fold(0.0, f64::max);
    if deepest > allowed {
        return deepest;
    }
    let middle = own.iter().sum::<Vector3<f64>>() / own.len() as f64;
    depth_in_solid(mesh, &middle).unwrap_or(deepest)
}

/// Depth of a point behind a surface that has one side and no rim, a solid or the walls of a container, m; `None` of others.
fn depth_in_solid(mesh: &WallMesh, point: &Vector3<f64>) -> Option<f64> {
    let is_solid = mesh.sides() == MeshSides::One && mesh.has_no_rim();
    is_solid.then(|| mesh.depth_behind(point)).flatten()
}

/// Penetration of a ball into a wall, m, its centre in the wall's own axes, m; negative when apart. For a centre within a
/// solid wall it is measured to the nearest face. A ball far from the inside of a hollow cylinder, or from a surface, is
/// apart from it.
pub fn ball_overlap(wall: &ShapeRecord, centre: &Vector3<f64>, radius: f64) -> f64 {
    match *wall {
        ShapeRecord::Mesh { surface: Some(ref mesh), .. } => {
            if let Some(depth) = depth_in_solid(mesh, centre) {
                return radius + depth;
            }
            let nearest = mesh.ball_contacts(centre, radius, 0.0);
            nearest.iter().map(|contact| radius - contact.distance).fold(f64::NEG_INFINITY, f64::max)
        }
        ShapeRecord::Plane { half_lengths } => {
            let beyond = centre.abs() - Vector3::from(half_lengths);
            radius - beyond.sup(&Vector3::zeros()).norm() - beyond.max().min(0.0)
        }
        ShapeRecord::Cylinder { half_height, radius: wall_radius, hollow: false } => {
            let beyond = Vector2::new(centre.xy().norm() - wall_radius, centre.z.abs() - half_height);
            radius - beyond.sup(&Vector2::zeros()).norm() - beyond.max().min(0.0)
        }
        ShapeRecord::Cylinder { half_height, radius: wall_radius, hollow: true }
            if centre.norm() - radius < libm::hypot(wall_radius, half_height) =>
        {
            radius + distance_beyond(centre, half_height, wall_radius)
        }
        _ => f64::NEG_INFINITY,
    }
}

/// Distance of a point beyond the side or the ends of a cylinder about the third axis, m; negative inside.
fn distance_beyond(point: &Vector3<f64>, half_height: f64, radius: f64) -> f64 {
    (point.xy().norm() - radius).max(point.z.abs() - half_height)
}

/// Bodies of the scene's (checked) walls, in order. Names of files are relative to `folder`; walls whose surfaces have faults
/// are left out, and the faults reported.
pub fn wall_bodies(walls: &[SceneWall], folder: &Path, report: &mut FaultReport) -> Vec<WallBody> {
    let mut bodies = Vec::new();
    for (k, wall) in walls.iter().enumerate() {
        match wall {
            SceneWall::Mesh { .. } => bodies.extend(mesh_body(k, wall, folder, report)),
            _ => bodies.extend(bodies_of_wall(k, wall)),
        }
    }
    bodies
}

/// Body of the surface with this index among the walls of the scene; `None` for other walls, and after a fault.
fn mesh_body(index: usize, wall: &SceneWall, folder: &Path, report: &mut FaultReport) -> Option<WallBody> {
    let SceneWall::Mesh {
        material,
        colour,
        file,
        scale,
        position,
        orientation,
        side,
        velocity,
        spin,
        revolution,
        surface_velocity,
    } = wall
    else {
        return None;
    };
    let path = folder.join(file);
    let read =
        read_triangles(&path).map_err(|faults| report_file_faults(faults, &format!("walls.{index}.file"), report));
    let FileTriangles { vertices, triangles, repairs } = read.ok()?.with_split_junctions();
    if !repairs.is_empty() {
        report.add_warning(&format!("walls.{index}.file"), repairs.join(", "), "is the surface as it should be?");
    }
    let vertices: Vec<[f64; 3]> = vertices.iter().map(|vertex| vertex.map(|x| scale * x)).collect();
    let OrientedTriangles { triangles: oriented, is_closed, is_orientable } = oriented_triangles(&vertices, &triangles);
    let side = side.unwrap_or(if is_closed && is_orientable { WallSide::Front } else { WallSide::Both });
    let (sides, triangles) = match side {
        WallSide::Both => (MeshSides::Both, triangles),
        WallSide::Front => (MeshSides::One, oriented),
        WallSide::Back => (MeshSides::One, oriented.into_iter().map(|[a, b, c]| [a, c, b]).collect()),
    };
    let mesh = match WallMesh::new(&vertices, &triangles, sides) {
        Ok(mesh) => mesh,
        Err(faults) => {
            for fault in faults.0.iter().take(MAX_PRINTED_FAULTS) {
                report.faults.push(fault.file_fault(&path));
            }
            return None;
        }
    };
    let rows = rotation_matrix(orientation).transpose().add_scalar(0.0); // no negative zeros
    let [[vx, vy, vz], [wx, wy, wz]] = [velocity.clone(), spin.clone()];
    let motion = [vx, vy, vz, wx, wy, wz];
    let servos = WallServos::default().with_surface_velocity(surface_velocity);
    let body = WallBody {
        wall: index,
        material: material.clone(),
        colour: colour.clone(),
        centre: round_point(&(*position).into()),
        axes: rows,
        shape: ShapeRecord::Mesh {
            radius: round_8_digits(mesh.radius()),
            sides,
            file: file.as_str().into(),
            surface: Some(Arc::new(mesh)),
        },
        motion,
        loads: Default::default(),
        servos,
    };
    Some(body.with_revolution(revolution.as_deref()))
}

/// Number of faults of one surface that are printed one by one; a broken surface has thousands of the same kind.
const MAX_PRINTED_FAULTS: usize = 5;

/// Bodies of the wall with this index in the scene: one, or the plates of a box; none of a surface, see [`mesh_body`].
fn bodies_of_wall(index: usize, wall: &SceneWall) -> Vec<WallBody> {
    match wall {
        SceneWall::Mesh { .. } => Vec::new(),
        SceneWall::Plate {
            material,
            colour,
            centre,
            normal,
            first_axis,
            half_lengths,
            velocity,
            force,
            spin,
            moment,
            pressure,
            strain_rate,
            revolution,
            surface_velocity,
        } => {
            let ([vx, vy, vz], [wx, wy, wz]) = (velocity.clone(), spin.clone());
            let ([fx, fy, fz], [mx, my, mz]) = (*force.clone(), *moment.clone());
            let axes = axes_about(&(*normal).into(), first_axis.map(Vector3::from));
            let motion = [vx, vy, vz, wx, wy, wz];
            let servos = WallServos::normal_servos(&axes, pressure.as_deref(), strain_rate.as_deref())
                .with_surface_velocity(surface_velocity);
            let body = WallBody {
                wall: index,
                material: material.clone(),
                colour: colour.clone(),
                centre: round_point(&(*centre).into()),
                axes,
                shape: ShapeRecord::Plane { half_lengths: round_point(&(*half_lengths).into()).into() },
                motion,
                loads: [fx, fy, fz, mx, my, mz],
                servos,
            };
            vec![body.with_revolution(revolution.as_deref())]
        }
        SceneWall::Cylinder {
            material,
            colour,
            centre,
            axis,
            half_height,
            radius,
            hollow,
            velocity,
            force,
            spin,
            moment,
            pressure,
            strain_rate,
            revolution,
            surface_spin,
            radial,
            ends: _,
        } => {
            let [vx, vy, vz] = velocity.clone();
            let [fx, fy, fz] = *force.clone();
            let axes = axes_about(&(*axis).into(), None);
            let motion = [vx, vy, vz, TimeFunction::default(), TimeFunction::default(), spin.clone()];
            let mut servos = WallServos::normal_servos(&axes, pressure.as_deref(), strain_rate.as_deref());
            servos.radius = *radial;
            servos.surface[5] = Some(surface_spin.clone()).filter(|spin| *spin != TimeFunction::default());
            let body = WallBody {
                wall: index,
                material: material.clone(),
                colour: colour.clone(),
                centre: round_point(&(*centre).into()),
                axes,
                shape: ShapeRecord::Cylinder {
                    half_height: round_8_digits(*half_height),
                    radius: round_8_digits(*radius),
                    hollow: *hollow,
                },
                motion,
                loads: [fx, fy, fz, None, None, moment.clone()],
                servos,
            };
            vec![body.with_revolution(revolution.as_deref())]
        }
        SceneWall::Box { material, colour, centre, lengths, orientation, half_thickness, lid, velocity } => {
            let rotation = rotation_matrix(orientation);
            let half_lengths = 0.5 * Vector3::from(*lengths);
            // Floor, four sides, lid: axis and sign of the direction of each from the centre of the box.
            let mut sides = vec![(2, -1.0), (0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0)];
            sides.extend(lid.then_some((2, 1.0)));
            let plate = |(axis, sign): (usize, f64)| {
                let unit = |k: usize| Vector3::from_fn(|row, _| if row == k { 1.0 } else { 0.0 });
                let (first, second) = ((axis + 1) % 3, (axis + 2) % 3);
                // The normal points into the box; flipping it flips the second axis too.
                let local = [unit(first), -sign * unit(second), -sign * unit(axis)];
                let rows = local.map(|axis| (rotation * axis).add_scalar(0.0).transpose()); // no negative zeros
                // Plates overlap along the edges of the box, so that no grain slips through there.
                let plate_half_length = |k: usize| half_lengths[k] + 2.0 * half_thickness;
                let [vx, vy, vz] = velocity.clone();
                let offset = sign * (half_lengths[axis] + half_thickness) * unit(axis);
                WallBody {
                    wall: index,
                    material: material.clone(),
                    colour: colour.clone(),
                    centre: round_point(&(Vector3::from(*centre) + rotation * offset)),
                    axes: Matrix3::from_rows(&rows),
                    shape: ShapeRecord::Plane {
                        half_lengths: round_point(&Vector3::new(
                            plate_half_length(first),
                            plate_half_length(second),
                            *half_thickness,
                        ))
                        .into(),
                    },
                    motion: [vx, vy, vz, TimeFunction::default(), TimeFunction::default(), TimeFunction::default()],
                    loads: Default::default(),
                    servos: WallServos::default(),
                }
            };
            sides.into_iter().map(plate).collect()
        }
    }
}

/// Right-handed axes with `normal` as the third. The first is `first` made perpendicular to it, or an arbitrary one.
fn axes_about(normal: &Vector3<f64>, first: Option<Vector3<f64>>) -> Matrix3<f64> {
    let n = normal.normalize();
    // Default: the fixed axis that is most nearly perpendicular to the normal.
    let first = first.unwrap_or_else(|| Vector3::from_fn(|k, _| if k == n.iamin() { 1.0 } else { 0.0 }));
    let t = (first - n * n.dot(&first)).normalize();
    Matrix3::from_rows(&[t.transpose(), n.cross(&t).transpose(), n.transpose()])
}

/// Different tables of the functions of time of a scene, which DRV_DOF.DAT names as files.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FunctionTables(Vec<Vec<[f64; 2]>>);

impl FunctionTables {
    /// Converts a function; a table that is not known yet is added to the tables.
    pub fn add_function(&mut self, evolution: &TimeFunction) -> FileFunction {
        match evolution {
            TimeFunction::Constant(value) => FileFunction::constant(*value),
            &TimeFunction::Harmonic { constant, amplitude, omega, phase, ramp_start, ramp_rate } => {
                let ramp_start = ramp_start.unwrap_or(if ramp_rate > 0.0 { 0.0 } else { 1.0 });
                FileFunction::Harmonic { constant, amplitude, omega, phase, ramp_start, ramp_rate }
            }
            TimeFunction::Table(points) => {
                let points: Vec<[f64; 2]> = points.iter().map(|&(t, v)| [t, v]).collect();
                let index = self.0.iter().position(|known| *known == points).unwrap_or_else(|| {
                    self.0.push(points.clone());
                    self.0.len() - 1
                });
                FileFunction::Table { name: table_name(index), points }
            }
        }
    }

    /// Name and text of each table's file.
    pub fn table_files(&self) -> Vec<(String, String)> {
        self.0.iter().enumerate().map(|(k, points)| (table_name(k), table_text(points))).collect()
    }
}

/// Name of the file of a table by its index.
fn table_name(index: usize) -> String {
    format!("evolution-{}.dat", index + 1)
}

impl TimeFunction {
    /// Function with values `factor` times as large; 0 stays without sign.
    fn scaled_by(&self, factor: f64) -> TimeFunction {
        let scaled_value = |value: f64| value * factor + 0.0;
        match self {
            TimeFunction::Constant(value) => TimeFunction::Constant(scaled_value(*value)),
            &TimeFunction::Harmonic { constant, amplitude, omega, phase, ramp_start, ramp_rate } => {
                let (constant, amplitude) = (scaled_value(constant), scaled_value(amplitude));
                TimeFunction::Harmonic { constant, amplitude, omega, phase, ramp_start, ramp_rate }
            }
            TimeFunction::Table(points) => {
                TimeFunction::Table(points.iter().map(|&(t, v)| (t, scaled_value(v))).collect())
            }
        }
    }

    /// Value at time 0.
    pub fn initial_value(&self) -> f64 {
        match self {
            TimeFunction::Constant(value) => round_8_digits(*value),
            _ => FunctionTables::default().add_function(self).value_at(0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Rotation;

    fn wall_bodies(walls: &[SceneWall]) -> Vec<WallBody> {
        super::wall_bodies(walls, Path::new(""), &mut FaultReport::new(Path::new("scene.ron"), ""))
    }

    fn box_walls(lid: bool, orientation: Rotation) -> Vec<WallBody> {
        wall_bodies(&[SceneWall::Box {
            material: "STEEL".into(),
            colour: "WALLx".into(),
            centre: [1.0, 2.0, 3.0],
            lengths: [4.0, 6.0, 8.0],
            orientation,
            half_thickness: 0.5,
            lid,
            velocity: Default::default(),
        }])
    }

    #[test]
    fn a_box_touches_the_ball_that_fills_it() {
        assert_eq!(box_walls(false, Rotation::default()).len(), 5);
        for angle in [0.0, 0.3] {
            let plates = box_walls(true, Rotation { axis: [1.0, 1.0, 0.0], angle });
            assert_eq!(plates.len(), 6);
            let centre = Vector3::new(1.0, 2.0, 3.0);
            let mut gaps: Vec<f64> = plates.iter().map(|plate| -plate.ball_overlap(&centre, 2.0)).collect();
            gaps.sort_by(f64::total_cmp);
            for (gap, expected) in gaps.iter().zip([0.0, 0.0, 1.0, 1.0, 2.0, 2.0]) {
                assert!((gap - expected).abs() < 1e-6, "{gap} {expected}"); // 8 digits
            }
            for plate in plates {
                let square = plate.axes * plate.axes.transpose();
                assert!((square - Matrix3::identity()).abs().max() < 1e-15 * 4.0);
                assert!((plate.axes.determinant() - 1.0).abs() < 1e-14); // right-handed
                assert!((plate.axes * (centre - plate.centre))[2] > 0.0); // its normal points inwards
            }
        }
    }

    fn cylinder(hollow: bool) -> WallBody {
        let [wall] = wall_bodies(&[SceneWall::Cylinder {
            material: "STEEL".into(),
            colour: "WALLx".into(),
            centre: [1.0, 2.0, 3.0],
            axis: [0.0, 5.0, 0.0],
            half_height: 2.0,
            radius: 3.0,
            hollow,
            velocity: Default::default(),
            force: Default::default(),
            spin: TimeFunction::Constant(0.5),
            moment: None,
            pressure: None,
            strain_rate: None,
            revolution: None,
            surface_spin: TimeFunction::default(),
            radial: None,
            ends: None,
        }])
        .try_into()
        .unwrap();
        wall
    }

    #[test]
    fn a_cylinder_stands_along_its_axis_and_turns_about_it() {
        let drum = cylinder(true);
        assert_eq!(drum.motion[5], TimeFunction::Constant(0.5));
        // Penetration into the solid and into the hollow cylinder; the last point is past the rim of both.
        for (x, r, solid, hollow) in [
            ([1.0, 2.0, 3.0], 1.0, 3.0, -1.0),
            ([4.5, 2.0, 3.0], 1.0, 0.5, 1.5),
            ([1.0, 3.5, 3.0], 0.75, 1.25, 0.25),
            ([5.0, 5.0, 3.0], 0.5, 0.5 - 2f64.sqrt(), f64::NEG_INFINITY),
        ] {
            let found = [cylinder(false), drum.clone()].map(|wall| wall.ball_overlap(&x.into(), r));
            assert!((found[0] - solid).abs() < 1e-14, "{x:?} {found:?}");
            assert!(found[1] == hollow || (found[1] - hollow).abs() < 1e-14, "{x:?} {found:?}");
        }
        let mass = drum.mass_properties();
        let volume = 36.0 * std::f64::consts::PI;
        assert!((mass.volume / volume - 1.0).abs() < 1e-15 && (mass.inertia[2][2] / volume - 4.5).abs() < 1e-14);
    }

    /// A cube within a drum: the farthest corner counts.
    #[test]
    fn cubes_in_a_drum() {
        let drum = cylinder(true);
        let deep = |x: f64, y: f64| {
            let cube =
                ConvexPiece::cuboid(Vector3::new(1.0 + x, 2.0 + y, 3.0), &Matrix3::identity(), &Vector3::repeat(0.5));
            drum.pieces_overlap(&[cube], &Vector3::zeros(), 0.0)
        };
        assert_eq!(deep(0.0, 1.5), 0.0);
        assert!((deep(2.5, 0.0) - (3f64.hypot(0.5) - 3.0)).abs() < 1e-14);
        assert!((deep(0.0, 1.75) - 0.25).abs() < 1e-14);
    }

    /// Walls of OBJ files with the other fields of a `Mesh` in `fields`; and the faults.
    fn mesh_walls(text: &str, fields: &str) -> (Vec<WallBody>, String) {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("wall.obj"), text).unwrap();
        let wall = format!("Mesh(material: \"STEEL\", colour: \"WALLx\", file: \"wall.obj\"{fields})");
        let wall: SceneWall = cd_formats::ron_file::from_ron(Path::new("scene.ron"), &wall, "wall").unwrap();
        let mut report = FaultReport::new(Path::new("scene.ron"), "");
        let walls = super::wall_bodies(&[wall], folder.path(), &mut report);
        (walls, report.faults.to_string())
    }

    const TETRAHEDRON: &str = "v 0 0 0\nv 3 0 0\nv 0 3 0\nv 0 0 3\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n";

    #[test]
    fn the_side_of_a_surface_follows_from_its_kind() {
        let open = TETRAHEDRON.strip_suffix("f 2 3 4\n").unwrap();
        let strip = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 1\nv 0 0 2\nf 1 2 3\nf 2 3 4\nf 3 4 5\nf 4 5 1\nf 5 1 2\n";
        for (text, fields, sides) in [
            (TETRAHEDRON, "", MeshSides::One),
            (TETRAHEDRON, ", side: Both", MeshSides::Both),
            (open, "", MeshSides::Both),
            (open, ", side: Front", MeshSides::One),
            (strip, "", MeshSides::Both),
        ] {
            let (walls, faults) = mesh_walls(text, fields);
            let [WallBody { shape: ShapeRecord::Mesh { sides: found, .. }, .. }] = &walls[..] else {
                panic!("{fields} {faults}")
            };
            assert_eq!(*found, sides, "{fields}");
        }
        // A strip of five triangles is a Moebius strip.
        let (walls, faults) = mesh_walls(strip, ", side: Front");
        assert!(walls.is_empty() && faults.contains("seen from different sides"), "{faults}");
        let (walls, faults) = mesh_walls("v 0 0 0\nv 1 0\nf 1 2 1\n", "");
        assert!(walls.is_empty() && faults.contains("wall.obj:2"), "{faults}");
    }

    #[test]
    fn balls_overlap_surfaces_on_the_side_that_pushes() {
        let ball_overlap =
            |fields: &str, x: [f64; 3]| mesh_walls(TETRAHEDRON, fields).0[0].ball_overlap(&x.into(), 0.5);
        // 0.25 m above the face x = 0, on its outside.
        assert_eq!(ball_overlap("", [-0.25, 0.5, 0.5]), 0.25);
        assert_eq!(ball_overlap("", [-0.75, 0.5, 0.5]), f64::NEG_INFINITY);
        // Inside; the oblique face is the nearest.
        let inside = [0.7; 3];
        assert!((ball_overlap("", inside) - (0.5 + 0.9 / 3f64.sqrt())).abs() < 1e-12);
        assert_eq!(ball_overlap(", side: Back", inside), f64::NEG_INFINITY);
        assert_eq!(ball_overlap(", side: Both", inside), f64::NEG_INFINITY);
        // Twice as large, turned by a right angle about z, and moved.
        let moved =
            ", scale: 2.0, position: (1.0, 0.0, 0.0), orientation: (axis: (0.0, 0.0, 1.0), angle: 1.5707963267948966)";
        assert!((ball_overlap(moved, [0.5, -0.25, 1.0]) - 0.25).abs() < 1e-12);
        assert_eq!(ball_overlap(moved, [-0.5, 0.75, 7.0]), f64::NEG_INFINITY);
    }

    #[test]
    fn axes_are_right_handed_with_the_wished_normal() {
        let normal = Vector3::new(0.0, 3.0, 4.0);
        for first in [None, Some(Vector3::new(1.0, 1.0, 0.0))] {
            let axes = axes_about(&normal, first);
            assert!((axes.determinant() - 1.0).abs() < 1e-15 * 4.0);
            assert!((axes.row(2).transpose() - normal / 5.0).norm() < 1e-15);
        }
        assert_eq!(axes_about(&Vector3::z(), None), Matrix3::identity());
    }

    #[test]
    fn equal_tables_share_a_file() {
        let mut tables = FunctionTables::default();
        let table = |end| TimeFunction::Table(vec![(0.0, 0.0), (1.0, end)]);
        let names: Vec<String> = [1.0, 2.0, 1.0]
            .iter()
            .map(|&end| match tables.add_function(&table(end)) {
                FileFunction::Table { name, .. } => name,
                FileFunction::Harmonic { .. } => unreachable!(),
            })
            .collect();
        assert_eq!(names, ["evolution-1.dat", "evolution-2.dat", "evolution-1.dat"]);
        assert_eq!(
            tables.table_files()[1].1,
            "0.0000000000000000E0 0.0000000000000000E0\n1.0000000000000000E0 2.0000000000000000E0\n"
        );
    }
}
