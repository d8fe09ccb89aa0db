//! Disjoint sets of connected items, and the choice of the largest remnant among fragments, sets of bodies in contact.

/// Smallest ratio of the number of members of the largest remnant to that of the most numerous fragment: a planet, a
/// lander or an impactor is not the remnant of an aggregate, however heavy.
const MIN_REMNANT_SHARE: f64 = 0.1;

/// Size of a fragment.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FragmentSize {
    /// Mass, kg.
    pub mass: f64,
    /// Number of bodies.
    pub members: usize,
}

/// Index of the largest remnant among fragments: the heaviest one with at least a tenth of the members of the most numerous one,
/// the first of equals. `None` without fragments.
///
/// ```
/// use cd_formats::groups::{FragmentSize, largest_remnant};
/// let fragments = [(5.0, 20), (90.0, 1), (6.0, 12)].map(|(mass, members)| FragmentSize { mass, members });
/// assert_eq!(largest_remnant(&fragments), Some(2));
/// ```
pub fn largest_remnant(fragments: &[FragmentSize]) -> Option<usize> {
    let max_members = fragments.iter().map(|fragment| fragment.members).max()?;
    let is_large = |k: &usize| fragments[*k].members as f64 >= MIN_REMNANT_SHARE * max_members as f64;
    (0..fragments.len())
        .filter(is_large)
        .reduce(|best, k| if fragments[k].mass > fragments[best].mass { k } else { best })
}

/// Disjoint sets of the numbers 0, 1, ... with halving of paths.
///
/// ```
/// let mut sets = cd_formats::groups::DisjointSets::new(4);
/// sets.union(3, 1);
/// sets.union(0, 3);
/// assert_eq!([0, 1, 2, 3].map(|i| sets.find(i)), [0, 0, 2, 0]);
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
