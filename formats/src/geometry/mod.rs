//! Geometry of the bodies in the files: closed surfaces, convex faces and pieces, mass properties.

pub mod convex_pieces;
pub mod faces;
pub mod mass;
pub mod surface;
