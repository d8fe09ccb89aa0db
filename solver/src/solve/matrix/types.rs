//! Vectors and blocks of the local order.

/// Components along n, t1, t2.
pub type LocalVector = [f64; 3];
/// A 3x3 block, row by row.
pub type MatrixBlock = [LocalVector; 3];
