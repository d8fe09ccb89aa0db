//! Comparison of the files of DATBOX with the snapshot that was computed from them: files edited since do not fit it.

use std::path::Path;

use crate::bodies::Bodies;
use crate::bulk_behav::BulkBehav;
use crate::drv_dof::DrvDof;
use crate::error::{Fault, Faults};
use crate::mass::InertialProperties;
use crate::names::{count_text, number_text};
use crate::snapshot::Snapshot;
use crate::surface::MassProperties;
use crate::tact_behav::TactBehav;

/// Largest number of bodies of a file that are reported one by one.
const MAX_REPORTED_BODIES: usize = 5;

/// Largest relative difference that counts as rounding of recomputed masses, radii and moments. It is below the last digit of
/// the file, which has eight or more, so that an edit of that digit is found.
const RELATIVE_ROUNDING: f64 = 1e-9;

/// Snapshot with its file, for messages.
#[derive(Debug, Clone, Copy)]
pub struct ComputedSnapshot<'a> {
    pub path: &'a Path,
    pub snapshot: &'a Snapshot,
}

impl ComputedSnapshot<'_> {
    /// Expectation of a fault: `value`, as in the snapshot.
    fn expected_text(&self, value: &str) -> String {
        format!("expected {value} as in {}", self.path.display())
    }

    /// Compares BODIES.DAT: the number of bodies, their materials, radii, masses and moments of inertia, with the
    /// densities of the snapshot. Returns the mass properties of the bodies at density 1.
    ///
    /// Errors: surfaces without mass properties, and the bodies that differ, first five, then the count of the others.
    pub fn expect_bodies(&self, file: &Path, bodies: &Bodies) -> Result<Vec<MassProperties>, Faults> {
        let stored = &self.snapshot.bodies;
        let count = stored.body_id.len();
        if bodies.0.len() != count {
            let (found, expected) = (count_text(bodies.0.len(), "body"), self.expected_text(&format!("{count}")));
            return Err(Fault::new(file, None, "file", found, expected).into());
        }
        let (mut surface_faults, mut differences, mut mass_properties) = (Faults::default(), Vec::new(), Vec::new());
        for (k, body) in bodies.0.iter().enumerate() {
            let fault = |found, expected| Fault::new(file, Some(body.line), format!("body {}", k + 1), found, expected);
            let own = match body.mass_properties() {
                Ok(own) => own,
                Err(found) => {
                    surface_faults.push(fault(found.to_string(), "expected closed surfaces".into()));
                    continue;
                }
            };
            let material = &self.snapshot.meta.materials[stored.body_material[k] as usize];
            let computed = body.inertial_properties(&own, material.density);
            let recorded = InertialProperties {
                mass: stored.body_mass[k],
                inertia: stored.body_inertia[k],
                radius: stored.body_radius[k],
            };
            mass_properties.push(own);
            // In the order of `property_texts`.
            let are_equal = [
                body.material == material.name,
                nearly_equal(&[computed.radius], &[recorded.radius]),
                nearly_equal(&[computed.mass], &[recorded.mass]),
                nearly_equal(&computed.inertia, &recorded.inertia),
            ];
            if are_equal.contains(&false) {
                let differing_texts = |texts: [String; 4]| {
                    let texts = texts.into_iter().zip(are_equal).filter(|(_, is_equal)| !is_equal);
                    texts.map(|(text, _)| text).collect::<Vec<_>>().join(", ")
                };
                let found = differing_texts(property_texts(&body.material, &computed));
                let expected = differing_texts(property_texts(&material.name, &recorded));
                differences.push(fault(found, self.expected_text(&expected)));
            }
        }
        surface_faults.0.extend(self.first_faults(file, differences));
        surface_faults.into_result(mass_properties)
    }

    /// First few faults of a file, and the count of the others.
    fn first_faults(&self, file: &Path, mut faults: Vec<Fault>) -> Vec<Fault> {
        let further = faults.len().saturating_sub(MAX_REPORTED_BODIES);
        faults.truncate(MAX_REPORTED_BODIES);
        if further > 0 {
            faults.push(Fault::new(
                file,
                None,
                "file",
                format!("{further} more bodies differ"),
                self.expected_text("all"),
            ));
        }
        faults
    }

    /// Compares the densities of BULK_BEHAV.DAT, exactly: the snapshot has the number that was read from the file. Errors: each
    /// material of the bodies that differs or is missing.
    pub fn expect_materials(&self, file: &Path, bulk: &BulkBehav) -> Result<(), Faults> {
        let mut faults = Faults::default();
        for (number, stored) in (0..).zip(&self.snapshot.meta.materials) {
            let density_in_file =
                bulk.materials.iter().find(|material| material.name == stored.name).map(|m| m.density);
            if density_in_file != Some(stored.density) && self.snapshot.bodies.body_material.contains(&number) {
                let found = density_in_file
                    .map_or("is missing".into(), |density| format!("density {} kg/m^3", number_text(density)));
                let expected = self.expected_text(&format!("{} kg/m^3", number_text(stored.density)));
                faults.push(Fault::new(file, None, format!("material {}", stored.name), found, expected));
            }
        }
        faults.into_result(())
    }

    /// Compares the laws of TACT_BEHAV.DAT that its table uses. Errors: each law that differs, is new or missing.
    pub fn expect_laws(&self, file: &Path, tact: &TactBehav) -> Result<(), Faults> {
        let mut faults = Faults::default();
        let stored = self.snapshot.meta.laws_of_file();
        let text = |kind: &str, parameters: &[f64]| format!("{kind} {parameters:?}");
        let is_used = |nickname: &str| tact.visibility.iter().any(|row| row.law == nickname);
        for law in tact.laws.iter().filter(|law| is_used(&law.nickname)) {
            let stored_text = stored.iter().find(|stored| stored.nickname == law.nickname);
            let stored_text = stored_text.map(|stored| text(&stored.kind, &stored.parameters));
            let text_in_file = text(&law.kind, &law.parameters);
            if stored_text.as_ref() != Some(&text_in_file) {
                let expected = self.expected_text(stored_text.as_deref().unwrap_or("no such law in use"));
                faults.push(Fault::new(
                    file,
                    Some(law.line),
                    format!("law '{}'", law.nickname),
                    text_in_file,
                    expected,
                ));
            }
        }
        for law in stored.iter().filter(|law| !is_used(&law.nickname)) {
            let expected = self.expected_text(&text(&law.kind, &law.parameters));
            faults.push(Fault::new(file, None, format!("law '{}'", law.nickname), "is not used by any pair", expected));
        }
        faults.into_result(())
    }

    /// Compares the components of velocities that DRV_DOF.DAT imposes; their values may change. Errors: the bodies that
    /// differ, first five, then the count of the others.
    pub fn expect_driven(&self, file: &Path, driven: &DrvDof) -> Result<(), Faults> {
        let snapshot_bits = &self.snapshot.bodies.body_driven;
        let mut file_bits = vec![0; snapshot_bits.len()];
        for row in driven.0.iter().filter(|row| row.kind.imposes_velocity()) {
            if let Some(bits) = file_bits.get_mut(row.body) {
                *bits |= 1 << row.component;
            }
        }
        let differences = (0..file_bits.len()).filter(|&k| file_bits[k] != snapshot_bits[k]).map(|k| {
            let line = driven.0.iter().find(|row| row.body == k).map(|row| row.line);
            let found = imposed_components(file_bits[k]);
            let expected = self.expected_text(&imposed_components(snapshot_bits[k]));
            Fault::new(file, line, format!("body {}", k + 1), found, expected)
        });
        Faults(self.first_faults(file, differences.collect())).into_result(())
    }
}

/// Properties of a body in words.
fn property_texts(material: &str, properties: &InertialProperties) -> [String; 4] {
    let InertialProperties { mass, inertia, radius } = properties;
    [
        format!("material '{material}'"),
        format!("radius {} m", number_text(*radius)),
        format!("mass {} kg", number_text(*mass)),
        format!("moments {} kg m²", inertia.map(number_text).join(", ")),
    ]
}

/// Components of the velocity in words, bit k for component k + 1.
fn imposed_components(bits: u8) -> String {
    let components: Vec<String> = (0..6).filter(|k| bits & (1 << k) != 0).map(|k| (k + 1).to_string()).collect();
    if components.is_empty() { "no velocity imposed".into() } else { format!("vlocy {}", components.join(" ")) }
}

/// Whether numbers differ by rounding at most, relative to the largest.
fn nearly_equal(a: &[f64], b: &[f64]) -> bool {
    let largest = b.iter().fold(0.0, |largest: f64, x| largest.max(x.abs()));
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= RELATIVE_ROUNDING * largest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::{Body, Contactor, ShapeRecord};
    use crate::bulk_behav::Material;
    use crate::drv_dof::{DrivenComponent, DrivenKind, Evolution};
    use crate::snapshot::{LawName, MaterialName};
    use crate::tact_behav::{LawRecord, VisibilityRow, VisibilitySide};

    /// Spheres of these radii, m, and 3000 kg/m^3.
    fn spheres(radii: &[f64]) -> Bodies {
        let sphere = |(k, &radius): (usize, &f64)| Body {
            line: 10 * k + 1,
            material: "ROCKx".into(),
            equivalent_radius: radius,
            inertia: None,
            position: [0.0; 3],
            contactors: vec![Contactor {
                colour: "BLUEx".into(),
                shape: ShapeRecord::Sphere { radius },
                local_frame: None,
            }],
        };
        Bodies(radii.iter().enumerate().map(sphere).collect())
    }

    fn computed(bodies: &Bodies) -> Snapshot {
        let mut snapshot = Snapshot::default();
        snapshot.meta.materials = vec![MaterialName { name: "ROCKx".into(), density: 3000.0 }];
        snapshot.meta.laws = vec![LawName { nickname: "iqsc0".into(), kind: "IQS_CLB".into(), parameters: vec![0.5] }];
        let rows = &mut snapshot.bodies;
        for (k, body) in bodies.0.iter().enumerate() {
            let inert = body.inertial_properties(&body.mass_properties().unwrap(), 3000.0);
            rows.body_id.push(k as u64 + 1);
            rows.body_mass.push(inert.mass);
            rows.body_inertia.push(inert.inertia);
            rows.body_radius.push(inert.radius);
            rows.body_material.push(0);
            rows.body_driven.push(0);
        }
        snapshot
    }

    fn messages<T: std::fmt::Debug>(result: Result<T, Faults>) -> Vec<String> {
        result.unwrap_err().0.iter().map(Fault::to_string).collect()
    }

    #[test]
    fn edited_bodies_are_reported_up_to_five() {
        let (file, path) = (Path::new("BODIES.DAT"), Path::new("snapshot-000005.npz"));
        let bodies = spheres(&[1.0; 8]);
        let snapshot = computed(&bodies);
        let computed = ComputedSnapshot { path, snapshot: &snapshot };
        assert_eq!(computed.expect_bodies(file, &bodies).unwrap().len(), 8);
        // The last of the file's eight digits.
        let nearly = spheres(&[1.0, 1.0, 1.0000001, 1.0, 1.0, 1.0, 1.0, 1.0]);
        let faults = messages(computed.expect_bodies(file, &nearly));
        assert!(faults.len() == 1 && faults[0].starts_with("BODIES.DAT:21: body 3: radius 1.0000001 m, mass 12566."));
        assert!(faults[0].contains("; expected radius 1 m, mass 12566."), "{faults:?}");
        assert!(faults[0].ends_with("kg m² as in snapshot-000005.npz"), "{faults:?}");
        let faults = messages(computed.expect_bodies(file, &spheres(&[2.0; 8])));
        assert_eq!(faults.len(), MAX_REPORTED_BODIES + 1);
        assert!(
            faults[MAX_REPORTED_BODIES].starts_with("BODIES.DAT: file: 3 more bodies differ; expected all"),
            "{faults:?}"
        );
        let faults = messages(computed.expect_bodies(file, &spheres(&[1.0; 7])));
        assert_eq!(faults, ["BODIES.DAT: file: 7 bodies; expected 8 as in snapshot-000005.npz"]);
        let mut other = bodies.clone();
        other.0[7].material = "IRONx".into();
        let expected = "BODIES.DAT:71: body 8: material 'IRONx'; expected material 'ROCKx' as in snapshot-000005.npz";
        assert_eq!(messages(computed.expect_bodies(file, &other)), [expected]);
    }

    #[test]
    fn densities_laws_and_imposed_motion_that_were_edited_are_reported() {
        let (file, path) = (Path::new("FILE.DAT"), Path::new("snapshot-000005.npz"));
        let snapshot = computed(&spheres(&[1.0; 2]));
        let computed = ComputedSnapshot { path, snapshot: &snapshot };
        let bulk = |density| BulkBehav {
            gravity: [0.0; 3],
            materials: vec![
                Material { name: "ROCKx".into(), density },
                Material { name: "IRONx".into(), density: 1.0 },
            ],
        };
        computed.expect_materials(file, &bulk(3000.0)).unwrap();
        let expected = "FILE.DAT: material ROCKx: density 2600 kg/m^3; expected 3000 kg/m^3 as in snapshot-000005.npz";
        assert_eq!(messages(computed.expect_materials(file, &bulk(2600.0))), [expected]);

        let side = VisibilitySide { body: "RBDY3".into(), contactor: "SPHER".into(), colour: "BLUEx".into() };
        let law = |line, nickname: &str, friction| LawRecord {
            line,
            nickname: nickname.into(),
            kind: "IQS_CLB".into(),
            parameters: vec![friction],
        };
        let see = |law: &str| VisibilityRow {
            line: 9,
            candidate: side.clone(),
            law: law.into(),
            antagonist: side.clone(),
            alert: 0.1,
        };
        let unused = law(5, "other", 0.1);
        let tact =
            |used: LawRecord| TactBehav { visibility: vec![see(&used.nickname)], laws: vec![used, unused.clone()] };
        computed.expect_laws(file, &tact(law(2, "iqsc0", 0.5))).unwrap();
        let expected = "FILE.DAT:2: law 'iqsc0': IQS_CLB [0.4]; expected IQS_CLB [0.5] as in snapshot-000005.npz";
        assert_eq!(messages(computed.expect_laws(file, &tact(law(2, "iqsc0", 0.4)))), [expected]);
        let expected = [
            "FILE.DAT:2: law 'iqsc1': IQS_CLB [0.5]; expected no such law in use as in snapshot-000005.npz",
            "FILE.DAT: law 'iqsc0': is not used by any pair; expected IQS_CLB [0.5] as in snapshot-000005.npz",
        ];
        assert_eq!(messages(computed.expect_laws(file, &tact(law(2, "iqsc1", 0.5)))), expected);

        let rest = Evolution::Harmonic {
            constant: 0.0,
            amplitude: 0.0,
            omega: 0.0,
            phase: 0.0,
            ramp_start: 1.0,
            ramp_rate: 0.0,
        };
        let row = |kind, component| DrivenComponent { line: 3, body: 1, component, kind, evolution: rest.clone() };
        computed.expect_driven(file, &DrvDof(vec![row(DrivenKind::Force, 0)])).unwrap();
        let driven = DrvDof((2..6).map(|component| row(DrivenKind::Velocity, component)).collect());
        let expected = "FILE.DAT:3: body 2: vlocy 3 4 5 6; expected no velocity imposed as in snapshot-000005.npz";
        assert_eq!(messages(computed.expect_driven(file, &driven)), [expected]);
    }
}
