//! Distributions of forces, mobilised friction and fabric.

use crate::commands::state::file::{StateFile, text_file};
use crate::derive::coordination::touches_with_force;
use crate::derive::fabric::{anisotropy, eigenvalues, fabric_tensor, mobilised_share, probability_density};
use crate::frame::{Contact, Frame};
use crate::write::figure::{Curve, Figure, FigureAxis};
use crate::write::series::{Column, csv_table};

/// Columns of forces.csv.
pub const FORCE_COLUMNS: [Column; 4] = [
    ("force_over_mean", "1", ""),
    ("P_normal", "1", "probability density of normal forces between grains that push"),
    ("P_tangential", "1", "probability density of tangential forces between grains"),
    ("P_tension", "1", "probability density of normal forces between grains that pull"),
];

/// Columns of mobilisation.csv.
pub const MOBILISATION_COLUMNS: [Column; 2] = [
    ("share", "1", "tangential force over the largest possible"),
    ("P", "1", "probability density of mobilised friction"),
];

/// Width of a bin of the distributions of forces, in units of the mean.
const FORCE_BIN_WIDTH: f64 = 0.25;

/// Distributions of the forces between grains, and of the mobilised friction.
pub fn force_files(frame: &Frame) -> Vec<StateFile> {
    let grain_contacts = || frame.active_contacts().filter(|c| c.grain_pair().is_some());
    let over_mean = |force: fn(&Contact) -> f64| probability_density(grain_contacts().map(force), FORCE_BIN_WIDTH);
    let densities = [over_mean(|c| c.normal_force), over_mean(|c| c.tangential_force), over_mean(|c| -c.normal_force)];
    // Status "no contact" is an attraction at a distance, which mobilises no friction.
    let touching = grain_contacts().filter(|contact| touches_with_force(contact));
    let shares: Vec<f64> = touching.filter_map(|c| mobilised_share(c, &frame.laws)).collect();
    // Twenty bins from 0 to 1; a share above 1 by round-off counts as 1.
    let mut bins = [0.0; 20];
    shares.iter().for_each(|share| bins[((share * 20.0) as usize).min(19)] += 20.0 / shares.len() as f64);
    let mobilised: Vec<(f64, f64)> = (0..20).map(|k| ((k as f64 + 0.5) / 20.0, bins[k])).collect();
    let longest = densities.iter().map(Vec::len).max().unwrap_or(0);
    let rows = (0..longest).map(|k| {
        let [normal, tangential, tension] =
            [0, 1, 2].map(|force: usize| densities[force].get(k).map_or(0.0, |bin| bin.1));
        [(k as f64 + 0.5) * FORCE_BIN_WIDTH, normal, tangential, tension]
    });
    let present = ["normal", "tangential", "tension"].into_iter().zip(&densities).filter(|(_, bins)| !bins.is_empty());
    let forces = Figure {
        title: "Forces between grains".into(),
        x: FigureAxis::linear("force / mean", "1"),
        y: FigureAxis::logarithmic("probability density", "1"),
        curves: present.map(|(name, bins)| Curve::line(name, bins.clone())).collect(),
    };
    let friction = Figure {
        title: "Mobilised friction".into(),
        x: FigureAxis::linear("tangential force / largest possible", "1"),
        y: FigureAxis::linear("probability density", "1"),
        curves: vec![Curve::line("contacts", if shares.is_empty() { Vec::new() } else { mobilised.clone() })],
    };
    let friction_rows = mobilised.iter().filter(|_| !shares.is_empty()).map(|(x, p)| [*x, *p]);
    vec![
        text_file("forces.csv", csv_table(&FORCE_COLUMNS, rows)),
        text_file("forces.svg", forces.to_svg()),
        text_file("mobilisation.csv", csv_table(&MOBILISATION_COLUMNS, friction_rows)),
        text_file("mobilisation.svg", friction.to_svg()),
    ]
}

/// Columns of fabric.csv.
pub const FABRIC_COLUMNS: [Column; 10] = [
    ("F_xx", "1", "fabric tensor, xx"),
    ("F_yy", "1", "fabric tensor, yy"),
    ("F_zz", "1", "fabric tensor, zz"),
    ("F_xy", "1", "fabric tensor, xy"),
    ("F_xz", "1", "fabric tensor, xz"),
    ("F_yz", "1", "fabric tensor, yz"),
    ("F_1", "1", "largest eigenvalue"),
    ("F_2", "1", "middle eigenvalue"),
    ("F_3", "1", "smallest eigenvalue"),
    ("anisotropy", "1", "(5/2) (F_1 - F_3)"),
];

/// Fabric tensor, its eigenvalues and its anisotropy, as the text of fabric.csv.
pub fn fabric_table(frame: &Frame) -> String {
    let f = fabric_tensor(frame);
    let [first, second, third] = eigenvalues(&f);
    let row = [f[(0, 0)], f[(1, 1)], f[(2, 2)], f[(0, 1)], f[(0, 2)], f[(1, 2)], first, second, third, anisotropy(&f)];
    csv_table(&FABRIC_COLUMNS, [row])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Scene;

    #[test]
    fn forces_that_pull_have_a_density_of_their_own() {
        let mut scene = Scene::default();
        for k in 0..5 {
            scene.grain([2.0 * k as f64, 0.0, 0.0], 1.0);
        }
        for (k, force) in [3.0, 5.0, -1.0, -3.0].into_iter().enumerate() {
            scene.push(k + 1, k, force);
        }
        let files = force_files(&scene.frame());
        let file = |name: &str| String::from_utf8(files.iter().find(|file| file.0 == name).unwrap().1.clone()).unwrap();
        let table = file("forces.csv");
        // Over their means, 4 and 2: pushes of 3/4 and 5/4, pulls of 1/2 and 3/2, in bins of 1/4.
        let filled = |column: usize| -> Vec<usize> {
            let rows = table.lines().skip(1).map(|line| line.split(',').nth(column).unwrap()).enumerate();
            rows.filter(|(_, p)| *p == "2.0").map(|(k, _)| k).collect()
        };
        assert_eq!((filled(1), filled(2), filled(3)), (vec![3, 5], vec![], vec![2, 6]), "{table}");
        assert!(file("forces.svg").contains("tension") && !file("forces.svg").contains("tangential"));
        // Nothing joins what empty bins part.
        let forces_svg = file("forces.svg");
        let lines: Vec<&str> = forces_svg.lines().filter(|line| line.contains("<polyline fill")).collect();
        let joins = |line: &&&str| line.contains("stroke-width=\"4\"") && line.matches(',').count() > 1;
        assert!(!lines.is_empty() && lines.iter().filter(joins).count() == 0, "{lines:?}");
        let nothing = force_files(&Scene::default().frame());
        assert_eq!(nothing[0].1, b"force_over_mean,P_normal,P_tangential,P_tension\n");
    }
}
