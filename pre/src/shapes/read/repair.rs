//! Conversion of polygons to a closed triangulation, with repairs that do not change the body. Points at the same
//! position are merged, triangles without area are dropped, and points of an open surface that differ in their last
//! digits only are welded.

use cd_formats::error::RecordFault;
use cd_formats::names::count_text;
use nalgebra::Vector3;
use rustc_hash::{FxHashMap, FxHashSet};

use cd_formats::mesh::PolygonMesh;

/// Distances up to which points of an open surface are welded, divided by the largest coordinate: the last digit of
/// numbers in single precision, of seven, six and five digits.
pub(super) const WELD_TOLERANCES: [f64; 3] = [2e-7, 2e-6, 2e-5];
/// Largest ratio of the welding distance to the extent: far from the origin the last digit may be as large as details
/// of the surface.
pub(super) const WELD_OF_EXTENT: f64 = 1e-3;
/// Ratio of the height of a triangle to its longest side, below which it has no area; same value as in
/// [`cd_formats::surface::Surface`].
const FLATNESS_LIMIT: f64 = 1e-14;

/// Triangles that a mesh is converted to.
pub struct Triangulation {
    pub vertices: Vec<[f64; 3]>,
    /// Triangles by the numbers of their vertices, from 0.
    pub triangles: Vec<[u32; 3]>,
    /// Phrases about the repairs.
    pub repairs: Vec<String>,
}

/// Triangulates a mesh. Faults of the surface are left for [`cd_formats::surface::Surface::new`].
pub fn triangulate(mesh: PolygonMesh) -> Triangulation {
    let PolygonMesh { points, polygons, notes } = mesh;
    let mut numbers: FxHashMap<[u64; 3], u32> = FxHashMap::default();
    let (mut vertices, mut triangles): (Vec<[f64; 3]>, Vec<[u32; 3]>) = (Vec::new(), Vec::new());
    for polygon in &polygons {
        let corners = polygon.iter().map(|&point| {
            let point = points[point].map(|x| x + 0.0); // makes -0 the same as 0
            *numbers.entry(point.map(f64::to_bits)).or_insert_with(|| {
                vertices.push(point);
                vertices.len() as u32 - 1
            })
        });
        let corners: Vec<u32> = corners.collect();
        match corners.as_slice() {
            [] => {}
            // A polygon of one or two corners is a triangle without area.
            [a] => triangles.push([*a; 3]),
            [a, b] => triangles.push([*a, *b, *b]),
            [first, rest @ ..] => triangles.extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]])),
        }
    }
    let exact = remove_degenerate(&vertices, &triangles, notes.clone());
    if is_closed(&exact.triangles) || vertices.iter().flatten().any(|x| !x.is_finite()) {
        return exact;
    }
    let [largest, extent] = coordinate_and_extent(&vertices);
    for share in WELD_TOLERANCES {
        let distance = (share * largest).min(WELD_OF_EXTENT * extent);
        let (number, vertex_count) = weld_vertices(&vertices, distance);
        let count = vertices.len() - vertex_count;
        let mut notes = notes.clone();
        if count > 0 {
            notes.push(format!("welded {} closer than {distance:.1e} m", count_text(count, "vertex")));
        }
        let triangles: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(|v| number[v as usize])).collect();
        let welded = remove_degenerate(&vertices, &triangles, notes);
        if is_closed(&welded.triangles) {
            return welded;
        }
    }
    exact
}

/// Extents, m, whose fifth powers, the moments of inertia, are numbers of double precision.
pub const EXTENTS: std::ops::RangeInclusive<f64> = 1e-60..=1e60;

/// Fault of the points that polygons use: numbers that are not finite, or an extent without a volume in double precision.
/// Such points have no triangles with an area, and further faults would not name the cause.
pub fn point_fault(mesh: &PolygonMesh) -> Option<RecordFault> {
    let mut used: Vec<usize> = mesh.polygons.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let points: Vec<[f64; 3]> = used.iter().map(|&k| mesh.points[k]).collect();
    let unbounded: Vec<usize> = (0..used.len()).filter(|&k| points[k].iter().any(|x| !x.is_finite())).collect();
    if let Some(&first) = unbounded.first() {
        let [x, y, z] = points[first];
        let more = if unbounded.len() > 1 { format!(", and {} more", unbounded.len() - 1) } else { String::new() };
        let found = format!("point {} is ({x}, {y}, {z}){more}", used[first] + 1);
        return Some(RecordFault::new(found, "expected finite numbers"));
    }
    let [_, extent] = coordinate_and_extent(&points);
    if points.len() > 1 && extent == 0.0 {
        return Some(RecordFault::new("all points are at one position", "expected a closed surface"));
    }
    let is_extreme = points.len() > 1 && !EXTENTS.contains(&extent);
    is_extreme.then(|| {
        let expected = format!("expected {:e} to {:e}; write the file in another unit", EXTENTS.start(), EXTENTS.end());
        RecordFault::new(format!("its extent is {extent:e}"), expected)
    })
}

/// Largest coordinate, and longest side of the box along the axes.
pub(super) fn coordinate_and_extent(vertices: &[[f64; 3]]) -> [f64; 2] {
    let largest = vertices.iter().flatten().fold(0.0, |largest: f64, x| largest.max(x.abs()));
    let side = |k: usize| {
        let ends = vertices.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(v[k]), b.max(v[k])]);
        ends[1] - ends[0]
    };
    [largest, side(0).max(side(1)).max(side(2))]
}

/// Number of the representative of each vertex, the first within `distance`, and the count of remaining vertices.
fn weld_vertices(vertices: &[[f64; 3]], distance: f64) -> (Vec<u32>, usize) {
    let cell = |v: &[f64; 3]| v.map(|x| (x / distance).floor() as i64);
    let mut cells: FxHashMap<[i64; 3], Vec<u32>> = FxHashMap::default();
    let (mut numbers, mut vertex_count) = (Vec::with_capacity(vertices.len()), 0);
    for (k, v) in (0..).zip(vertices) {
        let own_cell = cell(v);
        let is_near = |other: &&u32| {
            let other = vertices[**other as usize];
            (0..3).map(|k| (other[k] - v[k]).powi(2)).sum::<f64>() <= distance * distance
        };
        let neighbours = (0..27i64).map(|k| [k / 9 - 1, k / 3 % 3 - 1, k % 3 - 1]);
        let found = neighbours
            .filter_map(|step| cells.get(&[0, 1, 2].map(|k| own_cell[k].saturating_add(step[k]))))
            .flat_map(|known| known.iter().filter(is_near))
            .min()
            .copied();
        numbers.push(found.unwrap_or(k));
        if found.is_none() {
            cells.entry(own_cell).or_default().push(k);
            vertex_count += 1;
        }
    }
    (numbers, vertex_count)
}

/// Whether every edge belongs to two triangles.
fn is_closed(triangles: &[[u32; 3]]) -> bool {
    let mut edges: FxHashMap<[u32; 2], u32> = FxHashMap::default();
    for [a, b] in triangles.iter().flat_map(triangle_edges) {
        *edges.entry([a.min(b), a.max(b)]).or_default() += 1;
    }
    !triangles.is_empty() && edges.values().all(|count| *count == 2)
}

/// Edges of a triangle by the numbers of their ends, in its order.
pub(super) fn triangle_edges([a, b, c]: &[u32; 3]) -> [[u32; 2]; 3] {
    [[*a, *b], [*b, *c], [*c, *a]]
}

/// Drops triangles without area and second copies of triangles, then vertices that are not used.
fn remove_degenerate(vertices: &[[f64; 3]], triangles: &[[u32; 3]], mut notes: Vec<String>) -> Triangulation {
    let is_flat = |t: &[u32; 3]| apex_of_degenerate(vertices, t).is_some();
    let has_three_corners = |[a, b, c]: &[u32; 3]| a != b && b != c && c != a;
    let mut remaining: Vec<[u32; 3]> = triangles.iter().copied().filter(has_three_corners).collect();
    let (count_with_copies, mut known) = (remaining.len(), FxHashSet::default());
    remaining.retain(|t| {
        let first = (0..3).min_by_key(|&k| t[k]).unwrap_or(0);
        known.insert([t[first], t[(first + 1) % 3], t[(first + 2) % 3]])
    });
    let copies = count_with_copies - remaining.len();
    let flat_before = remaining.iter().filter(|t| is_flat(t)).count();
    if flat_before > 0 {
        let without_flat: Vec<[u32; 3]> = remaining.iter().copied().filter(|t| !is_flat(t)).collect();
        remaining = if is_closed(&without_flat) { without_flat } else { split_neighbours(vertices, remaining) };
    }
    let flat_after = remaining.iter().filter(|t| is_flat(t)).count();
    let degenerate = triangles.len() - count_with_copies + flat_before.saturating_sub(flat_after);
    let mut numbers: FxHashMap<u32, u32> = FxHashMap::default();
    let mut used = Vec::new();
    for corner in remaining.iter_mut().flatten() {
        let vertex = *corner;
        *corner = *numbers.entry(vertex).or_insert_with(|| {
            used.push(vertices[vertex as usize]);
            used.len() as u32 - 1
        });
    }
    if degenerate > 0 {
        notes.push(format!("dropped {}", count_text(degenerate, "degenerate triangle")));
    }
    if copies > 0 {
        notes.push(format!("dropped {}", count_text(copies, "duplicate triangle")));
    }
    Triangulation { vertices: used, triangles: remaining, repairs: notes }
}

/// Returns, for a triangle without area, the position of the corner on its longest side.
fn apex_of_degenerate(vertices: &[[f64; 3]], t: &[u32; 3]) -> Option<usize> {
    let [a, b, c] = t.map(|v| Vector3::from(vertices[v as usize]));
    let lengths = [(c - b).norm(), (a - c).norm(), (b - a).norm()];
    let longest = (0..3).max_by(|&i, &j| lengths[i].total_cmp(&lengths[j])).unwrap_or(0);
    ((b - a).cross(&(c - a)).norm() <= FLATNESS_LIMIT * lengths[longest].powi(2)).then_some(longest)
}

/// Removes triangles without area that close the surface. The neighbour at the longest side is split at the corner on it,
/// so that the edges at this corner get their second triangle.
fn split_neighbours(vertices: &[[f64; 3]], mut triangles: Vec<[u32; 3]>) -> Vec<[u32; 3]> {
    // Neighbours without area may need several passes.
    const MAX_PASSES: usize = 50;
    for _ in 0..MAX_PASSES {
        let mut triangles_of_edge: FxHashMap<[u32; 2], Vec<usize>> = FxHashMap::default();
        for (k, t) in triangles.iter().enumerate() {
            for [a, b] in triangle_edges(t) {
                triangles_of_edge.entry([a.min(b), a.max(b)]).or_default().push(k);
            }
        }
        let mut is_changed = vec![false; triangles.len()];
        let mut is_removed = vec![false; triangles.len()];
        for k in 0..is_changed.len() {
            let t = triangles[k];
            let Some(position) = apex_of_degenerate(vertices, &t).filter(|_| !is_changed[k]) else { continue };
            let (apex, a, b) = (t[position], t[(position + 1) % 3], t[(position + 2) % 3]);
            let others: Vec<usize> =
                triangles_of_edge[&[a.min(b), a.max(b)]].iter().copied().filter(|&other| other != k).collect();
            match others[..] {
                [] => {}
                [other] if is_changed[other] => continue,
                [other] if triangles[other].contains(&apex) => (is_changed[other], is_removed[other]) = (true, true),
                [other] => {
                    let apex_triangle = |old: u32| triangles[other].map(|v| if v == old { apex } else { v });
                    let halves = [apex_triangle(a), apex_triangle(b)];
                    triangles[other] = halves[0];
                    triangles.push(halves[1]);
                    is_changed[other] = true;
                }
                _ => continue,
            }
            (is_changed[k], is_removed[k]) = (true, true);
        }
        if !is_removed.contains(&true) {
            break;
        }
        is_removed.resize(triangles.len(), false);
        let mut is_removed = is_removed.into_iter();
        triangles.retain(|_| !is_removed.next().unwrap_or(false));
    }
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;
    use cd_formats::surface::Surface;

    fn cube() -> PolygonMesh {
        let corner = |k: usize| [k & 1, k >> 1 & 1, k >> 2 & 1].map(|side| side as f64 - 0.5);
        let polygons = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        PolygonMesh {
            points: (0..8).map(corner).collect(),
            polygons: polygons.map(|p| p.to_vec()).into(),
            notes: Vec::new(),
        }
    }

    /// Volume, m^3, and notes.
    fn repaired_volume(mesh: PolygonMesh) -> (f64, String) {
        let Triangulation { vertices, triangles, repairs } = triangulate(mesh);
        (Surface::new(&vertices, &triangles).unwrap().volume(), repairs.join(", "))
    }

    #[test]
    fn points_that_no_surface_can_have_are_named() {
        let fault = |points: [[f64; 3]; 3]| {
            let mesh = PolygonMesh { points: points.to_vec(), polygons: vec![vec![0, 1, 2]], notes: Vec::new() };
            point_fault(&mesh).map(|fault| fault.found)
        };
        let scaled = |size: f64| fault([[0.0; 3], [size, 0.0, 0.0], [0.0, size, 0.0]]);
        assert_eq!([1e-60, 1.0, 1e60].map(scaled), [None, None, None]);
        assert_eq!(scaled(1e-200).as_deref(), Some("its extent is 1e-200"));
        assert_eq!(scaled(0.0).as_deref(), Some("all points are at one position"));
        assert_eq!(fault([[f64::NAN, 0.0, 1.5]; 3]).as_deref(), Some("point 1 is (NaN, 0, 1.5), and 2 more"));
    }

    #[test]
    fn degenerate_and_duplicate_triangles_are_dropped() {
        for (more, note) in [
            (vec![0, 1, 1], "dropped 1 degenerate triangle"),
            (vec![0, 1], "dropped 1 degenerate triangle"),
            (vec![0, 2, 3], "dropped 1 duplicate triangle"),
            (vec![0, 0, 2, 3, 3], "dropped 2 degenerate triangles, dropped 1 duplicate triangle"),
        ] {
            let mut mesh = cube();
            mesh.polygons.push(more);
            assert_eq!(repaired_volume(mesh), (1.0, note.to_string()));
        }
    }

    /// A corner in the middle of an edge, of one of the two faces alone: a triangle without area closes the surface.
    #[test]
    fn a_triangle_without_area_that_closes_the_surface() {
        let mut mesh = cube();
        mesh.points.push([0.0, -0.5, -0.5]);
        mesh.polygons[2] = vec![0, 8, 1, 5, 4];
        mesh.polygons.push(vec![0, 1, 8]);
        assert_eq!(repaired_volume(mesh), (1.0, "dropped 2 degenerate triangles".to_string()));
        let mut mesh = cube();
        mesh.points.push([0.0, -0.5, -0.5]);
        mesh.polygons[2] = vec![8, 1, 5, 4, 0];
        mesh.polygons.push(vec![0, 1, 8]);
        assert_eq!(repaired_volume(mesh), (1.0, "dropped 1 degenerate triangle".to_string()));
    }

    #[test]
    fn gaps_in_the_last_digit_are_welded_and_wider_ones_are_not() {
        for (centre, gap, closes) in [(0.0, 3e-8, true), (0.0, 9e-6, true), (0.0, 1e-3, false), (1e3, 1e-4, true)] {
            let mut mesh = cube();
            mesh.points.iter_mut().flatten().for_each(|x| *x += centre);
            let mut moved = mesh.points[7];
            moved[0] += gap;
            mesh.points.push(moved);
            mesh.polygons[1] = vec![4, 5, 8, 6];
            let Triangulation { vertices, triangles, repairs: notes } = triangulate(mesh);
            match Surface::new(&vertices, &triangles) {
                Ok(surface) => {
                    // The welded corner is displaced by the gap.
                    assert!(closes && (surface.volume() - 1.0).abs() < 1e-4, "{gap}");
                    assert!(notes.join("").starts_with("welded 1 vertex closer than "), "{notes:?}");
                }
                Err(_) => assert!(!closes && notes.is_empty(), "{gap}"),
            }
        }
    }
}
