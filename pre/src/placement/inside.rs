//! Interior of a closed surface as a region for grains.

use std::sync::Arc;

use cd_formats::surface::{Surface, SurfaceFault, SurfaceFaults};
use nalgebra::Vector3;
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::math::{Pose, Vector as Point};
use parry3d_f64::query::{self, PointQuery};
use parry3d_f64::shape::{ConvexPolyhedron, TriMesh, TriMeshFlags};

use crate::shapes::overlap::ConvexPiece;

/// Closed surface about its centre of mass.
#[derive(Clone)]
pub struct SurfaceRegion {
    /// Solid of volume 1, about its centre of mass.
    surface: Arc<Surface>,
    /// Mesh of `surface`, for distances.
    mesh: Arc<TriMesh>,
    /// Factor of all lengths, m.
    scale: f64,
}

impl PartialEq for SurfaceRegion {
    fn eq(&self, other: &SurfaceRegion) -> bool {
        self.surface == other.surface && self.scale == other.scale
    }
}

impl std::fmt::Debug for SurfaceRegion {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Inside({} vertices, scale {})", self.surface.vertices().len(), self.scale)
    }
}

impl SurfaceRegion {
    /// Region inside of a surface. Errors: a surface of which no mesh can be made.
    pub fn new(surface: &Surface) -> Result<SurfaceRegion, SurfaceFaults> {
        let properties = surface.mass_properties();
        let centre = Vector3::from(properties.centre);
        let scale = libm::cbrt(properties.volume);
        let vertices: Vec<[f64; 3]> =
            surface.vertices().iter().map(|&v| ((Vector3::from(v) - centre) / scale).into()).collect();
        let points = vertices.iter().map(|&[x, y, z]| Point::new(x, y, z)).collect();
        let unit = Surface::new(&vertices, surface.triangles())?;
        let mesh = TriMesh::with_flags(points, unit.triangles().to_vec(), TriMeshFlags::ORIENTED);
        let no_volume = || SurfaceFault::new("its triangles enclose no volume", "expected a closed surface");
        let mesh = mesh.map_err(|_| SurfaceFaults(vec![no_volume()]))?;
        Ok(SurfaceRegion { surface: Arc::new(unit), mesh: Arc::new(mesh), scale })
    }

    /// Volume, m^3.
    pub fn volume(&self) -> f64 {
        self.scale.powi(3)
    }

    /// Region enlarged by a factor about its centre.
    pub fn scaled_by(&self, factor: f64) -> SurfaceRegion {
        SurfaceRegion { scale: factor * self.scale, ..self.clone() }
    }

    /// Vertices about the centre of mass, m.
    pub fn vertices(&self) -> Vec<[f64; 3]> {
        self.surface.vertices().iter().map(|v| v.map(|x| self.scale * x)).collect()
    }

    /// Half the lengths of the smallest box about the centre of mass, m.
    pub fn half_extents(&self) -> Vector3<f64> {
        let farthest_coordinate = |k: usize| self.surface.vertices().iter().map(|v| v[k].abs()).fold(0.0, f64::max);
        self.scale * Vector3::new(farthest_coordinate(0), farthest_coordinate(1), farthest_coordinate(2))
    }

    /// Whether the whole ball of `radius`, m, about `centre` lies inside.
    ///
    /// The nearest point of the surface gives the distance. The mean of the normals at it, weighted by their angles,
    /// gives the side on which the centre lies. The sign is exact for closed surfaces (Baerentzen & Aanaes, IEEE Trans.
    /// Vis. Comput. Graph. 11, 2005).
    pub fn contains_ball(&self, centre: &Vector3<f64>, radius: f64) -> bool {
        let local = centre / self.scale;
        let point = Point::new(local.x, local.y, local.z);
        let nearest = self.mesh.project_local_point(point, false);
        nearest.is_inside && (nearest.point - point).length() >= radius / self.scale
    }

    /// Distance of a point from the surface, m, negative outside, and the unit vector along which it grows; none for a point
    /// on the surface.
    pub fn nearest_wall(&self, point: &Vector3<f64>) -> Option<(f64, Vector3<f64>)> {
        let local = Point::new(point.x / self.scale, point.y / self.scale, point.z / self.scale);
        let nearest = self.mesh.project_local_point(local, false);
        let from_surface = local - nearest.point;
        let length = from_surface.length();
        let sign = if nearest.is_inside { 1.0 } else { -1.0 };
        let inward = Vector3::new(from_surface.x, from_surface.y, from_surface.z) * (sign / length);
        (length > f64::EPSILON).then_some((sign * length * self.scale, inward))
    }

    /// Calls `visit` with the corners, m, of each triangle of the surface near the box from `low` to `high`, m, in the order
    /// of their numbers.
    pub fn for_each_triangle(&self, low: &Vector3<f64>, high: &Vector3<f64>, mut visit: impl FnMut([Vector3<f64>; 3])) {
        let [mins, maxs] = [low, high].map(|v| Point::new(v.x / self.scale, v.y / self.scale, v.z / self.scale));
        let mut numbers: Vec<u32> = self.mesh.bvh().intersect_aabb(&Aabb::new(mins, maxs)).collect();
        numbers.sort_unstable();
        for number in numbers {
            let triangle = self.mesh.triangle(number);
            visit([triangle.a, triangle.b, triangle.c].map(|v| self.scale * Vector3::new(v.x, v.y, v.z)));
        }
    }

    /// Whether no point of the surface is nearer to the convex piece than `margin`, m. Then the piece lies inside as a
    /// whole if one of its points does.
    pub fn keeps_clear_of(&self, piece: &ConvexPiece, margin: f64) -> bool {
        let point = |v: Vector3<f64>| Point::new(v.x / self.scale, v.y / self.scale, v.z / self.scale);
        let Some(hull) = ConvexPolyhedron::from_convex_hull(&piece.vertices().map(point).collect::<Vec<_>>()) else {
            return false;
        };
        query::distance(&Pose::IDENTITY, &*self.mesh, &Pose::IDENTITY, &hull)
            .is_ok_and(|gap| gap.distance * self.scale > margin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{RandomStream, StreamPurpose};
    use crate::shapes::hull;
    use crate::sphere::sphere_spiral;

    /// A sphere with deep dents and sharp ridges.
    fn dented() -> Surface {
        let ball = hull::convex_hull(&sphere_spiral(500)).unwrap();
        let dent = |&v: &[f64; 3]| {
            let [x, y, z] = v;
            let r = 1.0 + 0.5 * libm::sin(5.0 * x) * libm::sin(4.0 * y) + 0.3 * libm::fabs(z - 0.3);
            v.map(|c| 100.0 * r * c)
        };
        let vertices: Vec<[f64; 3]> = ball.vertices().iter().map(dent).collect();
        Surface::new(&vertices, ball.triangles()).unwrap()
    }

    /// Winding number of the surface about a point: the sum of the solid angles of its triangles, divided by 4 pi.
    ///
    /// A. van Oosterom, J. Strackee, IEEE Trans. Biomed. Eng. 30 (1983) 125.
    fn winding(vertices: &[[f64; 3]], triangles: &[[u32; 3]], point: &Vector3<f64>) -> f64 {
        let angle = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|k| Vector3::from(vertices[k as usize]) - point);
            let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
            2.0 * f64::atan2(a.dot(&b.cross(&c)), la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb)
        };
        triangles.iter().map(angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
    }

    #[test]
    fn inside_is_where_the_surface_goes_round_a_point() {
        let surface = dented();
        let inside = SurfaceRegion::new(&surface).unwrap();
        assert!((inside.volume() / surface.volume() - 1.0).abs() < 1e-14);
        let vertices = inside.vertices();
        let mut random = RandomStream::new(8, 0, StreamPurpose::Positions);
        let mut counts = [0, 0];
        for k in 0..4000 {
            // Points anywhere, and points close to vertices, edges and faces.
            let point = if k % 2 == 0 {
                150.0 * random.point_in_cube()
            } else {
                let [a, b, c] = surface.triangles()[random.uniform_index(surface.triangles().len())]
                    .map(|v| Vector3::from(vertices[v as usize]));
                let (u, v) = (
                    [0.0, 0.0, 1.0, 0.5, random.uniform()][random.uniform_index(5)],
                    [0.0, 0.5, random.uniform()][random.uniform_index(3)],
                );
                a + (b - a) * u + (c - a) * (1.0 - u) * v + 1e-6 * random.point_in_cube()
            };
            let number = winding(&vertices, surface.triangles(), &point);
            assert!((number - number.round()).abs() < 1e-6, "{number}");
            assert_eq!(inside.contains_ball(&point, 0.0), number > 0.5, "{point} {number}");
            counts[usize::from(number > 0.5)] += 1;
        }
        assert!(counts.iter().all(|count| *count > 500), "{counts:?}");
    }

    #[test]
    fn walls_of_a_cube_have_their_distances_and_normals() {
        let corner = |k: usize| [0, 1, 2].map(|axis| if k >> axis & 1 == 0 { 4.0 } else { 6.0 });
        let cube = hull::convex_hull(&(0..8).map(corner).collect::<Vec<_>>()).unwrap();
        let inside = SurfaceRegion::new(&cube).unwrap();
        for (x, expected) in [(0.75, 0.25), (1.5, -0.5)] {
            let (distance, inward) = inside.nearest_wall(&Vector3::new(x, 0.2, -0.1)).unwrap();
            // Rounding of lengths of about 1.
            assert!(
                (distance - expected).abs() < 1e-14 && (inward + Vector3::x()).norm() < 1e-14,
                "{distance} {inward}"
            );
        }
    }

    #[test]
    fn balls_keep_within_a_cube() {
        let corner = |k: usize| [0, 1, 2].map(|axis| if k >> axis & 1 == 0 { 4.0 } else { 6.0 });
        let cube = hull::convex_hull(&(0..8).map(corner).collect::<Vec<_>>()).unwrap();
        let inside = SurfaceRegion::new(&cube).unwrap();
        let holds = |x: f64, y: f64, radius: f64| inside.contains_ball(&Vector3::new(x, y, 0.0), radius);
        assert!(holds(0.0, 0.0, 0.999999) && !holds(0.0, 0.0, 1.000001));
        assert!(holds(0.5, -0.5, 0.499999) && !holds(0.5, -0.5, 0.500001) && !holds(1.1, 0.0, 0.0));
        let larger = inside.scaled_by(3.0);
        assert!(
            (larger.volume() / 216.0 - 1.0).abs() < 1e-14
                && (larger.half_extents() - Vector3::repeat(3.0)).norm() < 1e-14
        );
    }
}
