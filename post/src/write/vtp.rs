//! `.vtp`: polygonal data of one time in VTK's XML format. Arrays are in base64, behind their length in bytes (64 bits).

use std::fmt::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use vtkio::model::{Attribute, DataArray, ElementType, IOBuffer, PolyDataPiece, VertexNumbers};

/// Text of a file of polygonal data; `fields` are elements before the piece, such as field data.
pub fn vtp_text(piece: &PolyDataPiece, fields: &str) -> String {
    let cells = [("Verts", &piece.verts), ("Lines", &piece.lines), ("Strips", &piece.strips), ("Polys", &piece.polys)];
    let cells = cells.map(|(name, cells)| (name, cells.clone().map(VertexNumbers::into_xml)));
    let mut text = String::from(
        "<VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\"><PolyData>",
    );
    text += fields;
    let _ = write!(text, "<Piece NumberOfPoints=\"{}\"", piece.points.len() / 3);
    for (name, cells) in &cells {
        if let Some((_, ends)) = cells.as_ref().filter(|(_, ends)| !ends.is_empty()) {
            let _ = write!(text, " NumberOf{name}=\"{}\"", ends.len());
        }
    }
    text += ">";
    put_attributes(&mut text, "PointData", &piece.data.point);
    put_attributes(&mut text, "CellData", &piece.data.cell);
    text += "<Points>";
    put_array(&mut text, "Points", 3, &piece.points);
    text += "</Points>";
    for (name, cells) in cells {
        if let Some((connectivity, ends)) = cells {
            let _ = write!(text, "<{name}>");
            put_array(&mut text, "connectivity", 1, &IOBuffer::U64(connectivity));
            put_array(&mut text, "offsets", 1, &IOBuffer::U64(ends));
            let _ = write!(text, "</{name}>");
        }
    }
    text + "</Piece></PolyData></VTKFile>"
}

/// Puts the arrays of points or of cells; the first scalars, vectors and tensors are those that ParaView shows at first.
fn put_attributes(text: &mut String, element: &str, attributes: &[Attribute]) {
    let arrays: Vec<&DataArray> = attributes
        .iter()
        .filter_map(|attribute| match attribute {
            Attribute::DataArray(array) => Some(array),
            Attribute::Field { .. } => None,
        })
        .collect();
    if arrays.is_empty() {
        return;
    }
    let _ = write!(text, "<{element}");
    for kind in ["Scalars", "Vectors", "Tensors"] {
        if let Some(array) = arrays.iter().find(|array| kind_name(&array.elem) == kind) {
            let _ = write!(text, " {kind}=\"{}\"", array.name);
        }
    }
    text.push('>');
    arrays.iter().for_each(|array| put_array(text, &array.name, array.num_comp(), &array.data));
    let _ = write!(text, "</{element}>");
}

/// Attribute of a piece that names the first array of this kind; empty for kinds that have none here.
fn kind_name(kind: &ElementType) -> &'static str {
    match kind {
        ElementType::Scalars { .. } => "Scalars",
        ElementType::Vectors => "Vectors",
        ElementType::Tensors => "Tensors",
        _ => "",
    }
}

/// Puts an array of rows of `components` numbers.
fn put_array(text: &mut String, name: &str, components: usize, data: &IOBuffer) {
    let (kind, values) = typed_bytes(data);
    let bytes = [&(values.len() as u64).to_le_bytes()[..], values].concat();
    let _ = write!(text, "<DataArray type=\"{kind}\" Name=\"{name}\"");
    if components != 1 {
        let _ = write!(text, " NumberOfComponents=\"{components}\"");
    }
    text.push_str(" format=\"binary\">");
    STANDARD.encode_string(bytes, text);
    text.push_str("</DataArray>");
}

/// Name of the type of numbers and their bytes, which are little-endian on all machines that this program is built for.
pub fn typed_bytes(data: &IOBuffer) -> (&'static str, &[u8]) {
    match data {
        IOBuffer::Bit(values) | IOBuffer::U8(values) => ("UInt8", values),
        IOBuffer::I8(values) => ("Int8", bytemuck::cast_slice(values)),
        IOBuffer::U16(values) => ("UInt16", bytemuck::cast_slice(values)),
        IOBuffer::I16(values) => ("Int16", bytemuck::cast_slice(values)),
        IOBuffer::U32(values) => ("UInt32", bytemuck::cast_slice(values)),
        IOBuffer::I32(values) => ("Int32", bytemuck::cast_slice(values)),
        IOBuffer::U64(values) => ("UInt64", bytemuck::cast_slice(values)),
        IOBuffer::I64(values) => ("Int64", bytemuck::cast_slice(values)),
        IOBuffer::F32(values) => ("Float32", bytemuck::cast_slice(values)),
        IOBuffer::F64(values) => ("Float64", bytemuck::cast_slice(values)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vtkio::model::Attributes;

    /// Three bytes are one group of base64: 8 bytes of length and one of value are `AQAAAAAAAAAH`.
    #[test]
    fn arrays_are_written_behind_their_length() {
        let piece = PolyDataPiece {
            points: IOBuffer::F64(Vec::new()),
            lines: Some(VertexNumbers::XML { connectivity: vec![], offsets: vec![] }),
            data: Attributes {
                point: vec![],
                cell: vec![Attribute::DataArray(DataArray::scalars("a", 1).with_data(IOBuffer::U8(vec![7])))],
            },
            ..PolyDataPiece::default()
        };
        let expected = "<Piece NumberOfPoints=\"0\"><CellData Scalars=\"a\">\
             <DataArray type=\"UInt8\" Name=\"a\" format=\"binary\">AQAAAAAAAAAH</DataArray></CellData>\
             <Points><DataArray type=\"Float64\" Name=\"Points\" NumberOfComponents=\"3\" format=\"binary\">AAAAAAAAAAA=\
             </DataArray></Points><Lines>\
             <DataArray type=\"UInt64\" Name=\"connectivity\" format=\"binary\">AAAAAAAAAAA=</DataArray>\
             <DataArray type=\"UInt64\" Name=\"offsets\" format=\"binary\">AAAAAAAAAAA=</DataArray></Lines></Piece>";
        let text = vtp_text(&piece, "<FieldData/>");
        assert!(text.contains(&format!("<PolyData><FieldData/>{expected}</PolyData>")), "{text}");
    }
}
