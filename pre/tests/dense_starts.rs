//! Scenes that start dense: polyhedra placed by their shapes.

use std::path::Path;

use cd_pre::grain::Population;
use cd_pre::scene::Scene;

/// Scene with these grains, and further fields.
fn scene(grains: &str, fields: &str) -> String {
    format!(
        r#"(
            seed: 1,
            materials: [(name: "ROCKx", density: 2700.0)],
            laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.5))],
            contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0")],
            grains: [(material: "ROCKx", colour: "BLUEx", {grains})],
            {fields}
        )"#
    )
}

/// Reads a scene in a folder.
fn read(folder: &Path, text: &str) -> Result<(Scene, Population), String> {
    cd_pre::read_scene(&folder.join("scene.ron"), text, &[])
        .map_err(|faults| faults.to_string().replace(&format!("{}/", folder.display()), ""))
}

fn placed(text: &str) -> Population {
    read(Path::new(""), text).unwrap_or_else(|faults| panic!("{faults}")).1
}

/// Rocks that are three times as long as thin: balls around them hardly fit at a solid fraction of 12 %.
const ROCKS: &str = "shape: Random(vertices: (8, 14), ratios: (1, 0.7, 0.4), angularity: 0.6), \
                     sizes: Uniform(min: 0.2, max: 0.4)";

#[test]
fn rocks_whose_balls_do_not_fit_are_placed_by_their_shapes() {
    // The reader rejects overlaps by the separating axes of the shapes.
    let box_of = |height: f64| {
        scene(
            &format!(
                "number: 40, {ROCKS}, placement: RandomSequential(envelope: Box(lengths: (2.5, 2.5, {height:?}))), \
                 centre: (0, 0, 4), orientation: (axis: (1, 2, 0), angle: 0.4)"
            ),
            "",
        )
    };
    let population = placed(&box_of(4.2));
    assert_eq!(population.grains.len(), 40);
    let balls_overlap = |a: usize, b: usize| {
        let [first, second] = [a, b].map(|k| &population.grains[k]);
        (first.position - second.position).norm() < first.reach + second.reach
    };
    assert!((0..40).any(|a| (0..a).any(|b| balls_overlap(a, b))), "the balls fit");
    assert_eq!(placed(&box_of(4.2)), population);
    let faults = read(Path::new(""), &box_of(2.1)).unwrap_err();
    assert!(faults.contains("of 40 grains (largest first) could be placed in a box"), "{faults}");
    assert!(faults.contains("tries found no free position for the next by its shape; expected"), "{faults}");
}
