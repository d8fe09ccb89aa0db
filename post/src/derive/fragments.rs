//! Fragments: sets of grains connected by contacts, the largest remnant first.

use std::cmp::Reverse;

use cd_formats::groups::{DisjointSets, FragmentSize, largest_remnant};

use crate::derive::motion::{AggregateSums, RotatingAxes};
use crate::frame::{Frame, GrainId};

/// Grains touch if their contact carries force, or if the gap between them is at most this share
/// of the smaller radius.
pub const TOUCHING_GAP: f64 = 1e-3;

/// Grains connected by chains of touching grains.
#[derive(Debug, Clone, PartialEq)]
pub struct Fragment {
    /// Grains of the fragment, rising.
    pub grains: Vec<GrainId>,
    /// Mass, inertia and motion of the fragment, in fixed axes.
    pub sums: AggregateSums,
}

/// Fragments of a frame: the largest remnant, then the others by falling mass, equal ones by their first grain.
///
/// [`largest_remnant`] chooses the largest remnant.
///
/// Two grains are in one fragment if a chain of touching grains links them ([`TOUCHING_GAP`]). The gap of spheres is
/// |x_i - x_j| - R_i - R_j at the snapshot's time, with x_j of the nearest image. The gap of other grains is the smallest of their
/// contacts at contact detection. Walls do not link grains.
pub fn find_fragments(frame: &Frame) -> Vec<Fragment> {
    fragments_within(frame, TOUCHING_GAP)
}

/// Fragments as those of [`find_fragments`], in which grains touch up to a gap of `gap_share` of the smaller radius, for
/// aggregates whose contacts an impact has opened. Pairs of grains that are not both spheres are known up to the distance
/// at which the run lists contacts.
pub fn fragments_within(frame: &Frame, gap_share: f64) -> Vec<Fragment> {
    let grains = &frame.grains;
    let touching_gap = |i, j| gap_share * smaller_radius(frame, i, j);
    let mut connected = DisjointSets::new(grains.len());
    for contact in &frame.contacts {
        if let Some((i, j)) = contact.grain_pair()
            && (contact.active || !both_spheres(frame, i, j) && contact.gap <= touching_gap(i, j))
        {
            connected.union(i.index(), j.index());
        }
    }
    connect_spheres(frame, gap_share, &mut connected);
    let mut members: Vec<Vec<GrainId>> = Vec::new();
    let mut index = vec![0; grains.len()];
    for i in frame.grain_ids() {
        let first = connected.find(i.index());
        if first == i.index() {
            index[first] = members.len();
            members.push(vec![i]);
        } else {
            members[index[first]].push(i);
        }
    }
    let axes = RotatingAxes::from_frame(frame);
    let fragment = |members: Vec<GrainId>| {
        let sums = AggregateSums::from_grains(members.iter().map(|&i| &grains[i]));
        Fragment { grains: members, sums: sums.in_fixed_axes(&axes) }
    };
    let mut found: Vec<Fragment> = members.into_iter().map(fragment).collect();
    // Bits of positive numbers are in their order.
    found.sort_by_cached_key(|fragment| Reverse(fragment.sums.mass.to_bits()));
    let size = |fragment: &Fragment| FragmentSize { mass: fragment.sums.mass, members: fragment.grains.len() };
    if let Some(remnant) = largest_remnant(&found.iter().map(size).collect::<Vec<_>>()) {
        found[..=remnant].rotate_right(1);
    }
    found
}

/// Sphere, or an image of it, in a column along x.
struct ColumnEntry {
    /// Numbers of the column along y and z.
    column: [i64; 2],
    /// Position along x from which on it may touch others, m.
    start: f64,
    /// Index of the sphere or image.
    image: usize,
}

/// Connects spheres that touch.
///
/// Sweeps along x in square columns, each sphere in all that it reaches, so that touching spheres share a column. Images
/// outside the cell are included.
fn connect_spheres(frame: &Frame, gap_share: f64, connected: &mut DisjointSets) {
    let grains = &frame.grains;
    let reach = |i: GrainId| grains[i].radius * (1.0 + gap_share);
    let spheres = || frame.grain_ids().filter(|&i| grains[i].solid.is_none());
    let count = spheres().count() as f64;
    // A sphere is in 2.5 columns on average at most, for any radii: (1 + 2 R / width)^2 <= 2 + 8 R^2 / width^2.
    let width = 4.0 * (spheres().map(|i| reach(i).powi(2)).sum::<f64>() / count).sqrt();
    let margin = 2.0 * spheres().map(reach).fold(0.0, f64::max);
    let (cell, mut images) = (frame.cell(), Vec::new());
    let mut entries: Vec<ColumnEntry> = Vec::new();
    for i in spheres() {
        for x in cell.images_near(grains[i].x, margin) {
            let columns = |c: f64| ((c - reach(i)) / width).floor() as i64..=((c + reach(i)) / width).floor() as i64;
            let columns_yz = columns(x.y).flat_map(|y| columns(x.z).map(move |z| [y, z]));
            entries.extend(columns_yz.map(|column| ColumnEntry { column, start: x.x - reach(i), image: images.len() }));
            images.push((i, x));
        }
    }
    entries.sort_unstable_by(|a, b| a.column.cmp(&b.column).then(a.start.total_cmp(&b.start)));
    for (k, first) in entries.iter().enumerate() {
        let (i, x) = images[first.image];
        let end = x.x + reach(i);
        let is_in_reach = |other: &&ColumnEntry| other.column == first.column && other.start <= end;
        for second in entries[k + 1..].iter().take_while(is_in_reach) {
            let (j, y) = images[second.image];
            let touching_distance = grains[i].radius + grains[j].radius + gap_share * smaller_radius(frame, i, j);
            if (x - y).norm_squared() <= touching_distance * touching_distance {
                connected.union(i.index(), j.index());
            }
        }
    }
}

/// Index of the fragment of each grain; 0 is the largest remnant.
pub fn fragment_numbers(fragments: &[Fragment], grains: usize) -> Vec<u32> {
    let mut number = vec![0; grains];
    for (k, fragment) in fragments.iter().enumerate() {
        fragment.grains.iter().for_each(|&grain| number[grain.index()] = k as u32);
    }
    number
}

/// The smaller radius of two grains, m.
fn smaller_radius(frame: &Frame, i: GrainId, j: GrainId) -> f64 {
    frame.grains[i].radius.min(frame.grains[j].radius)
}

fn both_spheres(frame: &Frame, i: GrainId, j: GrainId) -> bool {
    frame.grains[i].solid.is_none() && frame.grains[j].solid.is_none()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Scene;

    /// Share of the mass in each fragment.
    fn shares(scene: &Scene) -> Vec<f64> {
        let frame = scene.frame();
        find_fragments(&frame).iter().map(|fragment| fragment.sums.mass / frame.total_mass()).collect()
    }

    #[test]
    fn a_gap_within_the_limit_links_and_a_wider_one_does_not() {
        let mut scene = Scene::default();
        scene.grain([0.0; 3], 1.0);
        scene.grain([0.0, 1.5 + 0.9e-3 * 0.5, 0.0], 0.5); // 0.9 of the limit away
        assert_eq!(shares(&scene), [1.0]);
        scene.grain([0.0, 0.0, -1.5 - 1.1e-3 * 0.5], 0.5); // 1.1 of it
        let shares = shares(&scene); // of masses 8 + 1 and 1
        assert!(shares.len() == 2 && (shares[0] - 0.9).abs() < 1e-15 && (shares[1] - 0.1).abs() < 1e-15);
    }

    #[test]
    fn a_force_links_grains_that_have_moved_apart() {
        let mut scene = Scene::default();
        scene.grain([0.0; 3], 1.0);
        scene.grain([2.1, 0.0, 0.0], 1.0);
        assert_eq!(shares(&scene), [0.5, 0.5]);
        scene.push(0, 1, 1.0);
        assert_eq!(shares(&scene), [1.0]);
    }

    #[test]
    fn fragments_of_unequal_spheres_are_those_of_all_pairs() {
        // Radii from 0.05 to 20 in a cube, among them some that touch.
        let mut scene = Scene::default();
        for k in 1..300 {
            let digit = |step: u32| f64::from(k * step % 997) / 997.0;
            let radius = 0.05 * 400f64.powf(digit(331).powi(6));
            scene.grain([60.0 * digit(613), 60.0 * digit(271) - 30.0, 60.0 * digit(89) - 90.0], radius);
        }
        let frame = scene.frame();
        let mut connected = DisjointSets::new(frame.grains.len());
        for (i, a) in frame.grains.iter().enumerate() {
            for (j, b) in frame.grains.iter().enumerate().take(i) {
                let gap = (a.x - b.x).norm() - a.radius - b.radius;
                if gap <= TOUCHING_GAP * smaller_radius(&frame, GrainId::new(i), GrainId::new(j)) {
                    connected.union(i, j);
                }
            }
        }
        let numbers = |fragment: &Fragment| fragment.grains.iter().map(|i| i.index()).collect::<Vec<usize>>();
        let mut found: Vec<Vec<usize>> = find_fragments(&frame).iter().map(numbers).collect();
        let mut expected: Vec<Vec<usize>> = vec![Vec::new(); frame.grains.len()];
        (0..frame.grains.len()).for_each(|i| expected[connected.find(i)].push(i));
        expected.retain(|members| !members.is_empty());
        found.sort();
        assert_eq!(found, expected);
        assert!(expected.iter().any(|members| members.len() > 2));
    }

    #[test]
    fn fragments_do_not_end_at_the_border() {
        let mut scene = Scene::default();
        (scene.snapshot.meta.parameters.xperiode, scene.snapshot.meta.parameters.yperiode) = (Some(8.0), Some(6.0));
        // Across a corner of the cell, 2 apart, and one by itself.
        let step = 2f64.sqrt() * (1.0 - 1e-12);
        scene.grain([3.5, 2.5, 0.0], 1.0);
        scene.grain([3.5 + step, 2.5 + step, 0.0], 1.0);
        scene.grain([0.0; 3], 1.0);
        assert_eq!(shares(&scene), [2.0 / 3.0, 1.0 / 3.0]);
        let row = crate::derive::Row::from_frame(&scene.frame());
        assert_eq!((row.n_fragments, row.largest_mass), (2, 2.0 * scene.snapshot.bodies.body_mass[0]));
        // Values that would depend on the position of the border are undefined.
        let [a, spin, arm, largest] = [row.a, row.spin_z, row.L_z, row.largest_period];
        assert!([a, spin, arm, largest, row.com_x, row.com_y, row.Ec_rigid_mean].iter().all(|value| value.is_nan()));
        assert_eq!(row.com_z, 0.0);
        scene.snapshot.meta.parameters.yperiode = None;
        assert!(crate::derive::Row::from_frame(&scene.frame()).com_y.is_finite());
    }

    #[test]
    fn chains_are_followed_whatever_the_order() {
        let mut scene = Scene::default();
        for k in [7, 2, 5, 0, 3, 6, 1, 4] {
            scene.grain([0.3 * k as f64, 2.0 * k as f64, 0.0].map(|x: f64| x / 1.0111874208078342), 1.0);
        }
        assert_eq!(shares(&scene), [1.0]);
    }

    #[test]
    fn grains_know_their_fragment() {
        let mut scene = Scene::default();
        scene.grain([9.0, 0.0, 0.0], 1.0);
        scene.grain([0.0; 3], 1.0);
        scene.grain([2.0, 0.0, 0.0], 1.0);
        let fragments = find_fragments(&scene.frame());
        assert_eq!(fragments[0].grains, [1, 2].map(GrainId));
        assert_eq!(fragment_numbers(&fragments, 3), [1, 0, 0]);
    }

    #[test]
    fn no_grains_no_fragments() {
        assert!(shares(&Scene::default()).is_empty());
    }

    #[test]
    fn polyhedra_touch_by_their_contacts_and_fragments_are_numbered_by_mass() {
        let mut scene = Scene::default();
        for x in [0.0, 2.0005, 10.0, 12.0] {
            scene.cube([x, 0.0, 0.0], 1.0);
        }
        scene.grain([4.5, 0.0, 0.0], 1.0);
        let numbers = |scene: &Scene| fragment_numbers(&find_fragments(&scene.frame()), 5);
        assert_eq!(numbers(&scene), [0, 1, 2, 3, 4]);
        // Near enough, and half a metre too far.
        scene.contact_at(1, 0, [1.0, 0.0, 0.0], crate::math::Vec3::x() * 1e-300);
        scene.snapshot.contacts.contact_impulse[0] = [0.0; 3];
        scene.snapshot.contacts.contact_gap[0] = 0.5e-3;
        scene.push(4, 1, 0.0);
        scene.snapshot.contacts.contact_gap[1] = 0.5;
        scene.push(3, 2, 1.0);
        assert_eq!(numbers(&scene), [0, 0, 1, 1, 2]);
        let half = 8.0 / (32.0 + 4.0 / 3.0 * std::f64::consts::PI);
        assert!((shares(&scene)[0] - 2.0 * half).abs() < 1e-15);
    }
}
