//! How many contacts hold a grain.

use crate::frame::Frame;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coordination {
    /// Mean number of contacts that carry force per grain.
    pub z: f64,
    /// The same among the grains that are no rattlers, their contacts with rattlers left out.
    pub z_no_rattlers: f64,
    /// Rattlers over grains.
    pub rattler_fraction: f64,
}

/// Number of contacts that carry force of each grain; those with walls count too.
pub fn contact_counts(frame: &Frame) -> Vec<u32> {
    let mut counts = vec![0; frame.grains.len()];
    for contact in frame.active() {
        for (grain, _) in contact.forces_on_grains() {
            counts[grain] += 1;
        }
    }
    counts
}

/// The number of contacts below which a grain is not held.
///
/// | | free of load | under gravity |
/// |---|---|---|
/// | frictionless | 4 | 3 |
/// | friction | 2 | 2 |
///
/// Frictionless forces on a sphere all pass through its centre: without a load four are needed to
/// hold it whatever pushes it, and a load (gravity, uniform or of the grains) stands for one of
/// them. With friction two are enough to balance a force, along the line between them or beside it.
/// A snapshot counts as frictional if one of its contacts carries a tangential force, more than
/// the rounding of a change of frame leaves of a normal one.
pub fn stable_number(frame: &Frame) -> u32 {
    let parameters = &frame.meta.parameters;
    let loaded = parameters.self_gravity || parameters.uniform_gravity != [0.0; 3];
    let friction = frame.active().any(|contact| contact.tangential_force > 1e-12 * contact.normal_force.abs());
    match (friction, loaded) {
        (true, _) => 2,
        (false, true) => 3,
        (false, false) => 4,
    }
}

/// Which grains are rattlers: those with fewer than `stable` contacts that carry force, then those
/// that have fewer once these are taken away, and so on.
pub fn rattlers(frame: &Frame, stable: u32) -> Vec<bool> {
    let mut counts = contact_counts(frame);
    let mut neighbours = vec![Vec::new(); frame.grains.len()];
    for (i, j) in frame.active().filter_map(|contact| contact.pair()) {
        neighbours[i].push(j);
        neighbours[j].push(i);
    }
    let mut rattler: Vec<bool> = counts.iter().map(|&count| count < stable).collect();
    let mut removed: Vec<usize> = (0..rattler.len()).filter(|&i| rattler[i]).collect();
    while let Some(i) = removed.pop() {
        for &j in &neighbours[i] {
            counts[j] -= 1;
            if counts[j] < stable && !rattler[j] {
                rattler[j] = true;
                removed.push(j);
            }
        }
    }
    rattler
}

/// Mean contact numbers with and without rattlers.
///
/// Z = (2 N_gg + N_gw) / N with N grains, N_gg contacts between grains, N_gw between a grain and a
/// wall, of those that carry force. Without rattlers: the same of the remaining grains and of the
/// contacts whose grains all remain; NaN if none remains.
///
/// Three equal spheres that push each other: Z = 2.
pub fn coordination(frame: &Frame) -> Coordination {
    let total = frame.grains.len() as f64;
    let rattler = rattlers(frame, stable_number(frame));
    let held = rattler.iter().filter(|&&rattles| !rattles).count() as f64;
    let (mut ends, mut ends_held) = (0.0, 0.0);
    for contact in frame.active() {
        let grains = contact.forces_on_grains().count() as f64;
        ends += grains;
        if contact.forces_on_grains().all(|(grain, _)| !rattler[grain]) {
            ends_held += grains;
        }
    }
    Coordination { z: ends / total, z_no_rattlers: ends_held / held, rattler_fraction: (total - held) / total }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Vec3;
    use crate::samples::Scene;

    /// A tetrahedron of touching spheres, every pair pushing, and a fifth sphere that hangs on one of them.
    fn tetrahedron_with_tail() -> Scene {
        let mut scene = Scene::default();
        for x in [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0], [3.0, 3.0, 1.0]] {
            scene.grain(x, 2f64.sqrt());
        }
        for i in 0..4 {
            for j in 0..i {
                scene.push(i, j, 1.0);
            }
        }
        scene.push(4, 0, 1.0);
        scene
    }

    #[test]
    fn counts_both_ends_of_contacts_that_carry_force() {
        let mut scene = tetrahedron_with_tail();
        scene.push(4, 1, 0.0);
        let frame = scene.frame();
        assert_eq!(contact_counts(&frame), [4, 3, 3, 3, 1]);
        assert_eq!(coordination(&frame).z, 14.0 / 5.0);
    }

    #[test]
    fn rattlers_are_peeled_off_until_none_is_left() {
        let mut scene = tetrahedron_with_tail();
        // Unloaded and frictionless: four contacts hold. Only sphere 0 has four, and one goes with sphere 4.
        let all = coordination(&scene.frame());
        assert_eq!(all.rattler_fraction, 1.0);
        assert!(all.z_no_rattlers.is_nan());
        // Under gravity three hold: only the tail rattles.
        scene.snapshot.meta.parameters.self_gravity = true;
        let loaded = coordination(&scene.frame());
        assert_eq!((loaded.z_no_rattlers, loaded.rattler_fraction), (3.0, 0.2));
        // With friction two hold.
        scene.contact(3, 2, Vec3::new(0.3, 0.1, 0.0));
        assert_eq!(stable_number(&scene.frame()), 2);
    }

    #[test]
    fn a_contact_with_a_wall_counts_once() {
        let mut scene = Scene::default();
        let grain = scene.grain([0.0, 0.0, 1.0], 1.0);
        let floor = scene.plate([0.0, 0.0, -0.1], [5.0, 5.0, 0.1]);
        scene.contact_at(grain, floor, [0.0; 3], Vec3::new(0.0, 0.0, 7.0));
        assert_eq!(coordination(&scene.frame()).z, 1.0);
    }

    #[test]
    fn nothing_gives_nothing() {
        let none = coordination(&Scene::default().frame());
        assert!(none.z.is_nan() && none.z_no_rattlers.is_nan() && none.rattler_fraction.is_nan());
    }
}
