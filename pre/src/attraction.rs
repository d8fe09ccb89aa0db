//! Warning about an attraction per contact point whose total depends on how faces are described.

use cd_formats::report::FaultReport;

use crate::grain::Population;
use crate::scene::Scene;

/// Number of pairs of colours named in a warning; the others are counted.
const MAX_NAMED_COLOURS: usize = 3;

/// Reports, once for each law, the colours between which an attraction acts at several contact points of two bodies.
/// Polyhedra meet in up to one point for each corner, cylinders and capsules in two along a line, bodies of several
/// pieces in these numbers for each piece, clumps in one for each ball.
pub fn warn_of_attractions(scene: &Scene, population: &Population, report: &mut FaultReport) {
    let any_body_of_colour = |colour: &str, counts: &dyn Fn(usize) -> bool| {
        let mut polyhedra = population.grains.iter().filter_map(|grain| Some((grain.group, grain.shape.polyhedron()?)));
        polyhedra
            .any(|(group, polyhedron)| scene.grains[group].colour == colour && counts(polyhedron.solid.pieces.len()))
    };
    let has_round_solids = |colour: &str| {
        population
            .grains
            .iter()
            .any(|grain| grain.shape.round_solid().is_some() && scene.grains[grain.group].colour == colour)
    };
    let is_polyhedral = |colour: &str| any_body_of_colour(colour, &|_| true) || has_round_solids(colour);
    let has_clumps = |colour: &str| {
        population
            .grains
            .iter()
            .any(|grain| grain.shape.clump().is_some() && scene.grains[grain.group].colour == colour)
    };
    let has_pieces = |colour: &str| any_body_of_colour(colour, &|pieces| pieces > 1) || has_clumps(colour);
    let is_wall = |colour: &str| population.walls.iter().any(|wall| wall.colour == colour);
    let meets_in_points = |a: &str, b: &str| {
        has_pieces(a)
            || has_pieces(b)
            || is_polyhedral(a) && (is_polyhedral(b) || is_wall(b))
            || is_polyhedral(b) && is_wall(a)
    };
    for (k, law) in scene.laws.iter().enumerate().filter(|(_, law)| law.kind.point_attraction() > 0.0) {
        let contacts_of_law = scene.contacts.iter().filter(|contact| contact.law.as_ref() == Some(&law.name));
        let pairs: Vec<String> = contacts_of_law
            .map(|contact| &contact.between)
            .filter(|(a, b)| meets_in_points(a, b))
            .map(|(a, b)| format!("{a} and {b}"))
            .collect();
        if pairs.is_empty() {
            continue;
        }
        let mut named = pairs[..pairs.len().min(MAX_NAMED_COLOURS)].join(", ");
        if pairs.len() > MAX_NAMED_COLOURS {
            named += &format!(" and {} other pairs", pairs.len() - MAX_NAMED_COLOURS);
        }
        let found = format!(
            "{} attracts at each contact point, so a face of four corners holds four times its cohesion, and \
             bodies that meet in several points do so under it: {named}",
            law.kind.label()
        );
        let advice = "for one force of each pair of bodies, use a law with cohesion of pairs such as IQS_COH_DS_CLB; for a \
                      cohesion in proportion to the area of faces, IQS_MOHR_DS_CLB";
        report.add_warning(&format!("laws.{k}"), found, advice);
    }
}
