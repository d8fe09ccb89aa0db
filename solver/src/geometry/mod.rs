//! Kernel: contact geometry of convex polyhedra - with each other, with spheres, plates, cylinders and triangulated walls -
//! and of cylinders and capsules; and the search for near pairs.
//!
//! All lengths are relative to the centre of body A, so that precision does not depend on the distance from the origin:
//! `c` is x_B - x_A. Normals point from B, the antagonist, to A, the candidate.
//!
//! | file | what |
//! |---|---|
//! | `polyhedron` | shape: polygon faces, edges, neighbours; posed by its body's orientation |
//! | `manifold` | a contact: normal, points, area; gaps up to which it is listed |
//! | `polyhedra` | contact of two polyhedra, one pair at a time or in batches |
//! | `cache` | the feature of a pair that is kept for the next step |
//! | `pair` | two posed polyhedra, an axis, the corners of their common part |
//! | `search` | the direction in which two polyhedra are farthest apart, or least overlap |
//! | `gjk` | distance and direction where vertices or edges are nearest to each other |
//! | `sphere`, `plate`, `cylinder` | contact of a polyhedron with other shapes |
//! | `hollow_cylinder` | contacts of polyhedra, balls and solid cylinders inside a hollow cylinder |
//! | `cylinders` | contact of two cylinders or capsules |
//! | `capsule` | contact of a polyhedron with a capsule |
//! | `mesh` | contact of a polyhedron, cylinder or capsule with a triangulated wall |
//! | `flush` | heights and contact along a given direction |
//! | `outline` | the corners of the common part of two faces seen along the normal |
//! | `triangles` | corners of the common part of two triangles, for several pairs at once |
//! | `near_pairs` | near pairs among spheres of any sizes, by cells |
//! | `patch` | contact points and area from these corners |

mod cache;
mod capsule;
mod cylinder;
mod cylinders;
mod flush;
mod gjk;
mod hollow_cylinder;
mod manifold;
mod mesh;
mod near_pairs;
mod outline;
mod pair;
mod patch;
mod plate;
mod polyhedra;
mod polyhedron;
mod search;
mod sphere;
mod triangles;

pub use cache::CachedFeature;
pub use capsule::{nearest_of_segment, polyhedron_capsule, polyhedron_capsule_along, segment_ends};
pub use cylinder::{
    CYLINDER_END, CYLINDER_OTHER_END, CYLINDER_RIM, CYLINDER_SIDE, polyhedron_cylinder, polyhedron_cylinder_along,
    polyhedron_end_along,
};
pub use cylinders::{capsule_capsule, capsule_cylinder, capsule_end_along, cylinder_cylinder, cylinder_end_along};
pub use flush::polyhedra_along;
pub use hollow_cylinder::{
    FAR_WALL, cylinder_hollow_cylinder, far_walls, polyhedron_hollow_cylinder, rims_at_far_walls, vertices_at_far_walls,
};
pub use manifold::{
    ContactPoint, ContactPoints, ListingRange, Manifold, NarrowPhaseMode, Separated, WallContacts, edge_feature,
    face_feature, swapped_manifold, vertex_feature,
};
pub use mesh::{capsule_mesh, cylinder_mesh, polyhedron_mesh};
pub use near_pairs::{near_pairs, near_pairs_from};
pub use plate::polyhedron_plane;
pub use polyhedra::{PairBatch, PairRequest, PairResult, polyhedron_polyhedron};
pub use polyhedron::{Polyhedron, PosedPolyhedron};
pub use sphere::polyhedron_sphere;
