//! Test whether a contact with one contactor is inside the common surface of two contactors; see [`super`] for A, B and C.

use smallvec::SmallVec;

use super::solid::ConvexSolid;
use crate::math::Vec3;

/// Ratio of height to radius of A's ball, up to which surfaces are flush: above the overlaps that a sound solution
/// leaves, and less than a third of the smallest step that must stop a body, 1e-4 of its size.
pub const FLUSH_TOLERANCE: f64 = 3e-5;

/// Relative error of numbers in files, which have eight digits.
const FILE_ROUNDING: f64 = 5e-8;

/// 1 - cos of the angle between a contact's direction and a face's normal up to which the contact keeps A above that
/// face: 1e-3 rad, more than the tilt that overlaps cause for a body on a face.
const ON_FACE_TOLERANCE: f64 = 5e-7;

/// 1 - cos of the angle up to which two contacts count as parallel, 1e-4 rad: the side of a joint reduces the speed of A
/// by at most 1e-8.
const SAME_DIRECTION_TOLERANCE: f64 = 5e-9;

/// Sine of the angle between two faces beyond which they form no common surface.
const MAX_FACE_BEND: f64 = 1e-2;

/// Largest free displacement of B relative to C along the normal in the step, divided by the radius of the ball about
/// A.
const MAX_RELATIVE_RISE: f64 = 1e-2;

/// Largest number of contacts of one contactor for which all pairs are tested; beyond it only pairs near each other are.
pub const MAX_CONTACTS_ALL_PAIRS: usize = 64;

/// Contactor near A.
pub struct NearbyContactor<'a> {
    pub solid: ConvexSolid<'a>,
    /// Centre relative to the centre of A, m.
    pub centre: Vec3,
    /// Free velocity of its body at the step's end, m/s.
    pub v: Vec3,
    /// Free angular velocity of its body at the step's end, rad/s.
    pub w: Vec3,
    /// Centre of its body relative to the centre of A, m.
    pub body_centre: Vec3,
}

impl NearbyContactor<'_> {
    fn velocity_at(&self, point: &Vec3) -> Vec3 {
        self.v + self.w.cross(&(point - self.body_centre))
    }
}

/// Contactor A; lengths in m.
pub struct UpperContactor<'a> {
    pub solid: ConvexSolid<'a>,
    pub centre: Vec3,
    pub radius: f64,
    /// Largest displacement in the step, m.
    pub travel: f64,
    /// Time for which contacts are predicted, s.
    pub lookahead: f64,
}

/// Contact of A with one contactor; positions are relative to the centre of A.
#[derive(Clone, Copy)]
pub struct SurfaceContact {
    /// Index of the contact's run or pair in the list of the caller.
    pub index: u32,
    /// Whether A is the antagonist.
    pub a_is_antagonist: bool,
    /// Normal from the other contactor to A.
    pub normal: Vec3,
    /// Contact point on the other contactor's surface, m.
    pub point: Vec3,
    /// Centre of the other contactor, m.
    pub centre: Vec3,
    /// Radius of a ball about `point` that contains the other contactor, m.
    pub reach: f64,
}

/// Plane of a face of C, below A.
#[derive(Clone, Copy)]
pub struct FacePlane {
    n: Vec3,
    /// Height n·x of the plane, x from the centre of A, m.
    height: f64,
    /// Uncertainty of `height` due to the rounding of numbers in files, m.
    rounding: f64,
}

impl UpperContactor<'_> {
    /// Plane of the face of C above which a contact with C keeps A. `gap`: smallest gap of that contact, m.
    pub fn supporting_plane(&self, touch: &SurfaceContact, c: &NearbyContactor, gap: f64) -> Option<FacePlane> {
        let (n, face) = c.solid.face_along(&touch.normal)?;
        if n.dot(&touch.normal) < 1.0 - ON_FACE_TOLERANCE {
            return None;
        }
        let height = n.dot(&c.centre) + face;
        let rounding = self.height_uncertainty(&n, c, face);
        let below = height + self.solid.support_height(&-n);
        (below <= (-gap).max(0.0) + 2.0 * (FLUSH_TOLERANCE * self.radius + rounding)).then_some(FacePlane {
            n,
            height,
            rounding,
        })
    }

    /// Whether a contact with B in direction `normal`, at `points`, is an inner contact below the plane of C.
    pub fn is_inner(
        &self,
        plane: &FacePlane,
        c: &NearbyContactor,
        b: &NearbyContactor,
        normal: &Vec3,
        points: impl Iterator<Item = Vec3>,
    ) -> bool {
        let FacePlane { n, height, rounding } = plane;
        if normal.dot(n) >= 1.0 - SAME_DIRECTION_TOLERANCE {
            return false;
        }
        // Bounds of B's height where A can meet it: the height of all of B, and the plane of its face, which bounds B
        // from above.
        let extent = b.solid.support_height(n);
        let mut top = n.dot(&b.centre) + extent;
        let tolerance = FLUSH_TOLERANCE * self.radius + rounding + self.height_uncertainty(n, b, extent);
        let points: SmallVec<[Vec3; 6]> = points.collect();
        if top > height + tolerance
            && let Some((face, offset)) = b.solid.face_along(n)
        {
            let bent = face.cross(n).norm();
            if bent > MAX_FACE_BEND {
                return false;
            }
            // Height of the plane of B's face above or below a point.
            let height_of_face = |point: &Vec3| n.dot(point) + (offset - face.dot(&(point - b.centre))) / face.dot(n);
            top = points.iter().map(height_of_face).fold(f64::NEG_INFINITY, f64::max) + bent * self.travel;
        }
        let rise = |point: &Vec3| self.lookahead * (b.velocity_at(point) - c.velocity_at(point)).dot(n);
        top <= height + tolerance && points.iter().all(|point| rise(point) <= MAX_RELATIVE_RISE * self.radius)
    }

    /// Uncertainty of the height of a face at `distance` from a contactor's centre due to the rounding of numbers in
    /// files, m.
    fn height_uncertainty(&self, n: &Vec3, plate: &NearbyContactor, distance: f64) -> f64 {
        FILE_ROUNDING * (n.dot(&(self.centre + plate.centre)).abs() + distance.abs())
    }
}

/// Whether the point of a contact and the centre of the other contactor are low enough, relative to the surface of
/// another contact, that the contact may be an inner one.
#[inline(always)]
fn may_be_inner(hidden: &SurfaceContact, covering: &SurfaceContact) -> bool {
    // Tolerance: the largest angle between the contact's direction and the face's normal, and the largest deviation from
    // flush surfaces.
    let is_low = |point: &Vec3| {
        let between = point - covering.point;
        let above = covering.normal.dot(&between) - FLUSH_TOLERANCE * (hidden.reach + covering.reach);
        above <= 0.0 || above * above <= 4.0 * ON_FACE_TOLERANCE * between.norm_squared()
    };
    is_low(&hidden.point)
        && is_low(&hidden.centre)
        && hidden.normal.dot(&covering.normal) < 1.0 - SAME_DIRECTION_TOLERANCE
}

/// Position of a contact of A, for a necessary condition of [`may_be_inner`] that takes three products per pair; nearly all
/// contacts of rough bodies fail it. 64 bytes, one cache line.
pub struct ContactHeight {
    normal: Vec3,
    /// Contact point on the other contactor's surface, relative to the centre of A, m.
    point: Vec3,
    /// normal·point, m.
    height: f64,
    /// Largest height of an inner contact above the plane of another contact, m; the tolerances of both add up.
    tolerance: f64,
}

impl ContactHeight {
    /// `reach`: as in [`SurfaceContact`], m.
    #[inline(always)]
    pub fn new(normal: Vec3, point: Vec3, reach: f64) -> Self {
        // Two points are no farther from each other than both are from A's centre.
        let angle = 2.0 * ON_FACE_TOLERANCE.sqrt() * (1.0 + 1e-9);
        let tolerance = angle * point.norm() + FLUSH_TOLERANCE * reach;
        ContactHeight { normal, point, height: normal.dot(&point), tolerance }
    }

    /// Whether this contact is low enough for an inner contact relative to the surface of contact `covering`.
    #[inline(always)]
    fn is_low(&self, covering: &ContactHeight) -> bool {
        covering.normal.dot(&self.point) - covering.height <= self.tolerance + covering.tolerance
    }
}

/// Whether some contact is low relative to another one with another direction.
pub fn any_is_low(heights: &[ContactHeight]) -> bool {
    let has_other_direction =
        |a: &ContactHeight, b: &ContactHeight| a.normal.dot(&b.normal) < 1.0 - SAME_DIRECTION_TOLERANCE;
    // A contact is low relative to itself.
    let other_heights = |k: usize| heights[..k].iter().chain(&heights[k + 1..]);
    let is_hidden = |hidden: &ContactHeight, covering| hidden.is_low(covering) && has_other_direction(hidden, covering);
    heights.iter().enumerate().any(|(k, covering)| other_heights(k).any(|hidden| is_hidden(hidden, covering)))
}

/// Scratch memory, reused from contactor to contactor.
pub struct JointScratch {
    /// Contacts that may act in the step.
    pub nearby: Vec<u32>,
    pub heights: Vec<ContactHeight>,
    /// Supporting plane of each contact. `None`: not computed yet; `Some(None)`: the contact has no supporting face.
    pub planes: Vec<Option<Option<FacePlane>>>,
    pub found: Vec<HiddenContact>,
}

/// Contact of A that another contact of A hides; indices of contacts.
pub struct HiddenContact {
    hidden: usize,
    covering: usize,
    /// Normal of the plane of the covering contact.
    normal: Vec3,
}

/// Inner contact, with the normal of a plane that hides it.
#[derive(Clone, Copy)]
pub struct InnerContact {
    pub contact: SurfaceContact,
    pub plane_normal: Vec3,
}

impl JointScratch {
    /// Scratch without items.
    pub const fn new() -> Self {
        JointScratch { nearby: Vec::new(), heights: Vec::new(), planes: Vec::new(), found: Vec::new() }
    }

    /// Appends to `inner` the inner contacts among `count` contacts of A, each with the normal of a plane that hides it.
    ///
    /// `contact_at` returns a contact by its index. `supporting_plane` returns the plane of the face that supports A
    /// in a contact. `is_inner` returns whether the first contact is an inner contact below the plane of the second.
    pub fn find_inner_contacts(
        &mut self,
        count: usize,
        contact_at: impl Fn(usize) -> SurfaceContact,
        supporting_plane: impl Fn(&SurfaceContact) -> Option<FacePlane>,
        is_inner: impl Fn(&SurfaceContact, &SurfaceContact, &FacePlane) -> bool,
        inner: &mut Vec<InnerContact>,
    ) {
        let JointScratch { heights, planes, found, .. } = self;
        heights.clear();
        heights.extend(
            (0..count).map(&contact_at).map(|contact| ContactHeight::new(contact.normal, contact.point, contact.reach)),
        );
        planes.clear();
        planes.resize(count, None);
        found.clear();
        let mut try_pair = |hidden: usize, covering: usize| {
            if !heights[hidden].is_low(&heights[covering]) {
                return;
            }
            let (inner, outer) = (contact_at(hidden), contact_at(covering));
            if may_be_inner(&inner, &outer)
                && let Some(plane) = *planes[covering].get_or_insert_with(|| supporting_plane(&outer))
                && is_inner(&inner, &outer, &plane)
            {
                found.push(HiddenContact { hidden, covering, normal: plane.n });
            }
        };
        if count <= MAX_CONTACTS_ALL_PAIRS {
            for covering in 0..count {
                (0..count).filter(|hidden| *hidden != covering).for_each(|hidden| try_pair(hidden, covering));
            }
        } else {
            let bounds = |k: usize| {
                let SurfaceContact { point, reach, .. } = contact_at(k);
                [point.x - reach, point.x + reach]
            };
            let bounds: Vec<[f64; 2]> = (0..count).map(bounds).collect();
            let mut order: Vec<usize> = (0..count).collect();
            order.sort_by(|&a, &b| bounds[a][0].total_cmp(&bounds[b][0]));
            for (position, &i) in order.iter().enumerate() {
                for &j in order[position + 1..].iter().take_while(|&&j| bounds[j][0] <= bounds[i][1]) {
                    try_pair(i, j);
                    try_pair(j, i);
                }
            }
        }
        // An inner contact supports nothing.
        let is_not_inner = |k: usize| found.iter().all(|pair| pair.hidden != k);
        let first = inner.len();
        for &HiddenContact { hidden, covering, normal } in found.iter() {
            let contact = contact_at(hidden);
            if is_not_inner(covering) && inner[first..].iter().all(|known| known.contact.index != contact.index) {
                inner.push(InnerContact { contact, plane_normal: normal });
            }
        }
    }
}
