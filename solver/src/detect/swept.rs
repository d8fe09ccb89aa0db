//! Pairs of moving balls that come near each other within a step, found by their paths instead of their speeds.
//!
//! A tree of boxes bounds positions and displacements together. Two boxes are descended only if a ball of one and a ball
//! of the other can be in reach of each other at the same time. The work is proportional to the number of balls and
//! pairs, also if groups of balls move past each other at any speed: a box is split along the widest of its positions and
//! displacements, so that balls that move together stay together.

use rayon::prelude::*;

use crate::math::Vec3;

/// Balls in a leaf of the tree.
const MAX_LEAF_BALLS: usize = 8;
/// Smallest number of balls whose part of the tree a task makes.
const MIN_BALLS_PER_TASK: usize = 2048;
/// Relative margin on a reach, and on the length of the step, for rounding.
const ROUNDING_MARGIN: f64 = 1e-9;

/// Ball on its straight path through a step.
#[derive(Debug, Clone, Copy)]
pub struct SweptBall {
    /// Centre in the step's contact configuration, m.
    pub centre: Vec3,
    /// Displacement in the lookahead time, m.
    pub path: Vec3,
    /// Radius, m.
    pub radius: f64,
    /// Whether its pairs are searched; pairs of two balls without this flag are omitted.
    pub searched: bool,
}

/// Smallest distance of two points, one of which moves by `path` relative to the other from `offset` on, m.
///
/// ```
/// # use cd_solve::{detect::swept::least_distance, math::Vec3};
/// let at = |x: f64| least_distance(&Vec3::new(x, 3.0, 0.0), &Vec3::new(8.0, 0.0, 0.0));
/// assert_eq!((at(-4.0), at(-12.0), at(4.0)), (3.0, 5.0, 5.0));
/// ```
pub fn least_distance(offset: &Vec3, path: &Vec3) -> f64 {
    let along = -offset.dot(path);
    if along <= 0.0 {
        return offset.norm();
    }
    (offset + path * (along / path.norm_squared()).min(1.0)).norm()
}

/// Node of the tree: bounds of the positions and displacements of its balls.
struct BoxNode {
    /// Ranges of the balls' coordinates, reaches included, and of their displacements, m.
    balls: [[f64; 2]; 3],
    paths: [[f64; 2]; 3],
    /// Range of its balls in [`BoxTree::order`].
    first: u32,
    end: u32,
    /// Index of the second child minus its own; the first child follows its parent. 0 for a leaf.
    second: u32,
    /// Whether a ball of it is searched.
    searched: bool,
}

/// Binary tree of boxes.
struct BoxTree<'a> {
    balls: &'a [SweptBall],
    /// Indices of the balls; the balls of a node are consecutive.
    order: Vec<u32>,
    /// Nodes depth first, from the root.
    nodes: Vec<BoxNode>,
}

impl<'a> BoxTree<'a> {
    fn new(balls: &'a [SweptBall]) -> Self {
        let (mut order, mut nodes) = ((0..balls.len() as u32).collect::<Vec<u32>>(), Vec::new());
        BoxTree::add_subtree(balls, &mut order, 0, &mut nodes);
        BoxTree { balls, order, nodes }
    }

    /// Adds the nodes of the balls `order`, which are in the whole order from `first` on, and orders these.
    fn add_subtree(balls: &[SweptBall], order: &mut [u32], first: usize, nodes: &mut Vec<BoxNode>) {
        const EMPTY_RANGE: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];
        let mut node = BoxNode {
            balls: [EMPTY_RANGE; 3],
            paths: [EMPTY_RANGE; 3],
            first: first as u32,
            end: (first + order.len()) as u32,
            second: 0,
            searched: false,
        };
        // Extent of the centres and displacements alone.
        let mut extent = [EMPTY_RANGE; 6];
        let widen = |range: &mut [f64; 2], low: f64, high: f64| *range = [range[0].min(low), range[1].max(high)];
        for &i in &*order {
            let ball = &balls[i as usize];
            let reach = ball.radius * (1.0 + ROUNDING_MARGIN);
            for (k, extent) in extent[..3].iter_mut().enumerate() {
                widen(&mut node.balls[k], ball.centre[k] - reach, ball.centre[k] + reach);
                widen(&mut node.paths[k], ball.path[k], ball.path[k]);
                widen(extent, ball.centre[k], ball.centre[k]);
            }
            node.searched |= ball.searched;
        }
        extent[3..].copy_from_slice(&node.paths);
        let own_index = nodes.len();
        nodes.push(node);
        if order.len() <= MAX_LEAF_BALLS {
            return;
        }
        let axis = (0..6).max_by(|a, b| (extent[*a][1] - extent[*a][0]).total_cmp(&(extent[*b][1] - extent[*b][0])));
        let axis = axis.unwrap_or(0);
        let coordinate = |i: &u32| {
            let ball = &balls[*i as usize];
            if axis < 3 { ball.centre[axis] } else { ball.path[axis - 3] }
        };
        let half = order.len() / 2;
        let by_coordinate = |a: &u32, b: &u32| coordinate(a).total_cmp(&coordinate(b)).then(a.cmp(b));
        order.select_nth_unstable_by(half, by_coordinate);
        let (one, two) = order.split_at_mut(half);
        if one.len() < MIN_BALLS_PER_TASK {
            BoxTree::add_subtree(balls, one, first, nodes);
            nodes[own_index].second = (nodes.len() - own_index) as u32;
            BoxTree::add_subtree(balls, two, first + half, nodes);
            return;
        }
        let subtree = |order: &mut [u32], first: usize| {
            let mut nodes = Vec::new();
            BoxTree::add_subtree(balls, order, first, &mut nodes);
            nodes
        };
        let (mut one, mut two) = rayon::join(|| subtree(one, first), || subtree(two, first + half));
        nodes.append(&mut one);
        nodes[own_index].second = (nodes.len() - own_index) as u32;
        nodes.append(&mut two);
    }

    /// Adds the pairs of the leaf `a` with itself and with later leaves.
    fn add_leaf_pairs(&self, a: &BoxNode, pairs: &mut Vec<[u32; 2]>) {
        let mut stack = vec![0u32];
        while let Some(k) = stack.pop() {
            let b = &self.nodes[k as usize];
            if b.end <= a.first || !(a.searched || b.searched) || !can_meet(a, b) {
                continue;
            }
            if b.second != 0 {
                stack.extend([k + b.second, k + 1]);
                continue;
            }
            for position in a.first..a.end {
                let i = self.order[position as usize];
                let start = b.first.max(position + 1) as usize;
                let others = &self.order[start..start.max(b.end as usize)];
                let one = &self.balls[i as usize];
                for &j in others {
                    let other = &self.balls[j as usize];
                    let searched = one.searched || other.searched;
                    if searched
                        && least_distance(&(one.centre - other.centre), &(one.path - other.path))
                            <= one.radius + other.radius
                    {
                        pairs.push([i.min(j), i.max(j)]);
                    }
                }
            }
        }
    }
}

/// Whether a ball of one node can reach a ball of the other at some time of the step.
fn can_meet(a: &BoxNode, b: &BoxNode) -> bool {
    // Part of the step in which the boxes, which grow as their balls separate, overlap along all axes.
    let mut interval = [0.0, 1.0f64];
    for k in 0..3 {
        for (one, other) in [(a, b), (b, a)] {
            // Condition that the lower side of one is not above the upper side of the other: rate s <= limit.
            let (rate, limit) = (one.paths[k][0] - other.paths[k][1], other.balls[k][1] - one.balls[k][0]);
            if rate > 0.0 {
                interval[1] = interval[1].min(limit / rate);
            } else if rate < 0.0 {
                interval[0] = interval[0].max(limit / rate);
            } else if limit < 0.0 {
                return false;
            }
        }
    }
    interval[0] <= interval[1] + ROUNDING_MARGIN
}

/// All pairs i < j of balls that touch or overlap within the step, in an order that does not depend on threads.
pub fn swept_pairs(balls: &[SweptBall]) -> Vec<[u32; 2]> {
    let tree = BoxTree::new(balls);
    let leaves: Vec<&BoxNode> = tree.nodes.iter().filter(|node| node.second == 0).collect();
    let found = leaves.par_chunks(16).map(|leaves| {
        let mut pairs = Vec::new();
        leaves.iter().for_each(|leaf| tree.add_leaf_pairs(leaf, &mut pairs));
        pairs
    });
    found.collect::<Vec<_>>().concat()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sort_pairs(mut pairs: Vec<[u32; 2]>) -> Vec<[u32; 2]> {
        pairs.sort_unstable();
        pairs
    }

    proptest! {
        #[test]
        fn pairs_are_those_whose_paths_meet(
            points in prop::collection::vec(
                (prop::array::uniform3(-10.0..10.0f64), prop::array::uniform3(-9.0..9.0f64), -6.0..1.0f64, any::<bool>(), 0..3u32),
                0..90,
            ),
        ) {
            let ball = |(x, u, size, searched, group): ([f64; 3], [f64; 3], f64, bool, u32)| {
                // Groups that move past each other, one of them far away.
                let (away, common) = [(0.0, 0.0), (5.0, -20.0), (1e6, 1e3)][group as usize];
                SweptBall {
                    centre: Vec3::from(x) + Vec3::x() * away,
                    path: Vec3::from(u) * 0.3 + Vec3::x() * common,
                    radius: size.exp2(),
                    searched,
                }
            };
            let balls: Vec<SweptBall> = points.into_iter().map(ball).collect();
            let mut expected = Vec::new();
            for j in 0..balls.len() {
                for i in 0..j {
                    let [a, b] = [&balls[i], &balls[j]];
                    let distance = least_distance(&(a.centre - b.centre), &(a.path - b.path));
                    if (a.searched || b.searched) && distance <= a.radius + b.radius {
                        expected.push([i as u32, j as u32]);
                    }
                }
            }
            prop_assert_eq!(sort_pairs(swept_pairs(&balls)), sort_pairs(expected));
        }
    }

    #[test]
    fn work_is_proportional_to_pairs_if_two_groups_move_apart() {
        // Two cubes of 10 x 10 x 10 balls, in each of which neighbours touch.
        let balls: Vec<SweptBall> = (0..2000u32)
            .map(|k| {
                let (side, k) = (f64::from(k / 1000), k % 1000);
                let centre = Vec3::new(f64::from(k % 10) + side * 11.0, f64::from(k / 10 % 10), f64::from(k / 100));
                SweptBall { centre, path: Vec3::x() * (1e4 * side), radius: 0.5, searched: true }
            })
            .collect();
        assert_eq!(swept_pairs(&balls).len(), 2 * 3 * 900);
        let tree = BoxTree::new(&balls);
        let leaves = tree.nodes.iter().filter(|node| node.second == 0).count();
        let met: usize = tree.nodes.iter().map(|a| tree.nodes.iter().filter(|b| can_meet(a, b)).count()).sum();
        // Each node meets a few neighbours at each of its eight levels.
        assert!(met < 200 * leaves, "{met}");
    }
}
