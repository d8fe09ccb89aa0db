//! Readers of all input files, and damaged files that they must reject or read without a panic, in bounded time and memory.
//!
//! | module | |
//! |---|---|
//! | [`readers`] | a function of bytes for each reader |
//! | [`bundle`] | several files in one text |
//! | [`mutation`] | damage |
//! | [`memory`] | count of allocated bytes |
//! | [`trials`] | damaged files read, with limits |

pub mod bundle;
pub mod memory;
pub mod mutation;
pub mod readers;
pub mod trials;
