//! Geometry: shapes of the bodies in the files, closed surfaces, surfaces of walls, convex faces and pieces, mass properties,
//! and convex regions of space.

mod centred;
pub mod convex_pieces;
pub mod convex_region;
pub mod faces;
pub mod mass;
pub mod mesh;
pub mod obj;
pub mod periodic_cell;
pub mod plates;
pub mod polyhedron_gravity;
pub mod principal;
pub mod rotation;
pub mod surface;
pub mod wall_mesh;
