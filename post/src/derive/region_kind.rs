//! Kinds of regions.

/// Kind of a region; the column `region` has this number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum RegionKind {
    None = 0,
    LargestGroup = 1,
    AllGrains = 2,
    Walls = 3,
    Bed = 4,
    Cell = 5,
    Ball = 6,
    Box = 7,
    Cylinder = 8,
    Layer = 9,
}

impl RegionKind {
    /// All kinds, by their numbers.
    pub const ALL: [RegionKind; 10] = [
        RegionKind::None,
        RegionKind::LargestGroup,
        RegionKind::AllGrains,
        RegionKind::Walls,
        RegionKind::Bed,
        RegionKind::Cell,
        RegionKind::Ball,
        RegionKind::Box,
        RegionKind::Cylinder,
        RegionKind::Layer,
    ];

    /// Number of the column `region`.
    pub fn column_value(self) -> u64 {
        self as u64
    }

    /// Name in titles of plots and in reports.
    pub fn name(self) -> &'static str {
        match self {
            RegionKind::None => "no region",
            RegionKind::LargestGroup => "hull of the largest remnant",
            RegionKind::AllGrains => "hull of all grains",
            RegionKind::Walls => "between the walls",
            RegionKind::Bed => "between the walls, up to the surface",
            RegionKind::Cell => "periodic cell",
            RegionKind::Ball => "ball",
            RegionKind::Box => "box",
            RegionKind::Cylinder => "cylinder",
            RegionKind::Layer => "layer",
        }
    }
}
