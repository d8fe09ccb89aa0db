//! Flush joints: removes contacts with edges and sides that are inside the common surface of two contactors.
//!
//! The direction of a contact is computed pair by pair. If a contactor A slides over two contactors B and C with flush
//! surfaces, such as two adjacent plates, the side or edge of B that C covers would stop A. A contact of A and B is such
//! an **inner contact** if
//!
//! - A has a contact with a face of C, and
//! - the plane of this face separates A from B: A is above it, and B below.
//!
//! The contact with C keeps A above the plane during the whole step, so that A can touch only those parts of B that are in
//! the plane. A step up, or a wall on a floor, rises above the plane and remains a contact.
//!
//! | A | B | an inner contact of A and B |
//! |---|---|---|
//! | polyhedron, cylinder, capsule | any | is replaced by that along the normal of the plane if A is above B, else removed |
//! | sphere | any | is removed: a sphere above B has a contact with B's face |
//!
//! | file | content |
//! |---|---|
//! | `rims` | spheres on plates, in scenes without other shapes |
//! | `edges` | contactors of any shape |
//! | `along` | the contact that replaces an inner one |
//! | `inner` | the test of the contacts of one contactor A |
//! | `solid` | shapes for this test |
//!
//! Known as ghost collisions or internal edges in game physics; see E. Catto, Box2D: ghost collisions (2020).

mod along;
mod edges;
mod inner;
mod rims;
mod solid;

pub use edges::remove_inner_edges;
pub use rims::without_inner_rims;
