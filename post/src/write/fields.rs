//! Field data of the ParaView files: time, step, names of materials, colours and laws, and units of the arrays.

use std::fmt::Write;

use crate::axes::OutputAxes;
use crate::frame::Frame;

/// Units of the arrays with units of the ParaView files.
pub const ARRAY_UNITS: [(&str, &str); 19] = [
    ("radius", "m"),
    ("velocity", "m/s"),
    ("spin", "rad/s"),
    ("stress", "Pa"),
    ("pressure", "Pa"),
    ("mass", "kg"),
    ("kinetic_energy", "J"),
    ("kinetic_stress", "Pa"),
    ("normal_force", "N"),
    ("tangential_force", "N"),
    ("force", "N"),
    ("moment", "N m"),
    ("face_force", "N"),
    ("face_pressure", "Pa"),
    ("gap", "m"),
    ("height", "m"),
    ("slope", "°"),
    ("gravity", "m/s^2"),
    ("area", "m^2"),
];

/// Names that arrays of indices refer to.
#[derive(Debug, Clone, PartialEq)]
pub struct IndexNames {
    pub materials: Vec<String>,
    pub colours: Vec<String>,
    /// Nickname and kind of each law.
    pub laws: Vec<String>,
}

impl IndexNames {
    /// Names of a run.
    pub fn from_frame(frame: &Frame) -> IndexNames {
        let meta = &frame.meta;
        IndexNames {
            materials: meta.materials.iter().map(|material| material.name.clone()).collect(),
            colours: meta.colours.clone(),
            laws: meta.laws.iter().map(|law| format!("{} {}", law.nickname, law.kind)).collect(),
        }
    }

    /// Names by the array whose values are their indices.
    pub fn by_array(&self) -> [(&'static str, &[String]); 3] {
        [("material", &self.materials), ("colour", &self.colours), ("law", &self.laws)]
    }
}

/// XML element with the field data of a file with these arrays.
///
/// `TimeValue` is the time, s, which VTK's readers take from there; texts are arrays of strings, which VTK stores as
/// characters by number, each text with a zero at its end.
pub fn field_data(frame: &Frame, arrays: &[&str]) -> String {
    let mut text = String::from("<FieldData>\n");
    let time = frame.meta.time;
    let mut write_line = |line: String| writeln!(text, "{line}").expect("writing to a string");
    for (name, kind, value) in
        [("TimeValue", "Float64", format!("{time:?}")), ("step", "UInt64", frame.meta.step.to_string())]
    {
        write_line(format!(
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfTuples=\"1\" format=\"ascii\">{value}</DataArray>"
        ));
    }
    let names = IndexNames::from_frame(frame);
    let indexed = names.by_array().into_iter().filter(|(array, _)| arrays.contains(array));
    let units = ARRAY_UNITS.iter().filter(|(array, _)| arrays.contains(array));
    let units: Vec<String> = units.map(|(array, unit)| format!("{array} ({unit})")).collect();
    let lists = indexed.map(|(array, names)| (format!("{array} names"), names.to_vec()));
    let axes = Some(frame.axes).filter(|axes| *axes != OutputAxes::Computed).map(|axes| axes.to_string());
    let texts = [("units".to_string(), units), ("axes".to_string(), Vec::from_iter(axes))];
    for (name, texts) in lists.chain(texts).filter(|(_, texts)| !texts.is_empty()) {
        let codes: Vec<String> = texts.iter().flat_map(|text| text.bytes().chain([0])).map(|b| b.to_string()).collect();
        write_line(format!(
            "<Array type=\"String\" Name=\"{name}\" NumberOfTuples=\"{}\" format=\"ascii\">{}</Array>",
            texts.len(),
            codes.join(" ")
        ));
    }
    text + "</FieldData>\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Scene;

    #[test]
    fn texts_are_characters_by_number() {
        let mut scene = Scene::default();
        scene.snapshot.meta.time = 2.5;
        let text = field_data(&scene.frame(), &["radius", "material", "id"]);
        assert!(text.contains("Name=\"TimeValue\" NumberOfTuples=\"1\" format=\"ascii\">2.5<"), "{text}");
        // ROCKx, and "radius (m)".
        assert!(
            text.contains("Name=\"material names\" NumberOfTuples=\"1\" format=\"ascii\">82 79 67 75 120 0<"),
            "{text}"
        );
        assert!(text.contains(">114 97 100 105 117 115 32 40 109 41 0<"), "{text}");
        assert!(!text.contains("law names"), "{text}");
    }
}
