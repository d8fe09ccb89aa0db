//! Summary of the bodies of a scene for the user.

use cd_formats::error::Faults;
use cd_formats::messages::print_error;
use cd_formats::names::{count_text, rounded_number};
use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::grain::{Grain, Population};
use crate::scene::{Law, Scene};
use crate::shapes::{OrientedClump, OrientedShape};

/// Prints warnings on stderr.
pub fn print_warnings(warnings: &Faults) {
    if !warnings.0.is_empty() {
        print_error(warnings.format_report("cd-pre: warning").trim_end());
    }
}

/// Counts, sizes and masses: a line for each group of grains and one for all.
pub fn scene_summary(scene: &Scene, population: &Population) -> String {
    let (all, walls) = (population.grains.iter().collect::<Vec<_>>(), population.walls.len());
    let total = group_line(format!("{}, {walls} of them walls", count_text(all.len() + walls, "body")), &all);
    group_lines(scene, population) + &total + "\n" + &pair_law_lines(&scene.laws, contact_radii(population))
}

/// Radii of the grains at contacts, m: a clump has those of its balls.
pub fn contact_radii(population: &Population) -> impl Iterator<Item = f64> {
    population.grains.iter().flat_map(|grain| match grain.shape.clump() {
        Some(clump) => clump.balls().map(|ball| ball.radius).collect(),
        None => vec![grain.radius],
    })
}

/// A line for each law with cohesion of pairs: its forces between two of the smallest and two of the largest grains, of these
/// radii, m.
pub fn pair_law_lines(laws: &[Law], radii: impl Iterator<Item = f64>) -> String {
    let extremes =
        radii.fold([f64::INFINITY, 0.0], |[low, high]: [f64; 2], radius| [low.min(radius), high.max(radius)]);
    let line = |law: &Law| {
        let pair = law.kind.pair_cohesion()?;
        // 1/R of two equal grains is twice that of one.
        let [low, high] = extremes.map(|radius| five_digits(pair.force(0.5 * radius)));
        let forces = if low == high { low } else { format!("{low} to {high}") };
        let (parameter, value) = law.kind.parameter_values()[0];
        let mut text = format!("law {}: two equal grains attract each other with {forces} N", law.name);
        if let Some(bulk) = law.bulk_strength {
            text += &format!(
                ", {} {} {} for a tensile strength of {} Pa",
                parameter.name(),
                five_digits(value),
                parameter.quantity().unit(),
                rounded_number(bulk.tension)
            );
        }
        Some(text + "\n")
    };
    laws.iter().filter_map(line).collect()
}

/// Number with five decimals; below 0.01 and from 1e6 on with five significant digits and an exponent.
fn five_digits(x: f64) -> String {
    if (0.01..1e6).contains(&x) { format!("{x:.5}") } else { format!("{x:.4e}") }
}

/// Line about the number, sizes and mass of some grains, without its end.
fn group_line(name: String, grains: &[&Grain]) -> String {
    let radii = || grains.iter().map(|grain| grain.radius);
    let (count, min, max) = (grains.len(), radii().fold(f64::INFINITY, f64::min), radii().fold(0.0, f64::max));
    let mean = radii().sum::<f64>() / count as f64;
    let mass: f64 = grains.iter().map(|grain| grain.mass).sum();
    let polyhedra = grains.iter().filter(|grain| grain.shape.polyhedron().is_some()).count();
    let clumps: Vec<&OrientedClump> = grains.iter().filter_map(|grain| grain.shape.clump()).collect();
    let round_solids = |is_capsule: bool| {
        grains
            .iter()
            .filter_map(|grain| grain.shape.round_solid())
            .filter(|round_solid| round_solid.shape.is_capsule == is_capsule)
            .count()
    };
    let [cylinders, capsules] = [round_solids(false), round_solids(true)];
    let spheres = count - polyhedra - clumps.len() - cylinders - capsules;
    let kind = match (polyhedra, clumps.len()) {
        (0, 0) if spheres == count => count_text(spheres, "sphere"),
        (polyhedra, 0) if polyhedra == count => {
            format!("{} ({})", count_text(count, "polyhedron"), vertex_count_text(grains))
        }
        (0, number) if number == count => format!("{} ({})", count_text(count, "clump"), ball_count_text(&clumps)),
        (polyhedra, number) => {
            let counts = [
                (spheres, "sphere"),
                (polyhedra, "polyhedron"),
                (number, "clump"),
                (cylinders, "cylinder"),
                (capsules, "capsule"),
            ];
            let counts = counts.into_iter().filter(|(number, _)| *number > 0);
            counts.map(|(number, name)| count_text(number, name)).collect::<Vec<_>>().join(" and ")
        }
    };
    let [min, max, mean] = [min, max, mean].map(five_digits);
    format!("{name}: {kind}, radius {min} to {max} m (mean {mean} m), mass {mass:.6e} kg")
}

/// A line for each group of grains.
pub fn group_lines(scene: &Scene, population: &Population) -> String {
    let mut text = String::new();
    for (group, region) in population.regions.iter().enumerate() {
        let grains: Vec<_> = population.grains.iter().filter(|grain| grain.group == group).collect();
        text += &group_line(format!("grains {}", group + 1), &grains);
        if !population.file_summaries[group].is_empty() {
            text += &format!(", {}", population.file_summaries[group]);
        }
        if scene.grains[group].shape.has_axes()
            && let Some(grain) = grains.first()
        {
            match &grain.shape {
                OrientedShape::Sphere | OrientedShape::RoundSolid(_) => {}
                OrientedShape::Polyhedron(shape) => text += &frame_change_text(&shape.solid.shift, &shape.solid.axes),
                OrientedShape::Clump(shape) => {
                    text += &frame_change_text(&shape.clump.frame.shift, &shape.clump.frame.axes);
                }
            }
        }
        if let Some(region) = region {
            let filled: f64 = grains.iter().map(|grain| grain.volume()).sum();
            text += &format!(", solid fraction {:.4} in {region}", filled / region.volume());
        }
        text += if scene.grains[group].driven.is_some() { ", driven\n" } else { "\n" };
    }
    text
}

/// Text about the translation and rotation of a shape to its centre of mass and principal axes.
fn frame_change_text(shift: &Vector3<f64>, axes: &Matrix3<f64>) -> String {
    let mut text = String::new();
    if *shift != Vector3::zeros() {
        let [x, y, z] = (*shift).into();
        text += &format!(", centre of mass at ({x:.8}, {y:.8}, {z:.8}) m in the axes in which the shape is given");
    }
    let turn = Rotation3::from_matrix_unchecked(axes.transpose());
    if let Some((axis, angle)) = turn.axis_angle() {
        let [x, y, z] = axis.into_inner().into();
        text += &format!(
            ", principal axes rotated by {angle:.8} rad about ({x:.8}, {y:.8}, {z:.8}) from those in which the shape is given"
        );
    }
    text
}

/// Text about the number of balls of clumps.
fn ball_count_text(clumps: &[&OrientedClump]) -> String {
    let counts = clumps.iter().map(|clump| clump.clump.balls.len());
    let (min, max) = counts.fold((usize::MAX, 0), |(min, max), count| (min.min(count), max.max(count)));
    if min == max { format!("{min} balls each") } else { format!("{min} to {max} balls") }
}

/// Text about the number of vertices of the grains, summed over the pieces of a grain.
fn vertex_count_text(grains: &[&Grain]) -> String {
    let solids = grains.iter().filter_map(|grain| grain.shape.polyhedron()).map(|polyhedron| &polyhedron.solid.pieces);
    let counts = solids.map(|pieces| pieces.iter().map(|piece| piece.vertices().len()).sum::<usize>());
    let (min, max) = counts.fold((usize::MAX, 0), |(min, max), count| (min.min(count), max.max(count)));
    if min == max { format!("{min} vertices each") } else { format!("{min} to {max} vertices") }
}
