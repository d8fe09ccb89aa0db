//! LMGC90's own scenes against its results at the same step.
//!
//! Both programs run the same scheme on the same files with theta = 1/2. They differ in the lever of a contact
//! with a gap (LMGC90: the sphere's radius; here: both arms end in one point, which conserves angular
//! momentum), in the tolerance of their solvers (LMGC90: 1.666e-4 on QM/16) and LMGC90 writes 7 digits.
//! A pile of spheres makes such differences grow as it rearranges, so that the bounds are ten times what was
//! found.

use std::path::{Path, PathBuf};

use cd_formats::bodies::Bodies;
use cd_formats::dof::Dof;
use cd_formats::snapshot::{self, Snapshot};

use crate::case::{Figures, Vec3, solve};

const FILES: [&str; 5] = ["BODIES.DAT", "BULK_BEHAV.DAT", "TACT_BEHAV.DAT", "DRV_DOF.DAT", "DOF.INI"];

/// A file of LMGC90; some are kept by the crate of the formats.
fn file(scene: &str, name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let own = folder.join("tests/lmgc90").join(scene).join(name);
    let other = folder.join("../formats/tests/good").join(scene).join(name);
    if own.exists() { own } else { other }
}

/// Largest difference of positions (m) and velocities (m/s) after each of LMGC90's outputs (number, step).
fn differences(scene: &str, h: &str, outputs: &[(u64, u64)]) -> Vec<(f64, f64)> {
    let folder = tempfile::tempdir().unwrap();
    let datbox = folder.path().join("DATBOX");
    std::fs::create_dir(&datbox).unwrap();
    for name in FILES {
        std::fs::copy(file(scene, &format!("DATBOX/{name}")), datbox.join(name)).unwrap();
    }
    let bodies = Bodies::read(&datbox.join("BODIES.DAT")).unwrap();
    let mut found = Vec::new();
    for (output, step) in outputs {
        let steps = step.to_string();
        let flags = ["--resume", "--dt", h, "--theta", "0.5", "--tol", "1e-6", "--steps", &steps];
        assert_eq!(solve(folder.path().into(), &flags), 0);
        let ours = Snapshot::read(&snapshot::snapshot_path(&folder.path().join("OUTBOX"), *step)).unwrap();
        let theirs = Dof::read(&file(scene, &format!("OUTBOX/DOF.OUT.{output}"))).unwrap();
        assert_eq!(theirs.step, *step);
        let mut most = (0.0f64, 0.0f64);
        for (i, (body, dof)) in bodies.0.iter().zip(&theirs.bodies).enumerate() {
            let first = |six: &[f64; 6]| Vec3::from_row_slice(&six[..3]);
            let x = Vec3::from(body.position) + first(&dof.displacement);
            most.0 = most.0.max((ours.x(i) - x).norm());
            most.1 = most.1.max((ours.v(i) - first(&dof.velocity)).norm());
        }
        found.push(most);
    }
    found
}

#[track_caller]
fn expect(found: &[(f64, f64)], bounds: &[(f64, f64)]) {
    println!("{found:?}");
    for ((x, v), (x_bound, v_bound)) in found.iter().zip(bounds) {
        assert!(x <= x_bound && v <= v_bound, "{found:?} of {bounds:?}");
    }
}

#[test]
fn two_spheres() {
    expect(&differences("two-spheres", "5e-3", &[(12, 120)]), &[(3e-4, 1e-3)]);
}

#[test]
fn spheres_in_a_box() {
    expect(&differences("spheres20-box", "1e-3", &[(2, 400), (5, 1000)]), &[(1e-5, 5e-4), (3e-3, 5e-3)]);
}

#[test]
fn cohesive_spheres() {
    expect(&differences("cohesive27-wet", "1e-3", &[(2, 200)]), &[(4e-5, 1.5e-3)]);
}

#[test]
fn a_driven_plate() {
    expect(&differences("driven-plane27", "1e-3", &[(1, 200)]), &[(4e-3, 3e-2)]);
}
