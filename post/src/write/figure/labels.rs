//! Positions of names next to dots.

/// Largest width of a letter, in pixels.
pub const LETTER_WIDTH: i32 = 8;

/// Radius of a dot with a name, in pixels.
pub const NAMED_DOT_RADIUS: i32 = 5;

/// Distance from the middle of a dot to its name, in pixels.
pub const NAME_DISTANCE: i32 = NAMED_DOT_RADIUS + 3;

/// Possible positions of a name about its dot: steps to the right and down.
const NAME_DIRECTIONS: [(i32, i32); 8] = [(1, 0), (-1, 0), (0, -1), (0, 1), (1, -1), (1, 1), (-1, -1), (-1, 1)];

/// Rectangle of the picture, from the left and from above, in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelRect {
    pub left: i32,
    pub upper: i32,
    pub right: i32,
    pub lower: i32,
}

impl PixelRect {
    /// Square of 2 `half` pixels about a point.
    pub fn centred_at((x, y): (i32, i32), half: i32) -> PixelRect {
        PixelRect { left: x - half, upper: y - half, right: x + half, lower: y + half }
    }

    /// Whether the two share some area.
    pub fn intersects(&self, other: &PixelRect) -> bool {
        self.left < other.right && other.left < self.right && self.upper < other.lower && other.upper < self.lower
    }

    fn contains(&self, other: &PixelRect) -> bool {
        self.left <= other.left && other.right <= self.right && self.upper <= other.upper && other.lower <= self.lower
    }
}

/// The plot and its contents: names and named dots, which no name may cover, other dots, and lines.
pub struct LabelSpace {
    pub plot: PixelRect,
    pub names: Vec<PixelRect>,
    pub dots: Vec<PixelRect>,
    pub lines: Vec<PixelRect>,
}

impl LabelSpace {
    /// Position of a name of `letters` letters about its dot, and its side: 1 right, -1 left, else 0. Candidates are the
    /// positions in [`NAME_DIRECTIONS`] of the dot, or farther away, within the plot. The first with the fewest overlapping
    /// names is chosen, then with the fewest dots, then with the fewest lines. A dot counts as much as half a row of
    /// letters of distance.
    pub fn place_name(&self, (x, y): (i32, i32), letters: i32) -> (i32, PixelRect) {
        let (half_width, half_height) = (LETTER_WIDTH * letters / 2, 8);
        let candidate = |distance: i32, (across, down): (i32, i32)| {
            let (x, y) = (
                x + across * (half_width + NAME_DISTANCE),
                y + down * (half_height + NAME_DISTANCE + half_height * distance),
            );
            (
                distance as usize,
                across,
                PixelRect {
                    left: x - half_width,
                    upper: y - half_height,
                    right: x + half_width,
                    lower: y + half_height,
                },
            )
        };
        let cost = |(distance, _, rect): &(usize, i32, PixelRect)| {
            let overlaps = |all: &[PixelRect]| all.iter().filter(|other| rect.intersects(other)).count();
            (!self.plot.contains(rect), overlaps(&self.names), overlaps(&self.dots) + distance, overlaps(&self.lines))
        };
        let candidates = (0..12).flat_map(|distance| NAME_DIRECTIONS.map(|direction| candidate(distance, direction)));
        let (_, side, rect) = candidates.min_by_key(cost).expect("there are candidates");
        (side, rect)
    }
}

/// Rectangles along the line between two points, one in five pixels.
pub fn line_rectangles([a, b]: [(i32, i32); 2]) -> impl Iterator<Item = PixelRect> {
    let count = ((b.0 - a.0).abs().max((b.1 - a.1).abs()) / 5).max(1);
    (0..=count).map(move |k| PixelRect::centred_at((a.0 + (b.0 - a.0) * k / count, a.1 + (b.1 - a.1) * k / count), 1))
}
