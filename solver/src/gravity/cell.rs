//! Cells of the tree, and the summaries of their masses.

/// Eight numbers of a cell, as [`CellSummary::cell_line`] orders them.
pub type CellLine = [f64; 8];

/// Number of bodies below which a subtree is one task: large against the cost of a task, small against a thread's share.
pub const MAX_BODIES_PER_TASK: usize = 2048;

/// Cell of the tree.
#[derive(Debug, Clone, Copy)]
pub struct TreeCell {
    /// Range of the cell's bodies, in the tree's order.
    pub first: u32,
    pub count: u32,
    /// Offset of the second half's cell; 0 for a leaf. The first half is the next cell.
    pub second: u32,
}

impl TreeCell {
    pub fn body_range(&self) -> std::ops::Range<usize> {
        self.first as usize..(self.first + self.count) as usize
    }

    pub fn is_leaf(&self) -> bool {
        self.second == 0
    }
}

/// Data of a cell that each interaction reads, in one cache line.
#[derive(Debug, Clone, Copy)]
pub struct CellSummary {
    /// Centre of mass, and the distance of the farthest body from it, in the tree's units.
    pub centre: [f64; 3],
    pub radius: f64,
    pub mass: f64,
    /// Largest ratio of a squared multipole of degree 2 or more to that of all the mass at the radius: 0 for a point, 1
    /// at most.
    pub uneven: f64,
}

impl CellSummary {
    pub fn from_line(line: &CellLine) -> Self {
        let [x, y, z, radius, mass, uneven, ..] = *line;
        CellSummary { centre: [x, y, z], radius, mass, uneven }
    }

    pub fn cell_line(&self) -> CellLine {
        let [x, y, z] = self.centre;
        [x, y, z, self.radius, self.mass, self.uneven, 0.0, 0.0]
    }
}
