//! Totals of the contacts of a step, and the overlaps among them.

use std::ops::Add;

use crate::math::Vec3;
use crate::scene::{BodyId, Scene};
use crate::state::Contact;

/// Number of rows, contacts or bodies that one task sums.
pub const ITEMS_PER_TASK: usize = 1024;

/// Ratio of overlap to smaller radius above which a run warns. Overlaps of this size are normal only for laws with springs;
/// they change volumes by about three times the ratio.
pub const OVERLAP_WARNING_SHARE: f64 = 1e-2;

/// Two bodies that overlap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Overlap {
    pub bodies: [BodyId; 2],
    /// Depth of the overlap, m.
    pub depth: f64,
    /// Ratio of the depth to the smaller radius of the two bodies; bodies whose motion is all imposed do not count.
    pub share: f64,
}

impl Overlap {
    /// Overlap of the bodies of a contact; its depth is negative if they are apart.
    pub fn from_contact(scene: &Scene, contact: &Contact) -> Overlap {
        let bodies = [contact.candidate, contact.antagonist];
        let radius = |body: &BodyId| {
            let body = &scene.bodies[body.index()];
            if body.is_imposed() { f64::INFINITY } else { body.radius }
        };
        let (depth, smaller) = (-contact.gap, bodies.iter().map(radius).fold(f64::INFINITY, f64::min));
        Overlap { bodies, depth, share: depth / smaller }
    }

    /// Whether the overlap is deep enough for a warning.
    pub fn is_deep(&self) -> bool {
        self.share > OVERLAP_WARNING_SHARE
    }

    /// Text for messages, with bodies counted from 1. Bodies without a deep overlap touch.
    pub fn message_text(&self) -> String {
        let Overlap { bodies: [a, b], depth, share } = self;
        if !self.is_deep() {
            return format!("bodies {}-{} touch", a.number(), b.number());
        }
        format!(
            "bodies {}-{} overlap by {depth:.3e} m, {:.1} % of the smaller radius",
            a.number(),
            b.number(),
            100.0 * share
        )
    }
}

/// Returns the overlap with the larger share, the first if they are equal.
pub fn deeper_overlap(a: Option<Overlap>, b: Overlap) -> Option<Overlap> {
    a.filter(|a| a.share >= b.share).or(Some(b))
}

/// Totals of the contacts in a step.
#[derive(Debug, Clone, Copy, Default)]
pub struct ContactTotals {
    pub contacts_active: usize,
    /// Deepest overlap that is worth a warning.
    pub overlap: Option<Overlap>,
    /// Deepest overlap of two bodies neither of which can move along the normal, so that their contact does not act; or a
    /// touch of such bodies that a bond or a liquid would hold.
    pub inert_overlap: Option<Overlap>,
    /// Largest penetration of the listed contacts, m.
    pub penetration_largest: f64,
    /// Sum of the penetrations of the listed contacts, m.
    pub penetration_sum: f64,
    /// Penetration that contacts with force gain until the step's end, m: 0 if the problem is solved exactly.
    pub penetration_added: f64,
    /// Work of the contacts, J.
    pub contact_work: f64,
    /// Part of `contact_work` by friction and rolling resistance, J.
    pub friction_work: f64,
    /// Sum of impulses times branches, N m s.
    pub virial: f64,
    /// Sums of the components along x, y and z of impulses times those of branches, N m s; only in a deforming cell.
    pub normal_moments: Vec3,
    /// Work by walls and by a deforming cell, and by the reactions of held grains to contacts, J.
    pub outside_work: f64,
    /// Impulse of driven bodies on free ones, N s.
    pub driven_impulse: Vec3,
    /// Change of the angular momentum of the free bodies about the origin by driven bodies, and by contacts across periodic
    /// boundaries, whose forces act at two images, N m s.
    pub angular_momentum_change: Vec3,
}

impl Add for ContactTotals {
    type Output = ContactTotals;

    fn add(self, other: ContactTotals) -> ContactTotals {
        ContactTotals {
            contacts_active: self.contacts_active + other.contacts_active,
            overlap: other.overlap.map_or(self.overlap, |overlap| deeper_overlap(self.overlap, overlap)),
            inert_overlap: match other.inert_overlap {
                Some(overlap) => deeper_overlap(self.inert_overlap, overlap),
                None => self.inert_overlap,
            },
            penetration_largest: self.penetration_largest.max(other.penetration_largest),
            penetration_sum: self.penetration_sum + other.penetration_sum,
            penetration_added: self.penetration_added + other.penetration_added,
            contact_work: self.contact_work + other.contact_work,
            friction_work: self.friction_work + other.friction_work,
            virial: self.virial + other.virial,
            normal_moments: self.normal_moments + other.normal_moments,
            outside_work: self.outside_work + other.outside_work,
            driven_impulse: self.driven_impulse + other.driven_impulse,
            angular_momentum_change: self.angular_momentum_change + other.angular_momentum_change,
        }
    }
}
