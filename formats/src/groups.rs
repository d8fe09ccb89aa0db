//! Things that hang together by links between two of them.

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
    /// Each by itself.
    pub fn new(count: usize) -> Self {
        DisjointSets((0..count).collect())
    }

    /// The least of the group of `i`.
    pub fn find(&mut self, mut i: usize) -> usize {
        while self.0[i] != i {
            self.0[i] = self.0[self.0[i]];
            i = self.0[i];
        }
        i
    }

    /// Makes one group of those of `i` and `j`.
    pub fn union(&mut self, i: usize, j: usize) {
        let (i, j) = (self.find(i), self.find(j));
        self.0[i.max(j)] = i.min(j);
    }
}
