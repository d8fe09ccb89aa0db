//! Geometry of the bodies in the files: closed surfaces, convex faces, mass properties.

mod centred;
pub mod faces;
pub mod mass;
pub mod principal;
pub mod surface;
