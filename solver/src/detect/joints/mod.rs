//! Flush joints: removes contacts with edges and sides that are inside a common surface of two contactors.
//!
//! The direction of a contact is computed pair by pair. If a contactor A slides over two contactors B and C with flush
//! surfaces, such as two adjacent plates, the side or edge of B that C covers would stop A. A contact of A and B is such
//! an **inner contact** if A has a contact with a face of another contactor C, and the plane of that face separates A
//! from B: A is above it, and B below. The contact with C keeps A above the plane during the whole step, so that A can
//! touch only those parts of B that are in the plane. A step up, or a wall on a floor, rises above the plane and remains
//! a contact.
//!
//! An inner contact of polyhedra is replaced by the contact of A and B along the normal of the plane if A is over B, and
//! removed otherwise. An inner contact with a sphere is always removed: a sphere over B has a contact with B's face. An
//! inner contact with the rim of a cylinder is also removed: a polyhedron whose extent over the end exceeds its overlap
//! has a contact with the end.
//!
//! Known as ghost collisions or internal edges in game physics; see E. Catto, Box2D: ghost collisions (2020).

mod edges;
mod inner;
mod rims;
mod solid;

pub use edges::remove_inner_edges;
pub use rims::without_inner_rims;
