//! A [`Frame`]: the grains, walls and contacts of one snapshot, with contacts in the world's frame. `derive` computes
//! observables from it, `write` draws it.

use std::ops::Index;
use std::path::Path;
use std::sync::Arc;

use cd_formats::deforming_cell::CellState;
use cd_formats::error::{Fault, Faults};
use cd_formats::field::FieldShapes;
use cd_formats::geometry::periodic_cell::PeriodicCell;
use cd_formats::hollow_radius::RadiusState;
use cd_formats::ids::BodyId;
use cd_formats::index_types;
use cd_formats::law_table::LawModel;
use cd_formats::snapshot::{
    BodyArrays, DRIVEN_ALL, PRESENCE_GONE, SHAPE_PLANE, Snapshot, SnapshotMeta, WallCriteria, are_walls,
};
use nalgebra::{Quaternion, UnitQuaternion};

use crate::axes::{AxesOrigin, OutputAxes};
use crate::math::{Mat3, Vec3};
use crate::shapes::{ShapeCache, SolidShape};

/// The state at one instant.
#[derive(Debug, Clone)]
pub struct Frame {
    pub meta: SnapshotMeta,
    /// Contact laws in the order of [`SnapshotMeta::laws`].
    pub laws: Vec<LawModel>,
    /// Grains, in the order of the snapshot's bodies.
    pub grains: Vec<Grain>,
    /// Walls, in the order of the snapshot's bodies.
    pub walls: Vec<Wall>,
    /// Numbers of the bodies that have not yet entered or have left the run.
    pub absent: Vec<u64>,
    /// Bodies that have left, at their last position with the velocity with which they left; empty if the snapshot does not
    /// have these velocities.
    pub departed: Vec<Grain>,
    /// Contacts, in the order of the snapshot; those between two walls are left out.
    pub contacts: Vec<Contact>,
    pub interval: SnapshotInterval,
    /// Shapes of the attracting polyhedra among the fields of the options.
    pub field_shapes: FieldShapes,
    /// Axes of written positions and velocities.
    pub axes: OutputAxes,
    /// Origin of the axes in which positions and velocities are written; everything in the frame is in those of the computation.
    pub origin: AxesOrigin,
}

/// Sums over the contacts since the snapshot before.
#[derive(Debug, Clone, PartialEq)]
pub struct SnapshotInterval {
    /// Time since the snapshot before, s; NaN if the snapshot does not contain it.
    pub length: f64,
    /// Pairs of bodies of which a contact has carried force in a step of the interval, except pairs of walls.
    pub touched_pairs: Vec<TouchedPair>,
}

/// Two bodies of which a contact has carried force in the interval, with the sum over their contacts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TouchedPair {
    /// Bodies, the candidate first.
    pub bodies: [ContactBody; 2],
    /// Sum of impulses times branches, J s; at a wall the branch of a grain ends at the point of contact.
    pub virial: f64,
}

/// A body that moves freely, in translation at least, or along two axes in a plane problem.
#[derive(Debug, Clone)]
pub struct Grain {
    /// Number of the body in the snapshot and in BODIES.DAT.
    pub id: u64,
    /// Centre of mass at the snapshot's time, the end of the step, m; in a periodic scene, of the image in the cell about
    /// the origin.
    pub x: Vec3,
    /// Sum of periods added to move the centre into the cell, m.
    pub cell_shift: Vec3,
    /// Centre of mass at contact detection, m: x - theta h v, half-way through the step.
    pub x_contact: Vec3,
    /// Velocity, m/s.
    pub v: Vec3,
    /// Angular velocity in the world's frame, rad/s.
    pub w: Vec3,
    /// Mass, kg.
    pub mass: f64,
    /// Tensor of inertia about the centre of mass in the world's frame, kg m^2.
    pub inertia: Mat3,
    /// Radius of the sphere of equal volume, m; for a sphere its own radius.
    pub radius: f64,
    /// Index into [`SnapshotMeta::colours`].
    pub colour: u16,
    /// Index into [`SnapshotMeta::materials`].
    pub material: u16,
    /// Rotation from the body's frame to the world's.
    pub rotation: UnitQuaternion<f64>,
    /// Shape; None for a sphere about its centre.
    pub solid: Option<Arc<SolidShape>>,
}

impl Grain {
    /// Volume, m^3.
    pub fn volume(&self) -> f64 {
        4.0 / 3.0 * std::f64::consts::PI * self.radius.powi(3)
    }

    /// Returns the grain displaced by `shift`, m.
    pub fn moved_by(&self, shift: Vec3) -> Grain {
        Grain { x: self.x + shift, ..self.clone() }
    }

    /// Radius of the bounding ball about the centre of mass, m.
    pub fn bounding_radius(&self) -> f64 {
        self.solid.as_ref().map_or(self.radius, |solid| solid.bounding_radius())
    }

    /// Position of the centre and radius of the sphere, or of each sphere that the grain is made of, m.
    pub fn balls(&self) -> impl Iterator<Item = (Vec3, f64)> {
        let own_ball = self.solid.is_none().then_some((self.x, self.radius));
        let parts = self.solid.iter().flat_map(|solid| &solid.balls);
        own_ball.into_iter().chain(parts.map(|(centre, radius)| (self.x + self.rotation * centre, *radius)))
    }

    /// Positions of the vertices of a polyhedron, m; empty for a sphere.
    pub fn vertices(&self) -> impl Iterator<Item = Vec3> {
        let solid = self.solid.as_deref();
        solid.into_iter().flat_map(|solid| &solid.vertices).map(|v| self.x + self.rotation * v)
    }
}

/// A body that supports or pushes the grains: some of its translation is imposed, or it is a plane with an imposed
/// component.
///
/// A piston that moves freely along one axis under a load is a wall too: its force on the grains is an external load.
#[derive(Debug, Clone)]
pub struct Wall {
    /// Number of the body in the snapshot and in BODIES.DAT.
    pub id: u64,
    pub x: Vec3,
    /// Velocity of a partly driven wall, m/s.
    pub v: Option<Vec3>,
    /// Rotation from the body's frame to the world's.
    pub rotation: UnitQuaternion<f64>,
    pub shape: WallShape,
}

/// Shape of a wall in the frame of its body.
#[derive(Debug, Clone, PartialEq)]
pub enum WallShape {
    /// Half lengths along the body's axes, m.
    Plate(Vec3),
    /// Radius, m.
    Ball(f64),
    Polyhedron(Arc<SolidShape>),
}

index_types! {
    /// Index into [`Frame::grains`].
    GrainId(u32);
    /// Index into [`Frame::walls`].
    WallId(u32);
}

impl Index<GrainId> for Vec<Grain> {
    type Output = Grain;

    fn index(&self, id: GrainId) -> &Grain {
        &self[id.index()]
    }
}

impl Index<WallId> for Vec<Wall> {
    type Output = Wall;

    fn index(&self, id: WallId) -> &Wall {
        &self[id.index()]
    }
}

/// Body of a contact, a grain or a wall.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ContactBody {
    Grain(GrainId),
    Wall(WallId),
}

impl ContactBody {
    /// The grain; `None` for a wall.
    pub fn grain_id(self) -> Option<GrainId> {
        match self {
            ContactBody::Grain(grain) => Some(grain),
            ContactBody::Wall(_) => None,
        }
    }
}

/// A contact that was listed in the last step; at least one of its bodies is a grain.
#[derive(Debug, Clone)]
pub struct Contact {
    pub candidate: ContactBody,
    pub antagonist: ContactBody,
    /// Point of contact on the candidate, m.
    pub point: Vec3,
    /// Vector from the antagonist's position to the image of it that the candidate touches, m.
    pub image: Vec3,
    /// Unit vector from the antagonist to the candidate.
    pub normal: Vec3,
    /// Force on the candidate in the world's frame, N: mean over the step.
    pub force: Vec3,
    /// Component of the force along n, from the antagonist to the candidate, N: > 0 pushes.
    pub normal_force: f64,
    /// Length of the force across n, N.
    pub tangential_force: f64,
    /// Feature of the antagonist that is touched.
    pub antagonist_feature: u32,
    /// Gap, m, > 0 apart.
    pub gap: f64,
    /// Status: 0 no contact, 1 stick, 2 slide.
    pub status: u8,
    /// Index into [`Frame::laws`].
    pub law: u8,
    /// Whether the contact carries force: the impulse is not zero.
    pub active: bool,
    /// Whether a bond or a liquid bridge is intact at the end of the step.
    pub bonded: bool,
    /// Soundness β of its elastic interface at the end of the step; 0 without an interface.
    pub soundness: f64,
    /// Attraction by a law with cohesion per pair, N; 0 for other laws.
    pub attraction: f64,
    /// Area on which a bond's stresses act, m^2: the shared area of faces, else [`LawModel::bond_area`].
    pub area: f64,
}

impl Contact {
    /// The grains of a contact of grain and grain, candidate first.
    pub fn grain_pair(&self) -> Option<(GrainId, GrainId)> {
        Some((self.candidate.grain_id()?, self.antagonist.grain_id()?))
    }

    /// Candidate and antagonist.
    pub fn bodies(&self) -> impl Iterator<Item = ContactBody> {
        [self.candidate, self.antagonist].into_iter()
    }

    /// Each grain of the contact with the force on it, N, and the shift of its position to the touching image, m.
    pub fn on_grains(&self) -> impl Iterator<Item = (GrainId, Vec3, Vec3)> {
        [(self.candidate, self.force, Vec3::zeros()), (self.antagonist, -self.force, self.image)]
            .into_iter()
            .filter_map(|(body, force, image)| Some((body.grain_id()?, force, image)))
    }
}

impl Frame {
    /// Reads a snapshot and splits it into grains, walls and contacts.
    ///
    /// Errors: the errors of [`Snapshot::read`], each body with a mass, moment of inertia or length that is not positive, each law
    /// that is not in the table of laws, and with polyhedra or fields of polyhedra those of [`ShapeCache`].
    pub fn read(path: &Path, shapes: &ShapeCache) -> Result<Frame, Faults> {
        let snapshot = Snapshot::read(path)?;
        let mut faults = Faults::default();
        for (object, found) in out_of_range(&snapshot.bodies) {
            faults.push(Fault::new(path, None, object, found, "expected numbers > 0"));
        }
        let mut laws = Vec::new();
        for law in &snapshot.meta.laws {
            match law.model() {
                Ok(model) => laws.push(model),
                Err(error) => {
                    let object = format!("law '{}'", law.nickname);
                    faults.push(Fault::new(path, None, object, error.found(), error.expected()));
                }
            }
        }
        faults.into_result(())?;
        let solids = shapes.solids_of(path, &snapshot)?;
        let field_shapes = shapes.field_shapes_of(path, &snapshot.meta.parameters.fields)?;
        Ok(Frame { field_shapes, ..Frame::with_solids(snapshot, solids, laws) })
    }

    /// Calls [`Frame::read`], for positions and velocities that are written in `axes`. Errors: its errors, and those of
    /// [`OutputAxes::origin`].
    pub fn read_for_axes(path: &Path, shapes: &ShapeCache, axes: OutputAxes) -> Result<Frame, Faults> {
        let frame = Frame::read(path, shapes)?;
        Ok(Frame { axes, origin: axes.origin(&frame.meta, &frame.field_shapes)?, ..frame })
    }

    /// Splits a valid snapshot, without the bodies that are not in the run; `solids` has the polyhedron of each body, None
    /// for the other bodies, and `laws` the laws of the snapshot.
    pub fn with_solids(snapshot: Snapshot, mut solids: Vec<Option<Arc<SolidShape>>>, laws: Vec<LawModel>) -> Frame {
        solids.resize(snapshot.bodies.body_id.len(), None);
        let is_present: Vec<bool> = (0..solids.len()).map(|row| snapshot.is_present(row)).collect();
        let absent = snapshot.bodies.body_id.iter().zip(&is_present);
        let absent = absent.filter(|(_, is_present)| !**is_present).map(|(id, _)| *id).collect();
        let exit_velocities = snapshot.departures.as_ref().zip(snapshot.presence.as_ref()).map_or(
            vec![None; solids.len()],
            |(departures, presence)| {
                let rows = presence.body_presence.iter().zip(&departures.body_exit_v);
                rows.map(|(presence, v)| (*presence == PRESENCE_GONE).then(|| Vec3::from(*v))).collect()
            },
        );
        let Snapshot { meta, bodies, contacts, memory, laws: law_memory, attractions, shapes, interval, .. } = snapshot;
        let detection_time = -meta.parameters.theta * meta.h;
        let cell = meta.periodic_cell();
        // The cell in the contact configuration.
        let contact_cell = meta.cell.map_or(cell, |state| state.moved_by(detection_time).cell());
        let is_wall = wall_rows(&bodies);
        let is_mesh: Vec<bool> = solids.iter().map(|solid| solid.as_ref().is_some_and(|solid| solid.is_mesh)).collect();
        // Bodies of balls alone, as BODIES.DAT has them: position k in the list is contactor k.
        let clumps: Vec<Option<Arc<SolidShape>>> =
            solids.iter().map(|solid| solid.clone().filter(|solid| solid.is_clump())).collect();
        let (mut grains, mut walls, mut departed) = (Vec::new(), Vec::new(), Vec::new());
        let contact_bodies: Vec<ContactBody> = solids
            .into_iter()
            .enumerate()
            .map(|(row, solid)| {
                let solid = solid.map(|solid| with_current_radius(solid, &meta.radii, row));
                let grain = |solid| grain_of_row(&bodies, row, detection_time, solid, &cell, meta.cell.as_ref());
                if !is_present[row] {
                    departed.extend(exit_velocities[row].map(|v| Grain { v, ..grain(solid) }));
                    // No contact names it.
                    ContactBody::Grain(GrainId::new(grains.len()))
                } else if is_wall[row] {
                    walls.push(wall_of_row(&bodies, row, solid));
                    ContactBody::Wall(WallId::new(walls.len() - 1))
                } else {
                    grains.push(grain(solid));
                    ContactBody::Grain(GrainId::new(grains.len() - 1))
                }
            })
            .collect();
        let curvature = |body: BodyId, contactor: usize| match bodies.body_shape[body.index()] {
            SHAPE_PLANE if is_wall[body.index()] => 0.0,
            _ if is_mesh[body.index()] => 0.0,
            _ => {
                let ball = clumps[body.index()].as_ref().and_then(|clump| clump.balls.get(contactor));
                1.0 / ball.map_or(bodies.body_radius[body.index()], |(_, radius)| *radius)
            }
        };
        // Sum of edges at contact detection that is `shift` at the snapshot's time.
        let contact_shift =
            |shift: Vec3| meta.cell.as_ref().map_or(shift, |state| shift + state.gradient() * shift * detection_time);
        let contacts = (0..contacts.contact_body.len())
            .filter_map(|row| {
                let pair = contacts.contact_body[row].map(BodyId);
                let [candidate, antagonist] = pair.map(|body| contact_bodies[body.index()]);
                candidate.grain_id().or(antagonist.grain_id())?;
                let [n, t, s] = contacts.contact_frame[row].map(Vec3::from);
                let [f_n, f_t, f_s] = contacts.contact_force[row];
                let position_and_shift = |body: ContactBody| match body {
                    ContactBody::Grain(k) => (grains[k].x_contact, contact_shift(grains[k].cell_shift)),
                    ContactBody::Wall(k) => (walls[k].x, Vec3::zeros()),
                };
                let ((x, shift), (other, _)) = (position_and_shift(candidate), position_and_shift(antagonist));
                let shared_area = shapes.as_ref().map_or(0.0, |shapes| shapes.contacts.contact_area[row]);
                let ranks = shapes.as_ref().map(|shapes| &shapes.contacts.contact_rank);
                let contactors = ranks.and_then(|ranks| ranks.get(row)).copied().unwrap_or_default();
                let curvatures = [0, 1].map(|side| curvature(pair[side], contactors[side] as usize));
                let law = contacts.contact_law[row];
                let disc = || match laws.get(law as usize) {
                    Some(model) => model.bond_area(curvatures),
                    None => std::f64::consts::PI / (curvatures[0] + curvatures[1]).powi(2),
                };
                Some(Contact {
                    candidate,
                    antagonist,
                    point: Vec3::from(contacts.contact_point[row]) + shift,
                    image: contact_cell.nearest_shift(&(x - other)),
                    normal: n,
                    force: n * f_n + t * f_t + s * f_s,
                    normal_force: f_n,
                    tangential_force: f_t.hypot(f_s),
                    antagonist_feature: contacts.contact_feature.get(row).map_or(0, |feature| feature[1]),
                    gap: contacts.contact_gap[row],
                    status: contacts.contact_status[row],
                    law,
                    active: contacts.contact_impulse[row].iter().any(|&r| r != 0.0),
                    bonded: memory.as_ref().is_some_and(|memory| memory.contact_bonded[row] != 0),
                    soundness: law_memory.as_ref().map_or(0.0, |memory| memory.contact_soundness[row]),
                    attraction: attractions.as_ref().map_or(0.0, |attractions| attractions.contact_attraction[row]),
                    area: if shared_area > 0.0 { shared_area } else { disc() },
                })
            })
            .collect();
        let interval = interval.unwrap_or_default();
        let touched_pairs = interval.interval_body.iter().zip(&interval.interval_virial);
        let touched_pairs = touched_pairs.filter_map(|(pair, &virial)| {
            let bodies = pair.map(|body| contact_bodies[BodyId(body).index()]);
            bodies.into_iter().any(|body| body.grain_id().is_some()).then_some(TouchedPair { bodies, virial })
        });
        let interval = SnapshotInterval {
            length: meta.interval_start.map_or(f64::NAN, |start| meta.time - start),
            touched_pairs: touched_pairs.collect(),
        };
        let (field_shapes, axes, origin) = Default::default();
        Frame { meta, laws, grains, walls, absent, departed, contacts, interval, field_shapes, axes, origin }
    }

    /// Periodic cell of the scene.
    pub fn cell(&self) -> PeriodicCell {
        self.meta.periodic_cell()
    }

    /// Velocity of a grain, in a deforming cell about the affine field, m/s: it is the same for all images of the grain.
    pub fn local_velocity(&self, grain: &Grain) -> Vec3 {
        self.meta.cell.as_ref().map_or(grain.v, |cell| cell.fluctuation(&(grain.x - grain.cell_shift), &grain.v))
    }

    /// The indices of all grains.
    pub fn grain_ids(&self) -> impl Iterator<Item = GrainId> + use<> {
        (0..self.grains.len()).map(GrainId::new)
    }

    /// The indices of all walls.
    pub fn wall_ids(&self) -> impl Iterator<Item = WallId> + use<> {
        (0..self.walls.len()).map(WallId::new)
    }

    /// The contacts that carry force.
    pub fn active_contacts(&self) -> impl Iterator<Item = &Contact> {
        self.contacts.iter().filter(|contact| contact.active)
    }

    /// Total mass of the grains, kg.
    pub fn total_mass(&self) -> f64 {
        self.grains.iter().map(|grain| grain.mass).sum()
    }
}

/// Whether each body is a wall, as in the solver's energies.
fn wall_rows(bodies: &BodyArrays) -> Vec<bool> {
    let rows = bodies.body_driven.iter().zip(&bodies.body_shape);
    let criteria = rows.map(|(&driven, &shape)| WallCriteria { driven, is_plane: shape == SHAPE_PLANE });
    are_walls(&criteria.collect::<Vec<_>>())
}

fn body_rotation(bodies: &BodyArrays, row: usize) -> UnitQuaternion<f64> {
    let [w, x, y, z] = bodies.body_q[row];
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
}

/// Grain of a row of the snapshot, moved into `cell`. `detection_time`: time of contact detection relative to the snapshot, s;
/// `deforming_cell`: its gradient gives the velocity of the image relative to the grain.
fn grain_of_row(
    bodies: &BodyArrays,
    row: usize,
    detection_time: f64,
    solid: Option<Arc<SolidShape>>,
    cell: &PeriodicCell,
    deforming_cell: Option<&CellState>,
) -> Grain {
    let (x, v) = (Vec3::from(bodies.body_x[row]), Vec3::from(bodies.body_v[row]));
    let shift = -cell.cell_origin(&x);
    let image_velocity = deforming_cell.map_or(Vec3::zeros(), |cell| cell.gradient() * shift);
    let x = x + shift;
    let [j1, j2, j3] = bodies.body_inertia[row];
    // Equal moments need no rotation, and keep their digits without one.
    let inertia = if j1 == j2 && j2 == j3 {
        Mat3::from_diagonal_element(j1)
    } else {
        let axes = body_rotation(bodies, row).to_rotation_matrix();
        axes.matrix() * Mat3::from_diagonal(&Vec3::new(j1, j2, j3)) * axes.matrix().transpose()
    };
    let plate = || SolidShape::from_half_lengths(bodies.body_half_lengths[row].into()).into();
    let solid = solid.or_else(|| (bodies.body_shape[row] == SHAPE_PLANE).then(plate));
    Grain {
        id: bodies.body_id[row],
        x,
        cell_shift: shift,
        x_contact: x + detection_time * (v + image_velocity),
        v,
        w: bodies.body_w_world[row].into(),
        mass: bodies.body_mass[row],
        inertia,
        radius: bodies.body_radius[row],
        colour: bodies.body_colour[row],
        material: bodies.body_material[row],
        rotation: body_rotation(bodies, row),
        solid,
    }
}

/// Shape of the body of a row, with the current radius if it is a hollow cylinder whose radius changes.
fn with_current_radius(solid: Arc<SolidShape>, radii: &[RadiusState], row: usize) -> Arc<SolidShape> {
    let current = radii.iter().find(|radius| radius.body == row + 1);
    current.map_or(solid.clone(), |current| Arc::new(solid.with_hollow_radius(current.radius)))
}

/// Wall of a row of the snapshot.
fn wall_of_row(bodies: &BodyArrays, row: usize, solid: Option<Arc<SolidShape>>) -> Wall {
    let shape = match (solid, bodies.body_shape[row]) {
        (Some(solid), _) => WallShape::Polyhedron(solid),
        (None, SHAPE_PLANE) => WallShape::Plate(bodies.body_half_lengths[row].into()),
        (None, _) => WallShape::Ball(bodies.body_radius[row]),
    };
    let v = (bodies.body_driven[row] != DRIVEN_ALL).then(|| bodies.body_v[row].into());
    Wall { id: bodies.body_id[row], x: bodies.body_x[row].into(), v, rotation: body_rotation(bodies, row), shape }
}

/// Masses, moments of inertia and lengths that are not positive, with which no observable is defined, each as the
/// object and the text found.
fn out_of_range(bodies: &BodyArrays) -> Vec<(String, String)> {
    let mut faults = Vec::new();
    for (row, is_wall) in wall_rows(bodies).into_iter().enumerate() {
        let mut expect_positive = |name: &str, values: &[f64]| {
            if values.iter().any(|v| *v <= 0.0) {
                faults.push((format!("body {}, body_{name}", bodies.body_id[row]), format!("{values:?}")));
            }
        };
        if bodies.body_shape[row] == SHAPE_PLANE {
            expect_positive("half_lengths", &bodies.body_half_lengths[row]);
        }
        if !is_wall {
            expect_positive("mass", &[bodies.body_mass[row]]);
            expect_positive("inertia", &bodies.body_inertia[row]);
            expect_positive("radius", &[bodies.body_radius[row]]);
        }
    }
    faults
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Scene;
    use cd_formats::snapshot::{ContactPartArrays, DepartureArrays, PresenceArrays, ShapeArrays};

    #[test]
    fn planes_and_driven_bodies_are_walls() {
        let mut scene = Scene::default();
        let (floor, grain, stirrer, piston) = (
            scene.plate([0.0; 3], [1.0, 1.0, 0.1]),
            scene.grain([0.0, 0.0, 2.0], 1.0),
            scene.grain([5.0, 0.0, 2.0], 0.5),
            scene.plate([0.0, 0.0, 9.0], [1.0, 1.0, 0.1]),
        );
        scene.snapshot.bodies.body_driven[stirrer] = 0b11_1100; // pushed across z
        scene.snapshot.bodies.body_driven[piston] = 0b11_1011; // free along z
        scene.contact_at(grain, floor, [0.0; 3], Vec3::z());
        scene.contact_at(stirrer, floor, [0.0; 3], Vec3::z());
        scene.contact(stirrer, grain, Vec3::x());
        let frame = scene.frame();
        assert_eq!(frame.grains.iter().map(|g| g.id).collect::<Vec<_>>(), [2]);
        assert_eq!(frame.walls.iter().map(|w| w.id).collect::<Vec<_>>(), [1, 3, 4]);
        assert_eq!(frame.walls[1].shape, WallShape::Ball(0.5));
        // The one between two walls is left out.
        let pairs: Vec<(ContactBody, ContactBody)> =
            frame.contacts.iter().map(|c| (c.candidate, c.antagonist)).collect();
        let (grain, walls) = (ContactBody::Grain(GrainId(0)), [0, 1].map(|k| ContactBody::Wall(WallId(k))));
        assert_eq!(pairs, [(grain, walls[0]), (walls[1], grain)]);
        // Force on the candidate is against the grain's own when that is the antagonist.
        assert_eq!(frame.contacts[1].on_grains().collect::<Vec<_>>(), [(GrainId(0), -Vec3::x(), Vec3::zeros())]);
    }

    #[test]
    fn bodies_that_are_not_in_the_run_are_left_out() {
        let mut scene = Scene::default();
        let rows = [0.0, 4.0, 8.0, 12.0].map(|x| scene.grain([x, 0.0, 0.0], 1.0));
        scene.contact(rows[1], rows[3], -Vec3::x());
        scene.snapshot.presence = Some(PresenceArrays { body_presence: vec![2, 1, 0, 1] });
        assert!(scene.frame().departed.is_empty());
        let mut body_exit_v = vec![[0.0; 3]; 4];
        body_exit_v[0] = [1.0, 2.0, 3.0];
        scene.snapshot.departures = Some(DepartureArrays { body_exit_v });
        let frame = scene.frame();
        // The third has not yet entered.
        assert_eq!(frame.departed.iter().map(|grain| (grain.id, grain.v.z)).collect::<Vec<_>>(), [(1, 3.0)]);
        assert_eq!(frame.grains.iter().map(|grain| grain.id).collect::<Vec<_>>(), [2, 4]);
        assert_eq!(frame.absent, [1, 3]);
        assert_eq!(frame.contacts[0].grain_pair(), Some((GrainId(0), GrainId(1))));
    }

    #[test]
    fn bodies_whose_translation_is_free_are_grains() {
        let mut scene = Scene::default();
        scene.plate([0.0; 3], [1.0, 1.0, 0.1]);
        let rows = [0.0, 2.0, 4.0].map(|x| scene.grain([x, 0.0, 2.0], 1.0));
        let mut grains = |driven: [u8; 3]| {
            rows.iter().zip(driven).for_each(|(&row, driven)| scene.snapshot.bodies.body_driven[row] = driven);
            scene.frame().grains.iter().map(|grain| grain.id).collect::<Vec<_>>()
        };
        assert_eq!(grains([0, 0b11_1000, 0b11_1111]), [2, 3]);
        // A stirrer among grains is a wall; in a plane problem all are grains but those that move along one axis only.
        assert_eq!(grains([0, 0b10_1010, 0b10_1010]), [2]);
        assert_eq!(grains([0b10_1010, 0b10_1010, 0b11_1011]), [2, 3]);
    }

    #[test]
    fn a_plate_without_imposed_components_is_a_grain() {
        let mut scene = Scene::default();
        let plates = [0.0, 3.0, 6.0].map(|z| scene.plate([0.0, 0.0, z], [1.0, 2.0, 0.5]));
        scene.snapshot.bodies.body_driven[plates[1]] = 0;
        scene.snapshot.bodies.body_driven[plates[2]] = 0b11_1000; // a lid that cannot tilt
        let frame = scene.frame();
        assert_eq!(frame.grains.iter().map(|grain| grain.id).collect::<Vec<_>>(), [2]);
        assert!((frame.grains[0].volume() - 8.0).abs() < 1e-14); // some roundings
        assert!((frame.grains[0].bounding_radius() - 5.25f64.sqrt()).abs() < 1e-15);
        assert_eq!(frame.walls.len(), 2);
    }

    /// Discs of bonds have the radius of the balls in contact, also in clumps: π R², 1/R = 1/r_a + 1/r_b.
    #[test]
    fn the_area_of_a_contact_of_clumps_is_that_of_their_balls() {
        let mut scene = Scene::default();
        let rows = [0.0, 4.0].map(|x| scene.grain([x, 0.0, 0.0], 2.0));
        scene.contact(rows[0], rows[1], Vec3::x());
        let contacts = ContactPartArrays { contact_rank: vec![[1, 0]], contact_area: vec![0.0] };
        scene.snapshot.shapes = Some(ShapeArrays { contacts, ..ShapeArrays::default() });
        let balls = vec![(Vec3::x(), 0.5), (-Vec3::x(), 0.25)];
        let clump = Arc::new(SolidShape { balls, ..SolidShape::default() });
        let area = |solids: Vec<Option<Arc<SolidShape>>>| {
            Frame::with_solids(scene.snapshot.clone(), solids, Vec::new()).contacts[0].area
        };
        let expected = |a: f64, b: f64| std::f64::consts::PI / (1.0 / a + 1.0 / b).powi(2);
        assert_eq!(area(vec![None, None]), expected(2.0, 2.0));
        assert_eq!(area(vec![Some(clump.clone()), None]), expected(0.25, 2.0));
        assert_eq!(area(vec![Some(clump.clone()), Some(clump.clone())]), expected(0.25, 0.5));
    }

    #[test]
    fn inertia_is_turned_into_the_worlds_frame() {
        let mut scene = Scene::default();
        let grain = scene.grain([0.0; 3], 1.0);
        scene.snapshot.bodies.body_inertia[grain] = [1.0, 2.0, 4.0];
        let half = std::f64::consts::FRAC_1_SQRT_2;
        scene.snapshot.bodies.body_q[grain] = [half, 0.0, 0.0, half]; // a quarter turn about z: x to y
        let expected = Mat3::from_diagonal(&Vec3::new(2.0, 1.0, 4.0));
        assert!((scene.frame().grains[0].inertia - expected).norm() < 1e-14); // some roundings of 4
    }
}
