//! Reader of STL files, text and binary.

use cd_formats::names::count_text;

use super::vtk::NumberType;
use cd_formats::mesh::{PolygonMesh, ReadError, coordinate, lines, parse_real};

/// Bytes before the first triangle of a binary file: a header of 80, then the number of triangles.
const HEADER_BYTES: usize = 84;
/// Bytes of a triangle of a binary file: normal, three corners, two unused ones.
const TRIANGLE_BYTES: usize = 50;

/// Reads a file. Its length and its bytes decide between text and binary. The word `solid` alone does not: some binary
/// files begin with it.
pub fn read(bytes: &[u8]) -> Result<PolygonMesh, Vec<ReadError>> {
    let declared_count =
        bytes.get(80..HEADER_BYTES).map(|count| u32::from_le_bytes([count[0], count[1], count[2], count[3]]));
    let length = |count: u32| HEADER_BYTES as u64 + TRIANGLE_BYTES as u64 * u64::from(count);
    let exact = declared_count.is_some_and(|count| bytes.len() as u64 == length(count));
    let text = &bytes[bytes.iter().take_while(|&&byte| byte <= b' ').count()..];
    let begins = |word: &str| text.get(..word.len()).is_some_and(|start| start.eq_ignore_ascii_case(word.as_bytes()));
    if is_utf_16(bytes) {
        return Err(ReadError::new(None, "text in UTF-16, not UTF-8 or ASCII", "an STL file, text or binary").into());
    }
    let printable = !bytes.iter().any(|byte| matches!(byte, 0..=8 | 14..=26 | 28..=31));
    if !exact && printable && (begins("solid") || begins("facet")) {
        return read_text(&String::from_utf8_lossy(bytes)).map_err(Into::into);
    }
    let Some(count) = declared_count else {
        let found = format!("{} that do not begin with 'solid'", count_text(bytes.len(), "byte"));
        return Err(ReadError::new(None, found, "an STL file: text, or at least 84 bytes").into());
    };
    if !exact && printable {
        let found = "text that does not begin with 'solid'";
        return Err(ReadError::new(None, found, "an STL file, text or binary").into());
    }
    if !exact && let Some(mesh) = read_after_extra_bytes(bytes) {
        return Ok(mesh);
    }
    let big_endian = !exact && length(count.swap_bytes()) == bytes.len() as u64;
    let count = if big_endian { count.swap_bytes() } else { count };
    let complete = (bytes.len() - HEADER_BYTES) / TRIANGLE_BYTES;
    // Some programs leave the number at 0.
    let unset = count == 0 && complete > 0 && (bytes.len() - HEADER_BYTES).is_multiple_of(TRIANGLE_BYTES);
    let count = if unset { complete } else { count as usize };
    if complete < count {
        // Text with a stray control character, such as the end mark of DOS.
        if begins("solid")
            && let Ok(mut mesh) = read_text(&String::from_utf8_lossy(bytes).replace(['\0', '\u{1a}'], " "))
        {
            let marks = bytes.iter().filter(|byte| [0, 0x1a].contains(*byte)).count();
            mesh.add_note("ignored", marks, "control character", "");
            return Ok(mesh);
        }
        let found = format!("{} triangles announced, {complete} found: {} bytes", count, bytes.len());
        return Err(ReadError::new(None, found, "an STL file, text or binary, that is complete").into());
    }
    if count > 0 && complete > count && (bytes.len() - HEADER_BYTES).is_multiple_of(TRIANGLE_BYTES) {
        let found = format!("{count} triangles announced, {complete} found: {} bytes", bytes.len());
        return Err(ReadError::new(None, found, "an STL file with the number of its triangles").into());
    }
    if count == 0 {
        return Err(ReadError::new(None, "no triangles", "a closed surface").into());
    }
    let mut mesh = PolygonMesh::default();
    let mut wrong_normals = 0;
    for triangle in bytes[HEADER_BYTES..HEADER_BYTES + TRIANGLE_BYTES * count].chunks_exact(TRIANGLE_BYTES) {
        let normal = NumberType::Float.decode_all(&triangle[..12], big_endian);
        wrong_normals += usize::from(!normal.iter().all(|x| x.is_finite()));
        let numbers = NumberType::Float.decode_all(&triangle[12..48], big_endian);
        mesh.polygons.push((mesh.points.len()..).take(3).collect());
        mesh.points.extend(numbers.chunks_exact(3).map(|p| [p[0], p[1], p[2]]));
    }
    if big_endian {
        mesh.notes.push("read as big-endian, which STL files should not be".into());
    }
    mesh.add_note("ignored", wrong_normals, "normal", " without numbers");
    if unset {
        mesh.notes.push(format!("read {} where 0 are announced", count_text(count, "triangle")));
    } else {
        mesh.add_note(
            "ignored",
            bytes.len() - HEADER_BYTES - TRIANGLE_BYTES * count,
            "byte",
            " after the last triangle",
        );
    }
    Ok(mesh)
}

/// Whether bytes are text in UTF-16 that begins as STL does, with or without a byte order mark.
fn is_utf_16(bytes: &[u8]) -> bool {
    let text = bytes.strip_prefix(b"\xff\xfe").or(bytes.strip_prefix(b"\xfe\xff")).unwrap_or(bytes);
    let letters = |first: usize| -> Vec<u8> { text.iter().skip(first).step_by(2).take(5).copied().collect() };
    [0, 1].iter().any(|&first| {
        let word = letters(first).to_ascii_lowercase();
        (word == b"solid" || word == b"facet") && letters(1 - first).iter().all(|byte| *byte == 0)
    })
}

/// Reads a binary file after a few extra bytes, such as a line end, if the remaining length then fits the number of
/// triangles.
fn read_after_extra_bytes(bytes: &[u8]) -> Option<PolygonMesh> {
    const MAX_EXTRA_BYTES: usize = 8;
    let fits = |extra: &usize| {
        let count = bytes.get(extra + 80..extra + HEADER_BYTES).and_then(|count| count.try_into().ok());
        count
            .map(u32::from_le_bytes)
            .is_some_and(|count| count > 0 && bytes.len() - extra == HEADER_BYTES + TRIANGLE_BYTES * count as usize)
    };
    let extra = (1..=MAX_EXTRA_BYTES).find(fits)?;
    let mut mesh = read(&bytes[extra..]).ok()?;
    mesh.add_note("ignored", extra, "byte", " before the header");
    Some(mesh)
}

/// Word of a text file in lower case, and its line.
type Word = (usize, String);

fn read_text(text: &str) -> Result<PolygonMesh, ReadError> {
    let text = lines(text);
    let mut words = WordReader { lines: text.split('\n').enumerate(), current: Vec::new().into_iter(), line: 0 };
    let mut mesh = PolygonMesh::default();
    let (mut solids, mut wrong_normals) = (0, 0);
    while let Some((line, word)) = words.next_word() {
        match word.as_str() {
            // A name of any number of words follows.
            "solid" => {
                solids += 1;
                words.skip_line();
            }
            "endsolid" | "end" => words.skip_line(),
            "facet" => wrong_normals += usize::from(!read_facet(&mut words, line, &mut mesh)?),
            _ => return Err(ReadError::new(line, format!("the word '{word}'"), "facet, endsolid or solid")),
        }
    }
    if mesh.polygons.is_empty() {
        return Err(ReadError::new(None, "no facets", "an STL file, text or binary, of a closed surface"));
    }
    if solids > 1 {
        mesh.notes.push(format!("read {solids} solids as one surface"));
    }
    mesh.add_note("ignored", wrong_normals, "normal", " without numbers");
    Ok(mesh)
}

/// Reads a facet after the word `facet`; returns whether the normal consists of numbers.
fn read_facet(words: &mut WordReader, line: usize, mesh: &mut PolygonMesh) -> Result<bool, ReadError> {
    let number = mesh.polygons.len() + 1;
    let ends = || ReadError::new(None, format!("the end of the file within facet {number}"), "a complete file");
    let mut word = words.next_word().ok_or_else(ends)?;
    let mut normal = true;
    if word.1 == "normal" {
        // The stored normal is not used: it follows from the corners.
        let mut count = 0;
        loop {
            word = words.next_word().ok_or_else(ends)?;
            if word.1 == "outer" {
                break;
            }
            normal &= parse_real(&word.1).is_some_and(f64::is_finite);
            count += 1;
            if word.0 > line + 1 {
                break;
            }
        }
        normal &= count == 3;
    }
    for expected in ["outer", "loop"] {
        if word.1 != expected {
            return Err(ReadError::new(word.0, format!("the word '{}'", word.1), "outer loop"));
        }
        word = words.next_word().ok_or_else(ends)?;
    }
    let mut corners = Vec::new();
    while word.1 == "vertex" {
        let mut point = [0.0; 3];
        let vertex_line = word.0;
        for (k, x) in point.iter_mut().enumerate() {
            let (line, word) = words.next_word().ok_or_else(ends)?;
            *x = coordinate(&word).map_err(|error| {
                // The next word may be that of the next line.
                let (line, found) = match line {
                    line if line > vertex_line => (vertex_line, format!("a vertex of {}", count_text(k, "number"))),
                    line => (line, error.to_string()),
                };
                ReadError::new(line, found, "vertex and three coordinates")
            })?;
        }
        corners.push(mesh.points.len());
        mesh.points.push(point);
        word = words.next_word().ok_or_else(ends)?;
    }
    if word.1 != "endloop" {
        return Err(ReadError::new(
            word.0,
            format!("the word '{}'", word.1),
            "vertex and three coordinates, or endloop",
        ));
    }
    if corners.len() < 3 {
        let found = format!("facet {number} with {}", count_text(corners.len(), "vertex"));
        return Err(ReadError::new(word.0, found, "at least three"));
    }
    let (line, word) = words.next_word().ok_or_else(ends)?;
    if word != "endfacet" {
        return Err(ReadError::new(line, format!("the word '{word}'"), "endfacet"));
    }
    mesh.polygons.push(corners);
    Ok(normal)
}

/// Reader that returns the words of a text one after the other.
struct WordReader<'a> {
    lines: std::iter::Enumerate<std::str::Split<'a, char>>,
    current: std::vec::IntoIter<&'a str>,
    line: usize,
}

impl WordReader<'_> {
    fn next_word(&mut self) -> Option<Word> {
        loop {
            if let Some(word) = self.current.next() {
                return Some((self.line, word.to_ascii_lowercase()));
            }
            let (number, line) = self.lines.next()?;
            self.line = number + 1;
            self.current = line.split_whitespace().collect::<Vec<_>>().into_iter();
        }
    }

    /// Skips a name, up to the end of the line or, in a file of a single line, to the next facet.
    fn skip_line(&mut self) {
        let rest = self.current.as_slice();
        let begins = |words: &[&str]| {
            let is = |k: usize, word: &str| words.get(k).is_some_and(|known: &&str| known.eq_ignore_ascii_case(word));
            let numbers = words.get(2..5).is_some_and(|normal| normal.iter().all(|word| parse_real(word).is_some()));
            is(0, "facet") && is(1, "normal") && numbers && is(5, "outer") && is(6, "loop")
        };
        let facet = (0..rest.len()).find(|&k| begins(&rest[k..]));
        self.current = facet.map_or(Vec::new(), |k| rest[k..].to_vec()).into_iter();
    }
}
