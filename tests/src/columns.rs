//! A file of results as named columns of numbers, whatever its kind.
//!
//! The readers here are not those of the programs: a snapshot is read as the zip of npy arrays that
//! numpy takes it for, a `.vtp` file as the XML that it is.

use std::collections::BTreeMap;
use std::fs;
use std::io::{Cursor, Read};
use std::path::Path;

use serde_json::Value;

use crate::vtp;

/// Values of each column by its name: the components of vectors follow each other, an empty field is a NaN, and each byte
/// of a text is a number.
pub type Columns = BTreeMap<String, Vec<f64>>;

/// The columns of a file, by the ending of its name.
pub fn read(path: &Path) -> Result<Columns, String> {
    match path.extension().and_then(|e| e.to_str()) {
        Some("csv") => csv(path),
        Some("npz") => npz(path),
        Some("vtp") => vtp(path),
        _ => Ok([("text".to_string(), bytes(path)?.into_iter().map(f64::from).collect())].into()),
    }
}

fn bytes(path: &Path) -> Result<Vec<u8>, String> {
    fs::read(path).map_err(|error| format!("{}: {error}", path.display()))
}

/// A table whose first line names the columns.
pub fn csv(path: &Path) -> Result<Columns, String> {
    let text = String::from_utf8(bytes(path)?).map_err(|error| error.to_string())?;
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let mut columns: Columns = names.iter().map(|name| (name.to_string(), Vec::new())).collect();
    for line in lines {
        let fields: Vec<&str> = line.split(',').collect();
        if fields.len() != names.len() {
            return Err(format!("{}: a line has {} fields: {line}", path.display(), fields.len()));
        }
        for (name, field) in names.iter().zip(fields) {
            let value = if field.is_empty() { Ok(f64::NAN) } else { field.parse() };
            let value = value.map_err(|_| format!("{}: {name}: '{field}' is no number", path.display()))?;
            columns.get_mut(*name).unwrap().push(value);
        }
    }
    Ok(columns)
}

/// The arrays of a snapshot, and the values of its `meta` as `meta.step`, `meta.parameters.theta`, ...
pub fn npz(path: &Path) -> Result<Columns, String> {
    let fault = |found: String| format!("{}: {found}", path.display());
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes(path)?)).map_err(|e| fault(e.to_string()))?;
    let mut columns = Columns::new();
    for k in 0..archive.len() {
        let mut entry = archive.by_index(k).map_err(|e| fault(e.to_string()))?;
        let name = entry.name().map_err(|e| fault(e.to_string()))?.trim_end_matches(".npy").to_string();
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).map_err(|e| fault(format!("{name}: {e}")))?;
        if name == "meta" {
            let text = npy(&bytes).ok_or_else(|| fault(name.clone()))?.iter().map(|b| *b as u8).collect::<Vec<u8>>();
            let meta = serde_json::from_slice(&text).map_err(|e| fault(format!("meta: {e}")))?;
            flatten("meta", &meta, &mut columns);
        } else {
            columns.insert(name.clone(), npy(&bytes).ok_or_else(|| fault(format!("{name}: not an array of numbers")))?);
        }
    }
    Ok(columns)
}

/// The values of an npy file of version 1.0 in C order; u64 above 2^53 would lose digits, and none are.
fn npy(bytes: &[u8]) -> Option<Vec<f64>> {
    let length = u16::from_le_bytes([*bytes.get(8)?, *bytes.get(9)?]) as usize;
    let header = std::str::from_utf8(bytes.get(10..10 + length)?).ok()?;
    let data = &bytes[10 + length..];
    if bytes[..8] != *b"\x93NUMPY\x01\x00" || !header.contains("'fortran_order': False") {
        return None;
    }
    let text_after = |key: &str| header.split(key).nth(1);
    let number_type = text_after("'descr': '")?.split('\'').next()?;
    let shape = text_after("'shape': (")?.split(')').next()?;
    let dimensions = shape.split(',').map(str::trim).filter(|n| !n.is_empty());
    let count: usize = dimensions.map(|n| n.parse::<usize>().ok()).product::<Option<usize>>()?;
    macro_rules! values {
        ($type:ty) => {
            data.chunks_exact(size_of::<$type>())
                .map(|chunk| <$type>::from_le_bytes(chunk.try_into().unwrap()) as f64)
                .collect()
        };
    }
    let values: Vec<f64> = match number_type {
        "<f8" => values!(f64),
        "<u8" => values!(u64),
        "<u4" => values!(u32),
        "<u2" => values!(u16),
        "|u1" => values!(u8),
        _ => return None,
    };
    (values.len() == count).then_some(values)
}

/// Adds the numbers, truth values and texts in a JSON value as columns, each named by its path; the version of the program
/// and the options of the run are no results.
fn flatten(path: &str, value: &Value, columns: &mut Columns) {
    match value {
        Value::Null => drop(columns.insert(path.into(), vec![f64::NAN])),
        Value::Bool(truth) => drop(columns.insert(path.into(), vec![f64::from(u8::from(*truth))])),
        Value::Number(number) => columns.entry(path.into()).or_default().push(number.as_f64().unwrap_or(f64::NAN)),
        Value::String(_) if path == "meta.program" => {}
        Value::String(text) => columns.entry(path.into()).or_default().extend(text.bytes().map(f64::from)),
        Value::Array(list) => list.iter().for_each(|item| flatten(path, item, columns)),
        Value::Object(_) if path == "meta.options" => {}
        Value::Object(map) => map.iter().for_each(|(key, item)| flatten(&format!("{path}.{key}"), item, columns)),
    }
}

/// Points, cells and arrays of a ParaView file: of cells the numbers of their points.
pub fn vtp(path: &Path) -> Result<Columns, String> {
    let text = String::from_utf8(bytes(path)?).map_err(|error| format!("{}: {error}", path.display()))?;
    vtp::arrays(&text).map_err(|error| format!("{}: {error}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_of_a_table_by_name_and_empty_ones_as_nan() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        fs::write(&path, "step,x\n1,2.5\n2,\n").unwrap();
        let table = csv(&path).unwrap();
        assert_eq!(table["step"], [1.0, 2.0]);
        assert!(table["x"][0] == 2.5 && table["x"][1].is_nan());
        fs::write(&path, "step,x\n1\n").unwrap();
        assert!(csv(&path).unwrap_err().contains("has 1 fields"));
    }

    #[test]
    fn the_values_of_an_array() {
        let header = "{'descr': '<u2', 'fortran_order': False, 'shape': (1, 2, ), }\n";
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.bytes().chain([7, 0, 0, 1]));
        assert_eq!(npy(&bytes), Some(vec![7.0, 256.0]));
        assert_eq!(npy(&bytes[..bytes.len() - 2]), None);
    }
}
