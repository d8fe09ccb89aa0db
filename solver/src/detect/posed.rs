//! Contactors at their positions in the step, and pairs of them.

use cd_formats::geometry::periodic_cell::PeriodicCell;
use cd_formats::wall_mesh::WallMesh;
use rayon::prelude::*;

use super::swept;
use super::travel::{LISTING_MARGIN, TravelBounds};
use crate::geometry::{ContactPoint, ListingRange, Manifold, PosedPolyhedron};
use crate::integrate::ContactConfiguration;
use crate::math::{Quat, Vec3};
use crate::scene::{
    BodyId, BodyPart, ContactSides, ContactorCurvature, ContactorShape, LawId, Scene, radius_of_curvatures,
};
use crate::state::{Contact, VisiblePair};

/// Position of a contactor and the scene data that its pairs need, packed so that a pair reads little memory.
pub struct PosedContactor<'a> {
    /// Centre, world frame, m.
    pub centre: Vec3,
    /// Orientation, from the contactor's frame to the world.
    pub axes: Quat,
    /// Largest displacement of a point of the contactor in the step, m, `affine_travel` included.
    pub travel: f64,
    /// Allowance in `travel` for the displacement relative to any listed contactor by the affine field of a deforming cell, m;
    /// 0 in other scenes.
    pub affine_travel: f64,
    /// Radius of the bounding ball with travel and half of the listing distance, m.
    pub listing_radius: f64,
    /// Displacement of the centre in the step, in a deforming cell about the affine field, m.
    pub path: Vec3,
    /// Rotation in the step, rad.
    pub turn: Vec3,
    /// Largest distance from the centre of the points that a rotation moves, m: 0 for a sphere.
    pub rotating_extent: f64,
    /// Radius of the bounding ball, m.
    pub radius: f64,
    /// Largest deviation of the centre's trajectory from a straight line due to the body's rotation, m.
    pub bend: f64,
    /// Displacement in the step of the inside of a hollow cylinder by the change of its radius, m; 0 of others.
    pub growth: f64,
    /// Accumulated displacement of its surface, m.
    pub accumulated_travel: f64,
    /// Curvature used by cohesion, 1/m.
    pub curvature: ContactorCurvature,
    pub body: BodyId,
    /// Row and column in the visibility table.
    pub class: u16,
    /// Whether all of its body's motion is imposed.
    pub is_imposed: bool,
    /// Index among the contactors of its body.
    pub number: u16,
    pub shape: PosedShape<'a>,
}

/// Shape of a contactor, polyhedra with their orientation; lengths in m.
pub enum PosedShape<'a> {
    Sphere { radius: f64 },
    Polyhedron(PosedPolyhedron<'a>),
    Cylinder { half_height: f64, radius: f64, hollow: bool },
    Capsule { half_length: f64, radius: f64 },
    Plane { half_lengths: Vec3, cuboid: PosedPolyhedron<'a> },
    Mesh(&'a WallMesh),
}

/// All contactors of the scene, in the order of its parts.
pub fn posed_contactors<'a>(
    scene: &'a Scene,
    q_c: &ContactConfiguration,
    bounds: &TravelBounds,
) -> Vec<PosedContactor<'a>> {
    scene.parts.par_iter().with_min_len(64).map(|part| posed_contactor(scene, part, q_c, bounds)).collect()
}

fn posed_contactor<'a>(
    scene: &Scene,
    part: &'a BodyPart,
    q_c: &ContactConfiguration,
    bounds: &TravelBounds,
) -> PosedContactor<'a> {
    let i = part.body.index();
    let q = &q_c.q[i];
    let arm = q * part.offset;
    let axes = q * part.axes;
    let changed_radius = q_c.changing_radius(part.body);
    let bounding_radius = match (&part.geometry, changed_radius) {
        (ContactorShape::Cylinder { half_height, .. }, Some(radius)) => libm::hypot(radius, *half_height),
        _ => part.bounding_radius,
    };
    let growth = bounds.growth(part.body);
    let own_travel = bounds.surface_travel(i, arm.norm() + bounding_radius) + bounds.affine_travel(&arm) + growth;
    let own_reach = bounding_radius + own_travel + 0.5 * scene.listing_range;
    let affine_travel = own_reach * (bounds.reach_factor() - 1.0);
    let turn = bounds.rotation_vector(i);
    PosedContactor {
        centre: q_c.x[i] + arm,
        axes,
        travel: own_travel + affine_travel,
        affine_travel,
        listing_radius: own_reach + affine_travel,
        path: bounds.centre_path(i) + turn.cross(&arm) - bounds.affine_path(&arm),
        turn,
        rotating_extent: if matches!(part.geometry, ContactorShape::Sphere { .. }) { 0.0 } else { bounding_radius },
        radius: bounding_radius,
        bend: (0.5 * turn.norm_squared() * arm.norm()).min(own_travel),
        growth,
        accumulated_travel: 0.0,
        curvature: scene.part_curvature(part),
        body: part.body,
        class: part.class,
        is_imposed: scene.bodies[i].is_imposed(),
        number: part.number,
        shape: match &part.geometry {
            ContactorShape::Sphere { radius } => PosedShape::Sphere { radius: *radius },
            ContactorShape::Polyhedron(shape) => PosedShape::Polyhedron(shape.posed_by(&axes)),
            ContactorShape::Cylinder { half_height, radius, hollow } => {
                let radius = changed_radius.unwrap_or(*radius);
                PosedShape::Cylinder { half_height: *half_height, radius, hollow: *hollow }
            }
            ContactorShape::Capsule { half_length, radius } => {
                PosedShape::Capsule { half_length: *half_length, radius: *radius }
            }
            ContactorShape::Plane { half_lengths, cuboid } => {
                PosedShape::Plane { half_lengths: *half_lengths, cuboid: cuboid.posed_by(&axes) }
            }
            ContactorShape::Mesh(mesh) => PosedShape::Mesh(mesh),
        },
    }
}

/// Ratio of gap to smaller radius, up to which a pair gets all its points even if it does not close: faces in contact
/// during a common fall are pushed together at all their points once something stops them.
const FULL_MANIFOLD_GAP: f64 = 1e-3;

/// Settings that all pairs share.
#[derive(Clone, Copy)]
pub struct PairSettings<'a> {
    pub bounds: &'a TravelBounds<'a>,
    pub cell: &'a PeriodicCell,
}

/// Two contactors that may be near each other.
#[derive(Clone, Copy)]
pub struct CandidatePair<'a> {
    /// Index of the pair in its chunk.
    pub index: usize,
    pub a: &'a PosedContactor<'a>,
    pub b: &'a PosedContactor<'a>,
    /// Vector from the centre of `a` to that of the nearest periodic image of `b`, m.
    pub c: Vec3,
    /// Vector from `b` to this image, m.
    pub image: Vec3,
    pub range: ListingRange,
    pub law: LawId,
    /// Gap up to which points are listed whatever the motion, m; infinite if all points are.
    pub unconditional_gap: f64,
    /// Part of the alert distance within which passing bodies are still listed, m.
    pub margin: f64,
    /// Displacement of `b` relative to `a` in the step by the affine field of a deforming cell, m.
    affine_path: Vec3,
}

impl<'a> CandidatePair<'a> {
    /// Sum of the accumulated displacements of the surfaces of two contactors and of their largest possible range, m; cheaper
    /// than [`Self::new`].
    #[inline(always)]
    pub fn listing_reach(
        scene: &Scene,
        contactors: &[PosedContactor],
        nearby_gap_ratio: f64,
        (parts, rule): &VisiblePair,
    ) -> f64 {
        let [a, b] = parts.map(|k| &contactors[k.index()]);
        let cohesion_range = scene.laws[rule.law].interaction_range(Self::effective_radius(a, b));
        let smaller = a.radius.min(b.radius);
        let range = cohesion_range
            .max(a.travel + b.travel)
            .max(nearby_gap_ratio.max(FULL_MANIFOLD_GAP) * smaller)
            .max(rule.alert);
        a.accumulated_travel + b.accumulated_travel + range
    }

    /// Pair number `index` of a chunk, with the range up to which its points are listed.
    #[inline]
    pub fn new(
        scene: &Scene,
        contactors: &'a [PosedContactor<'a>],
        settings: PairSettings,
        index: usize,
        (parts, rule): &VisiblePair,
    ) -> Self {
        let [a, b] = parts.map(|k| &contactors[k.index()]);
        let radius = Self::effective_radius(a, b);
        let law = &scene.laws[rule.law];
        let image = settings.cell.nearest_shift(&(a.centre - b.centre));
        let c = b.centre + image - a.centre;
        let cohesion_range = law.interaction_range(radius);
        // Contactors farther apart than this touch in this step only if a contact pushes them.
        let (mut travel, mut unconditional_gap) = (a.travel + b.travel, f64::INFINITY);
        let nearby = settings.bounds.nearby * a.radius.min(b.radius);
        let affine_path = settings.bounds.affine_path(&c);
        let margin = LISTING_MARGIN * rule.alert;
        if travel > nearby.max(margin) {
            travel = travel.min(surface_approach(a, b, &c, &affine_path, Vec3::norm) + margin).max(nearby);
            unconditional_gap = cohesion_range.max(rule.alert).max(nearby);
        }
        // Faces may rest on each other at the gap that they had at the start.
        let joint = if law.acts_apart() { rule.alert } else { 0.0 };
        let patch = cohesion_range.max(travel).max(joint).max(FULL_MANIFOLD_GAP * a.radius.min(b.radius));
        let range = ListingRange { alert: patch.max(rule.alert), patch, joint, area: law.range_of_stress(radius) };
        CandidatePair { index, a, b, c, image, range, law: rule.law, unconditional_gap, margin, affine_path }
    }

    /// Effective radius of two contactors, m.
    #[inline(always)]
    fn effective_radius(a: &PosedContactor, b: &PosedContactor) -> f64 {
        radius_of_curvatures([a.curvature, b.curvature], || a.radius.min(b.radius))
    }

    /// Whether the bounding balls come within the range in the step.
    pub fn is_near(&self) -> bool {
        let CandidatePair { a, b, c, affine_path, .. } = self;
        let reach = a.listing_radius + b.listing_radius;
        let may_be_near = c.norm_squared() <= reach * reach;
        let reach_without_travel = reach - (a.travel + b.travel);
        may_be_near
            && (self.unconditional_gap == f64::INFINITY
                || swept::least_distance(c, &(b.path - a.path + affine_path)) <= reach_without_travel + a.bend + b.bend)
    }

    /// Gap up to which points with this normal (from the antagonist to the candidate) are listed, m.
    fn listing_gap(&self, normal: &Vec3) -> f64 {
        // The inside of a cylinder and a surface may curve towards a body that moves along them.
        let is_curved = matches!(self.b.shape, PosedShape::Cylinder { hollow: true, .. } | PosedShape::Mesh(_));
        if self.unconditional_gap == f64::INFINITY || is_curved {
            return self.range.alert;
        }
        let closing =
            surface_approach(self.a, self.b, &self.c, &self.affine_path, |against| (-normal.dot(against)).max(0.0));
        self.unconditional_gap.max(closing + self.margin).min(self.range.alert)
    }

    /// Accumulated displacement of both surfaces, m.
    pub fn accumulated_travel(&self) -> f64 {
        self.a.accumulated_travel + self.b.accumulated_travel
    }

    /// Points of a manifold up to the range; points on its area share the area.
    pub fn listed_contacts<'m>(&'m self, manifold: &'m Manifold) -> impl Iterator<Item = Contact> + 'm {
        let CandidatePair { a, b, range, .. } = self;
        let max_gap = self.listing_gap(&manifold.normal);
        let on_area = |point: &ContactPoint| point.gap <= range.area;
        let share = manifold.area / manifold.points.iter().filter(|point| on_area(point)).count() as f64;
        manifold.points.iter().filter(move |point| point.gap <= max_gap).map(move |point| Contact {
            candidate: a.body,
            antagonist: b.body,
            part_numbers: ContactSides { candidate: a.number, antagonist: b.number },
            features: <[u32; 2]>::from(point.features).into(),
            point: a.centre + point.position,
            image: self.image,
            normal: manifold.normal,
            gap: point.gap,
            area: if on_area(point) { share } else { 0.0 },
            law: self.law,
        })
    }
}

/// Approach of the surfaces of `a` and `b` in the step, with b at `c` from a, m: the `component` of their relative
/// displacement, of which b has `affine_path` by the affine field, and the contributions of rotation and growth. The smallest of the
/// values seen by observers who turn with a, with b or not at all: bodies that turn as one do not approach.
fn surface_approach(
    a: &PosedContactor,
    b: &PosedContactor,
    c: &Vec3,
    affine_path: &Vec3,
    component: impl Fn(&Vec3) -> f64,
) -> f64 {
    let path = a.path - b.path - affine_path;
    let turn = (a.turn - b.turn).norm();
    let in_fixed_axes = component(&path) + a.turn.norm() * a.rotating_extent + b.turn.norm() * b.rotating_extent;
    let with_a = component(&(path + a.turn.cross(c))) + turn * b.rotating_extent;
    let with_b = component(&(path + b.turn.cross(c))) + turn * a.rotating_extent;
    in_fixed_axes.min(with_a).min(with_b) + a.growth + b.growth
}
