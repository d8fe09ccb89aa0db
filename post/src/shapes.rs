//! Polyhedra of a case: snapshots contain their positions, DATBOX/BODIES.DAT their shapes.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use cd_formats::bodies::{Bodies, Body, Contactor, ShapeRecord};
use cd_formats::compute::ExternalField;
use cd_formats::error::{Fault, Faults};
use cd_formats::field::FieldShapes;
use cd_formats::groups::DisjointSets;
use cd_formats::snapshot::{BodyArrays, SHAPE_PARTS, Snapshot};
use cd_formats::surface::{Surface, SurfaceFaults};
use cd_formats::unchanged::ComputedSnapshot;
use nalgebra::Matrix3;

use crate::math::Vec3;

/// Largest difference of the normals of triangles of one face; files with eight digits leave about 1e-7.
const NORMAL_TOLERANCE: f64 = 1e-5;

/// A polyhedron, a cylinder, a capsule, off-centre spheres, or a cluster of these, or a triangulated wall, in the body's frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SolidShape {
    /// Vertices of all pieces, about the centre of mass, m.
    pub vertices: Vec<Vec3>,
    /// Polygons of vertex numbers, counter-clockwise seen from outside.
    pub faces: Vec<Vec<u32>>,
    /// Centre and radius of each sphere, m.
    pub balls: Vec<(Vec3, f64)>,
    /// Inside of a hollow cylinder about the third axis.
    pub hollow: Option<Hollow>,
    /// Whether it is a triangulated wall, of which face k is triangle k.
    pub is_mesh: bool,
}

/// Inside of a hollow cylinder with flat ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hollow {
    /// Radius, m.
    pub radius: f64,
    /// Half of the height, m.
    pub half_height: f64,
}

/// Number of sides of the prism that represents a cylinder.
const CYLINDER_SIDES: u32 = 64;
/// Number of sides of the polyhedron that represents a capsule, and of rings of faces on each of its ends.
const CAPSULE_SIDES: u32 = 32;
const CAPSULE_RINGS: u32 = 8;
/// Rings of faces, from pole to pole, of a drawn sphere of a cluster, and faces in each ring.
const SPHERE_RINGS: u32 = 10;
const SPHERE_SECTORS: u32 = 20;

impl SolidShape {
    /// Plate with the half lengths (m) along its axes.
    pub fn from_half_lengths(half: Vec3) -> SolidShape {
        let corner = |k: usize| Vec3::from_fn(|axis, _| if k >> axis & 1 == 0 { -half[axis] } else { half[axis] });
        let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        SolidShape {
            vertices: (0..8).map(corner).collect(),
            faces: sides.map(Vec::from).into(),
            ..SolidShape::default()
        }
    }

    /// Adds a cylinder about the third axis, as a prism with its edges on the cylinder; `to_body` maps its points to the
    /// body's frame.
    fn add_cylinder(&mut self, half_height: f64, radius: f64, to_body: impl Fn(Vec3) -> Vec3) {
        let first = self.vertices.len() as u32;
        for k in 0..CYLINDER_SIDES {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(CYLINDER_SIDES)).sin_cos();
            self.vertices
                .extend([-half_height, half_height].map(|z| to_body(Vec3::new(radius * cos, radius * sin, z))));
        }
        let lower_vertex = |k: u32| first + 2 * (k % CYLINDER_SIDES);
        self.faces.extend(
            (0..CYLINDER_SIDES)
                .map(|k| vec![lower_vertex(k), lower_vertex(k + 1), lower_vertex(k + 1) + 1, lower_vertex(k) + 1]),
        );
        self.faces.push((0..CYLINDER_SIDES).rev().map(lower_vertex).collect());
        self.faces.push((0..CYLINDER_SIDES).map(|k| lower_vertex(k) + 1).collect());
    }

    /// Returns a hollow cylinder with another radius, m; other shapes as they are.
    pub fn with_hollow_radius(&self, radius: f64) -> SolidShape {
        let mut solid = self.clone();
        if let Some(hollow) = &mut solid.hollow {
            let scale = Vec3::new(radius / hollow.radius, radius / hollow.radius, 1.0);
            solid.vertices.iter_mut().for_each(|vertex| vertex.component_mul_assign(&scale));
            hollow.radius = radius;
        }
        solid
    }

    /// Adds a plate; `to_body` maps its points to the body's frame.
    fn add_plate(&mut self, half_lengths: &[f64; 3], to_body: impl Fn(Vec3) -> Vec3) {
        let first = self.vertices.len() as u32;
        // Bit k of the index of a corner: the end along axis k.
        let corner =
            |index: u32| Vec3::from_fn(|k, _| if index >> k & 1 == 1 { half_lengths[k] } else { -half_lengths[k] });
        self.vertices.extend((0..8).map(|index| to_body(corner(index))));
        let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        self.faces.extend(faces.map(|face| face.map(|index| first + index).to_vec()));
    }

    /// Adds a capsule about the third axis, as a polyhedron with its vertices on the capsule; `to_body` maps its points to
    /// the body's frame.
    fn add_capsule(&mut self, half_length: f64, radius: f64, to_body: impl Fn(Vec3) -> Vec3) {
        let first = self.vertices.len() as u32;
        // Circles from the lower to the upper pole, two of them at the ends of the round side.
        let circles = 2 * CAPSULE_RINGS;
        for circle in 1..=circles {
            let (ring, end) = if circle <= CAPSULE_RINGS { (circle, -half_length) } else { (circle - 1, half_length) };
            let polar = std::f64::consts::PI * f64::from(ring) / f64::from(2 * CAPSULE_RINGS);
            for k in 0..CAPSULE_SIDES {
                let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(CAPSULE_SIDES)).sin_cos();
                let across = radius * polar.sin();
                self.vertices.push(to_body(Vec3::new(across * cos, across * sin, end - radius * polar.cos())));
            }
        }
        let poles = [-half_length - radius, half_length + radius];
        self.vertices.extend(poles.map(|z| to_body(Vec3::z() * z)));
        let vertex = |circle: u32, k: u32| first + circle * CAPSULE_SIDES + k % CAPSULE_SIDES;
        let [lower_pole, upper_pole] = [0, 1].map(|k| first + circles * CAPSULE_SIDES + k);
        for k in 0..CAPSULE_SIDES {
            self.faces.push(vec![vertex(0, k + 1), vertex(0, k), lower_pole]);
            self.faces.extend((1..circles).map(|upper| {
                vec![vertex(upper - 1, k), vertex(upper - 1, k + 1), vertex(upper, k + 1), vertex(upper, k)]
            }));
            self.faces.push(vec![vertex(circles - 1, k), vertex(circles - 1, k + 1), upper_pole]);
        }
    }

    /// Whether it consists of balls alone.
    pub fn is_clump(&self) -> bool {
        !self.balls.is_empty() && self.vertices.is_empty()
    }

    /// Distance of the farthest point from the centre of mass, m.
    pub fn bounding_radius(&self) -> f64 {
        let balls = self.balls.iter().map(|(centre, radius)| centre.norm() + radius);
        self.vertices.iter().map(|v| v.norm()).chain(balls).fold(0.0, f64::max)
    }

    /// Vertices and faces for pictures; spheres are replaced by inscribed polyhedra.
    pub fn drawn_mesh(&self) -> (Vec<Vec3>, Vec<Vec<u32>>) {
        let (mut vertices, mut faces) = (self.vertices.clone(), self.faces.clone());
        let pi = std::f64::consts::PI;
        for (centre, radius) in &self.balls {
            let first = vertices.len() as u32;
            for (ring, k) in (0..=SPHERE_RINGS).flat_map(|ring| (0..SPHERE_SECTORS).map(move |k| (ring, k))) {
                let (sin, cos) = (pi * f64::from(ring) / f64::from(SPHERE_RINGS)).sin_cos();
                let (y, x) = (2.0 * pi * f64::from(k) / f64::from(SPHERE_SECTORS)).sin_cos();
                vertices.push(centre + Vec3::new(sin * x, sin * y, -cos) * *radius);
            }
            let corner = |ring: u32, k: u32| first + ring * SPHERE_SECTORS + k % SPHERE_SECTORS;
            for (ring, k) in (0..SPHERE_RINGS).flat_map(|ring| (0..SPHERE_SECTORS).map(move |k| (ring, k))) {
                let mut face = vec![corner(ring, k), corner(ring, k + 1), corner(ring + 1, k + 1), corner(ring + 1, k)];
                // At a pole two corners are one.
                if ring == 0 {
                    face.remove(1);
                } else if ring == SPHERE_RINGS - 1 {
                    face.remove(2);
                }
                faces.push(face);
            }
        }
        (vertices, faces)
    }
}

/// Polyhedra of a case, and the properties of its bodies, which identify its snapshots.
#[derive(Debug)]
struct CaseShapes {
    /// Solid of each body of BODIES.DAT.
    solids: Vec<Option<Arc<SolidShape>>>,
    mass: Vec<f64>,
    inertia: Vec<[f64; 3]>,
    radius: Vec<f64>,
}

impl CaseShapes {
    /// Reads BODIES.DAT, which must have the bodies of the snapshot.
    fn read(file: &Path, computed: ComputedSnapshot) -> Result<CaseShapes, Faults> {
        let records = Bodies::read(file)?;
        computed.expect_bodies(file, &records)?;
        let mut solids = Vec::new();
        let mut faults = Faults::default();
        for (number, body) in (1..).zip(&records.0) {
            match body_solid(body) {
                Ok(solid) => solids.push(solid.map(Arc::new)),
                Err(found) => {
                    let object = format!("body {number}");
                    faults.push(Fault::new(
                        file,
                        Some(body.line),
                        object,
                        found.to_string(),
                        "expected a closed surface",
                    ));
                }
            }
        }
        let bodies = &computed.snapshot.bodies;
        let (mass, inertia) = (bodies.body_mass.clone(), bodies.body_inertia.clone());
        faults.into_result(CaseShapes { solids, mass, inertia, radius: bodies.body_radius.clone() })
    }

    /// Whether these are also the bodies of another snapshot.
    fn matches_bodies(&self, bodies: &BodyArrays) -> bool {
        self.mass == bodies.body_mass && self.inertia == bodies.body_inertia && self.radius == bodies.body_radius
    }
}

/// Shapes of several cases; the files of each case are read once.
#[derive(Debug, Default)]
pub struct ShapeCache {
    /// Polyhedra by the path of BODIES.DAT.
    solids: Mutex<HashMap<PathBuf, CaseShapes>>,
    /// Attracting polyhedra by the path of DATBOX, with the fields that they belong to.
    fields: Mutex<HashMap<PathBuf, (Vec<ExternalField>, FieldShapes)>>,
}

impl ShapeCache {
    /// Returns the polyhedra of each body of the snapshot `path`, None for other bodies, from the DATBOX next to its
    /// OUTBOX.
    ///
    /// Errors: a BODIES.DAT that cannot be read, or whose bodies are not those that the snapshot was computed with.
    pub fn solids_of(&self, path: &Path, snapshot: &Snapshot) -> Result<Vec<Option<Arc<SolidShape>>>, Faults> {
        let bodies = &snapshot.bodies;
        if !bodies.body_shape.contains(&SHAPE_PARTS) {
            return Ok(Vec::new());
        }
        let file = datbox_of(path).join("BODIES.DAT");
        let mut cases = self.solids.lock().unwrap_or_else(PoisonError::into_inner);
        if !cases.get(&file).is_some_and(|known| known.matches_bodies(bodies)) {
            cases.insert(file.clone(), CaseShapes::read(&file, ComputedSnapshot { path, snapshot })?);
        }
        let rows = cases[&file].solids.iter().zip(&bodies.body_shape);
        Ok(rows.map(|(solid, &shape)| solid.clone().filter(|_| shape == SHAPE_PARTS)).collect())
    }

    /// Returns the shapes of the polyhedra among the fields of the snapshot `path`, from the DATBOX next to its OUTBOX.
    ///
    /// Errors: surfaces that cannot be read.
    pub fn field_shapes_of(&self, path: &Path, fields: &[ExternalField]) -> Result<FieldShapes, Faults> {
        if !fields.iter().any(|field| matches!(field, ExternalField::Polyhedron { .. })) {
            return Ok(FieldShapes::default());
        }
        let datbox = datbox_of(path);
        let mut cases = self.fields.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((known, shapes)) = cases.get(&datbox)
            && known == fields
        {
            return Ok(shapes.clone());
        }
        let shapes = FieldShapes::read(fields, &datbox)?;
        cases.insert(datbox, (fields.to_vec(), shapes.clone()));
        Ok(shapes)
    }
}

/// DATBOX next to the OUTBOX of the snapshot `path`.
fn datbox_of(path: &Path) -> PathBuf {
    path.parent().and_then(Path::parent).unwrap_or(Path::new("")).join("DATBOX")
}

/// Polyhedra of a body as in cd-solve. Coordinates of a single polyhedron are relative to its centre of mass, of
/// several polyhedra to the common centre of mass, in principal axes unless I1 I2 I3 are given.
pub fn body_solid(body: &Body) -> Result<Option<SolidShape>, SurfaceFaults> {
    let is_single = body.contactors.len() == 1;
    let is_solid = |shape: &ShapeRecord| match shape {
        ShapeRecord::Cylinder { .. }
        | ShapeRecord::Capsule { .. }
        | ShapeRecord::Polyhedron { .. }
        | ShapeRecord::OffsetSphere { .. }
        | ShapeRecord::Mesh { .. } => true,
        ShapeRecord::Sphere { .. } | ShapeRecord::Plane { .. } => !is_single,
        ShapeRecord::Point { .. } => false,
    };
    if !body.contactors.iter().any(|contactor| is_solid(&contactor.shape)) {
        return Ok(None);
    }
    let keeps_own_axes = is_single && !matches!(body.contactors[0].shape, ShapeRecord::Polyhedron { .. });
    let (mut centre, mut axes) = (Vec3::zeros(), Matrix3::identity());
    if !keeps_own_axes {
        let properties = body.mass_properties()?;
        centre = body.centre_of_mass_offset(&properties).into();
        if let Some(frame) = body.computed_frame(&properties) {
            axes = Matrix3::from_rows(&frame.axes.map(|axis| Vec3::from(axis).transpose()));
        }
    }
    // Map from the frame of a cylinder or capsule to that of the body, which a single one has.
    let to_body = |contactor: &Contactor| {
        let frame = contactor.local_frame.as_ref().filter(|_| !is_single);
        let rotation = frame.map_or(Matrix3::identity(), |frame| Matrix3::from_fn(|i, j| frame.axes[j][i]));
        let offset = frame.map_or(Vec3::zeros(), |frame| frame.offset.into());
        move |v: Vec3| axes * (rotation * v + offset - centre)
    };
    let mut solid = SolidShape::default();
    for contactor in &body.contactors {
        match &contactor.shape {
            ShapeRecord::Cylinder { half_height, radius, hollow } => {
                solid.hollow = hollow.then_some(Hollow { radius: *radius, half_height: *half_height });
                solid.add_cylinder(*half_height, *radius, to_body(contactor));
            }
            ShapeRecord::Capsule { half_length, radius } => {
                solid.add_capsule(*half_length, *radius, to_body(contactor));
            }
            ShapeRecord::Polyhedron { vertices, triangles } => {
                let surface = Surface::new(vertices, triangles)?;
                let first = solid.vertices.len() as u32;
                solid.vertices.extend(surface.vertices().iter().map(|&v| axes * (Vec3::from(v) - centre)));
                let shifted_indices = |face: Vec<u32>| face.into_iter().map(|k| first + k).collect();
                solid.faces.extend(merged_faces(&surface).into_iter().map(shifted_indices));
            }
            ShapeRecord::Sphere { radius } => {
                let offset = contactor.local_frame.as_ref().map_or(Vec3::zeros(), |frame| frame.offset.into());
                solid.balls.push((axes * (offset - centre), *radius));
            }
            ShapeRecord::OffsetSphere { radius, offset } => {
                solid.balls.push((axes * (Vec3::from(*offset) - centre), *radius));
            }
            ShapeRecord::Mesh { surface, .. } => {
                solid.is_mesh = true;
                solid.vertices.extend(surface.iter().flat_map(|mesh| mesh.vertices()));
                solid.faces.extend(surface.iter().flat_map(|mesh| mesh.triangles()).map(|corners| corners.to_vec()));
            }
            ShapeRecord::Plane { half_lengths } => solid.add_plate(half_lengths, to_body(contactor)),
            ShapeRecord::Point { .. } => {}
        }
    }
    Ok(Some(solid))
}

/// Joins adjacent triangles in one plane to a polygon if it has a single rim.
fn merged_faces(surface: &Surface) -> Vec<Vec<u32>> {
    let triangles = surface.triangles();
    let normal = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|k| Vec3::from(surface.vertices()[k as usize]));
        (b - a).cross(&(c - a)).normalize()
    };
    let normals: Vec<Vec3> = triangles.iter().map(normal).collect();
    let mut triangle_of_side: HashMap<[u32; 2], usize> = HashMap::new();
    for (k, t) in triangles.iter().enumerate() {
        triangle_of_side.extend([[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]].map(|side| (side, k)));
    }
    let mut groups = DisjointSets::new(triangles.len());
    for ([a, b], &k) in &triangle_of_side {
        if let Some(&other) = triangle_of_side.get(&[*b, *a])
            && (normals[k] - normals[other]).norm() < NORMAL_TOLERANCE
        {
            groups.union(k, other);
        }
    }
    let mut faces: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for k in 0..triangles.len() {
        faces.entry(groups.find(k)).or_default().push(k);
    }
    let mut polygons = Vec::new();
    for face in faces.values() {
        // The rim: sides whose other side belongs to another face.
        let sides = face.iter().flat_map(|&k| {
            let [a, b, c] = triangles[k];
            [[a, b], [b, c], [c, a]]
        });
        let mut is_on_rim =
            |side: &[u32; 2]| groups.find(triangle_of_side[&[side[1], side[0]]]) != groups.find(face[0]);
        let rim: BTreeMap<u32, u32> = sides.filter(|side| is_on_rim(side)).map(|[a, b]| (a, b)).collect();
        let first = rim.keys().next().copied().unwrap_or_default();
        let cycle = std::iter::successors(Some(first), |k| rim.get(k).copied().filter(|next| *next != first));
        let polygon: Vec<u32> = cycle.take(rim.len() + 1).collect();
        // Every corner of the triangles lies on a single rim, or the face is left in triangles.
        if polygon.len() == rim.len() && rim.len() == face.len() + 2 {
            polygons.push(polygon);
        } else {
            polygons.extend(face.iter().map(|&k| triangles[k].to_vec()));
        }
    }
    polygons
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use cd_formats::snapshot::MaterialName;

    /// A box of half lengths 1, 2, 3 moved by `to`.
    fn body(to: f64, inertia: Option<[f64; 3]>) -> Body {
        let corner =
            |k: usize| [0, 1, 2].map(|axis| to + [1.0, 2.0, 3.0][axis] * if k >> axis & 1 == 0 { -1.0 } else { 1.0 });
        let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let triangles = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let shape = ShapeRecord::Polyhedron { vertices: (0..8).map(corner).collect(), triangles };
        let contactor = Contactor { colour: "BLUEx".into(), shape, local_frame: None };
        let material = "ROCKx".to_string();
        Body { line: 0, material, equivalent_radius: 1.0, inertia, position: [0.0; 3], contactors: vec![contactor] }
    }

    #[test]
    fn a_box_has_six_faces_about_its_centre() {
        let solid = body_solid(&body(7.0, Some([1.0; 3]))).unwrap().unwrap();
        assert_eq!((solid.vertices.len(), solid.faces.len()), (8, 6));
        assert!((solid.bounding_radius() - 14f64.sqrt()).abs() < 1e-14);
        let plate = SolidShape::from_half_lengths(Vec3::new(1.0, 2.0, 3.0));
        let ordered = |faces: &[Vec<u32>]| faces.iter().map(|face| face.iter().sum()).collect::<BTreeSet<u32>>();
        assert_eq!((&plate.vertices, ordered(&plate.faces)), (&solid.vertices, ordered(&solid.faces)));
        for face in &solid.faces {
            let corner: Vec<Vec3> = face.iter().map(|&k| solid.vertices[k as usize]).collect();
            assert_eq!(corner.len(), 4);
            let normal = (corner[1] - corner[0]).cross(&(corner[2] - corner[1]));
            assert!(normal.dot(&(corner[0] + corner[2])) > 0.0, "outward");
        }
    }

    #[test]
    fn axes_of_the_file_that_are_principal_stay() {
        let solid = body_solid(&body(0.0, None)).unwrap().unwrap();
        assert!(solid.vertices.iter().all(|v| (v.abs() - Vec3::new(1.0, 2.0, 3.0)).norm() < 1e-14));
    }

    #[test]
    fn a_cluster_without_inertia_is_about_its_centre_in_its_principal_axes() {
        let mut pair = body(0.0, None);
        pair.equivalent_radius = 0.0; // else the centre stays where the file has it
        let mut other = pair.contactors[0].clone();
        let ShapeRecord::Polyhedron { vertices, .. } = &mut other.shape else { unreachable!() };
        vertices.iter_mut().for_each(|v| v[2] += 10.0);
        pair.contactors.push(other);
        // The axes of the file are principal.
        let found = body_solid(&pair).unwrap().unwrap();
        let mut along: Vec<f64> = found.vertices.iter().map(|v| v.z).collect();
        along.sort_by(f64::total_cmp);
        assert!(
            along.iter().zip([-8.0, -2.0, 2.0, 8.0].iter().flat_map(|x| [x; 4])).all(|(x, y)| (x - y).abs() < 1e-13)
        );
        assert!(found.vertices.iter().all(|v| (v.y.abs() - 2.0).abs() < 1e-13 && (v.x.abs() - 1.0).abs() < 1e-13));
        // With a radius in the file the coordinates are unchanged.
        pair.equivalent_radius = 1.0;
        pair.inertia = Some([1.0; 3]);
        assert!(body_solid(&pair).unwrap().unwrap().vertices.iter().any(|v| v.z == 13.0));
    }

    #[test]
    fn snapshots_take_their_polyhedra_from_the_datbox_of_their_case() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("OUTBOX").join("snapshot-000000.npz");
        let mut ball = body(0.0, None);
        ball.contactors[0].shape = ShapeRecord::Sphere { radius: 1.0 };
        let datbox = folder.path().join("DATBOX").join("BODIES.DAT");
        let text = Bodies(vec![ball, body(0.0, Some([1.0; 3]))]).to_text();
        cd_formats::atomic::write(&datbox, text.as_bytes()).unwrap();
        let snapshot = |radius: f64, shape: u8| {
            let mut snapshot = Snapshot::default();
            snapshot.meta.materials = vec![MaterialName { name: "ROCKx".into(), density: 1.0 }];
            let mass = 4.0 / 3.0 * std::f64::consts::PI;
            snapshot.bodies = BodyArrays {
                body_id: vec![1, 2],
                body_shape: vec![shape; 2],
                body_mass: vec![mass, mass * radius.powi(3)],
                body_radius: vec![1.0, radius],
                body_inertia: vec![[0.4 * mass; 3], [1.0; 3]],
                body_material: vec![0; 2],
                ..BodyArrays::default()
            };
            snapshot
        };
        let shapes = ShapeCache::default();
        let counts = |snapshot: &Snapshot| -> Vec<usize> {
            let found = shapes.solids_of(&path, snapshot).unwrap();
            found.iter().map(|solid| solid.as_ref().map_or(0, |solid| solid.faces.len())).collect()
        };
        // A body of other contactors has none, even if the snapshot gives it such a shape.
        assert_eq!(counts(&snapshot(1.0, SHAPE_PARTS)), [0, 6]);
        assert!(counts(&snapshot(1.0, 0)).is_empty());
        // A snapshot from before BODIES.DAT was remade, after another snapshot has been accepted.
        let message = shapes.solids_of(&path, &snapshot(1.5, SHAPE_PARTS)).unwrap_err().to_string();
        assert!(
            message.contains("BODIES.DAT:11: body 2: radius 1 m, mass 4.18") && !message.contains("body 1"),
            "{message}"
        );
        assert!(message.contains("; expected radius 1.5 m, mass 14.13"), "{message}");
    }

    #[test]
    fn a_cylinder_is_a_prism_that_looks_outward() {
        let mut drum = body(0.0, None);
        drum.contactors[0].shape = ShapeRecord::Cylinder { half_height: 1.5, radius: 2.0, hollow: true };
        let solid = body_solid(&drum).unwrap().unwrap();
        let inside = Some(Hollow { radius: 2.0, half_height: 1.5 });
        assert_eq!((solid.vertices.len(), solid.faces.len(), solid.hollow), (128, 66, inside));
        assert!((solid.bounding_radius() - 2.5).abs() < 1e-14);
        // The 64-gon has 32 sin(2π/64) r² over the height.
        let expected = 3.0 * 4.0 * 32.0 * (std::f64::consts::TAU / 64.0).sin();
        assert!((outward_volume(&solid) - expected).abs() < 1e-12);
    }

    #[test]
    fn a_capsule_is_a_closed_polyhedron_on_its_surface() {
        let mut capsule = body(0.0, None);
        capsule.contactors[0].shape = ShapeRecord::Capsule { half_length: 1.5, radius: 2.0 };
        let solid = body_solid(&capsule).unwrap().unwrap();
        assert_eq!((solid.vertices.len(), solid.faces.len()), (514, 544));
        for v in &solid.vertices {
            let from_segment = v - Vec3::z() * v.z.clamp(-1.5, 1.5);
            assert!((from_segment.norm() - 2.0).abs() < 1e-14);
        }
        let sides = solid.faces.iter().flat_map(|face| (0..face.len()).map(|k| (face[k], face[(k + 1) % face.len()])));
        let sides: BTreeSet<(u32, u32)> = sides.collect();
        assert!(sides.iter().all(|&(a, b)| sides.contains(&(b, a))));
        // A 32-gon has 0.9936 of the circle, and the rings of 11° less of the ends.
        let filled = outward_volume(&solid) / (std::f64::consts::PI * 4.0 * (3.0 + 4.0 / 3.0 * 2.0));
        assert!((0.985..0.994).contains(&filled), "{filled}");
    }

    /// Volume of a solid all of whose faces look away from its centre.
    fn outward_volume(solid: &SolidShape) -> f64 {
        let cone = |face: &Vec<u32>| -> f64 {
            let at = |k: u32| solid.vertices[k as usize];
            face[1..].windows(2).map(|pair| at(face[0]).dot(&at(pair[0]).cross(&at(pair[1]))) / 6.0).sum()
        };
        assert!(solid.faces.iter().all(|face| cone(face) > 0.0));
        solid.faces.iter().map(cone).sum()
    }

    #[test]
    fn spheres_of_a_cluster_reach_as_far_as_they_do() {
        // A dumb-bell along y, 6 between its centres, off the origin.
        let mut pair = body(0.0, None);
        pair.equivalent_radius = 0.0; // else the centre stays where the file has it
        let ball = |y: f64| Contactor {
            colour: "BLUEx".into(),
            shape: ShapeRecord::OffsetSphere { radius: 0.5, offset: [1.0, y, 0.0] },
            local_frame: None,
        };
        pair.contactors = vec![ball(-2.0), ball(4.0)];
        let found = body_solid(&pair).unwrap().unwrap();
        // It stays along y.
        assert!(found.balls.iter().all(|(centre, _)| (centre.map(f64::abs) - Vec3::y() * 3.0).norm() < 1e-14));
        assert!((found.bounding_radius() - 3.5).abs() < 1e-14);
        let (vertices, faces) = found.drawn_mesh();
        let cone = |face: &Vec<u32>| -> f64 {
            let at = |k: u32| vertices[k as usize];
            face[1..].windows(2).map(|pair| at(face[0]).dot(&at(pair[0]).cross(&at(pair[1]))) / 6.0).sum()
        };
        // Inscribed polyhedra of 10 by 20 faces have a few parts in a hundred less than two balls.
        let share = faces.iter().map(cone).sum::<f64>() / (std::f64::consts::PI / 3.0);
        assert!((0.93..1.0).contains(&share), "{share}");
        pair.contactors.pop();
        assert_eq!(
            body_solid(&pair).unwrap().unwrap().balls,
            [(Vec3::new(1.0, -2.0, 0.0), 0.5)],
            "a lone one off the centre"
        );
    }

    #[test]
    fn a_broken_surface_is_reported() {
        let mut broken = body(0.0, None);
        let ShapeRecord::Polyhedron { triangles, .. } = &mut broken.contactors[0].shape else { unreachable!() };
        triangles.pop();
        assert!(body_solid(&broken).unwrap_err().to_string().contains("belongs to 1 triangle"));
    }
}
