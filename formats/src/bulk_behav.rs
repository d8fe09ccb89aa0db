//! `BULK_BEHAV.DAT`: uniform gravity and the materials' densities.

use std::fmt::Write;
use std::path::Path;

use crate::error::Faults;
use crate::scan::{Line, Scan, Text, e14, long14, put};

#[derive(Debug, Clone, PartialEq, Default)]
pub struct BulkBehav {
    /// m/s^2, fixed axes.
    pub gravity: [f64; 3],
    pub materials: Vec<Material>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// Trimmed, at most five characters.
    pub name: String,
    /// `Umas`, kg/m^3.
    pub density: f64,
}

impl BulkBehav {
    /// Reads the file; all its faults at once. Lines that are neither gravity nor a material are passed
    /// over, as LMGC90 does; of materials that are not `RIGID` the density alone is kept.
    pub fn read(path: &Path) -> Result<Self, Faults> {
        Self::parse(path, &Text::load(path)?)
    }

    /// Reads the text of a file; `path` is for messages.
    pub fn parse(path: &Path, text: &Text) -> Result<Self, Faults> {
        let scan = &mut Scan::new(path, text);
        let mut gravity = None;
        let mut materials: Vec<Material> = Vec::new();
        while let Some(begin) = scan.line() {
            match begin.keyword() {
                "gravy" => {
                    scan.about("gravity");
                    if gravity.is_some() {
                        scan.fault(begin.number, "a second $gravy", "expected one");
                    }
                    let gravity = gravity.insert([0.0; 3]);
                    if let Some(line) = scan.expect_continuation("grv1 grv2 grv3") {
                        *gravity = [0, 1, 2].map(|k| scan.real(line, GRAVITY[k], format_args!("grv{}", k + 1)));
                    }
                }
                "behav" => {
                    scan.about(format!("material {}", materials.len() + 1));
                    let Some(line) = scan.expect("expected a material", Line::is_data) else {
                        continue;
                    };
                    let name = scan.name5(line, 2, "name");
                    scan.about(format!("material {name}"));
                    scan.name(line, (9, 38), "law");
                    let density = scan.positive(line, 46, "density Umas");
                    if !name.is_empty() && materials.iter().any(|known| known.name == name) {
                        scan.fault(line.number, format!("'{name}' is defined twice"), "expected each name once");
                    }
                    materials.push(Material { name, density });
                }
                _ => {}
            }
        }
        if gravity.is_none() {
            scan.fault_of_file("no $gravy", "expected it with grv1 grv2 grv3 on the next line");
        }
        scan.finish(BulkBehav { gravity: gravity.unwrap_or_default(), materials })
    }

    /// The text of the file, numbers with eight digits.
    pub fn to_text(&self) -> String {
        self.text(e14)
    }

    /// The same with as many digits as the columns hold, see [`long14`].
    pub fn to_long_text(&self) -> String {
        self.text(long14)
    }

    fn text(&self, real: fn(f64) -> String) -> String {
        let mut out = String::from("$gravy\n");
        for (k, column) in GRAVITY.iter().enumerate() {
            put(&mut out, column - 5, format_args!("grv{}={}", k + 1, real(self.gravity[k])));
        }
        out.push('\n');
        for Material { name, density } in &self.materials {
            let _ = writeln!(out, "$behav  lawty\n {name:<5}  {:<30}  Umas={}", "RIGID", real(*density));
        }
        out
    }
}

/// First columns of the components of gravity.
const GRAVITY: [usize; 3] = [25, 46, 67];
