//! The grains of a frame for the script of the page: JSON with arrays of 32-bit floats in base 64.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};

use crate::derive::coordination::contact_counts;
use crate::derive::enclosing::enclosing_ball;
use crate::derive::fragments::{fragments, membership};
use crate::derive::stress::{grain_stresses, pressure};
use crate::frame::{Frame, Vec3};

/// Balls with the grain that each shows, triangles likewise, and the quantities to colour by.
///
/// `middle` and `radius` frame the picture: the largest fragment; `reach` holds all grains.
pub fn json(frame: &Frame) -> String {
    let grains = &frame.grains;
    let owners: Vec<usize> = (0..grains.len()).flat_map(|k| grains[k].balls().map(move |_| k)).collect();
    let of_balls = grains.iter().flat_map(|grain| grain.balls()).flat_map(|(x, radius)| [x.x, x.y, x.z, radius]);
    let balls: Vec<f32> = of_balls.map(|value| value as f32).collect();
    // Faces as fans of triangles; a corner has four numbers as a ball has.
    let (mut corners, mut corner_owners) = (Vec::new(), Vec::new());
    for (k, grain) in grains.iter().enumerate() {
        let Some(solid) = &grain.solid else { continue };
        let vertices: Vec<Vec3> = grain.vertices().collect();
        for pair in solid.faces.iter().flat_map(|face| face[1..].windows(2).map(|pair| [face[0], pair[0], pair[1]])) {
            for corner in pair {
                let x = vertices[corner as usize];
                corners.extend([x.x as f32, x.y as f32, x.z as f32, 1.0]);
                corner_owners.push(k as f32);
            }
        }
    }
    let fragments = fragments(frame);
    let members = fragments.first().map_or(Vec::new(), |largest| largest.grains.clone());
    let mut chosen: Vec<_> = members.iter().map(|&i| grains[i].clone()).collect();
    // A fragment that is but a part is seen with the rest.
    if 2 * chosen.len() < grains.len() {
        chosen.clone_from(grains);
    }
    let ball = enclosing_ball(&chosen);
    let (middle, radius) = if chosen.is_empty() { (Vec3::zeros(), 1.0) } else { (ball.centre, ball.radius) };
    let reach = grains.iter().map(|g| (g.x - middle).norm() + 2.0 * g.radius).fold(radius, f64::max);
    let stresses = grain_stresses(frame);
    let quantities = [
        quantity("contacts", "1", contact_counts(frame).iter().map(|n| f64::from(*n)).collect()),
        quantity("pressure", "Pa", stresses.iter().map(pressure).collect()),
        quantity("speed", "m/s", grains.iter().map(|g| g.v.norm()).collect()),
        quantity("distance from the middle", "m", grains.iter().map(|g| (g.x - middle).norm()).collect()),
        quantity("radius", "m", grains.iter().map(|g| g.radius).collect()),
        quantity("fragment", "1", membership(&fragments, grains.len()).iter().map(|n| f64::from(*n)).collect()),
        quantity("colour", "1", grains.iter().map(|g| f64::from(g.colour)).collect()),
        quantity("number", "1", grains.iter().map(|g| g.id as f64).collect()),
    ];
    json!({
        "balls": base64(&balls),
        "ball_owners": owners,
        "corners": base64(&corners),
        "owners": base64(&corner_owners),
        "middle": [middle.x, middle.y, middle.z],
        "radius": radius,
        "reach": reach,
        "quantities": quantities,
    })
    .to_string()
}

fn base64(values: &[f32]) -> String {
    STANDARD.encode(values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>())
}

/// The colours span what 98 of 100 grains have, so that one grain does not set them.
fn quantity(name: &str, unit: &str, values: Vec<f64>) -> Value {
    let mut sorted = values.clone();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| sorted.get(((sorted.len() - 1) as f64 * share).round() as usize).copied().unwrap_or(0.0);
    let (low, high) = if sorted.is_empty() { (0.0, 1.0) } else { (at(0.01), at(0.99)) };
    let values: Vec<f32> = values.iter().map(|value| *value as f32).collect();
    json!({ "name": name, "unit": unit, "low": low, "high": high, "values": base64(&values) })
}
