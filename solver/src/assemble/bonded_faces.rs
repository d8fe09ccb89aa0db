//! Elastic bonds of faces: points at which the forces of the corner points of an area act.
//!
//! The corner points p_i share the area S of two faces in equal parts. With springs at these points a face would resist bending
//! too much: a square 3 times. The forces therefore act at
//!
//! ```text
//! q_i = p̄ + λ (p_i - p̄),   λ² = J / (S/n Σ |p_i - p̄|²),   p̄ = 1/n Σ p_i
//! ```
//!
//! with the polar moment J of the area about p̄. Triangles, rectangles and regular polygons then have their second moments I of
//! bending about all axes, and in torsion J. λ² is 1/4 for a triangle, 1/3 for a rectangle, and up to 1/2 for a disc. Where the
//! area is larger than the polygon of the points, as that of a round face of which some corners have a point, J is that of the
//! polygon scaled to the area.

use super::context::AssemblyContext;
use super::problem::{BlockData, ContactConstraint};
use crate::laws::ContactLaw;
use crate::math::{Vec3, to_local};
use crate::state::Contact;

impl AssemblyContext<'_> {
    /// Moves the points at which elastic bonds of faces act, with the shifts and velocities of their rows.
    pub(super) fn set_bonded_faces(
        &self,
        block_data: &mut BlockData,
        contacts: &[Contact],
        rows: &mut [ContactConstraint],
    ) {
        let is_elastic = |law: &ContactLaw| law.bond_stiffness().is_some();
        if !self.state.laws.iter().any(is_elastic) {
            return;
        }
        let pair = |contact: &Contact| (contact.candidate, contact.antagonist, contact.part_numbers);
        let mut start = 0;
        for face in contacts.chunk_by(|a, b| pair(a) == pair(b)) {
            let is_bonded = |&k: &usize| {
                contacts[k].area > 0.0 && is_elastic(&self.state.laws[contacts[k].law]) && rows[k].bond.is_some()
            };
            let bonded: Vec<usize> = (start..start + face.len()).filter(is_bonded).collect();
            start += face.len();
            if bonded.len() > 2 {
                let is_whole = bonded.len() == face.len();
                let area = if is_whole { face.iter().map(|contact| contact.area).sum() } else { 0.0 };
                self.move_points(&bonded, area, block_data, contacts, rows);
            }
        }
    }

    /// Moves the points of the `bonded` rows of a face of this area, m²; 0 if some of its points are not bonded.
    fn move_points(
        &self,
        bonded: &[usize],
        area: f64,
        block_data: &mut BlockData,
        contacts: &[Contact],
        rows: &mut [ContactConstraint],
    ) {
        let count = bonded.len() as f64;
        let points: Vec<Vec3> = bonded.iter().map(|&k| contacts[k].point).collect();
        let [normal, t, s] = contacts[bonded[0]].frame();
        let centre = points.iter().sum::<Vec3>() / count;
        let arms: Vec<Vec3> =
            points.iter().map(|point| point - centre).map(|arm| arm - normal * normal.dot(&arm)).collect();
        let plane: Vec<[f64; 2]> = arms.iter().map(|arm| [t.dot(arm), s.dot(arm)]).collect();
        let factor = lever_factor(&plane, area);
        let opening = |k: usize| contacts[k].gap - rows[k].bond.unwrap_or(contacts[k].gap);
        let mean_opening = bonded.iter().map(|&k| opening(k)).sum::<f64>() / count;
        let changes: Vec<f64> = bonded.iter().map(|&k| (factor - 1.0) * (opening(k) - mean_opening)).collect();
        for ((&k, arm), change) in bonded.iter().zip(&arms).zip(changes) {
            let offset = arm * (factor - 1.0);
            block_data.arms[k].iter_mut().for_each(|arm| *arm += offset);
            let row = &mut rows[k];
            row.shift += row.normal * (change / self.closing_time());
            let [a, b] = row.bodies.map(|body| self.start.w[body.index()]);
            row.u_before += to_local(&contacts[k].frame(), &(a - b).cross(&offset));
        }
    }
}

/// λ of the corners of a convex polygon, by their positions from their mean, in a face of the area `face_area` (m²; 0 if that of
/// the polygon counts); 1 if they span no area.
fn lever_factor(corners: &[[f64; 2]], face_area: f64) -> f64 {
    let mut corners = corners.to_vec();
    corners.sort_by(|a, b| libm::atan2(a[1], a[0]).total_cmp(&libm::atan2(b[1], b[0])));
    let (mut area, mut moment) = (0.0, 0.0);
    for (k, a) in corners.iter().enumerate() {
        let b = &corners[(k + 1) % corners.len()];
        let triangle = 0.5 * (a[0] * b[1] - a[1] * b[0]);
        let squares = a[0] * (a[0] + b[0]) + a[1] * (a[1] + b[1]) + b[0] * b[0] + b[1] * b[1];
        (area, moment) = (area + triangle, moment + triangle / 6.0 * squares);
    }
    let spread = corners.iter().map(|a| a[0] * a[0] + a[1] * a[1]).sum::<f64>() / corners.len() as f64;
    if area * spread <= 0.0 || moment <= 0.0 {
        return 1.0;
    }
    // Shares of the area have the digits of single precision.
    let scale = f64::from((face_area / area) as f32).max(1.0);
    (scale * moment / (area * spread)).sqrt().min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_have_the_second_moments_of_their_area() {
        let squared = |corners: &[[f64; 2]]| lever_factor(corners, 0.0).powi(2);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-14, "{a} {b}"); // a few roundings of numbers near 1
        near(squared(&[[-1.0, -0.5], [1.0, -0.5], [1.0, 0.5], [-1.0, 0.5]]), 1.0 / 3.0);
        near(squared(&[[-1.0, -1.0], [2.0, -1.0], [-1.0, 2.0]]), 0.25);
        // n corners on a circle: J/S = R² (2 + cos 2π/n)/6.
        let regular: Vec<[f64; 2]> =
            (0..6).map(|k| f64::from(k) * std::f64::consts::FRAC_PI_3).map(|a| [a.cos(), a.sin()]).collect();
        near(squared(&regular), 2.5 / 6.0);
        assert_eq!(lever_factor(&[[0.0, 0.0]; 3], 0.0), 1.0);
        // The hexagon as the points of a disc: 1/2 to the single precision of areas, but for 0.8 % by the shape of the hexagon.
        let disc = lever_factor(&regular, std::f64::consts::PI).powi(2);
        assert!((disc - 0.5).abs() < 4e-3, "{disc}");
    }
}
