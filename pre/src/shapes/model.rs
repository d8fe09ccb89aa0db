//! Models: surfaces from files at their size, as grains and as rooms.

use std::path::Path;

use cd_formats::error::{Fault, Faults};
use cd_formats::surface::Surface;
use parry3d_f64::math::Vector as Point;
use parry3d_f64::transformation::vhacd::{VHACD, VHACDParameters};
use parry3d_f64::transformation::voxelization::FillMode;

use crate::place::fragments::spiral;
use crate::scene::{ContactSurface, Scaled};
use crate::shapes::hull::Misfit;
use crate::shapes::read::{self, Read};
use crate::shapes::{Solid, hull};

/// A surface counts as convex if its vertices may move by this share of its extent: files have seven digits.
const CONVEX: f64 = 1e-6;

/// A surface that is convex but for this share of its extent, as few digits of its coordinates leave it, is taken as its
/// hull: six decimals of a cube of 1 cm make 5e-5.
const ROUNDED: [f64; 6] = [2e-6, 5e-6, 1e-5, 2e-5, 5e-5, 1e-4];

/// Voxels along the longest side on which pieces are found.
const RESOLUTION: u32 = 64;

/// Pieces below this share of the volume are left out: shavings.
const SHAVING: f64 = 1e-6;

/// The surface of a file at its size. Errors: those of [`read::surface`].
pub fn surface(folder: &Path, file: &str, scaled: Scaled) -> Result<Read, Faults> {
    let path = folder.join(file);
    let read = read::surface(&path)?;
    let factor = factor(&read.surface, scaled);
    Ok(Read { surface: times(&path, &read.surface, factor)?, ..read })
}

/// How many times as large as in the file.
fn factor(surface: &Surface, scaled: Scaled) -> f64 {
    match scaled {
        Scaled::Factor(factor) => factor,
        Scaled::Volume(volume) => libm::cbrt(volume / surface.volume()),
        Scaled::Radius(radius) => radius / libm::cbrt(0.75 * surface.mass_properties().volume / std::f64::consts::PI),
        Scaled::Length(length) => {
            let [x, y, z] = bounds(surface).map(|[low, high]| high - low);
            length / x.max(y).max(z)
        }
    }
}

/// The box around a surface: the ends along each axis, m.
fn bounds(surface: &Surface) -> [[f64; 2]; 3] {
    [0, 1, 2].map(|k| {
        let of = |start: f64, choose: fn(f64, f64) -> f64| surface.vertices().iter().map(|v| v[k]).fold(start, choose);
        [of(f64::INFINITY, f64::min), of(f64::NEG_INFINITY, f64::max)]
    })
}

/// The surface of the file `path`, so many times as large.
fn times(path: &Path, surface: &Surface, factor: f64) -> Result<Surface, Faults> {
    if factor == 1.0 {
        return Ok(surface.clone());
    }
    let vertices: Vec<[f64; 3]> = surface.vertices().iter().map(|v| v.map(|x| factor * x)).collect();
    Surface::new(&vertices, surface.triangles()).map_err(|_| {
        let found = format!("{factor:e} times as large it is no surface of finite volume");
        Fault::new(path, None, "surface", found, "expected a size whose volume is a number").into()
    })
}

/// The solid of a model, and notes on it.
pub fn solid(folder: &Path, file: &str, scaled: Scaled, contact: &ContactSurface) -> Result<(Solid, String), Faults> {
    let path = folder.join(file);
    let refuse =
        |object: &str, found: String, expected: &str| Faults::from(Fault::new(&path, None, object, found, expected));
    let read = read::surface(&path)?;
    let factor = factor(&read.surface, scaled);
    let whole = times(&path, &read.surface, factor)?;
    let mut told = told(file, &whole, &read);
    let solid = match contact {
        ContactSurface::Whole => {
            let expected = "expected a convex one, or contact: Hull, Pieces(...) or Files([...])";
            let convex = convex(&whole).ok_or_else(|| refuse("surface", "it is not convex".to_string(), expected))?;
            told += &convex.1;
            Solid::convex(&convex.0)
        }
        ContactSurface::Hull => {
            let hull = hull::convex(whole.vertices());
            let hull = hull.map_err(|misfit| refuse("hull", misfit.to_string(), "expected a body"))?;
            told += &format!(", of which the hull has {:.4} times the volume", hull.volume() / whole.volume());
            Solid::convex(&hull)
        }
        &ContactSurface::Pieces { most, concavity, vertices } => {
            let pieces = decompose(&whole, most, concavity, vertices);
            let pieces = pieces.map_err(|misfit| refuse("pieces", misfit.to_string(), "expected a body"))?;
            if pieces.is_empty() {
                return Err(refuse("pieces", "none was found".to_string(), "expected a body that has convex pieces"));
            }
            told += &covered(&whole, &pieces);
            Solid::new(&whole, &pieces)
        }
        ContactSurface::Files(files) => {
            let mut faults = Faults::default();
            let mut pieces = Vec::new();
            let model = bounds(&read.surface);
            for file in files {
                let path = folder.join(file);
                if let Some(mut read) = faults.gather_result(read::surface(&path)) {
                    match convex(&read.surface) {
                        Some((surface, note)) if note.is_empty() => read.surface = surface,
                        Some((surface, note)) => {
                            read.surface = surface;
                            told += &format!(", {file}{note}");
                        }
                        None => {
                            let found = "it is not convex";
                            faults.push(Fault::new(&path, None, "surface", found, "expected convex pieces"));
                        }
                    }
                    let mut ends = bounds(&read.surface).into_iter().zip(&model);
                    if ends.any(|([low, high], [least, most])| high <= *least || *most <= low) {
                        let expected = "expected a piece of the model, in the same axes";
                        faults.push(Fault::new(&path, None, "surface", "it lies beside the model", expected));
                    }
                    if !read.repairs.is_empty() {
                        told += &format!(", {file}: {}", read.repairs.join(", "));
                    }
                    pieces.extend(faults.gather_result(times(&path, &read.surface, factor)));
                }
            }
            faults.into_result(())?;
            told += &covered(&whole, &pieces);
            Solid::new(&whole, &pieces)
        }
    };
    let solid =
        solid.map_err(|misfit| refuse("surface", misfit.to_string(), "expected one whose parts are less small"))?;
    Ok((solid, told))
}

/// A surface that is convex, or its hull if it is but for the digits of its coordinates; and what is to be told of that.
fn convex(surface: &Surface) -> Option<(Surface, String)> {
    if surface.is_convex(CONVEX) {
        return Some((surface.clone(), String::new()));
    }
    let share = ROUNDED.into_iter().find(|share| surface.is_convex(*share))?;
    let hull = hull::convex(surface.vertices()).ok()?;
    let note = format!(
        ", taken as its hull: it is convex but for {share:.0e} of its size, as coordinates of few digits leave it"
    );
    Some((hull, note))
}

/// Counts, volume and repairs of a surface from a file, for the summary.
fn told(file: &str, whole: &Surface, read: &Read) -> String {
    let (vertices, triangles) = (whole.vertices().len(), whole.triangles().len());
    let turned = match read.turned {
        0 => String::new(),
        turned => format!(", {turned} of them turned to point outward"),
    };
    let size = format!("{file}: {vertices} vertices, {triangles} triangles{turned}, {:.6e} m^3", whole.volume());
    if read.repairs.is_empty() { size } else { format!("{size} ({})", read.repairs.join(", ")) }
}

fn covered(whole: &Surface, pieces: &[Surface]) -> String {
    let sum: f64 = pieces.iter().map(Surface::volume).sum();
    format!(", {} convex pieces, together {:.4} of its volume", pieces.len(), sum / whole.volume())
}

/// At most `most` convex pieces that approximate the inside of `whole` (K. Mamou, Volumetric hierarchical approximate
/// convex decomposition, 2016, by parry): hulls of what of the surface lies in each, of at most `vertices` vertices.
fn decompose(whole: &Surface, most: u32, concavity: f64, vertices: usize) -> Result<Vec<Surface>, Misfit> {
    // In a frame in which the surface has size 1 about its centre.
    let properties = whole.mass_properties();
    let [x, y, z] = properties.centre;
    let size = libm::cbrt(properties.volume);
    let point = |v: &[f64; 3]| Point::new((v[0] - x) / size, (v[1] - y) / size, (v[2] - z) / size);
    let points: Vec<Point> = whole.vertices().iter().map(point).collect();
    let parameters = VHACDParameters {
        concavity,
        max_convex_hulls: most,
        resolution: RESOLUTION,
        fill_mode: FillMode::FloodFill { detect_cavities: false },
        ..VHACDParameters::default()
    };
    let parts = VHACD::decompose(&parameters, &points, whole.triangles(), true);
    let mut pieces = Vec::new();
    for part in parts.compute_primitive_intersections(&points, whole.triangles()) {
        let part: Vec<[f64; 3]> = part.iter().map(|p| [x + size * p.x, y + size * p.y, z + size * p.z]).collect();
        match hull::convex(&part).and_then(|piece| fewer(piece, vertices)) {
            Ok(piece) if piece.volume() > SHAVING * properties.volume => pieces.push(piece),
            Ok(_) | Err(Misfit::Flat) => {}
            Err(misfit) => return Err(misfit),
        }
    }
    joined(pieces, most as usize, vertices)
}

/// Two pieces become their common hull, those to which it adds the least volume, until there are at most `most`: the
/// decomposition halves pieces and so may end with more.
fn joined(mut all: Vec<Surface>, most: usize, vertices: usize) -> Result<Vec<Surface>, Misfit> {
    if all.len() <= most {
        return Ok(all);
    }
    let hull = |a: &Surface, b: &Surface| {
        hull::convex(&[a.vertices(), b.vertices()].concat()).and_then(|hull| fewer(hull, vertices))
    };
    // Pieces that are left, and the volume that joining each two of them would add, m^3.
    let (mut left, mut pairs) = (Vec::new(), Vec::<(f64, [usize; 2])>::new());
    let mut new = 0;
    loop {
        for b in new..all.len() {
            let added = |a: usize| {
                hull(&all[a], &all[b]).map_or(f64::INFINITY, |hull| hull.volume() - all[a].volume() - all[b].volume())
            };
            pairs.extend(left.iter().map(|&a| (added(a), [a, b])));
            left.push(b);
        }
        new = all.len();
        let least = pairs.iter().min_by(|a, b| a.0.total_cmp(&b.0));
        let Some(&(_, both)) = least.filter(|_| left.len() > most) else {
            return Ok(left.into_iter().map(|k| all[k].clone()).collect());
        };
        all.push(hull(&all[both[0]], &all[both[1]])?);
        left.retain(|k| !both.contains(k));
        pairs.retain(|(_, pair)| pair.iter().all(|k| !both.contains(k)));
    }
}

/// The hull of the vertices that reach farthest along so many directions, evenly spread, if it has more.
fn fewer(piece: Surface, vertices: usize) -> Result<Surface, Misfit> {
    if piece.vertices().len() <= vertices {
        return Ok(piece);
    }
    let mut kept: Vec<[f64; 3]> = Vec::with_capacity(vertices);
    for [x, y, z] in spiral(vertices) {
        let along = |v: &&[f64; 3]| x * v[0] + y * v[1] + z * v[2];
        if let Some(&farthest) = piece.vertices().iter().max_by(|a, b| along(a).total_cmp(&along(b)))
            && !kept.contains(&farthest)
        {
            kept.push(farthest);
        }
    }
    hull::convex(&kept)
}
