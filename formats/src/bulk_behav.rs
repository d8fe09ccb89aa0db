//! `DATBOX/BULK_BEHAV.DAT`: uniform gravity and the densities of the materials.

use std::collections::HashSet;
use std::fmt::Write;
use std::path::Path;

use crate::error::Faults;
use crate::scan::{AcceptedDeviation, AsciiText, LineScanner, RealText, TextLine, format_e14, format_long14, put_text};

/// Content of the file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct BulkBehav {
    /// Gravity, m/s^2, fixed axes.
    pub gravity: [f64; 3],
    pub materials: Vec<Material>,
}

/// Material of bodies.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// Name, trimmed, at most five characters.
    pub name: String,
    /// `Umas`, kg/m^3.
    pub density: f64,
}

impl BulkBehav {
    /// Reads the file; reports all its faults at once. Lines that are neither gravity nor a material are skipped, as in
    /// LMGC90. Of materials that are not `RIGID` only the density is kept, and springs (`DISCRETE`) are skipped, with a notice.
    pub fn read(path: &Path) -> Result<Self, Faults> {
        Self::parse(path, &AsciiText::read_file(path)?)
    }

    /// Reads the text of a file; `path` is for messages. Errors: all faults of the text.
    pub fn parse(path: &Path, text: &AsciiText) -> Result<Self, Faults> {
        Ok(Self::parse_with_notices(path, text)?.0)
    }

    /// Reads the text of a file like [`BulkBehav::parse`]; also returns notices about deviations from its form.
    pub fn parse_with_notices(path: &Path, text: &AsciiText) -> Result<(Self, Vec<String>), Faults> {
        let scan = &mut LineScanner::new(path, text);
        let mut gravity = None;
        let mut materials: Vec<Material> = Vec::new();
        let mut material_names = HashSet::new();
        let mut first_material = None;
        while let Some(begin) = scan.next_line() {
            match begin.keyword() {
                "gravy" => {
                    scan.set_object("gravity");
                    if gravity.is_some() {
                        scan.add_fault(begin.number, "a second $gravy", "expected one");
                    }
                    let gravity = gravity.insert([0.0; 3]);
                    if let Some(line) = scan.expect_continuation("grv1 grv2 grv3") {
                        *gravity =
                            [0, 1, 2].map(|k| scan.read_real(line, GRAVITY_COLUMNS[k], format_args!("grv{}", k + 1)));
                    }
                }
                "behav" => {
                    first_material = first_material.or(Some(begin.number));
                    scan.set_object(format!("material {}", materials.len() + 1));
                    let Some(line) = scan.expect_line("expected a material", TextLine::is_data) else {
                        continue;
                    };
                    let name = scan.read_name5(line, 2, "name");
                    scan.set_object(format!("material {name}"));
                    let law = scan.read_name(line, (9, 38), "law");
                    if law == "DISCRETE" {
                        scan.add_form(AcceptedDeviation::SpringMaterial, line.number);
                        while scan.next_line_if(TextLine::is_continuation).is_some() {}
                        continue;
                    }
                    if law != "RIGID" {
                        scan.add_form(AcceptedDeviation::OtherMaterialLaw, line.number);
                    }
                    let density = scan.read_positive(line, 46, "density Umas");
                    if !name.is_empty() && !material_names.insert(name.clone()) {
                        scan.add_fault(line.number, format!("'{name}' is defined twice"), "expected each name once");
                    }
                    materials.push(Material { name, density });
                }
                _ if is_material(begin) => {
                    scan.set_object("file");
                    scan.add_fault(begin.number, "a material that LMGC90 would skip", "expected $behav before it");
                }
                _ => scan.reject_unknown_keyword(begin, "expected $gravy or $behav"),
            }
        }
        if gravity.is_none() {
            let (found, expected) = ("no $gravy", "expected it with grv1 grv2 grv3 on the next line");
            scan.set_object("file");
            match first_material {
                Some(line) => scan.add_fault(line, found, expected),
                None => scan.add_file_fault(found, expected),
            }
        }
        scan.finish_with_notices(BulkBehav { gravity: gravity.unwrap_or_default(), materials })
    }

    /// Text of the file, numbers with eight digits.
    pub fn to_text(&self) -> String {
        self.text_with(format_e14)
    }

    /// Text of the file with as many digits as the columns can hold, see [`format_long14`].
    pub fn to_long_text(&self) -> String {
        self.text_with(format_long14)
    }

    /// Text of the file with numbers formatted by `real`.
    fn text_with(&self, real: fn(f64) -> RealText) -> String {
        let mut out = String::from("$gravy\n");
        for (k, column) in GRAVITY_COLUMNS.iter().enumerate() {
            put_text(&mut out, column - LABEL_WIDTH, format_args!("grv{}={}", k + 1, real(self.gravity[k])));
        }
        out.push('\n');
        for Material { name, density } in &self.materials {
            let _ = writeln!(out, "$behav  lawty\n {name:<5}  {:<30}  Umas={}", "RIGID", real(*density));
        }
        out
    }
}

/// Whether a line without a keyword belongs to a material.
fn is_material(line: TextLine) -> bool {
    line.is_data() && !line.is_continuation() && line.columns(9, 38).trim() == "RIGID"
}

/// First columns of the components of gravity.
const GRAVITY_COLUMNS: [usize; 3] = [25, 46, 67];

/// Width of the label in front of a component, such as `grv1=`.
const LABEL_WIDTH: usize = 5;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn materials_of_springs_are_skipped() {
        let text = "$gravy
                   grv1= 0.0000000E+00  grv2= 0.0000000E+00  grv3=-9.8100000E+00
$behav  lawty
 ressr  DISCRETE                        m1  = 0.0000000D+00  m2  = 0.0000000D+00  m3  = 0.0000000D+00
                                        k1  = 0.0000000D+00  k2  = 0.0000000D+00  k3  = 0.0000000D+00
$behav  lawty
 ROCKx  RIGID                           Umas= 1.0000000E+03
";
        let text = AsciiText::new(text.as_bytes());
        let (bulk, notices) = BulkBehav::parse_with_notices(Path::new("BULK_BEHAV.DAT"), &text).unwrap();
        assert_eq!(bulk.materials, [Material { name: "ROCKx".into(), density: 1000.0 }]);
        assert_eq!(notices.len(), 1, "{notices:?}");
    }

    #[test]
    fn materials_of_other_laws_get_a_notice() {
        let head = "$gravy\n                   grv1= 0.0000000E+00  grv2= 0.0000000E+00  grv3= 0.0000000E+00\n$behav\n";
        let notices = |law: &str| {
            let text = format!("{head} ROCKx  {law:<30}  Umas= 1.0000000E+03\n");
            let (bulk, notices) =
                BulkBehav::parse_with_notices(Path::new("BULK_BEHAV.DAT"), &AsciiText::new(text.as_bytes())).unwrap();
            assert_eq!(bulk.materials, [Material { name: "ROCKx".into(), density: 1000.0 }]);
            notices
        };
        assert_eq!(notices("RIGID"), [""; 0]);
        let expected = "BULK_BEHAV.DAT:4: 1 material has a law other than RIGID, of which only the density is used";
        assert_eq!(notices("RIGIz"), [expected]);
    }
}
