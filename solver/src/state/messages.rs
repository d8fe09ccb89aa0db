//! Contacts in fields of fixed size, as ranks send them to each other.

use bytemuck::{Pod, Zeroable};

use super::{Contact, ContactStatus, PairVirial, SolvedContact};
use crate::scene::{BodyId, LawId};

/// [`Contact`] in fields of fixed size.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct ContactMessage {
    point: [f64; 3],
    image: [f64; 3],
    normal: [f64; 3],
    gap: f64,
    area: f64,
    candidate: u32,
    antagonist: u32,
    features: [u32; 2],
    part_numbers: [u16; 2],
    law: u32,
}

impl From<&Contact> for ContactMessage {
    fn from(contact: &Contact) -> Self {
        ContactMessage {
            point: contact.point.into(),
            image: contact.image.into(),
            normal: contact.normal.into(),
            gap: contact.gap,
            area: contact.area,
            candidate: contact.candidate.0,
            antagonist: contact.antagonist.0,
            features: contact.features.into(),
            part_numbers: contact.part_numbers.into(),
            law: u32::from(contact.law.0),
        }
    }
}

impl From<ContactMessage> for Contact {
    fn from(message: ContactMessage) -> Self {
        Contact {
            candidate: BodyId(message.candidate),
            antagonist: BodyId(message.antagonist),
            part_numbers: message.part_numbers.into(),
            features: message.features.into(),
            point: message.point.into(),
            image: message.image.into(),
            normal: message.normal.into(),
            gap: message.gap,
            area: message.area,
            law: LawId(message.law as u8),
        }
    }
}

/// [`SolvedContact`] in fields of fixed size.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct SolvedContactMessage {
    contact: ContactMessage,
    impulse: [f64; 3],
    moment: [f64; 3],
    velocity: [f64; 3],
    /// Gap of the bond; 0 without one.
    bond: f64,
    /// 0: no contact, 1: stick, 2: slide.
    status: u32,
    /// 1 with a bond, 0 without.
    has_bond: u32,
}

impl From<&SolvedContact> for SolvedContactMessage {
    fn from(SolvedContact { contact, impulse, moment, velocity, status, bond }: &SolvedContact) -> Self {
        let status = match status {
            ContactStatus::NoContact => 0,
            ContactStatus::Stick => 1,
            ContactStatus::Slide => 2,
        };
        SolvedContactMessage {
            contact: ContactMessage::from(contact),
            impulse: (*impulse).into(),
            moment: (*moment).into(),
            velocity: (*velocity).into(),
            bond: bond.unwrap_or(0.0),
            status,
            has_bond: u32::from(bond.is_some()),
        }
    }
}

impl From<SolvedContactMessage> for SolvedContact {
    fn from(message: SolvedContactMessage) -> Self {
        let status = match message.status {
            0 => ContactStatus::NoContact,
            1 => ContactStatus::Stick,
            _ => ContactStatus::Slide,
        };
        SolvedContact {
            contact: message.contact.into(),
            impulse: message.impulse.into(),
            moment: message.moment.into(),
            velocity: message.velocity.into(),
            status,
            bond: (message.has_bond > 0).then_some(message.bond),
        }
    }
}

impl PairVirial {
    /// Candidate and antagonist in one word, the candidate in the upper half, and the bits of the virial.
    pub fn to_words(self) -> [u64; 2] {
        let [candidate, antagonist] = self.bodies.map(|body| u64::from(body.0));
        [candidate << u32::BITS | antagonist, self.virial.to_bits()]
    }

    /// Inverse of [`Self::to_words`].
    pub fn from_words([bodies, virial]: [u64; 2]) -> Self {
        let bodies = [(bodies >> u32::BITS) as u32, bodies as u32].map(BodyId);
        PairVirial { bodies, virial: f64::from_bits(virial) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;
    use crate::scene::ContactSides;

    #[test]
    fn messages_hold_the_whole_contact() {
        let contact = Contact {
            candidate: BodyId(7),
            antagonist: BodyId(u32::MAX),
            part_numbers: ContactSides { candidate: 1, antagonist: 2 },
            features: ContactSides { candidate: u32::MAX, antagonist: 3 },
            point: Vec3::new(1.0, -0.0, f64::MIN_POSITIVE),
            image: Vec3::new(1.0, 2.0, 3.0),
            normal: Vec3::z(),
            gap: -4.0,
            area: 0.25,
            law: LawId(255),
        };
        let vectors = [5.0, 6.0, 7.0].map(|x| Vec3::new(x, -x, 0.5 * x));
        for status in [ContactStatus::NoContact, ContactStatus::Stick, ContactStatus::Slide] {
            for bond in [None, Some(0.0), Some(-1.0)] {
                let [impulse, moment, velocity] = vectors;
                let solved = SolvedContact { contact, impulse, moment, velocity, status, bond };
                assert_eq!(SolvedContact::from(SolvedContactMessage::from(&solved)), solved);
            }
        }
        let pair = PairVirial { bodies: [BodyId(u32::MAX), BodyId(4)], virial: -0.5 };
        assert_eq!(PairVirial::from_words(pair.to_words()), pair);
    }
}
