//! Spheres on flush plates: contacts with the rims between the plates.

use smallvec::SmallVec;

use super::inner::{FacePlane, JointScratch, NearbyContactor, SurfaceContact, UpperContactor};
use super::solid::ConvexSolid;
use crate::detect::spheres::{ListedPair, contact_geometry};
use crate::detect::travel::TravelBounds;
use crate::integrate::ContactConfiguration;
use crate::scene::{BodyShape, Scene};

/// Returns the contacts of spheres with plates without those with rims between flush plates.
pub fn without_inner_rims(
    scene: &Scene,
    q_c: &ContactConfiguration,
    ways: &TravelBounds,
    listed: Vec<ListedPair>,
) -> Vec<ListedPair> {
    if scene.planes.len() < 2 {
        return listed;
    }
    let mut counts = vec![0u32; scene.bodies.len()];
    listed.iter().for_each(|([sphere, _], _)| counts[*sphere as usize] += 1);
    let is_alone = |([sphere, _], _): &ListedPair| counts[*sphere as usize] == 1;
    let (mut left, mut listed): (Vec<ListedPair>, Vec<ListedPair>) = listed.into_iter().partition(is_alone);
    listed.sort_unstable_by_key(|(pair, _)| *pair);
    let (mut scratch, mut inner) = (JointScratch::new(), Vec::new());
    for of_one in listed.chunk_by(|(a, _), (b, _)| a[0] == b[0]) {
        let sphere = of_one[0].0[0] as usize;
        let (x, radius) = (q_c.x[sphere], scene.bodies[sphere].radius);
        let over = UpperContactor {
            solid: ConvexSolid::Sphere { radius },
            centre: x,
            radius,
            travel: ways.travel[sphere],
            lookahead: ways.lookahead,
        };
        let seen: SmallVec<[_; 8]> = of_one.iter().map(|(pair, _)| contact_geometry(scene, q_c, *pair)).collect();
        let touch = |k: usize| {
            let found = &seen[k];
            let BodyShape::Plane { half_lengths } = &scene.bodies[of_one[k].0[1] as usize].shape else {
                unreachable!("these are plates")
            };
            let at = found.point - x - found.normal * (0.5 * found.gap);
            let plate = of_one[k].0[1] as usize;
            let centre = q_c.x[plate] + scene.nearest_image_shift(&x, &q_c.x[plate]) - x;
            SurfaceContact {
                of: k as u32,
                turned: false,
                normal: found.normal,
                at,
                centre,
                reach: 2.0 * half_lengths.norm(),
            }
        };
        let near = |touch: &SurfaceContact| {
            let plate = of_one[touch.of as usize].0[1] as usize;
            let BodyShape::Plane { half_lengths } = &scene.bodies[plate].shape else {
                unreachable!("these are plates")
            };
            let solid = ConvexSolid::Cuboid { axes: &q_c.q[plate], half_lengths };
            let (v, w) = (ways.v_free[plate], ways.w_free[plate]);
            NearbyContactor { solid, centre: touch.centre, v, w, body: touch.centre }
        };
        let plane = |by: &SurfaceContact| over.supporting_plane(by, &near(by), seen[by.of as usize].gap);
        let test = |of: &SurfaceContact, by: &SurfaceContact, plane: &FacePlane| {
            over.is_inner(plane, &near(by), &near(of), &of.normal, std::iter::once(of.at))
        };
        inner.clear();
        scratch.find_inner_contacts(seen.len(), touch, plane, test, &mut inner);
        let is_inner = |k: usize| inner.iter().any(|(touch, _)| touch.of as usize == k);
        left.extend((0..of_one.len()).filter(|&k| !is_inner(k)).map(|k| of_one[k]));
    }
    left
}
