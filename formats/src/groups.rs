//! Things that hang together by links between two of them.

/// Disjoint sets of the numbers 0, 1, ... with halving of paths.
///
/// ```
/// let mut groups = cd_formats::groups::Groups::new(4);
/// groups.join(3, 1);
/// groups.join(0, 3);
/// assert_eq!([0, 1, 2, 3].map(|i| groups.root(i)), [0, 0, 2, 0]);
/// ```
#[derive(Debug, Clone)]
pub struct Groups(Vec<usize>);

impl Groups {
    /// Each by itself.
    pub fn new(count: usize) -> Self {
        Groups((0..count).collect())
    }

    /// The least of the group of `i`.
    pub fn root(&mut self, mut i: usize) -> usize {
        while self.0[i] != i {
            self.0[i] = self.0[self.0[i]];
            i = self.0[i];
        }
        i
    }

    /// Makes one group of those of `i` and `j`.
    pub fn join(&mut self, i: usize, j: usize) {
        let (i, j) = (self.root(i), self.root(j));
        self.0[i.max(j)] = i.min(j);
    }
}
