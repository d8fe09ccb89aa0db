//! `POSTPRO/*.svg`: the main columns of the series against time.

use crate::derive::Row;
use crate::derive::region_kind::RegionKind;
use crate::write::figure::{Curve, Figure, FigureAxis};

/// One plot: columns of [`Row`] that share a unit.
pub struct SeriesPlot {
    /// Name of the file in `POSTPRO/`.
    pub file: &'static str,
    pub title: &'static str,
    /// Caption in the report.
    pub caption: &'static str,
    /// Quantity on the vertical axis.
    pub quantity: &'static str,
    /// Whether the first curve is a mean over the region, which the title then names.
    pub is_of_region: bool,
    /// Whether the axis is logarithmic, in powers of ten; values under 1e-14 of the largest, round-off, are left out.
    pub logarithmic: bool,
    /// Name of each column, and its label in the legend.
    pub curves: &'static [(&'static str, &'static str)],
}

/// Plots of the columns of `series.csv`.
pub const PLOTS: [SeriesPlot; 6] = [
    SeriesPlot {
        file: "energy.svg",
        title: "Kinetic energy per grain",
        caption: "Mean kinetic energy per grain: total, rotation of the grains, and rigid motion of all grains as one body.",
        quantity: "kinetic energy",
        is_of_region: false,
        logarithmic: true,
        curves: &[("Ec_mean", "all"), ("Ec_rot_mean", "rotation"), ("Ec_rigid_mean", "rigid motion")],
    },
    SeriesPlot {
        file: "coordination.svg",
        title: "Neighbours per grain",
        caption: "Mean number of neighbours that a grain touches with force, in the region in the title: of all grains, and without rattlers.",
        quantity: "neighbours per grain, Z",
        is_of_region: true,
        logarithmic: false,
        curves: &[("Z", "all grains"), ("Z_no_rattlers", "no rattlers")],
    },
    SeriesPlot {
        file: "solid_fraction.svg",
        title: "Solid fraction",
        caption: "Solid fraction in the region in the title; for a bed, also between its walls up to twice the height of its centre of mass.",
        quantity: "solid fraction, ν",
        is_of_region: true,
        logarithmic: false,
        curves: &[("nu", "ν"), ("bed_nu", "bed")],
    },
    SeriesPlot {
        file: "pressure.svg",
        title: "Mean pressure",
        caption: "Mean pressure in the region in the title: of the contact forces, walls included, and the virial of the loads. Both are equal at rest.",
        quantity: "pressure",
        is_of_region: true,
        logarithmic: false,
        curves: &[("pressure", "contacts"), ("pressure_virial", "virial of the loads"), ("bed_pressure", "bed")],
    },
    SeriesPlot {
        file: "semi_axes.svg",
        title: "Semi-axes of the ellipsoid of equal inertia",
        caption: "Semi-axes of the uniform ellipsoid with the same moments of inertia.",
        quantity: "semi-axis",
        is_of_region: false,
        logarithmic: false,
        curves: &[("a", "a"), ("b", "b"), ("c", "c")],
    },
    SeriesPlot {
        file: "dissipation.svg",
        title: "Work of the contacts",
        caption: "Work of the contacts since the start, by friction and by normal forces; negative: dissipated.",
        quantity: "work",
        is_of_region: false,
        logarithmic: false,
        curves: &[("E_contacts", "all"), ("E_shocks", "shocks"), ("E_friction", "friction")],
    },
];

/// Number and unit of a column.
fn find_column(name: &str) -> (usize, &'static str) {
    let index = Row::COLUMNS.iter().position(|(known, _, _)| *known == name).expect("a column");
    (index, Row::COLUMNS[index].1)
}

/// Values of a column against time.
pub fn column_points(rows: &[Row], name: &str) -> Vec<(f64, f64)> {
    let (index, _) = find_column(name);
    rows.iter().map(|row| (row.time, row.numbers()[index])).collect()
}

/// Regions of the means of a series, in the order in which they occur.
pub fn region_names(rows: &[Row]) -> String {
    let mut names: Vec<&str> = Vec::new();
    for kind in
        rows.iter().filter_map(|row| RegionKind::ALL.get(row.region as usize)).filter(|kind| **kind != RegionKind::None)
    {
        if !names.contains(&kind.name()) {
            names.push(kind.name());
        }
    }
    names.join("; ")
}

impl SeriesPlot {
    /// Vertical axis, in the unit of the columns.
    pub fn y_axis(&self) -> FigureAxis {
        let (_, unit) = find_column(self.curves[0].0);
        FigureAxis { quantity: self.quantity.into(), unit: unit.into(), logarithmic: self.logarithmic }
    }

    /// Figure of a series.
    pub fn to_figure(&self, rows: &[Row]) -> Figure {
        // Columns without values, such as columns of a bed in a scene without one, are not in the legend.
        let is_shown =
            |curve: &Curve| curve.name == self.curves[0].1 || curve.points.iter().any(|(_, y)| y.is_finite());
        let curves = self.curves.iter().map(|(name, label)| Curve::line(label, column_points(rows, name)));
        let curves = curves.filter(is_shown).collect();
        let title = match self.is_of_region.then(|| region_names(rows)) {
            Some(regions) if !regions.is_empty() => format!("{}, {regions}", self.title),
            _ => self.title.into(),
        };
        Figure { title, x: FigureAxis::linear("time", "s"), y: self.y_axis(), curves }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(times: &[f64], z: impl Fn(usize) -> f64) -> Vec<Row> {
        let row = |(k, time): (usize, &f64)| Row { time: *time, Z: z(k), Ec_mean: z(k), ..Row::default() };
        times.iter().enumerate().map(row).collect()
    }

    #[test]
    fn axes_carry_units_and_gaps_part_the_line() {
        let rows = |z: &dyn Fn(usize) -> f64| rows(&[0.0, 10.0, 20.0, 30.0, 40.0], z);
        let text = PLOTS[1].to_figure(&rows(&|k| if k == 2 { f64::NAN } else { k as f64 })).to_svg();
        assert!(text.contains("time (s)") && text.contains("no rattlers"));
        // The title names where the means are.
        let row = |kind: RegionKind| Row { region: kind.column_value(), ..Row::default() };
        let rows_of = [
            row(RegionKind::None),
            row(RegionKind::AllGrains),
            row(RegionKind::LargestGroup),
            row(RegionKind::AllGrains),
        ];
        assert_eq!(region_names(&rows_of), "hull of all grains; hull of the largest remnant");
        assert!(
            PLOTS[2]
                .to_figure(&rows_of)
                .to_svg()
                .contains("Solid fraction, hull of all grains; hull of the largest remnant")
        );
        assert!(!PLOTS[0].to_figure(&rows_of).to_svg().contains("hull"));
        let lines = text.matches("stroke-width=\"4\"").count();
        assert_eq!(lines, 2, "{text}"); // of Z, before and after the gap
        let energy = PLOTS[0].to_figure(&rows(&|k| [1e-3, 10.0, 1.0, 1.0, 1.0][k])).to_svg();
        assert!(energy.contains("energy (J)") && energy.contains("10⁻²"), "{energy}");
    }

    #[test]
    fn what_is_plotted_is_a_column() {
        for plot in &PLOTS {
            assert!(
                plot.curves.iter().all(|(name, _)| find_column(name).1 == find_column(plot.curves[0].0).1),
                "{}",
                plot.file
            );
        }
    }
}
