//! Contacts as plain numbers, as ranks exchange them.

use bytemuck::{Pod, Zeroable};

use super::{Contact, ContactExchange, ContactStatus, SolvedContact};
use crate::math::Vec3;
use crate::scene::{BodyId, LawId};

/// [`Contact`] as plain numbers.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct ContactNumbers {
    /// Point, image and normal.
    vectors: [[f64; 3]; 3],
    gap: f64,
    area: f64,
    /// Candidate and antagonist.
    bodies: [u32; 2],
    features: [u32; 2],
    part_numbers: [u16; 2],
    law: u32,
}

impl From<&Contact> for ContactNumbers {
    fn from(contact: &Contact) -> Self {
        ContactNumbers {
            vectors: [contact.point, contact.image, contact.normal].map(Into::into),
            gap: contact.gap,
            area: contact.area,
            bodies: [contact.candidate.0, contact.antagonist.0],
            features: contact.features.into(),
            part_numbers: contact.part_numbers.into(),
            law: u32::from(contact.law.0),
        }
    }
}

impl From<ContactNumbers> for Contact {
    fn from(numbers: ContactNumbers) -> Self {
        let [point, image, normal] = numbers.vectors.map(Vec3::from);
        let [candidate, antagonist] = numbers.bodies.map(BodyId);
        Contact {
            candidate,
            antagonist,
            part_numbers: numbers.part_numbers.into(),
            features: numbers.features.into(),
            point,
            image,
            normal,
            gap: numbers.gap,
            area: numbers.area,
            law: LawId(numbers.law as u8),
        }
    }
}

/// [`SolvedContact`] as plain numbers.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct SolvedContactNumbers {
    contact: ContactNumbers,
    /// Impulse, moment and velocity.
    vectors: [[f64; 3]; 3],
    /// Gap of the bond; 0 without one.
    bond: f64,
    /// Status by number, and whether there is a bond.
    flags: [u32; 2],
}

impl From<&SolvedContact> for SolvedContactNumbers {
    fn from(SolvedContact { contact, impulse, moment, velocity, status, bond }: &SolvedContact) -> Self {
        let status = match status {
            ContactStatus::NoContact => 0,
            ContactStatus::Stick => 1,
            ContactStatus::Slide => 2,
        };
        SolvedContactNumbers {
            contact: ContactNumbers::from(contact),
            vectors: [impulse, moment, velocity].map(|vector| (*vector).into()),
            bond: bond.unwrap_or(0.0),
            flags: [status, u32::from(bond.is_some())],
        }
    }
}

impl From<SolvedContactNumbers> for SolvedContact {
    fn from(SolvedContactNumbers { contact, vectors, bond, flags: [status, has_bond] }: SolvedContactNumbers) -> Self {
        let [impulse, moment, velocity] = vectors.map(Vec3::from);
        let status = match status {
            0 => ContactStatus::NoContact,
            1 => ContactStatus::Stick,
            _ => ContactStatus::Slide,
        };
        SolvedContact {
            contact: contact.into(),
            impulse,
            moment,
            velocity,
            status,
            bond: (has_bond > 0).then_some(bond),
        }
    }
}

impl ContactExchange {
    /// Bodies in the order of their numbers, and bits of the virial.
    pub fn to_words(self) -> [u64; 2] {
        let [candidate, antagonist] = self.bodies.map(|body| u64::from(body.0));
        [candidate << u32::BITS | antagonist, self.virial.to_bits()]
    }

    /// Inverse of [`Self::to_words`].
    pub fn from_words([bodies, virial]: [u64; 2]) -> Self {
        let bodies = [(bodies >> u32::BITS) as u32, bodies as u32].map(BodyId);
        ContactExchange { bodies, virial: f64::from_bits(virial) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::ContactSides;

    #[test]
    fn numbers_are_those_of_the_contact() {
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
                assert_eq!(SolvedContact::from(SolvedContactNumbers::from(&solved)), solved);
            }
        }
        let exchange = ContactExchange { bodies: [BodyId(u32::MAX), BodyId(4)], virial: -0.5 };
        assert_eq!(ContactExchange::from_words(exchange.to_words()), exchange);
    }
}
