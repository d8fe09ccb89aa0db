//! Models: surfaces from files at their size, as the shape of grains, with convex contact shapes, and as regions for grains.

use std::path::Path;

use cd_formats::error::{Fault, Faults};
use cd_formats::surface::Surface;
use parry3d_f64::math::Vector as Point;
use parry3d_f64::transformation::vhacd::{VHACD, VHACDParameters};
use parry3d_f64::transformation::voxelization::FillMode;

use crate::scene::{ContactSurface, ModelScale};
use crate::shapes::clump::{self, BallsError, PrincipalClump};
use crate::shapes::hull;
use crate::shapes::hull::HullError;
use crate::shapes::inscribed::{SurfaceBalls, inscribed_balls};
use crate::shapes::principal::PrincipalSolid;
use crate::shapes::read::{self, RepairedSurface};
use crate::shapes::union::union_properties;
use crate::sphere::sphere_spiral;

/// Largest shift of vertices, divided by the extent, for which a surface counts as convex: files have seven digits.
const CONVEXITY_TOLERANCE: f64 = 1e-6;

/// Deviations from convexity, divided by the extent, up to which a surface is replaced by its hull, as its coordinates
/// have few digits. Six decimals of a cube of 1 cm give 5e-5.
const ROUNDING_DEVIATIONS: [f64; 6] = [2e-6, 5e-6, 1e-5, 2e-5, 5e-5, 1e-4];

/// Number of voxels along the longest side for the convex decomposition.
const VOXEL_RESOLUTION: u32 = 64;

/// Smallest ratio of the volume of a piece to that of the whole; smaller pieces are left out as slivers.
const MIN_PIECE_VOLUME: f64 = 1e-6;

/// Advice about a surface of which no body can be made.
const LARGER_SURFACE: &str =
    "expected a surface that encloses a volume, large enough to be represented: check its scale";

/// Reads the surface of a file and scales it. Errors: the errors of [`read::read_surface`].
pub fn read_surface(folder: &Path, file: &str, scale: ModelScale) -> Result<RepairedSurface, Faults> {
    let path = folder.join(file);
    let read = read::read_surface(&path)?;
    let factor = scale_factor(&read.surface, scale);
    Ok(RepairedSurface { surface: scale_surface(&path, &read.surface, factor)?, ..read })
}

/// Factor from the lengths of the file to the requested size.
fn scale_factor(surface: &Surface, scale: ModelScale) -> f64 {
    match scale {
        ModelScale::Factor(factor) => factor,
        ModelScale::Volume(volume) => libm::cbrt(volume / surface.volume()),
        ModelScale::Radius(radius) => {
            radius / libm::cbrt(0.75 * surface.mass_properties().volume / std::f64::consts::PI)
        }
        ModelScale::Length(length) => {
            let [x, y, z] = bounding_box(surface).map(|[low, high]| high - low);
            length / x.max(y).max(z)
        }
    }
}

/// Bounding box of a surface: both ends along each axis, m.
fn bounding_box(surface: &Surface) -> [[f64; 2]; 3] {
    [0, 1, 2].map(|k| {
        let coordinates = || surface.vertices().iter().map(|v| v[k]);
        [coordinates().fold(f64::INFINITY, f64::min), coordinates().fold(f64::NEG_INFINITY, f64::max)]
    })
}

/// Surface of the file `path`, scaled by `factor`.
fn scale_surface(path: &Path, surface: &Surface, factor: f64) -> Result<Surface, Faults> {
    if factor == 1.0 {
        return Ok(surface.clone());
    }
    let vertices: Vec<[f64; 3]> = surface.vertices().iter().map(|v| v.map(|x| factor * x)).collect();
    Surface::new(&vertices, surface.triangles()).map_err(|_| {
        let found = format!("scaled by {factor:e} it has no finite volume");
        Fault::new(path, None, "surface", found, "expected a size with a finite volume").into()
    })
}

/// Solid of a model.
#[derive(Debug, Clone, PartialEq)]
pub enum ModelSolid {
    Polyhedron(PrincipalSolid),
    Clump(PrincipalClump),
}

/// Solid of a model, and notes on it. Errors: a file that is no closed surface, a size without a finite volume, a surface that
/// is not convex although `contact_shape` requires it, or no convex body from it.
pub fn model_solid(
    folder: &Path,
    file: &str,
    scale: ModelScale,
    contact_shape: &ContactSurface,
) -> Result<(ModelSolid, String), Faults> {
    let path = folder.join(file);
    let model_fault =
        |object: &str, found: String, expected: &str| Faults::from(Fault::new(&path, None, object, found, expected));
    let read = read::read_surface(&path)?;
    let factor = scale_factor(&read.surface, scale);
    let whole = scale_surface(&path, &read.surface, factor)?;
    let mut summary = repair_summary(file, &whole, &read);
    let solid = match contact_shape {
        ContactSurface::Surface => {
            let expected = "expected a convex one, or contact_shape: Hull, Pieces(...), Files([...]) or Balls(...)";
            let (surface, note) = convex_surface(&whole)
                .ok_or_else(|| model_fault("surface", "it is not convex".to_string(), expected))?;
            summary += &note;
            PrincipalSolid::from_convex(&surface)
        }
        ContactSurface::Hull => {
            let hull = hull::convex_hull(whole.vertices());
            let hull = hull.map_err(|misfit| model_fault("hull", misfit.to_string(), LARGER_SURFACE))?;
            summary += &format!(", hull of {:.4} times its volume", hull.volume() / whole.volume());
            PrincipalSolid::from_convex(&hull)
        }
        &ContactSurface::Pieces { max_pieces, concavity, max_vertices } => {
            let pieces = decompose_convex(&whole, max_pieces, concavity, max_vertices);
            let pieces = pieces.map_err(|misfit| model_fault("pieces", misfit.to_string(), LARGER_SURFACE))?;
            if pieces.is_empty() {
                return Err(model_fault("pieces", "none was found".to_string(), LARGER_SURFACE));
            }
            summary += &coverage_text(&whole, &pieces);
            PrincipalSolid::new(&whole, &pieces)
        }
        ContactSurface::Files(files) => {
            let model_box = bounding_box(&read.surface);
            let mut faults = Faults::default();
            let mut pieces = Vec::new();
            for file in files {
                let piece = read_piece(folder, file, &model_box, factor);
                if let Some((piece, notes)) = faults.gather_result(piece) {
                    pieces.push(piece);
                    summary += &notes;
                }
            }
            faults.into_result(())?;
            summary += &coverage_text(&whole, &pieces);
            PrincipalSolid::new(&whole, &pieces)
        }
        &ContactSurface::Balls { max_balls, max_error } => {
            let chosen = inscribed_balls(&whole, max_balls, max_error)
                .ok_or_else(|| model_fault("balls", "none was found".to_string(), LARGER_SURFACE))?;
            clump::check_balls(&chosen.balls).map_err(|BallsError { found, expected }| {
                let advice = match chosen.balls.len() {
                    0 | 1 => "expected several balls: a smaller max_error, or Sphere as the shape".to_string(),
                    _ => format!("expected {expected}"),
                };
                model_fault("balls", found, &advice)
            })?;
            summary += &balls_text(&whole, &chosen);
            let clump = PrincipalClump::new(&chosen.balls, &whole.mass_properties());
            return Ok((ModelSolid::Clump(clump), summary));
        }
    };
    let solid = solid.map_err(|misfit| model_fault("surface", misfit.to_string(), LARGER_SURFACE))?;
    Ok((ModelSolid::Polyhedron(solid), summary))
}

/// Text about balls that represent a surface: their number, volume and distances.
fn balls_text(whole: &Surface, found: &SurfaceBalls) -> String {
    format!(
        ", {} balls: union {:.4} of its volume; {:.4} of its surface within max_error, farthest point of the surface {:.3e} m \
         from the balls",
        found.balls.len(),
        union_properties(&found.balls).volume / whole.volume(),
        found.covered_share,
        found.largest_distance
    )
}

/// Convex piece of a model from a file of its own, scaled by `factor`, and notes on it for the summary; `model_box` is the
/// bounding box of the model in the axes of the file.
///
/// Errors: faults of the file, and a piece that is not convex or outside of the model.
fn read_piece(folder: &Path, file: &str, model_box: &[[f64; 2]; 3], factor: f64) -> Result<(Surface, String), Faults> {
    let path = folder.join(file);
    let RepairedSurface { mut surface, repairs, .. } = read::read_surface(&path)?;
    let (mut faults, mut notes) = (Faults::default(), String::new());
    match convex_surface(&surface) {
        Some((convex, note)) => {
            if !note.is_empty() {
                notes += &format!(", {file}{note}");
            }
            surface = convex;
        }
        None => faults.push(Fault::new(&path, None, "surface", "it is not convex", "expected convex pieces")),
    }
    let mut sides = bounding_box(&surface).into_iter().zip(model_box);
    if sides.any(|([low, high], [model_low, model_high])| high <= *model_low || *model_high <= low) {
        let expected = "expected a piece of the model, in the same axes";
        faults.push(Fault::new(&path, None, "surface", "it is outside the model", expected));
    }
    if !repairs.is_empty() {
        notes += &format!(", {file}: {}", repairs.join(", "));
    }
    let scaled = faults.gather_result(scale_surface(&path, &surface, factor));
    Ok((faults.into_result(scaled)?.expect("without faults there is a surface"), notes))
}

/// Convex surface, or its hull if it is convex but for the digits of its coordinates, and a note on that; `None` for a surface
/// that is not convex.
fn convex_surface(surface: &Surface) -> Option<(Surface, String)> {
    if surface.is_convex(CONVEXITY_TOLERANCE) {
        return Some((surface.clone(), String::new()));
    }
    let deviation = ROUNDING_DEVIATIONS.into_iter().find(|deviation| surface.is_convex(*deviation))?;
    let hull = hull::convex_hull(surface.vertices()).ok()?;
    let note = format!(
        ", replaced by its convex hull, from which it deviates by {deviation:.0e} of its size (rounded coordinates)"
    );
    Some((hull, note))
}

/// Counts, volume and repairs of a surface from a file, for the summary.
fn repair_summary(file: &str, whole: &Surface, read: &RepairedSurface) -> String {
    let (vertices, triangles) = (whole.vertices().len(), whole.triangles().len());
    let flipped_text = match read.flipped {
        0 => String::new(),
        flipped => format!(", {flipped} of them turned outward"),
    };
    let size = format!("{file}: {vertices} vertices, {triangles} triangles{flipped_text}, {:.6e} m^3", whole.volume());
    if read.repairs.is_empty() { size } else { format!("{size} ({})", read.repairs.join(", ")) }
}

/// Text about the number and the volume of convex pieces.
fn coverage_text(whole: &Surface, pieces: &[Surface]) -> String {
    let sum: f64 = pieces.iter().map(Surface::volume).sum();
    format!(", {} convex pieces, together {:.4} of its volume", pieces.len(), sum / whole.volume())
}

/// Approximates the inside of `whole` by at most `max_pieces` convex pieces (K. Mamou, Volumetric hierarchical approximate
/// convex decomposition, 2016, by parry). Each piece is the hull of the part of the surface in it, with at most
/// `max_vertices` vertices.
fn decompose_convex(
    whole: &Surface,
    max_pieces: u32,
    concavity: f64,
    max_vertices: usize,
) -> Result<Vec<Surface>, HullError> {
    // Frame in which the surface has size 1 about its centre.
    let properties = whole.mass_properties();
    let [x, y, z] = properties.centre;
    let size = libm::cbrt(properties.volume);
    let point = |v: &[f64; 3]| Point::new((v[0] - x) / size, (v[1] - y) / size, (v[2] - z) / size);
    let points: Vec<Point> = whole.vertices().iter().map(point).collect();
    let parameters = VHACDParameters {
        concavity,
        max_convex_hulls: max_pieces,
        resolution: VOXEL_RESOLUTION,
        fill_mode: FillMode::FloodFill { detect_cavities: false },
        ..VHACDParameters::default()
    };
    let parts = VHACD::decompose(&parameters, &points, whole.triangles(), true);
    let mut pieces = Vec::new();
    for part in parts.compute_primitive_intersections(&points, whole.triangles()) {
        let part: Vec<[f64; 3]> = part.iter().map(|p| [x + size * p.x, y + size * p.y, z + size * p.z]).collect();
        match hull::convex_hull(&part).and_then(|piece| reduce_vertices(piece, max_vertices)) {
            Ok(piece) if piece.volume() > MIN_PIECE_VOLUME * properties.volume => pieces.push(piece),
            Ok(_) | Err(HullError::Flat) => {}
            Err(misfit) => return Err(misfit),
        }
    }
    merge_pieces(pieces, max_pieces as usize, max_vertices)
}

/// Merges pairs of pieces into their common hull, those to which it adds the least volume first, until at most
/// `max_pieces` are left. The decomposition halves pieces and may exceed that number.
fn merge_pieces(mut pieces: Vec<Surface>, max_pieces: usize, max_vertices: usize) -> Result<Vec<Surface>, HullError> {
    if pieces.len() <= max_pieces {
        return Ok(pieces);
    }
    let hull = |a: &Surface, b: &Surface| {
        hull::convex_hull(&[a.vertices(), b.vertices()].concat()).and_then(|hull| reduce_vertices(hull, max_vertices))
    };
    // Remaining pieces, and the volume that joining each pair would add, m^3.
    let (mut remaining, mut pairs) = (Vec::new(), Vec::<(f64, [usize; 2])>::new());
    let mut first_new = 0;
    loop {
        for b in first_new..pieces.len() {
            let added_volume = |a: usize| {
                hull(&pieces[a], &pieces[b])
                    .map_or(f64::INFINITY, |hull| hull.volume() - pieces[a].volume() - pieces[b].volume())
            };
            pairs.extend(remaining.iter().map(|&a| (added_volume(a), [a, b])));
            remaining.push(b);
        }
        first_new = pieces.len();
        let best_pair = pairs.iter().min_by(|(volume, _), (other, _)| volume.total_cmp(other));
        let Some(&(_, joined)) = best_pair.filter(|_| remaining.len() > max_pieces) else {
            return Ok(remaining.into_iter().map(|k| pieces[k].clone()).collect());
        };
        pieces.push(hull(&pieces[joined[0]], &pieces[joined[1]])?);
        remaining.retain(|k| !joined.contains(k));
        pairs.retain(|(_, pair)| pair.iter().all(|k| !joined.contains(k)));
    }
}

/// Hull of the vertices with the farthest reach along `vertices` evenly spread directions, if it has more vertices.
fn reduce_vertices(piece: Surface, vertices: usize) -> Result<Surface, HullError> {
    if piece.vertices().len() <= vertices {
        return Ok(piece);
    }
    let mut farthest_vertices: Vec<[f64; 3]> = Vec::with_capacity(vertices);
    for [x, y, z] in sphere_spiral(vertices) {
        let reach = |v: &&[f64; 3]| x * v[0] + y * v[1] + z * v[2];
        if let Some(&farthest) = piece.vertices().iter().max_by(|a, b| reach(a).total_cmp(&reach(b)))
            && !farthest_vertices.contains(&farthest)
        {
            farthest_vertices.push(farthest);
        }
    }
    hull::convex_hull(&farthest_vertices)
}
