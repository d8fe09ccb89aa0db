//! Reader of VTK XML polygonal data: arrays as text, binary in place, or appended, plain or in zlib blocks.

use miniz_oxide::inflate::decompress_to_vec_zlib_with_limit;

use super::vtk::{CellLists, NumberType, PolyDataPiece};
use cd_formats::mesh::{PolygonMesh, ReadError, coordinate};

const FILE_KIND: &str = "polygonal data of VTK, legacy or XML";
const COMPLETE_FILE: &str = "a complete file";

/// Reads a file. Errors: XML that is not PolyData or not complete, arrays that do not fit their numbers, no polygons.
pub fn read(bytes: &[u8]) -> Result<PolygonMesh, ReadError> {
    let mut file = VtpFile::from_bytes(bytes)?;
    let mut mesh = PolygonMesh::default();
    for piece in file.read_pieces()? {
        piece.add_to(&mut mesh).map_err(|error| ReadError::new(None, error.to_string(), FILE_KIND))?;
    }
    if mesh.polygons.is_empty() {
        return Err(ReadError::new(None, "no polygons", "Polys or Strips"));
    }
    Ok(mesh)
}

/// Tag with the text up to the next one.
struct XmlTag {
    line: usize,
    name: String,
    attributes: Vec<(String, String)>,
    kind: TagKind,
    content: String,
}

/// Kind of a tag: `<name>`, `</name>` or `<name/>`.
#[derive(PartialEq)]
enum TagKind {
    Start,
    End,
    Empty,
}

impl XmlTag {
    fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }

    /// Number in an attribute, if present.
    fn number_attribute(&self, name: &str) -> Result<Option<usize>, ReadError> {
        let number = |value: &str| {
            value.trim().parse().map_err(|_| ReadError::new(self.line, format!("{name}=\"{value}\""), "a number"))
        };
        self.attribute(name).map(number).transpose()
    }
}

/// Tags, data and conventions of a file.
struct VtpFile<'a> {
    /// All tags up to the appended data.
    tags: Vec<XmlTag>,
    /// Bytes after the `_` of the appended data.
    appended: &'a [u8],
    /// Whether the appended data are in base64.
    is_base64: bool,
    big_endian: bool,
    /// Number of bytes of a number in the header of a binary array.
    header_number_size: usize,
    compressed: bool,
}

impl<'a> VtpFile<'a> {
    fn from_bytes(bytes: &'a [u8]) -> Result<Self, ReadError> {
        // Raw appended data are not XML.
        let appended = find_word(bytes, b"<AppendedData").unwrap_or(bytes.len());
        let mut tags = parse_tags(&String::from_utf8_lossy(&bytes[..appended]))?;
        let mut file = VtpFile {
            tags: Vec::new(),
            appended: &[],
            is_base64: false,
            big_endian: false,
            header_number_size: 4,
            compressed: false,
        };
        if appended < bytes.len() {
            let end = find_word(&bytes[appended..], b">").map(|end| appended + end + 1);
            let begin = end.and_then(|end| Some(end + find_word(&bytes[end..], b"_")? + 1));
            let (Some(end), Some(begin)) = (end, begin) else {
                return Err(ReadError::new(None, "AppendedData without '_'", COMPLETE_FILE));
            };
            let tags = self::parse_tags(&String::from_utf8_lossy(&bytes[appended..end]))?;
            file.is_base64 = tags.iter().any(|tag| tag.attribute("encoding") == Some("base64"));
            file.appended = &bytes[begin..];
        }
        tags.retain(|tag| tag.name != "?");
        let Some(first) = tags.first().filter(|tag| tag.name == "VTKFile") else {
            return Err(ReadError::new(None, "no tag VTKFile", FILE_KIND));
        };
        let kind = first.attribute("type").unwrap_or_default();
        if kind != "PolyData" {
            let expected = "PolyData; in ParaView: Extract Surface";
            return Err(ReadError::new(first.line, format!("VTKFile of the type '{kind}'"), expected));
        }
        let attribute_error = |name: &str, value: &str, expected: &'static str| {
            Err(ReadError::new(first.line, format!("{name}=\"{value}\""), expected))
        };
        file.big_endian = match first.attribute("byte_order") {
            None | Some("LittleEndian") => false,
            Some("BigEndian") => true,
            Some(other) => return attribute_error("byte_order", other, "LittleEndian or BigEndian"),
        };
        file.header_number_size = match first.attribute("header_type") {
            None | Some("UInt32") => 4,
            Some("UInt64") => 8,
            Some(other) => return attribute_error("header_type", other, "UInt32 or UInt64"),
        };
        file.compressed = match first.attribute("compressor") {
            None | Some("") => false,
            Some("vtkZLibDataCompressor") => true,
            Some(other) => {
                let expected = "vtkZLibDataCompressor or none; in ParaView: Compressor Type";
                return Err(ReadError::new(first.line, format!("compressed by {other}"), expected));
            }
        };
        file.tags = tags;
        Ok(file)
    }

    fn read_pieces(&mut self) -> Result<Vec<PolyDataPiece>, ReadError> {
        let mut pieces: Vec<PolyDataPiece> = Vec::new();
        let mut open: Vec<&XmlTag> = Vec::new();
        for tag in &self.tags {
            let parent = open.last().map_or("", |tag| tag.name.as_str());
            if tag.kind == TagKind::End {
                if parent != tag.name {
                    return Err(ReadError::new(
                        tag.line,
                        format!("</{}> where <{parent}> is open", tag.name),
                        FILE_KIND,
                    ));
                }
                if tag.name == "Piece" {
                    expect_complete(&pieces, open[open.len() - 1])?;
                }
                open.pop();
                continue;
            }
            match (tag.name.as_str(), parent) {
                ("Piece", _) => {
                    let counts = [tag.number_attribute("NumberOfVerts")?, tag.number_attribute("NumberOfLines")?];
                    let ignored = counts.into_iter().flatten().fold(0, usize::saturating_add);
                    pieces.push(PolyDataPiece { ignored, ..PolyDataPiece::default() });
                    if tag.attribute("Source").is_some() {
                        return Err(ReadError::new(tag.line, "a piece in another file", "pieces in this one"));
                    }
                }
                ("DataArray", "Points" | "Polys" | "Strips") => {
                    let Some(piece) = pieces.last_mut() else {
                        return Err(ReadError::new(tag.line, "an array outside of a Piece", FILE_KIND));
                    };
                    let list: Option<&mut Vec<f64>> = match (parent, tag.attribute("Name")) {
                        ("Points", _) => Some(&mut piece.coordinates),
                        ("Polys", Some("connectivity")) => Some(&mut piece.polygons.corners),
                        ("Polys", Some("offsets")) => Some(&mut piece.polygons.ends),
                        ("Strips", Some("connectivity")) => Some(&mut piece.strips.corners),
                        ("Strips", Some("offsets")) => Some(&mut piece.strips.ends),
                        _ => None,
                    };
                    if let Some(list) = list {
                        let components = tag.number_attribute("NumberOfComponents")?;
                        let expected = if parent == "Points" { 3 } else { 1 };
                        if let Some(other) = components.filter(|components| *components != expected) {
                            let found = format!("NumberOfComponents=\"{other}\" of {parent}");
                            return Err(ReadError::new(tag.line, found, format!("{expected}")));
                        }
                        *list = self.read_array(tag)?;
                    }
                }
                _ => {}
            }
            if tag.kind == TagKind::Start {
                open.push(tag);
            }
        }
        let last = open.last().map_or("", |tag| tag.name.as_str());
        if !(last.is_empty() || last == "VTKFile" && !self.appended.is_empty()) {
            return Err(ReadError::new(None, format!("the end of the file within <{last}>"), COMPLETE_FILE));
        }
        Ok(pieces)
    }

    fn read_array(&self, tag: &XmlTag) -> Result<Vec<f64>, ReadError> {
        let tag_error = |found: String, expected: &'static str| ReadError::new(tag.line, found, expected);
        let kind = tag.attribute("type").unwrap_or_default();
        let number = NumberType::from_name(kind)
            .ok_or_else(|| tag_error(format!("numbers of the type '{kind}'"), "Float64, Int64 or alike"))?;
        let bytes = match tag.attribute("format").unwrap_or("ascii") {
            "ascii" => {
                let number = |word| coordinate(word).map_err(|error| tag_error(error.to_string(), FILE_KIND));
                return tag.content.split_whitespace().map(number).collect();
            }
            "binary" => {
                let is_stray = |c: &char| !(c.is_ascii_alphanumeric() || "+/=".contains(*c) || c.is_ascii_whitespace());
                if let Some(stray) = tag.content.chars().find(is_stray) {
                    let name = tag.attribute("Name").unwrap_or("Points");
                    return Err(tag_error(format!("array '{name}': the character '{stray}'"), "numbers in base64"));
                }
                self.decode_binary(&decode_base64(tag.content.as_bytes()))
            }
            "appended" => {
                let offset = tag.number_attribute("offset")?.unwrap_or(0);
                let data = self.appended.get(offset..).unwrap_or_default();
                if self.is_base64 { self.decode_binary(&decode_base64(data)) } else { self.decode_binary(data) }
            }
            other => return Err(tag_error(format!("format=\"{other}\""), "ascii, binary or appended")),
        };
        let name = tag.attribute("Name").unwrap_or("Points");
        let bytes = bytes.map_err(|error| tag_error(format!("array '{name}': {error}"), COMPLETE_FILE))?;
        Ok(number.decode_all(&bytes, self.big_endian))
    }

    /// Bytes of an array, after its header: their number, or the sizes of compressed blocks.
    fn decode_binary(&self, data: &[u8]) -> Result<Vec<u8>, ArrayDataError> {
        let mut at = 0;
        let number = NumberType::Unsigned(self.header_number_size);
        let mut next_header_number = || {
            let bytes = data.get(at..at + self.header_number_size).ok_or(ArrayDataError::NoHeader)?;
            at += self.header_number_size;
            Ok::<usize, ArrayDataError>(number.decode_all(bytes, self.big_endian)[0] as usize)
        };
        if !self.compressed {
            let byte_count = next_header_number()?;
            let rest = &data[at..];
            let bytes = rest.get(..byte_count).map(<[u8]>::to_vec);
            return bytes.ok_or(ArrayDataError::ByteCount { announced: byte_count, found: rest.len() });
        }
        // Number of blocks, size of a block and, if it is not 0, of the last one before compression, then the compressed sizes.
        let block_count = next_header_number()?;
        let (block_size, last_block_size) = (next_header_number()?, next_header_number()?);
        let mut compressed_sizes = Vec::new();
        for _ in 0..block_count {
            compressed_sizes.push(next_header_number()?);
        }
        let mut bytes = Vec::new();
        for (k, compressed_size) in compressed_sizes.into_iter().enumerate() {
            let max_size = if k + 1 == block_count && last_block_size > 0 { last_block_size } else { block_size };
            let end = at.saturating_add(compressed_size);
            let block = data.get(at..end).and_then(|block| decompress_to_vec_zlib_with_limit(block, max_size).ok());
            bytes.extend(block.ok_or(ArrayDataError::ZlibBlock { block: k + 1, count: block_count })?);
            at = end;
        }
        Ok(bytes)
    }
}

/// Bytes of an array that do not agree with its header.
#[derive(Debug)]
enum ArrayDataError {
    NoHeader,
    ByteCount { announced: usize, found: usize },
    ZlibBlock { block: usize, count: usize },
}

impl std::fmt::Display for ArrayDataError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            ArrayDataError::NoHeader => f.write_str("it ends before the number of its bytes"),
            ArrayDataError::ByteCount { announced, found } => write!(f, "{announced} bytes announced, {found} found"),
            ArrayDataError::ZlibBlock { block, count } => {
                write!(f, "block {block} of {count} is not a complete zlib stream")
            }
        }
    }
}

impl std::error::Error for ArrayDataError {}

/// Checks that a piece has the numbers of points and cells that its tag announces.
fn expect_complete(pieces: &[PolyDataPiece], tag: &XmlTag) -> Result<(), ReadError> {
    let Some(piece) = pieces.last() else { return Ok(()) };
    let cell_count = |cells: &CellLists| cells.ends.strip_prefix(&[0.0]).unwrap_or(&cells.ends).len();
    let counts = [
        ("NumberOfPoints", piece.coordinates.len() / 3),
        ("NumberOfPolys", cell_count(&piece.polygons)),
        ("NumberOfStrips", cell_count(&piece.strips)),
    ];
    for (name, count) in counts {
        if let Some(announced) = tag.number_attribute(name)?.filter(|announced| *announced != count) {
            return Err(ReadError::new(tag.line, format!("{name}=\"{announced}\", and {count} found"), COMPLETE_FILE));
        }
    }
    Ok(())
}

/// Tags of a file without comments and declarations.
fn parse_tags(text: &str) -> Result<Vec<XmlTag>, ReadError> {
    let mut tags: Vec<XmlTag> = Vec::new();
    let (mut at, mut line) = (0, 1);
    while let Some(begin) = text[at..].find('<').map(|begin| at + begin) {
        if let Some(tag) = tags.last_mut() {
            tag.content += &text[at..begin];
        }
        line += text[at..begin].matches('\n').count();
        let rest = &text[begin..];
        let length = if let Some(comment) = rest.strip_prefix("<!--") {
            comment.find("-->").map(|end| end + 7)
        } else if rest.starts_with("<?") {
            rest.find("?>").map(|end| end + 2)
        } else {
            end_of_tag(rest)
        };
        let Some(length) = length else {
            return Err(ReadError::new(line, "the end of the file within a tag", COMPLETE_FILE));
        };
        let whole = &rest[..length];
        if !whole.starts_with("<!") && !whole.starts_with("<?") {
            let inner = &whole[1..length - 1];
            let (inner, kind) = match (inner.strip_prefix('/'), inner.strip_suffix('/')) {
                (Some(name), _) => (name, TagKind::End),
                (None, Some(inner)) => (inner, TagKind::Empty),
                (None, None) => (inner, TagKind::Start),
            };
            let (name, attributes) = inner.split_once(char::is_whitespace).unwrap_or((inner, ""));
            let (name, attributes) = (name.trim().to_string(), parse_attributes(attributes));
            tags.push(XmlTag { line, name, attributes, kind, content: String::new() });
        }
        line += whole.matches('\n').count();
        at = begin + length;
    }
    Ok(tags)
}

/// Length of the tag at the start of a text, up to its `>` outside of quotes.
fn end_of_tag(text: &str) -> Option<usize> {
    let mut quote = None;
    for (k, byte) in text.bytes().enumerate() {
        match (quote, byte) {
            (None, b'>') => return Some(k + 1),
            (None, b'"' | b'\'') => quote = Some(byte),
            (Some(open), _) if open == byte => quote = None,
            _ => {}
        }
    }
    None
}

fn parse_attributes(mut text: &str) -> Vec<(String, String)> {
    let mut all = Vec::new();
    while let Some((name, rest)) = text.split_once('=') {
        let rest = rest.trim_start();
        let Some(quote) = rest.chars().next().filter(|c| matches!(c, '"' | '\'')) else { break };
        let Some((value, behind)) = rest[1..].split_once(quote) else { break };
        all.push((name.trim().to_string(), value.to_string()));
        text = behind;
    }
    all
}

/// Decodes base64. The header of an array may be encoded separately, so that padding occurs inside the text.
fn decode_base64(text: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    let (mut bits, mut count) = (0u32, 0);
    for byte in text {
        let value = match byte {
            b'A'..=b'Z' => byte - b'A',
            b'a'..=b'z' => byte - b'a' + 26,
            b'0'..=b'9' => byte - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            b'=' => {
                // A group of two or three letters gives one or two bytes.
                let whole = [0, 0, 1, 2][count];
                let group = bits << (6 * (4 - count));
                bytes.extend((0..whole).map(|k| (group >> (16 - 8 * k)) as u8));
                (bits, count) = (0, 0);
                continue;
            }
            byte if byte.is_ascii_whitespace() => continue,
            _ => break,
        };
        (bits, count) = (bits << 6 | u32::from(value), count + 1);
        if count == 4 {
            bytes.extend([16, 8, 0].map(|shift| (bits >> shift) as u8));
            (bits, count) = (0, 0);
        }
    }
    bytes
}

/// Position of a word in a longer one.
fn find_word(bytes: &[u8], word: &[u8]) -> Option<usize> {
    bytes.windows(word.len()).position(|window| window == word)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn padding_within_base64() {
        assert_eq!(decode_base64(b"YWI=YWJj\nYQ=="), b"ababca");
        assert_eq!(decode_base64(b"===YW"), b"");
        assert_eq!(decode_base64(b"YWJj</x>"), b"abc");
    }

    #[test]
    fn tags_with_quotes_and_comments() {
        let tags = parse_tags("<?xml?><a x='1>2' y = \"3\"/><!-- <b> --><c>text</c>").unwrap();
        let names: Vec<&str> = tags.iter().map(|tag| tag.name.as_str()).collect();
        assert_eq!(names, ["a", "c", "c"]);
        assert_eq!((tags[0].attribute("x"), tags[0].attribute("y")), (Some("1>2"), Some("3")));
        assert_eq!(tags[1].content, "text");
    }
}
