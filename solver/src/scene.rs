//! Data: `Scene`, the constants of a run, which `read` makes of DATBOX: bodies and their shapes, laws, visibility, imposed
//! motion and options. `state` has the data that change.

mod imposed_motion;

use std::ops::Index;
use std::sync::Arc;

use cd_formats::compute::{Compute, Event, ExternalField, GravityMethod, NarrowPhase};
pub use cd_formats::doubts::EVENT_SLACK;
use cd_formats::drv_dof::Evolution;
use cd_formats::field::{FieldModel, FieldShapes, PrimaryResponse};
use cd_formats::geometry::periodic_cell::PeriodicCell;
pub use cd_formats::ids::BodyId;
use cd_formats::postpro::{PostproCommand, PostproKind};
use cd_formats::probe::{BodySelection, Probe, ProbeQuantity};
use cd_formats::region::SpaceRegion;
use cd_formats::snapshot::{LawName, MaterialName, WallCircle};
use cd_formats::wall_mesh::WallMesh;

pub use self::imposed_motion::{
    AreaSide, ChangingRadius, ImposedLoad, ImposedVelocity, PressedArea, RadialGrowth, StrainDrive, SurfaceMotion,
    WallArea, WallPivot,
};
use crate::features::BARE;
use crate::geometry::Polyhedron;
use crate::gravity::{GravitySolver, SummationMethod};
use crate::laws::ContactLaw;
use crate::math::rotation;
use crate::math::{Mat3, Quat, Twist, Vec3};

/// Shape of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BodyShape {
    /// Sphere about the centre of mass; radius in m.
    Sphere { radius: f64 },
    /// Rectangular plate; half lengths along its axes, m.
    Plane { half_lengths: Vec3 },
    /// Any other shape, or several contactors, given in `Scene::parts`.
    Parts,
}

/// Shape of a contactor, in its own frame; m.
#[derive(Debug, Clone, PartialEq)]
pub enum ContactorShape {
    Sphere {
        radius: f64,
    },
    /// Convex polyhedron about its centroid.
    Polyhedron(Polyhedron),
    /// Cylinder about the third axis; contact is on the inside if hollow.
    Cylinder {
        half_height: f64,
        radius: f64,
        hollow: bool,
    },
    /// All points up to `radius` from a segment about the centre along the third axis.
    Capsule {
        half_length: f64,
        radius: f64,
    },
    /// Rectangular plate; the cuboid is the same plate as a polyhedron.
    Plane {
        half_lengths: Vec3,
        cuboid: Polyhedron,
    },
    /// Triangulated surface of a wall.
    Mesh(Arc<WallMesh>),
}

impl ContactorShape {
    /// Radius of the largest ball about the centre that is within the shape, m; infinite for a hollow cylinder and a surface,
    /// behind which all is wall.
    pub fn inner_radius(&self) -> f64 {
        match self {
            ContactorShape::Sphere { radius } | ContactorShape::Capsule { radius, .. } => *radius,
            ContactorShape::Polyhedron(shape) => shape.inradius(),
            ContactorShape::Cylinder { hollow: true, .. } | ContactorShape::Mesh(_) => f64::INFINITY,
            ContactorShape::Cylinder { half_height, radius, .. } => half_height.min(*radius),
            ContactorShape::Plane { half_lengths, .. } => half_lengths.min(),
        }
    }

    /// Largest n·x of the shape with the orientation `axes`, x from its centre, m; a hollow cylinder counts as solid.
    pub fn support_height(&self, axes: &Quat, n: &Vec3) -> f64 {
        match self {
            ContactorShape::Sphere { radius } => *radius,
            ContactorShape::Polyhedron(shape) | ContactorShape::Plane { cuboid: shape, .. } => {
                shape.posed_by(axes).support_height(n)
            }
            ContactorShape::Cylinder { half_height, radius, .. } => {
                let local = axes.inverse_transform_vector(n);
                half_height * local.z.abs() + radius * local.xy().norm()
            }
            ContactorShape::Capsule { half_length, radius } => {
                half_length * axes.inverse_transform_vector(n).z.abs() + radius
            }
            ContactorShape::Mesh(mesh) => {
                let local = axes.inverse_transform_vector(n);
                mesh.vertices().iter().map(|vertex| local.dot(vertex)).fold(f64::NEG_INFINITY, f64::max)
            }
        }
    }
}

cd_formats::index_types! {
    /// Index of a contactor in `Scene::parts`.
    PartId(u32);
    /// Index of a sphere in `Scene::spheres`, in a scene of spheres and plates alone.
    SphereId(u32);
    /// Index of a law in `Scene::laws`, `Scene::law_names` and `State::laws`; one byte, as in snapshots.
    LawId(u8);
}

/// Values of the two sides of a contact, ordered by that of the candidate first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct ContactSides<T> {
    pub candidate: T,
    pub antagonist: T,
}

impl<T> ContactSides<T> {
    /// The same values with the sides exchanged.
    pub fn swapped_sides(self) -> Self {
        ContactSides { candidate: self.antagonist, antagonist: self.candidate }
    }
}

impl<T> From<[T; 2]> for ContactSides<T> {
    fn from([candidate, antagonist]: [T; 2]) -> Self {
        ContactSides { candidate, antagonist }
    }
}

impl<T> From<ContactSides<T>> for [T; 2] {
    fn from(sides: ContactSides<T>) -> Self {
        [sides.candidate, sides.antagonist]
    }
}

/// Contactor of a body, in scenes with bodies other than spheres and plates.
#[derive(Debug, Clone)]
pub struct BodyPart {
    pub body: BodyId,
    /// Number of the part: its index among the parts of its body.
    pub number: u16,
    /// Index of its contactor in BODIES.DAT, from 0, of which it may be one of several convex pieces.
    pub contactor: u16,
    pub geometry: ContactorShape,
    /// Centre and axes in the body's frame, m.
    pub offset: Vec3,
    pub axes: Quat,
    /// Radius of the bounding ball about its centre, m.
    pub bounding_radius: f64,
    /// Index into `Scene::colours`.
    pub colour: u16,
    /// Row and column in the visibility table.
    pub class: u16,
}

/// Wire or rod between points of two bodies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointLink {
    /// Bodies; the candidate is the first in BODIES.DAT.
    pub bodies: [BodyId; 2],
    /// Points in the frames of the bodies, m.
    pub offsets: [Vec3; 2],
    /// Numbers of the points, which follow the numbers of the parts of their bodies.
    pub part_numbers: ContactSides<u16>,
    /// Distance of the points in BODIES.DAT, m: the length without strain.
    pub rest_length: f64,
    pub law: LawId,
}

/// Whether a body is in the run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BodyPresence {
    /// Not yet entered from its source.
    Waiting,
    Present,
    /// Left by a sink.
    Gone,
}

/// Constant data of a body.
#[derive(Debug, Clone)]
pub struct RigidBody {
    pub shape: BodyShape,
    /// Radius of the sphere of equal volume, m.
    pub radius: f64,
    /// Mass, kg.
    pub mass: f64,
    /// Principal moments of inertia, kg m^2; a sphere's are equal.
    pub inertia: [f64; 3],
    /// Whether it is a driven body: some or all components of its velocity are imposed, or it is absent.
    pub driven: bool,
    /// Components of the velocity that forces and moments change: along the fixed axes, then about the body's axes. A body
    /// without any has no inverse mass; a body that is not driven has all.
    pub free_components: [bool; 6],
    /// Whether the body has not yet entered or has left the run. Such a body is a free one, kept as an imposed one without
    /// contacts.
    pub absent: bool,
    /// Index into `Scene::materials`.
    pub material: u16,
    /// Index into `Scene::colours`.
    pub colour: u16,
    /// Row and column of the body in the visibility table.
    pub class: u16,
}

impl RigidBody {
    /// Inverse mass, 1/kg; 0 for a body whose motion is all imposed.
    pub fn inverse_mass(&self) -> f64 {
        if self.is_imposed() { 0.0 } else { 1.0 / self.mass }
    }

    /// Whether it is an imposed body: all components of its velocity are imposed.
    pub fn is_imposed(&self) -> bool {
        self.driven && !self.is_driven_in_part()
    }

    /// Whether it is driven in part: some components of its velocity are imposed, and others are not.
    pub fn is_driven_in_part(&self) -> bool {
        self.driven && self.free_components.contains(&true)
    }

    /// Whether normal forces can move it: some of its motion is not imposed, and of a sphere some of its translation, as its
    /// normals pass through its centre.
    pub fn can_be_pushed(&self) -> bool {
        let is_sphere = matches!(self.shape, BodyShape::Sphere { .. });
        self.free_components[..3].contains(&true) || (self.can_rotate() && !is_sphere)
    }

    /// 1 for each fixed axis along which the velocity of a body driven in part is imposed, else 0.
    pub fn locked_axes(&self) -> Vec3 {
        Vec3::from_fn(|k, _| if self.is_driven_in_part() && !self.free_components[k] { 1.0 } else { 0.0 })
    }

    /// The part of a vector along the fixed axes along which the velocity is imposed.
    pub fn imposed_part(&self, vector: &Vec3) -> Vec3 {
        Vec3::from_fn(|k, _| if self.free_components[k] { 0.0 } else { vector[k] })
    }

    /// The part of a vector in fixed axes along the axes of the body, with the orientation `q`, about which its rotation is
    /// imposed.
    pub fn imposed_rotation_part(&self, q: &Quat, vector: &Vec3) -> Vec3 {
        if self.rotates_freely() {
            return Vec3::zeros();
        }
        let own = q.inverse_transform_vector(vector);
        q * Vec3::from_fn(|k, _| if self.free_components[3 + k] { 0.0 } else { own[k] })
    }

    /// Energy of the rotation with the angular velocity `w` (rad/s, fixed axes), J.
    pub fn rotational_energy(&self, q: &Quat, w: &Vec3) -> f64 {
        0.5 * self.angular_momentum(q, w).dot(w)
    }

    /// Imposed components of the velocity as in the files: bit k for component k.
    pub fn imposed_components(&self) -> u8 {
        if self.absent {
            return 0;
        }
        (0..6).map(|k| if self.free_components[k] { 0 } else { 1 << k }).sum()
    }

    /// Whether moments change all components of its angular velocity.
    pub fn rotates_freely(&self) -> bool {
        self.free_components[3..] == [true; 3]
    }

    /// Whether moments change some component of its angular velocity.
    pub fn can_rotate(&self) -> bool {
        self.free_components[3..].contains(&true)
    }

    /// Whether some components of its angular velocity are imposed, and others are not.
    pub fn rotates_in_part(&self) -> bool {
        self.can_rotate() && !self.rotates_freely()
    }

    /// Curvature of its plates, cylinders and surfaces: 0 next to spheres, and of a body that is driven and does not rotate by moments.
    fn curvature_of_flat_part(&self) -> ContactorCurvature {
        let value = if self.can_rotate() { 1.0 / self.radius } else { 0.0 };
        ContactorCurvature { next_to_sphere: 0.0, ..ContactorCurvature::new(value) }
    }

    /// 1 for each axis of the body about which moments turn it, else 0.
    fn free_rotations(&self) -> Vec3 {
        Vec3::from_fn(|k, _| if self.free_components[3 + k] { 1.0 } else { 0.0 })
    }

    /// Inverse moment of inertia of a sphere that [rotates freely](Self::rotates_freely), 1/(kg m^2), else 0.
    pub fn inverse_inertia(&self) -> f64 {
        if self.rotates_freely() { 1.0 / self.inertia[0] } else { 0.0 }
    }

    /// Inverse inertia in the world frame of the body with the orientation `q`, 1/(kg m²): the inverse of the block of the
    /// inertia of the components that are not imposed, 0 in all others. The body's axes are principal, so that the block is
    /// diagonal in them.
    pub fn inverse_inertia_matrix(&self, q: &Quat) -> Mat3 {
        if !self.can_rotate() {
            return Mat3::zeros();
        }
        if self.rotates_freely() && self.is_isotropic() {
            return Mat3::from_diagonal_element(1.0 / self.inertia[0]);
        }
        let axes = q.to_rotation_matrix();
        let own = Vec3::from(self.inertia.map(|j| 1.0 / j)).component_mul(&self.free_rotations());
        axes * Mat3::from_diagonal(&own) * axes.transpose()
    }

    /// Angular momentum about the centre of mass, kg m²/s, world frame, of the body with the orientation `q` and the angular
    /// velocity `w` (rad/s, world frame).
    pub fn angular_momentum(&self, q: &Quat, w: &Vec3) -> Vec3 {
        if self.is_isotropic() { w * self.inertia[0] } else { rotation::angular_momentum(q, &self.inertia, w) }
    }

    /// Change of the angular velocity, rad/s, world frame, by an angular impulse; 0 about axes of imposed rotation.
    pub fn angular_velocity(&self, q: &Quat, impulse: &Vec3) -> Vec3 {
        if self.rotates_in_part() {
            let own = q.inverse_transform_vector(impulse).component_mul(&self.free_rotations());
            q * own.component_div(&Vec3::from(self.inertia))
        } else if self.is_isotropic() || !self.can_rotate() {
            impulse * self.inverse_inertia()
        } else {
            rotation::angular_velocity(q, &self.inertia, impulse)
        }
    }

    /// Whether all axes are principal: angular velocity and angular momentum are then parallel.
    pub fn is_isotropic(&self) -> bool {
        let [a, b, c] = self.inertia;
        a == b && b == c
    }

    /// Whether the body is a single sphere about its centre of mass.
    pub fn is_sphere(&self) -> bool {
        matches!(self.shape, BodyShape::Sphere { .. })
    }
}

/// Law and alert distance (m) of a pair of classes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InteractionRule {
    pub law: LawId,
    /// Alert distance, m.
    pub alert: f64,
}

impl Index<LawId> for Vec<ContactLaw> {
    type Output = ContactLaw;

    #[inline(always)]
    fn index(&self, law: LawId) -> &ContactLaw {
        &self[law.index()]
    }
}

impl Index<LawId> for Vec<LawName> {
    type Output = LawName;

    fn index(&self, law: LawId) -> &LawName {
        &self[law.index()]
    }
}

/// Visibility table: classes that interact, and their laws.
#[derive(Debug, Clone, Default)]
pub struct VisibilityTable {
    /// Number of classes.
    pub classes: usize,
    /// Rule of each pair of classes, row by row; `None` if they do not interact.
    pub table: Vec<Option<InteractionRule>>,
}

impl VisibilityTable {
    /// Rule of two classes, if they interact.
    pub fn interaction_rule(&self, a: u16, b: u16) -> Option<InteractionRule> {
        self.table[a as usize * self.classes + b as usize]
    }
}

/// Curvature 1/R of a contactor, 1/m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactorCurvature {
    /// Curvature next to all but spheres.
    pub value: f64,
    /// Curvature next to a sphere: plates and cylinders are flat there, however their bodies move.
    pub next_to_sphere: f64,
    pub is_sphere: bool,
}

impl ContactorCurvature {
    /// Curvature of a contactor that is no sphere; `value` next to all others, too.
    fn new(value: f64) -> Self {
        Self { value, next_to_sphere: value, is_sphere: false }
    }

    fn sphere(radius: f64) -> Self {
        Self { is_sphere: true, ..Self::new(1.0 / radius) }
    }

    /// Curvature next to another contactor, 1/m.
    #[inline(always)]
    fn next_to(&self, other: &Self) -> f64 {
        if other.is_sphere { self.next_to_sphere } else { self.value }
    }
}

/// Effective radius R, 1/R = 1/R_a + 1/R_b, of two curvatures, m; two flat walls have the radius `flat_radius`.
#[inline(always)]
pub fn radius_of_curvatures([a, b]: [ContactorCurvature; 2], flat_radius: impl Fn() -> f64) -> f64 {
    let sum = a.next_to(&b) + b.next_to(&a);
    if sum > 0.0 { 1.0 / sum } else { flat_radius() }
}

/// Steps made when neither `steps` nor `end_time` is given.
pub const DEFAULT_STEPS: u64 = 1000;

/// Gap, divided by the smaller radius and the steps of lookahead, up to which a pair is listed and solved in any
/// direction of motion, if the speeds suffice, because contact impulses may close it. In a suitable step bodies move
/// that far.
pub const NEARBY_GAP: f64 = 0.1;

/// Number of bodies below which self-gravity is evaluated at every step: few bodies may be on orbits, and their sums are
/// cheap.
const MIN_BODIES_TO_EXTRAPOLATE: usize = 100;

/// Number of a step and the time at its end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepTime {
    pub step: u64,
    /// Time, s.
    pub time: f64,
}

/// Lists of a scene with all its bodies, of which some may be absent; only if the run has sinks or sources.
#[derive(Debug, Clone)]
pub struct BodyRoster {
    pub free: Vec<BodyId>,
    pub spheres: Vec<BodyId>,
    pub free_rotors: Vec<BodyId>,
    pub parts: Vec<BodyPart>,
    pub part_starts: Vec<PartId>,
    /// Radius of the bounding ball of each body about its centre of mass, m.
    pub bounding_radii: Vec<f64>,
    /// Bodies of each source, in the order in which they enter, with the velocities that they then have.
    pub entries: Vec<Vec<(BodyId, Twist)>>,
}

/// Constant data of a run: bodies, laws, imposed motion and options. Lists of free bodies, spheres and contactors have
/// the bodies that are in the run, which sinks and sources change.
#[derive(Debug, Clone)]
pub struct Scene {
    pub bodies: Vec<RigidBody>,
    pub drives: Vec<ImposedVelocity>,
    pub loads: Vec<ImposedLoad>,
    /// Areas of the walls whose pressure a probe follows.
    pub wall_areas: Vec<WallArea>,
    /// Hollow cylinders whose radius changes, in the order of the option `radii`.
    pub radii: Vec<ChangingRadius>,
    pub laws: Vec<ContactLaw>,
    pub visibility: VisibilityTable,
    /// Whether there are free bodies without a rule, which pass through each other.
    pub has_unseen_pairs: bool,
    pub options: Compute,
    /// Shapes of the attracting polyhedra among the fields of the options.
    pub field_shapes: FieldShapes,
    /// Step and time of the state in DATBOX.
    pub start: StepTime,
    /// Whether the run begins with the motion with which the last step of another run ended, and continues that run.
    pub continues_run: bool,
    /// Step and time from which steps of `dt` are counted: start of the run, unless `dt` has changed at a resume.
    pub counted_from: StepTime,
    /// Events of the options ordered by time; repeated ones occur once per repetition.
    pub events: Vec<Event>,
    /// Names of the colours, for the files.
    pub colours: Vec<String>,
    pub materials: Vec<MaterialName>,
    pub law_names: Vec<LawName>,
    /// Positions in BODIES.DAT, m, from which LMGC90's files count displacements.
    pub reference: Vec<Vec3>,
    /// Orientations at the start, body to world, unless DOF.INI gives them.
    pub axes: Vec<Quat>,
    /// Lists with all bodies, if the run has sinks or sources.
    pub roster: Option<Arc<BodyRoster>>,
    /// Free bodies, of which no component of the velocity is imposed, in order.
    pub free: Vec<BodyId>,
    /// Whether each body is a [wall](cd_formats::snapshot::are_walls): one that the energies do not count.
    pub walls: Vec<bool>,
    /// Grains that are driven in part, in order.
    pub held_grains: Vec<BodyId>,
    /// Spheres, free or driven, in order.
    pub spheres: Vec<BodyId>,
    /// Whether each body is a sphere; a packed array, as contacts read it in any order.
    pub sphere_flags: Vec<bool>,
    /// Plates, in order.
    pub planes: Vec<BodyId>,
    /// Contactors of all bodies, ordered by body, if some body is neither a sphere nor a plate, is driven in part, or is a
    /// plate that moves; otherwise empty.
    pub parts: Vec<BodyPart>,
    /// Whether some contactor in `parts` is a sphere.
    pub has_round_parts: bool,
    /// Whether some contactor in `parts` is a solid cylinder of a body that moves.
    pub has_rollers: bool,
    /// Whether some contactor in `parts` is a hollow cylinder.
    pub has_drums: bool,
    /// Index in `parts` of the first contactor of each body, and the length of `parts`; empty if there are no
    /// parts. Read by [`Self::parts_of`] and [`Self::part_index`].
    pub part_starts: Vec<PartId>,
    /// Wires and rods, ordered by bodies and numbers of points; a scene that has some has `parts`.
    pub links: Vec<PointLink>,
    /// Commands of POSTPRO.DAT.
    pub postpro: Vec<PostproCommand>,
    /// Notes for the user about the bodies in the files.
    pub notes: Vec<String>,
    /// Probable mistakes in the input.
    pub warnings: Vec<String>,
    /// Bodies whose rotation is not imposed and whose moments of inertia differ, in order: their angular velocity changes
    /// without a torque.
    pub free_rotors: Vec<BodyId>,
    /// Bodies whose rotation is imposed about some of their axes and whose moments of inertia differ, in order.
    pub constrained_rotors: Vec<BodyId>,
    /// Whether the orientation of each body is integrated; a sphere's matters only to moments and rotations in its own
    /// axes.
    pub oriented: Vec<bool>,
    /// Mean radius of the free bodies, m, or of those driven in part if none is free; the length that penetrations are
    /// compared with.
    pub mean_radius: f64,
    /// Smallest radius of the same bodies, m.
    pub smallest_radius: f64,
    /// Largest gap (m) at which a pair is listed, over all rows of the visibility table.
    pub listing_range: f64,
}

fn is_polyhedron(shape: &ContactorShape) -> bool {
    matches!(shape, ContactorShape::Polyhedron(_))
}

impl Scene {
    /// Imposed motion of a driven body at `time` (s), world frame. `x` (m) and `q`: poses of all bodies. With a strain
    /// rate or pivot it is the constant velocity that brings the body onto its path in the time `h` (s); h = 0 gives
    /// the velocity at the instant. Components that are not imposed are those of `pushed`.
    pub fn imposed_motion(
        &self,
        drive: &ImposedVelocity,
        time: f64,
        x: &[Vec3],
        q: &[Quat],
        h: f64,
        pushed: &Twist,
    ) -> Twist {
        let i = drive.body.index();
        let mut motion = drive.motion_of_components(time, &q[i], pushed);
        if let Some(pivot) = &drive.pivot {
            motion.v = pivot.centre_velocity(&x[i], &q[i], &motion.w, h);
        }
        if let Some(strain) = &drive.strain {
            let opposite = strain.opposite.index();
            let row = self.drives.binary_search_by_key(&strain.opposite, |drive| drive.body);
            let imposed = row.ok().and_then(|row| self.drives[row].velocity[strain.component].as_ref());
            let opposite_velocity = imposed.map_or(0.0, |value| value.value_at(time));
            motion.v[strain.component] = opposite_velocity + strain.relative_velocity(time, &x[i], &x[opposite], h);
        }
        motion
    }

    /// Circles of the walls with a revolution at a rate.
    pub fn wall_circles(&self) -> Vec<WallCircle> {
        let circle = |drive: &ImposedVelocity| {
            let WallPivot { point, offset } = drive.pivot?;
            Some(WallCircle { body: drive.body.number() as u64, point: point.into(), offset: offset.into() })
        };
        self.drives.iter().filter_map(circle).collect()
    }

    /// Moves walls with a revolution at a rate onto these circles, if they turn about the same points.
    pub fn set_wall_circles(&mut self, circles: &[WallCircle]) {
        for drive in &mut self.drives {
            let Some(pivot) = &mut drive.pivot else { continue };
            let is_of_wall = |circle: &&WallCircle| {
                circle.body == drive.body.number() as u64 && Vec3::from(circle.point) == pivot.point
            };
            if let Some(circle) = circles.iter().find(is_of_wall) {
                pivot.offset = circle.offset.into();
            }
        }
    }

    /// Motions of the surfaces of walls at a time (s), with the orientations `q`, by body; empty if no surface moves.
    pub fn surface_motions(&self, time: f64, q: &[Quat]) -> Vec<SurfaceMotion> {
        let motion = |drive: &ImposedVelocity| {
            let surface = drive.surface.as_ref()?;
            let value = |k: usize| surface[k].as_ref().map_or(0.0, |value| value.value_at(time));
            let [v, w] = [0, 3].map(|first| Vec3::from_fn(|k, _| value(first + k)));
            Some(SurfaceMotion { body: drive.body, v, w: q[drive.body.index()] * w, growth: None })
        };
        self.drives.iter().filter_map(motion).collect()
    }
}

impl Scene {
    /// Whether a command of POSTPRO.DAT needs the solver's criteria.
    pub fn has_solver_file(&self) -> bool {
        self.postpro.iter().any(|command| command.kind == PostproKind::SolverInformations)
    }

    /// Whether figures of a step are computed from its start.
    pub fn keeps_step_start(&self) -> bool {
        let has_forces = |probe: &Probe| {
            matches!(
                probe.quantity,
                ProbeQuantity::Force { .. } | ProbeQuantity::Pressure { .. } | ProbeQuantity::Region { .. }
            )
        };
        !self.postpro.is_empty() || self.options.probes.iter().any(has_forces)
    }

    /// Bodies of a selection, rising.
    pub fn selected_bodies(&self, bodies: &BodySelection) -> Vec<BodyId> {
        match bodies {
            BodySelection::Body(number) => vec![BodyId::new(number - 1)],
            BodySelection::Free => self.roster.as_ref().map_or(&self.free, |roster| &roster.free).clone(),
            BodySelection::Colour(colour) => {
                let has_colour = |index: u16| self.colours[usize::from(index)] == *colour;
                let is_selected = |&body: &BodyId| match self.all_parts_of(body) {
                    [] => has_colour(self.bodies[body.index()].colour),
                    parts => parts.iter().any(|part| has_colour(part.colour)),
                };
                (0..self.bodies.len()).map(BodyId::new).filter(is_selected).collect()
            }
        }
    }

    /// Radius of the bounding ball of a body about its centre of mass, m.
    pub fn bounding_radius(&self, body: BodyId) -> f64 {
        let extent = |part: &BodyPart| part.offset.norm() + part.bounding_radius;
        match self.bodies[body.index()].shape {
            BodyShape::Sphere { radius } => radius,
            BodyShape::Plane { half_lengths } => half_lengths.norm(),
            BodyShape::Parts => self.all_parts_of(body).iter().map(extent).fold(0.0, f64::max),
        }
    }

    /// Sums of whole periods that shift bodies of the cell about the origin, and branches to their neighbours, into a region,
    /// m. None for more than a region can have, and for a region without a volume.
    pub fn region_images(&self, region: &SpaceRegion, bodies: &[BodyId]) -> Option<Vec<Vec3>> {
        // A branch reaches from a body of the cell to the centre of a neighbour.
        let reach = 2.0 * bodies.iter().map(|&body| self.bounding_radius(body)).fold(0.0, f64::max);
        region.convex_region()?.image_shifts(self.options.periods(), reach)
    }

    /// Whether a body is in the run.
    pub fn is_present(&self, body: BodyId) -> bool {
        !self.bodies[body.index()].absent
    }

    /// Removes the absent bodies from all lists, and adds those that are present again. Without a roster all are present.
    pub fn set_presence(&mut self, presence: &[BodyPresence]) {
        let Some(roster) = self.roster.clone() else { return };
        for body in &roster.free {
            let (i, absent) = (body.index(), presence[body.index()] != BodyPresence::Present);
            let rigid_body = &mut self.bodies[i];
            (rigid_body.absent, rigid_body.driven, rigid_body.free_components) = (absent, absent, [!absent; 6]);
            self.walls[i] = absent;
        }
        let present_bodies = |bodies: &[BodyId]| -> Vec<BodyId> {
            bodies.iter().copied().filter(|body| presence[body.index()] == BodyPresence::Present).collect()
        };
        self.free = present_bodies(&roster.free);
        self.spheres = present_bodies(&roster.spheres);
        self.free_rotors = present_bodies(&roster.free_rotors);
        if !roster.parts.is_empty() {
            // Polyhedra are large: those that stay are moved.
            let mut before = std::mem::take(&mut self.parts).into_iter().peekable();
            self.part_starts.clear();
            for (i, presence) in presence.iter().enumerate() {
                self.part_starts.push(PartId::new(self.parts.len()));
                let is_present = *presence == BodyPresence::Present;
                let first = self.parts.len();
                while let Some(part) = before.next_if(|part| part.body.index() == i) {
                    self.parts.extend(is_present.then_some(part));
                }
                if is_present && self.parts.len() == first {
                    let [start, end] = [i, i + 1].map(|k| roster.part_starts[k].index());
                    self.parts.extend_from_slice(&roster.parts[start..end]);
                }
            }
            self.part_starts.push(PartId::new(self.parts.len()));
        }
    }

    /// Last step of the run.
    pub fn last_step(&self) -> u64 {
        let StepTime { step, time } = self.counted_from;
        self.options.last_step(self.start.step, (step, time)).unwrap_or(self.start.step + DEFAULT_STEPS)
    }

    /// Time at the end of the last step, s.
    pub fn end_time(&self) -> f64 {
        self.time_at(self.last_step())
    }

    /// Time at the end of a step, s. It is computed as a product, as a sum would round at each step.
    pub fn time_at(&self, step: u64) -> f64 {
        let StepTime { step: first, time } = self.counted_from;
        time + step.saturating_sub(first) as f64 * self.options.dt
    }

    /// Whether an imposed velocity or force depends on time.
    pub fn changes_in_time(&self) -> bool {
        self.drives.iter().any(ImposedVelocity::depends_on_position)
            || !self.imposed_functions().all(Evolution::is_constant)
    }

    /// Functions of time of all imposed velocities, rates and loads.
    fn imposed_functions(&self) -> impl Iterator<Item = &Evolution> {
        self.drives.iter().flat_map(ImposedVelocity::functions).chain(self.loads.iter().map(|load| &load.value))
    }

    /// Time (s) up to which all imposed velocities and forces remain as they are at `time`: `time` itself while one
    /// changes, infinite if none changes any more.
    pub fn constant_until(&self, time: f64) -> f64 {
        if self.drives.iter().any(ImposedVelocity::depends_on_position) {
            return time;
        }
        self.imposed_functions().map(|value| value.constant_until(time)).fold(f64::INFINITY, f64::min)
    }

    /// Radius (m) of the ball that the free bodies would form without pores, and self-gravity at its surface, m/s²;
    /// `None` without self-gravity.
    pub fn surface_gravity(&self) -> Option<(f64, f64)> {
        let free_bodies = || self.free.iter().map(|&i| &self.bodies[i.index()]);
        let radius = libm::cbrt(free_bodies().map(|body| body.radius.powi(3)).sum());
        let strength = self.options.gravity_constant * free_bodies().map(|body| body.mass).sum::<f64>();
        (self.has_self_gravity() && !self.free.is_empty()).then_some((radius, strength / (radius * radius)))
    }

    /// Free bodies, or those driven in part if none is free: the bodies of which the run computes the motion.
    pub fn moving_bodies(&self) -> Vec<BodyId> {
        let driven_in_part =
            || (0..self.bodies.len()).filter(|&i| self.bodies[i].is_driven_in_part()).map(BodyId::new).collect();
        if self.free.is_empty() { driven_in_part() } else { self.free.clone() }
    }

    /// Effective radius R, 1/R = 1/R_a + 1/R_b, of two contactors, each a body and the number of its part, m.
    pub fn effective_radius(&self, a: (BodyId, u16), b: (BodyId, u16)) -> f64 {
        let curvatures = [a, b].map(|contactor| self.contactor_curvature(contactor));
        radius_of_curvatures(curvatures, || {
            let extent = |(body, part_number): (BodyId, u16)| {
                self.find_part(body, part_number).map_or(f64::INFINITY, |part| part.bounding_radius)
            };
            extent(a).min(extent(b))
        })
    }

    /// Smaller radius of two contactors, each a body and the number of its part, m; infinite for two flat ones.
    pub fn smaller_radius(&self, a: (BodyId, u16), b: (BodyId, u16)) -> f64 {
        let [a, b] = [a, b].map(|contactor| self.contactor_curvature(contactor));
        1.0 / a.next_to(&b).max(b.next_to(&a))
    }

    /// Size of a pair of contactors, each a body and the number of its part, m: the radius of the smaller free body, limited
    /// to the sum of the inner radii, as a pair that overlaps by twice that sum may separate on the wrong side.
    pub fn pair_size(&self, a: (BodyId, u16), b: (BodyId, u16)) -> f64 {
        let free = [a, b].map(|(body, _)| &self.bodies[body.index()]).into_iter().filter(|body| !body.driven);
        free.map(|body| body.radius).fold(self.inner_radius(a) + self.inner_radius(b), f64::min)
    }

    fn inner_radius(&self, (body, part_number): (BodyId, u16)) -> f64 {
        match self.bodies[body.index()].shape {
            BodyShape::Sphere { radius } => radius,
            BodyShape::Plane { half_lengths } => half_lengths.min(),
            BodyShape::Parts => {
                self.find_part(body, part_number).map_or(f64::INFINITY, |part| part.geometry.inner_radius())
            }
        }
    }

    fn contactor_curvature(&self, (body, part_number): (BodyId, u16)) -> ContactorCurvature {
        match self.bodies[body.index()].shape {
            BodyShape::Sphere { radius } => ContactorCurvature::sphere(radius),
            BodyShape::Plane { .. } => self.bodies[body.index()].curvature_of_flat_part(),
            BodyShape::Parts => {
                self.find_part(body, part_number).map_or(ContactorCurvature::new(0.0), |part| self.part_curvature(part))
            }
        }
    }

    /// Curvature of a contactor: next to a sphere, as in LMGC90, plates and cylinders are flat. Otherwise a polyhedron, and a
    /// plate or cylinder that is not a wall, has the curvature of the sphere of its body's volume; walls are flat. A capsule
    /// has that of its ends.
    pub fn part_curvature(&self, part: &BodyPart) -> ContactorCurvature {
        let body = &self.bodies[part.body.index()];
        match part.geometry {
            ContactorShape::Sphere { radius } => ContactorCurvature::sphere(radius),
            ContactorShape::Polyhedron(_) => ContactorCurvature::new(1.0 / body.radius),
            ContactorShape::Capsule { radius, .. } => ContactorCurvature::new(1.0 / radius),
            ContactorShape::Cylinder { .. } | ContactorShape::Plane { .. } | ContactorShape::Mesh(_) => {
                body.curvature_of_flat_part()
            }
        }
    }

    /// Contactors of a body in a scene with [`Self::has_parts`].
    pub fn parts_of(&self, body: BodyId) -> &[BodyPart] {
        let [start, end] = [body.index(), body.index() + 1].map(|k| self.part_starts[k].index());
        &self.parts[start..end]
    }

    /// Contactors of a body that may be absent; none in a scene without [`Self::has_parts`].
    pub fn all_parts_of(&self, body: BodyId) -> &[BodyPart] {
        match &self.roster {
            _ if !self.has_parts() => &[],
            Some(roster) => {
                let [start, end] = [body.index(), body.index() + 1].map(|k| roster.part_starts[k].index());
                &roster.parts[start..end]
            }
            None => self.parts_of(body),
        }
    }

    /// Index in `parts` of a part of a body, if it has that many.
    pub fn part_index(&self, body: BodyId, part_number: u16) -> Option<PartId> {
        let starts = self.part_starts.get(body.index()..body.index() + 2)?;
        let part = PartId(starts[0].0 + u32::from(part_number));
        (part < starts[1]).then_some(part)
    }

    /// Part of a body with this number, in scenes with bodies other than spheres and plates.
    pub fn find_part(&self, body: BodyId, part_number: u16) -> Option<&BodyPart> {
        self.part_index(body, part_number).map(|part| &self.parts[part.index()])
    }

    /// Wire or rod between two points, given by their bodies and numbers.
    pub fn find_link(&self, bodies: [BodyId; 2], part_numbers: ContactSides<u16>) -> Option<&PointLink> {
        let position =
            self.links.binary_search_by_key(&(bodies, part_numbers), |link| (link.bodies, link.part_numbers)).ok()?;
        self.links.get(position)
    }

    /// Cell of the scene at the start.
    pub fn periodic_cell(&self) -> PeriodicCell {
        PeriodicCell::with_periods(self.options.periods())
    }

    /// Whether the scene has a list of parts (`parts`): with shapes other than spheres and plates, bodies driven in part, plates
    /// that move, wires or rods.
    pub fn has_parts(&self) -> bool {
        !BARE && (!self.parts.is_empty() || self.roster.as_ref().is_some_and(|roster| !roster.parts.is_empty()))
    }

    /// Whether a body is a triangulated wall.
    pub fn is_mesh(&self, body: BodyId) -> bool {
        self.has_parts() && self.parts_of(body).iter().any(|part| matches!(part.geometry, ContactorShape::Mesh(_)))
    }

    /// Whether contactors of present bodies are polyhedra.
    pub fn has_polyhedra(&self) -> bool {
        self.parts.iter().any(|part| is_polyhedron(&part.geometry))
    }

    /// Whether bodies that move freely, now or at another time, have polyhedra.
    pub fn has_free_polyhedra(&self) -> bool {
        let (free, parts) = match &self.roster {
            Some(roster) => (&roster.free, &roster.parts),
            None => (&self.free, &self.parts),
        };
        parts.iter().any(|part| is_polyhedron(&part.geometry) && free.binary_search(&part.body).is_ok())
    }

    /// Whether there are contacts that need full blocks, as contacts of points do. The block of a sphere with a sphere, or
    /// with any body whose motion is all imposed, is diagonal.
    pub fn needs_blocks(&self) -> bool {
        let not_diagonal = |body: &RigidBody| body.is_driven_in_part() || (!body.is_sphere() && !body.driven);
        !BARE && (!self.links.is_empty() || self.bodies.iter().any(not_diagonal))
    }

    /// Whether the free bodies attract each other.
    pub fn has_self_gravity(&self) -> bool {
        !BARE && self.options.self_gravity
    }

    /// Whether the fast narrow phase is used (directions may not be optimal).
    pub fn narrow_phase_is_fast(&self) -> bool {
        self.has_parts() && self.options.narrow_phase() == NarrowPhase::Fast
    }

    /// Whether contacts may be bonded.
    pub fn has_bonds(&self) -> bool {
        self.laws.iter().any(ContactLaw::can_bond)
    }

    /// Sort key that determines the candidate of a contact, as in LMGC90: the lower of the two. Spheres come before
    /// capsules before polyhedra before cylinders before plates, surfaces and hollow cylinders, then in general bodies that
    /// are not driven, then the lower number.
    pub fn candidate_order(&self, body: BodyId, part_number: u16) -> (u8, bool, BodyId, u16) {
        let kind =
            match (self.find_part(body, part_number).map(|part| &part.geometry), &self.bodies[body.index()].shape) {
                (Some(ContactorShape::Sphere { .. }), _) | (None, BodyShape::Sphere { .. }) => 0,
                (Some(ContactorShape::Capsule { .. }), _) => 1,
                (Some(ContactorShape::Polyhedron(_)), _) => 2,
                (Some(ContactorShape::Cylinder { hollow: false, .. }), _) => 3,
                (Some(_) | None, _) => 4,
            };
        (kind, self.has_parts() && self.bodies[body.index()].driven, body, part_number)
    }

    /// Class of the part of a body with this number, if it has that many.
    pub fn contactor_class(&self, body: BodyId, part_number: u16) -> Option<u16> {
        match self.bodies[body.index()].shape {
            BodyShape::Parts => Some(self.find_part(body, part_number)?.class),
            _ => (part_number == 0).then_some(self.bodies[body.index()].class),
        }
    }

    /// Solver for self-gravity.
    pub fn gravity_solver(&self) -> GravitySolver {
        let method = match self.options.gravity {
            GravityMethod::Direct => SummationMethod::Direct,
            GravityMethod::Fmm => SummationMethod::Fmm,
            // Only the direct sum knows the radii.
            GravityMethod::Auto if self.options.gravity_softening.is_some() => SummationMethod::Direct,
            GravityMethod::Auto => SummationMethod::Auto,
        };
        let mut gravity = GravitySolver::new(method, self.options.gravity_error());
        gravity.order = self.options.gravity_order;
        gravity.opening = self.options.gravity_opening;
        gravity
    }

    /// Radii with which the free bodies attract each other as balls, m; `None` if they attract as points, as their overlaps are
    /// small.
    pub fn attracting_radii(&self) -> Option<Vec<f64>> {
        let softening = self.options.gravity_softening;
        let is_summed = self.gravity_solver().method_for(self.free.len()) == SummationMethod::Direct;
        ((softening.is_some() || self.has_unseen_pairs) && is_summed).then(|| {
            let radius = |i: &BodyId| self.bodies[i.index()].radius.max(softening.unwrap_or(0.0));
            self.free.iter().map(radius).collect()
        })
    }

    /// Largest number of steps between two evaluations of self-gravity. Unless the option is set, few bodies are evaluated at
    /// every step, and so are direct sums that were chosen by name.
    pub fn gravity_refresh(&self) -> u64 {
        let is_small_or_direct =
            self.free.len() < MIN_BODIES_TO_EXTRAPOLATE || self.gravity_solver().method == SummationMethod::Direct;
        let is_set = self.options.gravity_refresh.is_some();
        if !self.has_self_gravity() || (is_small_or_direct && !is_set) { 1 } else { self.options.gravity_refresh() }
    }

    /// External fields at a time, s, with the response of the primary at this time, if it has one.
    pub fn external_fields(&self, time: f64, response: Option<&PrimaryResponse>) -> Vec<FieldModel> {
        let options = &self.options;
        FieldModel::from_fields(&options.fields, &self.field_shapes, options.gravity_constant, time, response)
    }

    /// Mass of all primaries, kg: one with a response is the only one.
    pub fn primary_mass(&self) -> f64 {
        self.field_shapes.primary_masses(&self.options.fields).into_iter().sum()
    }

    /// Response of the primary at the start, if its field has one: none yet, to the mass of all bodies that it attracts.
    pub fn initial_response(&self) -> Option<PrimaryResponse> {
        self.options.fields.iter().find(|field| field.has_response())?;
        let bodies_mass = self.free.iter().chain(&self.held_grains).map(|body| self.bodies[body.index()].mass).sum();
        Some(PrimaryResponse { bodies_mass, ..PrimaryResponse::default() })
    }

    /// Angular velocity of the frame of reference, rad/s.
    pub fn frame_angular_velocity(&self) -> Vec3 {
        self.options.fields.iter().map(|field| Vec3::from(field.rotation_rate())).sum()
    }

    /// Numbers of bodies, contactors, loads and links of the scene by kind, in words.
    fn body_counts(&self) -> Vec<String> {
        let spheres = |is_counted: fn(&RigidBody) -> bool| {
            self.spheres.iter().filter(|&&i| is_counted(&self.bodies[i.index()])).count()
        };
        let parts = |is_counted_body: fn(&RigidBody) -> bool, is_counted: fn(&ContactorShape) -> bool| {
            let is_of_parts = |part: &&BodyPart| self.bodies[part.body.index()].shape == BodyShape::Parts;
            let parts = self.parts.iter().filter(is_of_parts);
            parts.filter(|part| is_counted_body(&self.bodies[part.body.index()]) && is_counted(&part.geometry)).count()
        };
        let [is_free, is_driven]: [fn(&RigidBody) -> bool; 2] = [|body| !body.driven, |body| body.driven];
        let free_planes = self.planes.iter().filter(|&&i| !self.bodies[i.index()].driven).count();
        let sphere = |geometry: &ContactorShape| matches!(geometry, ContactorShape::Sphere { .. });
        let cylinder = |geometry: &ContactorShape| matches!(geometry, ContactorShape::Cylinder { .. });
        let capsule = |geometry: &ContactorShape| matches!(geometry, ContactorShape::Capsule { .. });
        let mesh = |geometry: &ContactorShape| matches!(geometry, ContactorShape::Mesh(_));
        let pressures = self.loads.iter().filter(|load| load.area.is_some()).count();
        let servos = |has_servo: fn(&ImposedVelocity) -> bool| self.drives.iter().filter(|d| has_servo(d)).count();
        let counts = [
            (spheres(is_free), "sphere"),
            (spheres(RigidBody::is_imposed), "driven sphere"),
            (parts(is_free, is_polyhedron), "polyhedral contactor"),
            (parts(is_driven, is_polyhedron), "driven polyhedral contactor"),
            (parts(is_free, sphere) + parts(is_driven, sphere), "spherical contactor"),
            (parts(is_driven, cylinder), "cylinder"),
            (parts(is_free, cylinder), "free cylinder"),
            (parts(is_driven, capsule), "driven capsule"),
            (parts(is_free, capsule), "capsule"),
            (parts(is_driven, mesh), "triangulated wall"),
            (self.planes.len() - free_planes, "plane"),
            (free_planes, "free plane"),
            (self.loads.len() - pressures, "imposed force"),
            (pressures, "pressure"),
            (servos(|drive| drive.strain.is_some()), "strain rate"),
            (servos(|drive| drive.pivot.is_some()), "revolution"),
            (servos(|drive| drive.hinged_centre.is_some()), "hinge"),
            (servos(|drive| drive.surface.is_some()), "moving surface"),
            (self.radii.len(), "radial motion"),
            (self.links.len(), "link"),
        ];
        let plural = |n: usize| if n == 1 { "" } else { "s" };
        let present = counts.into_iter().filter(|(n, _)| *n > 0);
        let mut counts: Vec<String> = present.map(|(n, kind)| format!("{n} {kind}{}", plural(n))).collect();
        let spheres_in_part = spheres(RigidBody::is_driven_in_part);
        let bodies_in_part = self.bodies.iter().filter(|body| body.is_driven_in_part()).count();
        let in_part =
            [(spheres_in_part, ["sphere", "spheres"]), (bodies_in_part - spheres_in_part, ["body", "bodies"])];
        let in_part = in_part.into_iter().filter(|(n, _)| *n > 0);
        counts.extend(in_part.map(|(n, names)| format!("{n} {} driven in part", names[usize::from(n > 1)])));
        counts
    }

    /// Names of the models that this scene uses, for the summary.
    pub fn model_names(&self) -> Vec<String> {
        let mut models = self.body_counts();
        models.extend(self.law_names.iter().map(|law| {
            let parameters: Vec<String> = law.parameters.iter().map(|p| p.to_string()).collect();
            format!("{} {} ({})", law.nickname, law.kind, parameters.join(", "))
        }));
        if self.law_names.is_empty() {
            models.push("no contacts: no row of TACT_BEHAV.DAT concerns these bodies".into());
        }
        if self.has_polyhedra() {
            models.push(match self.options.narrow_phase() {
                NarrowPhase::Fast => "narrow phase fast".into(),
                NarrowPhase::Accurate => "narrow phase accurate".into(),
            });
        }
        for (axis, period) in ["x", "y", "z"].into_iter().zip(self.options.periods()) {
            models.extend(period.map(|period| format!("period {period} m along {axis}")));
        }
        models.extend(self.options.cell.map(|_| "a cell that deforms".to_string()));
        if !self.options.impacts.is_simultaneous() {
            models.push("impacts in order".into());
        }
        if self.has_self_gravity() {
            let gravity = self.gravity_solver();
            models.push(match gravity.method_for(self.free.len()) {
                SummationMethod::Direct if self.attracting_radii().is_some() => {
                    "self-gravity by direct sum, of balls".into()
                }
                SummationMethod::Direct => "self-gravity by direct sum".into(),
                _ => format!("self-gravity by fast multipoles, error {}", gravity.error),
            });
            if self.options.gravity_quadrupole {
                let has_all_pairs = gravity.method_for(self.free.len()) == SummationMethod::Direct;
                models.push(if has_all_pairs { "quadrupoles" } else { "quadrupoles of near bodies" }.into());
            }
        }
        models.extend(self.options.fields.iter().map(|field| {
            let motion = match (field.orbit(), field.has_response()) {
                (Some(_), true) => "on an orbit, which responds",
                (Some(_), false) => "on an orbit",
                (None, _) => "at rest",
            };
            match field {
                ExternalField::PointMass { mass, .. } => format!("point mass of {mass:e} kg {motion}"),
                ExternalField::Oblate { mass, .. } => format!("oblate mass of {mass:e} kg {motion}"),
                ExternalField::Polyhedron { surface, density, rate, .. } => {
                    let motion = match (field.orbit(), *rate == [0.0; 3]) {
                        (None, false) => "that turns".into(),
                        (Some(_), false) => format!("that turns {motion}"),
                        (_, true) => motion.to_string(),
                    };
                    format!("attraction of {surface}, {density} kg/m^3, {motion}")
                }
                ExternalField::RotatingFrame { .. } => "rotating axes".into(),
            }
        }));
        if self.options.quench > 0.0 {
            models.push(format!("quench {}", self.options.quench));
        }
        models
    }
}
