//! Split of triangles at vertices of other triangles that lie on their edges, T-junctions, so that pieces of a surface that
//! touch have common edges.

use cd_formats::names::count_text;
use nalgebra::Vector3;
use rustc_hash::FxHashMap;

use super::FileTriangles;
use super::repair::{WELD_OF_EXTENT, WELD_TOLERANCES, coordinate_and_extent, triangle_edges};

/// Vertices inside edges, from the lower to the higher of the two ends of each edge, by the numbers of these ends.
type EdgeVertices = FxHashMap<[u32; 2], Vec<u32>>;

impl FileTriangles {
    /// Surface with its triangles split at vertices that lie on their edges, to the last digit of numbers in single
    /// precision. Both the vertices and the edges are on the rim, where an edge belongs to one triangle. The surface stays
    /// as it is if an edge would belong to more than two triangles.
    pub fn with_split_junctions(mut self) -> Self {
        let counts = edge_counts(&self.triangles);
        let mut rim: Vec<[u32; 2]> = counts.iter().filter(|(_, count)| **count == 1).map(|(edge, _)| *edge).collect();
        rim.sort_unstable();
        let junctions = vertices_on_edges(&self.vertices, &rim);
        if junctions.is_empty() {
            return self;
        }
        let (mut pieces, mut split_count) = (Vec::with_capacity(self.triangles.len()), 0);
        for triangle in &self.triangles {
            let first = pieces.len();
            let edges = triangle_edges(triangle).map(ordered_ends);
            collect_pieces(triangle, &edges, &junctions, &mut pieces);
            split_count += usize::from(pieces.len() > first + 1);
        }
        let has_crowded_edge = |counts: &FxHashMap<[u32; 2], u32>| counts.values().any(|count| *count > 2);
        if has_crowded_edge(&counts) || !has_crowded_edge(&edge_counts(&pieces)) {
            self.triangles = pieces;
            self.repairs.push(format!("split {} at vertices on their edges", count_text(split_count, "triangle")));
        }
        self
    }
}

/// Number of triangles of each edge.
fn edge_counts(triangles: &[[u32; 3]]) -> FxHashMap<[u32; 2], u32> {
    let mut counts = FxHashMap::default();
    for edge in triangles.iter().flat_map(triangle_edges) {
        *counts.entry(ordered_ends(edge)).or_default() += 1;
    }
    counts
}

/// Ends of an edge, the lower number first.
fn ordered_ends([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Vertices of some edges that lie inside others of them.
fn vertices_on_edges(vertices: &[[f64; 3]], edges: &[[u32; 2]]) -> EdgeVertices {
    let [largest, extent] = coordinate_and_extent(vertices);
    let tolerance = (WELD_TOLERANCES[0] * largest).min(WELD_OF_EXTENT * extent);
    let position = |vertex: u32| Vector3::from(vertices[vertex as usize]);
    let mut by_x: Vec<u32> = edges.iter().flatten().copied().collect();
    by_x.sort_unstable_by(|a, b| position(*a).x.total_cmp(&position(*b).x).then(a.cmp(b)));
    by_x.dedup();
    let mut found = EdgeVertices::default();
    for edge in edges {
        let [start, end] = edge.map(position);
        let (along, length) = ((end - start).normalize(), (end - start).norm());
        let [low, high] = [start.x.min(end.x) - tolerance, start.x.max(end.x) + tolerance];
        let first = by_x.partition_point(|vertex| position(*vertex).x < low);
        let near = by_x[first..].iter().take_while(|vertex| position(**vertex).x <= high);
        let inside = near.filter_map(|&vertex| {
            let from_start = position(vertex) - start;
            let distance = from_start.dot(&along);
            let is_on_line = (from_start - along * distance).norm() <= tolerance;
            (is_on_line && distance > tolerance && length - distance > tolerance).then_some((distance, vertex))
        });
        let mut inside: Vec<(f64, u32)> = inside.collect();
        inside.sort_unstable_by(|one, other| one.0.total_cmp(&other.0).then(one.1.cmp(&other.1)));
        if !inside.is_empty() {
            found.insert(*edge, inside.into_iter().map(|(_, vertex)| vertex).collect());
        }
    }
    found
}

/// Appends the pieces of a triangle that is split at the vertices on `edges`, those of its own edges that remain.
fn collect_pieces(triangle: &[u32; 3], edges: &[[u32; 2]], junctions: &EdgeVertices, pieces: &mut Vec<[u32; 3]>) {
    let Some((edge, others)) = edges.split_first() else {
        pieces.push(*triangle);
        return;
    };
    let side = (0..3).find(|&k| ordered_ends(triangle_edges(triangle)[k]) == *edge);
    let (Some(k), Some(inside)) = (side, junctions.get(edge)) else {
        return collect_pieces(triangle, others, junctions, pieces);
    };
    let [from, to, apex] = [0, 1, 2].map(|i| triangle[(k + i) % 3]);
    // A needle may have its apex on the opposite edge.
    let mut chain: Vec<u32> = inside.iter().copied().filter(|&vertex| vertex != apex).collect();
    if from > to {
        chain.reverse();
    }
    chain.insert(0, from);
    chain.push(to);
    chain.windows(2).for_each(|pair| collect_pieces(&[pair[0], pair[1], apex], others, junctions, pieces));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles and repairs after the split.
    fn split(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> (Vec<[u32; 3]>, String) {
        let read = FileTriangles { vertices: vertices.into(), triangles: triangles.into(), repairs: Vec::new() };
        let FileTriangles { triangles, repairs, .. } = read.with_split_junctions();
        (triangles, repairs.join(", "))
    }

    /// A square next to two, whose common corners, in single precision, are on its side.
    #[test]
    fn a_long_edge_gets_the_vertices_on_it() {
        let third = f64::from(1.0f32 / 3.0);
        for off in [0.0, 1e-7] {
            let points = [
                [-1.0, 0.0, 0.0],
                [0.0, 0.0, 0.0],
                [0.0, 1.0, 0.0],
                [-1.0, 1.0, 0.0],
                [off, third, -off],
                [off, 2.0 * third, off],
                [1.0, 0.0, 0.0],
                [1.0, 1.0, 0.0],
            ];
            let left = [[0, 1, 2], [0, 2, 3]];
            let right = [[1, 6, 4], [4, 6, 5], [5, 6, 7], [5, 7, 2]];
            let (triangles, note) = split(&points, &[&left[..], &right].concat());
            assert_eq!(note, "split 1 triangle at vertices on their edges");
            assert_eq!(triangles[..4], [[1, 4, 0], [4, 5, 0], [5, 2, 0], [0, 2, 3]]);
            assert_eq!(triangles[4..], right);
            // Each edge across the joint now has two triangles.
            assert!([[1, 4], [4, 5], [2, 5]].iter().all(|edge| edge_counts(&triangles)[edge] == 2));
            // Nothing is left to split.
            assert_eq!(split(&points, &triangles), (triangles, String::new()));
        }
    }

    /// Vertices on all three edges, and vertices near an edge, at its ends or beyond it.
    #[test]
    fn all_edges_are_split_and_vertices_off_them_ignored() {
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let others = [[0.5, 0.0, 0.0], [0.5, -1.0, 0.0], [0.75, -1.0, 0.0]];
        let mut points = [&corners[..], &others, &[[0.5, 0.5, 0.0], [1.0, 2.0, 0.0], [2.0, 1.0, 0.0]]].concat();
        points.extend([[0.0, 0.5, 0.0], [-1.0, 0.5, 0.0], [-1.0, 0.75, 0.0]]);
        let (triangles, note) = split(&points, &[[0, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11]]);
        assert_eq!(note, "split 1 triangle at vertices on their edges");
        assert_eq!(triangles.len(), 7);
        let area = |[a, b, c]: &[u32; 3]| {
            let [a, b, c] = [a, b, c].map(|&k| Vector3::from(points[k as usize]));
            (b - a).cross(&(c - a)).z
        };
        // Pieces are turned as the triangle was.
        assert!(triangles[..4].iter().all(|triangle| area(triangle) > 0.0), "{triangles:?}");
        assert_eq!(triangles[..4].iter().map(area).sum::<f64>(), 1.0);
        for vertex in [[0.5, 1e-5, 0.0], [0.5, 0.0, -1e-5], [-0.5, 0.0, 0.0]] {
            points[3] = vertex;
            assert_eq!(split(&points[..6], &[[0, 1, 2], [3, 4, 5]]), (vec![[0, 1, 2], [3, 4, 5]], String::new()));
        }
    }

    /// Two triangles on one edge from outside, one of them upright: the edge would get three.
    #[test]
    fn edges_of_three_triangles_are_not_made() {
        let points = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
        let points = [&points[..], &[[1.0, -1.0, 0.0], [1.0, 0.0, 1.0]]].concat();
        let flat = [[0, 1, 2], [4, 3, 5]];
        assert_eq!(split(&points, &flat).1, "split 1 triangle at vertices on their edges");
        // The part of the edge between points 3 and 4 has two triangles already: a piece of the first one would be its third.
        let upright = [[0, 1, 2], [3, 4, 5], [0, 3, 6], [6, 3, 4]];
        assert_eq!(split(&points, &upright), (upright.to_vec(), String::new()));
    }
}
