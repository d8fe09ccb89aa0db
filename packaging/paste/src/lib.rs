//! Takes the place of the crate `paste`, which pulp uses and which is no longer maintained: its successor is `pastey`.

pub use pastey::paste;
