//! Contact of a convex body with a triangulated wall.
//!
//! Along a unit normal n, from the wall to the body A, a triangle T has the gap s(n) = min_A n·a - max_T n·t. T may be
//! touched along n only if the surface near the touched face, edge or corner is behind the plane across n: along the normal
//! of a face, between the normals at a convex edge, in the cone of those around a convex corner
//! ([`WallMesh::allows_normal`](cd_formats::wall_mesh::WallMesh::allows_normal)). Concave edges and edges within a plane
//! have no directions of their own.
//!
//! 1. Each triangle gets its own direction: if it is apart from A, that of the nearest points, if that is allowed; if the two
//!    overlap, the allowed one with the smallest translation that separates them.
//! 2. Triangles are taken in the order of decreasing gap. If a direction that is already taken separates the next one no
//!    worse, that direction is used for it, too: its plane keeps A away from both.
//! 3. Along each direction, the side of A that faces the wall, a face, a line or an end, is clipped to the triangles. Corners
//!    in flush edges are not corners of the common part and are left out, so that a plane of triangles has the points of a
//!    plate.
//!
//! | file | what |
//! |---|---|
//! | `outline` | the side of a body that faces the wall, seen along a direction |
//! | `search` | the three steps, for any convex body |
//! | `polyhedron` | polyhedra |
//! | `cylinder` | solid cylinders, and capsules: cylinders of radius 0 with their radius taken off |

mod cylinder;
mod outline;
mod polyhedron;
mod search;

pub use cylinder::{capsule_mesh, cylinder_mesh};
pub use polyhedron::polyhedron_mesh;
