//! Groups of items connected by pairwise links.

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
