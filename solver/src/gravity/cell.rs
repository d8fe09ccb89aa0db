//! Cells of the tree, and the summaries of their masses.

/// Eight numbers of a cell: a summary, ordered as in [`CellSummary::cell_line`], or a part of its moments, see
/// [`super::expansion`].
pub type CellLine = [f64; 8];

/// Number of bodies below which a subtree is one task: large against the cost of a task, small against a thread's share.
pub const MAX_BODIES_PER_TASK: usize = 2048;

/// Cell of the tree.
#[derive(Debug, Clone, Copy)]
pub struct TreeCell {
    /// First of the cell's bodies, in the tree's order.
    pub first: u32,
    /// Number of its bodies.
    pub count: u32,
    /// Offset from this cell to the cell of its second half; 0 for a leaf. The first half is the next cell.
    pub second: u32,
}

impl TreeCell {
    /// Positions of the cell's bodies in the tree's order.
    pub fn body_range(&self) -> std::ops::Range<usize> {
        self.first as usize..(self.first + self.count) as usize
    }

    /// Whether there are no cells below it.
    pub fn is_leaf(&self) -> bool {
        self.second == 0
    }
}

/// Data of a cell that each interaction reads, in one cache line.
#[derive(Debug, Clone, Copy)]
pub struct CellSummary {
    /// Centre of mass, in the tree's units, as all lengths and masses here.
    pub centre: [f64; 3],
    /// Distance of the farthest body from the centre, or a bound of it.
    pub radius: f64,
    /// Total mass.
    pub mass: f64,
    /// Largest ratio of a squared multipole of degree 2 or more to that of all the mass at the radius: 0 for a point, 1
    /// at most.
    pub uneven: f64,
}

impl CellSummary {
    /// Reads a summary from its line.
    pub fn from_line(line: &CellLine) -> Self {
        let [x, y, z, radius, mass, uneven, ..] = *line;
        CellSummary { centre: [x, y, z], radius, mass, uneven }
    }

    /// Line of the summary; the last two numbers are 0.
    pub fn cell_line(&self) -> CellLine {
        let [x, y, z] = self.centre;
        [x, y, z, self.radius, self.mass, self.uneven, 0.0, 0.0]
    }
}
