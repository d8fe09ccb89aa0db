//! Contacts whose own block of W is diagonal: spheres and plates.
//!
//! | module | contents |
//! |---|---|
//! | [`local`] | one contact, exactly |
//! | [`batches`] | bodies and contacts packed for sweeps |
//! | [`sweep`] | one sweep, in vectors of contacts |

pub mod batches;
pub mod local;
pub mod sweep;
