//! Directions of contacts, their anisotropy and mobilised friction.

use cd_formats::law_table::{ContactLoad, LawCohesion, LawModel};
use cd_formats::snapshot::STATUS_SLIDE;
use nalgebra::SymmetricEigen;

use crate::derive::coordination::touching_contacts;
use crate::frame::{Contact, Frame};
use crate::math::Mat3;

/// Fabric tensor of the normals: F = (1/N) sum n ⊗ n over the N contacts that touch with force, walls too; trace 1.
///
/// Directions without preference give 1/3 of the unit tensor. NaN without contacts. Source: Satake (1982).
pub fn fabric_tensor(frame: &Frame) -> Mat3 {
    let (count, sum) = touching_contacts(frame)
        .fold((0.0, Mat3::zeros()), |(count, sum), c| (count + 1.0, sum + c.normal * c.normal.transpose()));
    sum / count
}

/// Eigenvalues of a symmetric tensor, largest first; NaN if one of its components is.
pub fn eigenvalues(tensor: &Mat3) -> [f64; 3] {
    if tensor.iter().any(|x| !x.is_finite()) {
        return [f64::NAN; 3];
    }
    let mut values: [f64; 3] = SymmetricEigen::new(*tensor).eigenvalues.into();
    values.sort_by(|a, b| b.total_cmp(a));
    values
}

/// Anisotropy a of the density of directions (1 + a (3 cos^2 - 1)) / 4 pi about an axis: a = (5/2) (F_1 - F_3).
///
/// Source: Azéma, Radjaï & Saussine (2009), in the principal frame of the fabric.
pub fn anisotropy(fabric: &Mat3) -> f64 {
    let [first, _, last] = eigenvalues(fabric);
    2.5 * (first - last)
}

/// Greatest tangential force that a contact could carry with its normal force, N: [`LawModel::friction_limit`].
///
/// A contact that slides under a law with bonds is at its limit, that of the bond if it has just broken: returns its
/// tangential force.
pub fn tangential_limit(contact: &Contact, law: &LawModel) -> f64 {
    let &Contact { gap, normal_force, area, bonded, soundness, attraction, .. } = contact;
    let breaks_by_sliding = match law.cohesion() {
        Some(LawCohesion::Bond { .. }) => true,
        None | Some(LawCohesion::Liquid { .. } | LawCohesion::Pair(_)) => false,
    };
    if breaks_by_sliding && !bonded && contact.status == STATUS_SLIDE {
        return contact.tangential_force;
    }
    law.friction_limit(&ContactLoad { gap, normal_force, area, bonded, soundness, attraction })
}

/// Mobilised share of the available friction: f_t / [`tangential_limit`], 0 to 1; None if no friction is available, and
/// for contacts with a sound interface, whose force in the snapshot contains that of the interface.
pub fn mobilised_share(contact: &Contact, laws: &[LawModel]) -> Option<f64> {
    if contact.soundness > 0.0 {
        return None;
    }
    let limit = tangential_limit(contact, laws.get(contact.law as usize)?);
    (limit > 0.0).then(|| contact.tangential_force / limit)
}

/// Mobilisation of friction over some contacts.
#[derive(Debug, PartialEq)]
pub struct MeanMobilisation {
    /// Mean of [`mobilised_share`].
    pub mobilised_share: f64,
    /// Share of the contacts that slide (status 2).
    pub sliding_share: f64,
}

/// Mobilisation over the contacts that touch with force and have friction available; NaN without such contacts. Contacts that
/// only pull at a distance carry no pressure and are left out.
pub fn mean_mobilisation(frame: &Frame) -> MeanMobilisation {
    let all: Vec<(f64, bool)> = touching_contacts(frame)
        .filter_map(|c| Some((mobilised_share(c, &frame.laws)?, c.status == STATUS_SLIDE)))
        .collect();
    let count = all.len() as f64;
    let sliding = all.iter().filter(|(_, slides)| *slides).count() as f64;
    let sum = all.iter().map(|(share, _)| share).sum::<f64>();
    MeanMobilisation { mobilised_share: sum / count, sliding_share: sliding / count }
}

/// Density of probability of the ratios of values to their mean, in bins of equal width from 0 on.
///
/// Returns the middle of each bin and the density P, with sum P x width = 1; values that are not > 0 are
/// left out. None without values.
pub fn probability_density(values: impl Iterator<Item = f64>, width: f64) -> Vec<(f64, f64)> {
    let values: Vec<f64> = values.filter(|v| *v > 0.0 && v.is_finite()).collect();
    let (count, mean) = (values.len() as f64, values.iter().sum::<f64>() / values.len() as f64);
    let bin = |value: &f64| (value / mean / width) as usize;
    let mut bins = vec![0.0; values.iter().map(bin).max().map_or(0, |last| last + 1)];
    values.iter().for_each(|value| bins[bin(value)] += 1.0 / (count * width));
    bins.into_iter().enumerate().map(|(k, p)| ((k as f64 + 0.5) * width, p)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use cd_formats::snapshot::{LawArrays, STATUS_STICK, ShapeArrays};

    use crate::math::Vec3;
    use crate::samples::Scene;

    #[test]
    fn three_axes_are_isotropic_and_one_is_not() {
        let mut scene = Scene::default();
        scene.grain([0.0; 3], 1.0);
        for k in 0..3 {
            let mut x = [0.0; 3];
            x[k] = 2.0;
            scene.grain(x, 1.0);
        }
        scene.push(1, 0, 1.0);
        let single = scene.frame();
        assert_eq!(fabric_tensor(&single), Mat3::from_diagonal(&Vec3::new(1.0, 0.0, 0.0)));
        assert_eq!(anisotropy(&fabric_tensor(&single)), 2.5);
        scene.push(2, 0, 5.0);
        scene.push(3, 0, 0.1);
        let all = fabric_tensor(&scene.frame());
        assert!((all - Mat3::from_diagonal_element(1.0 / 3.0)).norm() < 1e-15);
        assert!(anisotropy(&all) < 1e-14);
        assert!(anisotropy(&fabric_tensor(&Scene::default().frame())).is_nan());
    }

    #[test]
    fn a_known_density_of_directions_gives_its_anisotropy() {
        // Normals at the nodes of an integration over cos and angle, with frequency proportional to (1 + a (3 c^2 - 1)).
        let a = 0.4;
        let (mut sum, mut total) = (Mat3::zeros(), 0.0);
        for k in 0..200 {
            let c = -1.0 + (k as f64 + 0.5) / 100.0;
            for angle in [0.0, 1.0, 2.0, 3.0].map(|q| q * std::f64::consts::FRAC_PI_2) {
                let s = (1.0 - c * c).sqrt();
                let n = Vec3::new(s * angle.cos(), s * angle.sin(), c);
                let weight = 1.0 + a * (3.0 * c * c - 1.0);
                (sum, total) = (sum + weight * n * n.transpose(), total + weight);
            }
        }
        assert!((anisotropy(&(sum / total)) - a).abs() < 1e-4); // the midpoint rule on 200 points
    }

    #[test]
    fn sliding_contacts_mobilise_all_friction() {
        let mut scene = Scene::default(); // friction 0.5
        for k in 0..3 {
            scene.grain([2.0 * k as f64, 0.0, 0.0], 1.0);
        }
        scene.contact(1, 0, Vec3::new(4.0, 0.0, 2.0)); // all of it
        scene.contact(2, 1, Vec3::new(4.0, 1.0, 0.0)); // half of it
        let mean = mean_mobilisation(&scene.frame()).mobilised_share;
        assert!((mean - 0.75).abs() < 1e-15);
        // A cohesive law adds to what friction can give: 1 / (0.5 (4 + 4)).
        let law = &mut scene.snapshot.meta.laws[0];
        (law.kind, law.parameters) = ("IQS_WET_DS_CLB".into(), vec![4.0, 0.0, 0.1, 0.4, 0.5]);
        let mean = mean_mobilisation(&scene.frame()).mobilised_share;
        assert!((mean - 0.375).abs() < 1e-15, "{mean}");
        // No attraction beyond the range, nor, under a law with memory, after the bridge breaks: 1 / (0.5 4) and again half
        // of that.
        scene.snapshot.contacts.contact_gap[1] = 0.2;
        let mean = mean_mobilisation(&scene.frame()).mobilised_share;
        assert!((mean - 0.5 * (0.5 + 0.5)).abs() < 1e-15, "{mean}");
        scene.snapshot.meta.laws[0].kind = "xQS_WET_DS_CLB".into();
        scene.snapshot.contacts.contact_gap[1] = 0.0;
        for (bonded, expected) in [([1, 1], 0.375), ([0, 0], 0.75), ([0, 1], 0.5 * (1.0 + 0.25))] {
            scene.remember(&bonded);
            let mean = mean_mobilisation(&scene.frame()).mobilised_share;
            assert!((mean - expected).abs() < 1e-15, "{bonded:?} {mean}");
        }
    }

    #[test]
    fn mobilised_friction_leaves_out_sound_interfaces() {
        let mut scene = Scene::default();
        for k in 0..3 {
            scene.grain([2.0 * k as f64, 0.0, 0.0], 1.0);
        }
        let law = &mut scene.snapshot.meta.laws[0];
        (law.kind, law.parameters) = ("IQS_MAC_CZM".into(), vec![0.5, 0.5, 1e9, 1e9, 0.0, 1.0]);
        scene.contact(1, 0, Vec3::new(4.0, 1.0, 0.0)); // 1 of at most 0.5 * 4, once broken
        scene.contact(2, 1, Vec3::new(4.0, 2.0, 0.0)); // all of it
        let mut share = |contact_soundness: [f64; 2]| {
            scene.snapshot.laws =
                Some(LawArrays { contact_soundness: contact_soundness.to_vec(), ..LawArrays::default() });
            mean_mobilisation(&scene.frame()).mobilised_share
        };
        assert_eq!(share([0.0, 0.0]), 0.75);
        assert_eq!(share([0.0, 0.25]), 0.5);
        assert!(share([1.0, 0.25]).is_nan());
    }

    #[test]
    fn a_bond_can_give_shear_without_being_pushed() {
        // Radii 1 and 1: S = pi / 4; at most c_t S + (c_t / c_n) f_n = 2 S + 0.5 f_n.
        let mut scene = Scene::default();
        scene.grain([0.0; 3], 1.0);
        scene.grain([2.0, 0.0, 0.0], 1.0);
        let law = &mut scene.snapshot.meta.laws[0];
        (law.kind, law.parameters) = ("IQS_MOHR_DS_CLB".into(), vec![4.0, 2.0, 0.3, 0.4]);
        let area = std::f64::consts::FRAC_PI_4;
        let share = |scene: &Scene| mean_mobilisation(&scene.frame()).mobilised_share;
        scene.contact(1, 0, Vec3::new(-1.0, 0.0, area)); // pulled by 1
        scene.remember(&[1]);
        assert!((share(&scene) - area / (2.0 * area - 0.5)).abs() < 1e-15, "{}", share(&scene));
        // The area of a contact between faces is the area of the faces.
        let mut shapes = ShapeArrays::default();
        shapes.contacts.contact_area = vec![2.0 * area];
        scene.snapshot.shapes = Some(shapes);
        assert!((share(&scene) - area / (4.0 * area - 0.5)).abs() < 1e-15, "{}", share(&scene));
        // It has slid, and so is gone at the end of the step: it gave all.
        scene.remember(&[0]);
        assert_eq!(share(&scene), 1.0);
        // A contact that only sticks has the friction of the law.
        scene.snapshot.contacts.contact_force[0] = [5.0, 1.0, 0.0];
        scene.snapshot.contacts.contact_status[0] = STATUS_STICK;
        assert_eq!(share(&scene), 1.0 / (0.4 * 5.0));
        // On a plate, which is flat, S = pi.
        let mut scene = Scene::default();
        let (floor, ball) = (scene.plate([0.0, 0.0, -0.1], [5.0, 5.0, 0.1]), scene.grain([0.0, 0.0, 1.0], 1.0));
        scene.contact_at(ball, floor, [0.0; 3], Vec3::z());
        assert_eq!(scene.frame().contacts[0].area, std::f64::consts::PI);
    }

    #[test]
    fn a_distribution_is_normalised_and_has_mean_one() {
        // Quantiles of the exponential distribution: P = exp(-x).
        let count = 20_000;
        let values = (0..count).map(|k| -3.0 * (1.0 - (k as f64 + 0.5) / count as f64).ln());
        let bins = probability_density(values, 0.1);
        let area: f64 = bins.iter().map(|(_, p)| p * 0.1).sum();
        assert!((area - 1.0).abs() < 1e-12);
        for (x, p) in bins.iter().filter(|(x, _)| *x < 3.0) {
            assert!((p / (-x).exp() - 1.0).abs() < 0.02, "{x} {p}"); // 0.1^2 / 24 of a bin, and one value more or less
        }
        assert!(probability_density([0.0, -1.0].into_iter(), 0.1).is_empty());
    }
}
