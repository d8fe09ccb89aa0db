//! Reader of ParaView files as the XML that they are, for tests; that of cd-post writes them.

use std::collections::BTreeMap;

use base64::Engine;

/// Points, cells and arrays of a file by name; of cells the numbers of their points.
pub fn arrays(text: &str) -> Result<BTreeMap<String, Vec<f64>>, String> {
    let document = roxmltree::Document::parse(text).map_err(|error| error.to_string())?;
    let pieces: Vec<roxmltree::Node> = document.descendants().filter(|node| node.has_tag_name("Piece")).collect();
    let [piece] = pieces[..] else { return Err("expected one piece".into()) };
    let mut arrays = BTreeMap::new();
    for group in piece.children().filter(roxmltree::Node::is_element) {
        for array in group.children().filter(|node| node.has_tag_name("DataArray")) {
            let array_name = array.attribute("Name").unwrap_or_default();
            let name = match group.tag_name().name() {
                "PointData" | "CellData" => array_name.to_string(),
                "Points" => "points".into(),
                _ if array_name != "connectivity" => continue,
                cells => cells.to_lowercase(),
            };
            arrays.insert(name, numbers(array).ok_or_else(|| format!("array {array_name} is damaged"))?);
        }
    }
    Ok(arrays)
}

/// Numbers of an array in base64, behind their length in bytes.
fn numbers(array: roxmltree::Node) -> Option<Vec<f64>> {
    let bytes = base64::engine::general_purpose::STANDARD.decode(array.text()?.trim()).ok()?;
    let (length, values) = bytes.split_at_checked(8)?;
    (u64::from_le_bytes(length.try_into().ok()?) == values.len() as u64).then_some(())?;
    fn decode<const N: usize>(values: &[u8], number: impl Fn([u8; N]) -> f64) -> Option<Vec<f64>> {
        let (numbers, rest) = values.as_chunks::<N>();
        rest.is_empty().then(|| numbers.iter().map(|&bytes| number(bytes)).collect())
    }
    match array.attribute("type")? {
        "Float64" => decode(values, f64::from_le_bytes),
        "UInt64" => decode(values, |bytes| u64::from_le_bytes(bytes) as f64),
        "UInt32" => decode(values, |bytes| u32::from_le_bytes(bytes).into()),
        "UInt16" => decode(values, |bytes| u16::from_le_bytes(bytes).into()),
        "UInt8" => decode(values, |[byte]| byte.into()),
        _ => None,
    }
}
