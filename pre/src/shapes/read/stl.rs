//! Reader of STL files, text and binary.

use cd_formats::names::count_text;

use super::vtk::NumberType;
use cd_formats::mesh::{PolygonMesh, ReadError, coordinate, lines, parse_real};

/// Bytes before the first triangle of a binary file: a header of 80, then the number of triangles.
const HEADER_BYTES: usize = 84;
/// Bytes of a triangle of a binary file: normal, three corners, two unused ones.
const TRIANGLE_BYTES: usize = 50;

/// Reads a file. Its length and its bytes decide between text and binary. The word `solid` alone does not: some binary
/// files begin with it. Errors: bytes of neither kind, a file that is cut off, or the faults of its text.
pub fn read(bytes: &[u8]) -> Result<PolygonMesh, Vec<ReadError>> {
    let announced_count =
        bytes.get(80..HEADER_BYTES).map(|count| u32::from_le_bytes([count[0], count[1], count[2], count[3]]));
    let length = |count: u32| HEADER_BYTES as u64 + TRIANGLE_BYTES as u64 * u64::from(count);
    let fits_length = announced_count.is_some_and(|count| bytes.len() as u64 == length(count));
    let text = &bytes[bytes.iter().take_while(|&&byte| byte <= b' ').count()..];
    let begins_with =
        |word: &str| text.get(..word.len()).is_some_and(|start| start.eq_ignore_ascii_case(word.as_bytes()));
    if is_utf_16(bytes) {
        return Err(ReadError::new(None, "text in UTF-16, not UTF-8 or ASCII", "an STL file, text or binary").into());
    }
    // Without control characters, except white space and escape.
    let is_printable = !bytes.iter().any(|byte| matches!(byte, 0..=8 | 14..=26 | 28..=31));
    if !fits_length && is_printable && (begins_with("solid") || begins_with("facet")) {
        return read_text(&String::from_utf8_lossy(bytes)).map_err(Into::into);
    }
    let Some(count) = announced_count else {
        let found = format!("{} that do not begin with 'solid'", count_text(bytes.len(), "byte"));
        return Err(ReadError::new(None, found, "an STL file: text, or at least 84 bytes").into());
    };
    if !fits_length && is_printable {
        let found = "text that does not begin with 'solid'";
        return Err(ReadError::new(None, found, "an STL file, text or binary").into());
    }
    if !fits_length && let Some(mesh) = read_after_extra_bytes(bytes) {
        return Ok(mesh);
    }
    let big_endian = !fits_length && length(count.swap_bytes()) == bytes.len() as u64;
    let count = if big_endian { count.swap_bytes() } else { count };
    let data_bytes = bytes.len() - HEADER_BYTES;
    let (complete_count, ends_with_triangle) = (data_bytes / TRIANGLE_BYTES, data_bytes.is_multiple_of(TRIANGLE_BYTES));
    // Some programs leave the number at 0.
    let is_count_unset = count == 0 && complete_count > 0 && ends_with_triangle;
    let count = if is_count_unset { complete_count } else { count as usize };
    if complete_count < count {
        // Text with a stray control character, such as the end mark of DOS.
        if begins_with("solid")
            && let Ok(mut mesh) = read_text(&String::from_utf8_lossy(bytes).replace(['\0', '\u{1a}'], " "))
        {
            let marks = bytes.iter().filter(|byte| [0, 0x1a].contains(*byte)).count();
            mesh.note_ignored(marks, "control character", "");
            return Ok(mesh);
        }
        let found = format!("{count} triangles announced, {complete_count} found: {} bytes", bytes.len());
        return Err(ReadError::new(None, found, "an STL file, text or binary, that is complete").into());
    }
    if count > 0 && complete_count > count && ends_with_triangle {
        let found = format!("{count} triangles announced, {complete_count} found: {} bytes", bytes.len());
        return Err(ReadError::new(None, found, "an STL file with the number of its triangles").into());
    }
    if count == 0 {
        return Err(ReadError::new(None, "no triangles", "a closed surface").into());
    }
    let (triangles, rest) = bytes[HEADER_BYTES..].split_at(TRIANGLE_BYTES * count);
    let mut mesh = read_triangles(triangles, big_endian);
    if is_count_unset {
        mesh.notes.push(format!("read {} where 0 are announced", count_text(count, "triangle")));
    } else {
        mesh.note_ignored(rest.len(), "byte", " after the last triangle");
    }
    Ok(mesh)
}

/// Reads the triangles of a binary file, with notes on the order of the bytes and on normals.
fn read_triangles(bytes: &[u8], big_endian: bool) -> PolygonMesh {
    let mut mesh = PolygonMesh::default();
    let mut wrong_normals = 0;
    for triangle in bytes.chunks_exact(TRIANGLE_BYTES) {
        let normal = NumberType::Float.decode_all(&triangle[..12], big_endian);
        wrong_normals += usize::from(!normal.iter().all(|x| x.is_finite()));
        let numbers = NumberType::Float.decode_all(&triangle[12..48], big_endian);
        mesh.polygons.push((mesh.points.len()..).take(3).collect());
        mesh.points.extend(numbers.chunks_exact(3).map(|p| [p[0], p[1], p[2]]));
    }
    if big_endian {
        mesh.notes.push("read as big-endian, which STL files should not be".into());
    }
    mesh.note_ignored(wrong_normals, "normal", " without numbers");
    mesh
}

/// Whether bytes are text in UTF-16 that begins as STL does, with or without a byte order mark.
fn is_utf_16(bytes: &[u8]) -> bool {
    let text = bytes.strip_prefix(b"\xff\xfe").or(bytes.strip_prefix(b"\xfe\xff")).unwrap_or(bytes);
    let alternate_bytes = |first: usize| -> Vec<u8> { text.iter().skip(first).step_by(2).take(5).copied().collect() };
    // One byte of each letter is that of ASCII, the other is 0.
    [0, 1].iter().any(|&first| {
        let word = alternate_bytes(first).to_ascii_lowercase();
        (word == b"solid" || word == b"facet") && alternate_bytes(1 - first).iter().all(|byte| *byte == 0)
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
    mesh.note_ignored(extra, "byte", " before the header");
    Some(mesh)
}

/// Word of a text file.
struct Word {
    /// Number of its line, from 1.
    line: usize,
    /// The word in lower case.
    text: String,
}

/// Reads a text file.
fn read_text(text: &str) -> Result<PolygonMesh, ReadError> {
    let text = lines(text);
    let mut words = StlWords { lines: text.split('\n').enumerate(), current: Vec::new().into_iter(), line: 0 };
    let mut mesh = PolygonMesh::default();
    let (mut solids, mut wrong_normals) = (0, 0);
    while let Some(Word { line, text }) = words.next_word() {
        match text.as_str() {
            // A name of any number of words follows.
            "solid" => {
                solids += 1;
                words.skip_line();
            }
            "endsolid" | "end" => words.skip_line(),
            "facet" => wrong_normals += usize::from(!read_facet(&mut words, line, &mut mesh)?),
            _ => return Err(ReadError::new(line, format!("the word '{text}'"), "facet, endsolid or solid")),
        }
    }
    if mesh.polygons.is_empty() {
        return Err(ReadError::new(None, "no facets", "an STL file, text or binary, of a closed surface"));
    }
    if solids > 1 {
        mesh.notes.push(format!("read {solids} solids as one surface"));
    }
    mesh.note_ignored(wrong_normals, "normal", " without numbers");
    Ok(mesh)
}

/// Reads a facet after the word `facet` on `line`; returns whether the normal, if there is one, consists of three numbers.
fn read_facet(words: &mut StlWords, line: usize, mesh: &mut PolygonMesh) -> Result<bool, ReadError> {
    let number = mesh.polygons.len() + 1;
    let end_error = || ReadError::new(None, format!("the end of the file within facet {number}"), "a complete file");
    let mut word = words.next_word().ok_or_else(end_error)?;
    let mut is_normal_sound = true;
    if word.text == "normal" {
        // The stored normal is not used: it follows from the corners.
        let mut count = 0;
        loop {
            word = words.next_word().ok_or_else(end_error)?;
            if word.text == "outer" {
                break;
            }
            is_normal_sound &= parse_real(&word.text).is_some_and(f64::is_finite);
            count += 1;
            if word.line > line + 1 {
                break;
            }
        }
        is_normal_sound &= count == 3;
    }
    for expected in ["outer", "loop"] {
        if word.text != expected {
            return Err(ReadError::new(word.line, format!("the word '{}'", word.text), "outer loop"));
        }
        word = words.next_word().ok_or_else(end_error)?;
    }
    let mut corners = Vec::new();
    while word.text == "vertex" {
        let mut point = [0.0; 3];
        for (k, x) in point.iter_mut().enumerate() {
            let number = words.next_word().ok_or_else(end_error)?;
            *x = coordinate(&number.text).map_err(|error| {
                // Too few numbers: the next word belongs to the next line.
                let is_on_next_line = number.line > word.line;
                let found = if is_on_next_line {
                    format!("a vertex of {}", count_text(k, "number"))
                } else {
                    error.to_string()
                };
                ReadError::new(number.line.min(word.line), found, "vertex and three coordinates")
            })?;
        }
        corners.push(mesh.points.len());
        mesh.points.push(point);
        word = words.next_word().ok_or_else(end_error)?;
    }
    if word.text != "endloop" {
        let expected = "vertex and three coordinates, or endloop";
        return Err(ReadError::new(word.line, format!("the word '{}'", word.text), expected));
    }
    if corners.len() < 3 {
        let found = format!("facet {number} with {}", count_text(corners.len(), "vertex"));
        return Err(ReadError::new(word.line, found, "at least three"));
    }
    let word = words.next_word().ok_or_else(end_error)?;
    if word.text != "endfacet" {
        return Err(ReadError::new(word.line, format!("the word '{}'", word.text), "endfacet"));
    }
    mesh.polygons.push(corners);
    Ok(is_normal_sound)
}

/// Reader that returns the words of a text one after the other.
struct StlWords<'a> {
    lines: std::iter::Enumerate<std::str::Split<'a, char>>,
    /// Words of the current line that were not returned yet.
    current: std::vec::IntoIter<&'a str>,
    /// Number of the current line, from 1; 0 before the first.
    line: usize,
}

impl StlWords<'_> {
    fn next_word(&mut self) -> Option<Word> {
        loop {
            if let Some(word) = self.current.next() {
                return Some(Word { line: self.line, text: word.to_ascii_lowercase() });
            }
            let (number, line) = self.lines.next()?;
            self.line = number + 1;
            self.current = line.split_whitespace().collect::<Vec<_>>().into_iter();
        }
    }

    /// Skips a name, up to the end of the line or, in a file of a single line, to the next facet.
    fn skip_line(&mut self) {
        let rest = self.current.as_slice();
        let is_facet = |words: &[&str]| {
            let is_word =
                |k: usize, word: &str| words.get(k).is_some_and(|known: &&str| known.eq_ignore_ascii_case(word));
            let numbers = words.get(2..5).is_some_and(|normal| normal.iter().all(|word| parse_real(word).is_some()));
            is_word(0, "facet") && is_word(1, "normal") && numbers && is_word(5, "outer") && is_word(6, "loop")
        };
        let facet = (0..rest.len()).find(|&k| is_facet(&rest[k..]));
        self.current = facet.map_or(Vec::new(), |k| rest[k..].to_vec()).into_iter();
    }
}
