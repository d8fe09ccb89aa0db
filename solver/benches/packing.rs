//! Synthetic contact problems for benches and tests.

use cd_solve::assemble::{BlockData, ContactConstraint, ContactProblem, RollingConstraint, SolverBody};
use cd_solve::math::{Mat3, Vec3};
use cd_solve::scene::BodyId;
use cd_solve::solve::gauss_seidel::block::local::{delassus_block_of_row, full_matrix};
use cd_solve::state::ContactId;

/// The same with cuboids in place of the spheres, four points on each face that touches.
pub fn blocks(side: usize, friction: f64) -> ContactProblem {
    let mut system = packing(side, friction);
    let turned = |k: usize| 0.2 * ((k as f64 + 0.5) * 9.7).sin();
    let inverse_inertia = |k: usize| Mat3::from_diagonal(&Vec3::new(1.5, 1.2 + turned(k), 1.8));
    let inverse_inertia = (0..system.bodies.len()).map(inverse_inertia).collect();
    let mut full =
        BlockData { arms: Vec::new(), friction_offsets: Vec::new(), locked_axes: Vec::new(), inverse_inertia };
    let mut rows = Vec::new();
    for row in &system.rows {
        let (u, v) = (row.normal.cross(&Vec3::new(0.6, 0.8, 0.1)), row.normal.yzx());
        let along = (v - row.normal * v.dot(&row.normal)).normalize();
        for (x, y) in [(-0.7, -0.7), (0.7, -0.7), (0.7, 0.7), (-0.7, 0.7)] {
            let across = u.normalize() * x + along * y;
            full.arms.push([across - row.normal, across + row.normal]);
            rows.push(*row);
        }
    }
    system.rows = rows;
    for k in 0..system.rows.len() {
        let block = full_matrix(delassus_block_of_row(&system, &full, k));
        let row = &mut system.rows[k];
        row.w_n = row.normal.dot(&(block * row.normal));
        row.w_t = 0.5 * (block.trace() - row.w_n);
    }
    system.block_data = Some(full);
    system
}

/// The same with resistance to rolling and spinning at every contact.
pub fn resisting(mut system: ContactProblem) -> ContactProblem {
    let roll = |row| RollingConstraint {
        row,
        radius: 0.5,
        rolling: 0.1,
        spinning: 0.05,
        shear: 0.0,
        inverse_w: 0.2, // two spheres of 2.5/(kg m^2)
        shift: Vec3::zeros(),
        compliance: [0.0; 2],
        warm_start: Vec3::zeros(),
    };
    system.rolling_constraints = (0..system.rows.len()).map(ContactId::new).map(roll).collect();
    system
}

/// side^3 spheres on a cubic lattice, each touching its neighbours, with random velocities; ordered along Morton's curve.
pub fn packing(side: usize, friction: f64) -> ContactProblem {
    let random = |k: usize, f: f64| ((k as f64 + 0.5) * f).sin();
    let count = side.pow(3);
    let place = |k: usize| [k / side / side, k / side % side, k % side];
    let records = (0..count)
        .map(|k| SolverBody {
            v: Vec3::new(random(k, 12.9898), random(k, 78.233), random(k, 37.719)) * 0.1,
            inverse_mass: 1.0,
            w: Vec3::zeros(),
            inverse_inertia: 2.5,
            radius: 1.0,
        })
        .collect();
    let mut rows = Vec::new();
    for k in 0..count {
        for (axis, stride) in [(0, side * side), (1, side), (2, 1)] {
            if place(k)[axis] + 1 == side {
                continue;
            }
            let mut normal = Vec3::new(random(k, 3.1), random(k, 5.7), random(k, 7.3)) * 0.2;
            normal[axis] -= 1.0;
            rows.push(ContactConstraint {
                bodies: [BodyId::new(k), BodyId::new(k + stride)],
                normal: normal.normalize(),
                arm: 1.0,
                w_n: 2.0,
                w_t: 7.0,
                friction,
                acts: true,
                can_close: true,
                ..ContactConstraint::default()
            });
        }
    }
    let key = |&k: &u32| {
        let place = place(k as usize);
        (0..8).rev().flat_map(|bit| place.map(|c| c >> bit & 1)).fold(0, |key, bit| key << 1 | bit)
    };
    let mut order: Vec<u32> = (0..count as u32).collect();
    order.sort_by_cached_key(key);
    ContactProblem {
        rows,
        rolling_constraints: Vec::new(),
        regularised: Vec::new(),
        memories: Vec::new(),
        pair_attractions: Vec::new(),
        block_data: None,
        bodies: records,
        order,
    }
}
