//! Groups of bodies connected by contacts: disjoint sets, and the choice of the largest remnant among groups.

/// Smallest number of members of the largest remnant, over that of the most numerous group: a planet, a lander or an impactor
/// is not the remnant of an aggregate, however heavy.
const MIN_REMNANT_SHARE: f64 = 0.1;

/// Size of a group.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GroupSize {
    /// Mass, kg.
    pub mass: f64,
    /// Number of bodies.
    pub members: usize,
}

/// Index of the largest remnant among groups: the heaviest one with at least a tenth of the members of the most numerous one,
/// the first of equals. `None` if there is no group.
///
/// ```
/// use cd_formats::groups::{GroupSize, largest_remnant};
/// let groups = [(5.0, 20), (90.0, 1), (6.0, 12)].map(|(mass, members)| GroupSize { mass, members });
/// assert_eq!(largest_remnant(&groups), Some(2));
/// ```
pub fn largest_remnant(groups: &[GroupSize]) -> Option<usize> {
    let max_members = groups.iter().map(|group| group.members).max()?;
    let is_large = |k: &usize| groups[*k].members as f64 >= MIN_REMNANT_SHARE * max_members as f64;
    (0..groups.len()).filter(is_large).reduce(|best, k| if groups[k].mass > groups[best].mass { k } else { best })
}

/// Disjoint sets of the numbers 0, 1, ... with halving of paths.
///
/// ```
/// let mut groups = cd_formats::groups::DisjointSets::new(4);
/// groups.union(3, 1);
/// groups.union(0, 3);
/// assert_eq!([0, 1, 2, 3].map(|i| groups.find(i)), [0, 0, 2, 0]);
/// ```
#[derive(Debug, Clone)]
pub struct DisjointSets(Vec<usize>);

impl DisjointSets {
    /// `count` sets of one number each.
    pub fn new(count: usize) -> Self {
        DisjointSets((0..count).collect())
    }

    /// Smallest number in the set of `i`.
    pub fn find(&mut self, mut i: usize) -> usize {
        while self.0[i] != i {
            self.0[i] = self.0[self.0[i]];
            i = self.0[i];
        }
        i
    }

    /// Merges the sets of `i` and `j`.
    pub fn union(&mut self, i: usize, j: usize) {
        let (i, j) = (self.find(i), self.find(j));
        self.0[i.max(j)] = i.min(j);
    }
}
