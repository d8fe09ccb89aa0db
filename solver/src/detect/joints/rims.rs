//! Removes ghost contacts of spheres at joints of flush plates, in scenes without other shapes; A, B, C and inner contacts as
//! in [`super`]. A is the sphere; B and C are plates.

use smallvec::SmallVec;

use super::inner::{FacePlane, InnerContact, JointScratch, NearbyContactor, SurfaceContact, UpperContactor};
use super::solid::ConvexSolid;
use crate::detect::narrow::ContactGeometry;
use crate::detect::spheres::{ListedPair, contact_geometry};
use crate::detect::travel::TravelBounds;
use crate::integrate::ContactConfiguration;
use crate::math::Vec3;
use crate::scene::{BodyShape, Scene};

/// Returns the `pairs` of spheres and plates except the inner contacts, with rims at joints of flush plates.
pub fn without_inner_rims(
    scene: &Scene,
    q_c: &ContactConfiguration,
    travel_bounds: &TravelBounds,
    pairs: Vec<ListedPair>,
) -> Vec<ListedPair> {
    if scene.planes.len() < 2 {
        return pairs;
    }
    let mut counts = vec![0u32; scene.bodies.len()];
    pairs.iter().for_each(|([sphere, _], _)| counts[sphere.index()] += 1);
    let is_alone = |([sphere, _], _): &ListedPair| counts[sphere.index()] == 1;
    let (mut kept, mut pairs): (Vec<ListedPair>, Vec<ListedPair>) = pairs.into_iter().partition(is_alone);
    pairs.sort_unstable_by_key(|(pair, _)| *pair);
    let (mut scratch, mut inner) = (JointScratch::new(), Vec::new());
    for plates in pairs.chunk_by(|(a, _), (b, _)| a[0] == b[0]) {
        inner.clear();
        SphereOnPlates::new(scene, q_c, travel_bounds, plates).collect_inner_contacts(&mut scratch, &mut inner);
        let is_inner = |k: usize| inner.iter().any(|inner| inner.contact.index as usize == k);
        kept.extend((0..plates.len()).filter(|&k| !is_inner(k)).map(|k| plates[k]));
    }
    kept
}

/// Contacts of one sphere with plates.
struct SphereOnPlates<'a> {
    scene: &'a Scene,
    q_c: &'a ContactConfiguration,
    travel_bounds: &'a TravelBounds<'a>,
    pairs: &'a [ListedPair],
    geometries: SmallVec<[ContactGeometry; 8]>,
}

impl<'a> SphereOnPlates<'a> {
    fn new(
        scene: &'a Scene,
        q_c: &'a ContactConfiguration,
        travel_bounds: &'a TravelBounds<'a>,
        pairs: &'a [ListedPair],
    ) -> Self {
        let geometries = pairs.iter().map(|(pair, _)| contact_geometry(scene, q_c, *pair)).collect();
        SphereOnPlates { scene, q_c, travel_bounds, pairs, geometries }
    }

    /// Appends the inner contacts, with rims at joints of flush plates; [`SurfaceContact::index`] is an index into `pairs`.
    fn collect_inner_contacts(&self, scratch: &mut JointScratch, inner: &mut Vec<InnerContact>) {
        let a = self.upper_contactor();
        let contact_at = |k: usize| self.surface_contact(k);
        let supporting_plane = |covering: &SurfaceContact| {
            a.supporting_plane(covering, &self.nearby_plate(covering), self.geometries[covering.index as usize].gap)
        };
        // `hidden`: contact of A and B, which the contact `covering` of A and C may make an inner one.
        let is_inner = |hidden: &SurfaceContact, covering: &SurfaceContact, plane: &FacePlane| {
            let (b, c) = (self.nearby_plate(hidden), self.nearby_plate(covering));
            a.is_inner(plane, &c, &b, &hidden.normal, std::iter::once(hidden.point))
        };
        scratch.find_inner_contacts(self.pairs.len(), contact_at, supporting_plane, is_inner, inner);
    }

    /// The sphere, A.
    fn upper_contactor(&self) -> UpperContactor<'a> {
        let sphere = self.pairs[0].0[0].index();
        let (centre, radius) = (self.q_c.x[sphere], self.scene.bodies[sphere].radius);
        let (travel, lookahead) = (self.travel_bounds.travel[sphere], self.travel_bounds.lookahead);
        UpperContactor { solid: ConvexSolid::Sphere { radius }, centre, radius, travel, lookahead }
    }

    /// Plate of pair `k`: its body and its half lengths, m.
    fn plate(&self, k: usize) -> (usize, &'a Vec3) {
        let plate = self.pairs[k].0[1].index();
        let BodyShape::Plane { half_lengths } = &self.scene.bodies[plate].shape else {
            unreachable!("these are plates")
        };
        (plate, half_lengths)
    }

    /// Contact of the sphere with the plate of pair `k`.
    fn surface_contact(&self, k: usize) -> SurfaceContact {
        let (found, (plate, half_lengths)) = (&self.geometries[k], self.plate(k));
        let x = self.q_c.x[self.pairs[k].0[0].index()];
        SurfaceContact {
            index: k as u32,
            a_is_antagonist: false,
            normal: found.normal,
            point: found.point - x - found.normal * (0.5 * found.gap),
            centre: self.q_c.x[plate] + self.q_c.cell.nearest_shift(&(x - self.q_c.x[plate])) - x,
            reach: 2.0 * half_lengths.norm(),
        }
    }

    /// Plate of a contact, B or C.
    fn nearby_plate(&self, touch: &SurfaceContact) -> NearbyContactor<'a> {
        let (plate, half_lengths) = self.plate(touch.index as usize);
        let solid = ConvexSolid::Cuboid { axes: &self.q_c.q[plate], half_lengths };
        let (v, w) = (self.travel_bounds.velocities.v[plate], self.travel_bounds.velocities.w[plate]);
        NearbyContactor { solid, centre: touch.centre, v, w, body_centre: touch.centre }
    }
}
