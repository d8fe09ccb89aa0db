//! STL, text and binary.

use super::{Mesh, Number, Refusal, plural, real};

/// Bytes before the first triangle of a binary file: a header of 80, then the number of triangles.
const HEAD: usize = 84;
/// Bytes of a triangle of a binary file: normal, three corners, two unused ones.
const TRIANGLE: usize = 50;

/// Reads a file. Whether it is text or binary follows from its length and its bytes, not from the word `solid` alone,
/// with which binary files begin too.
pub fn read(bytes: &[u8]) -> Result<Mesh, Vec<Refusal>> {
    let announced = bytes.get(80..HEAD).map(|count| u32::from_le_bytes([count[0], count[1], count[2], count[3]]));
    let length = |count: u32| HEAD as u64 + TRIANGLE as u64 * u64::from(count);
    let exact = announced.is_some_and(|count| bytes.len() as u64 == length(count));
    let text = bytes.trim_ascii_start();
    let begins = |word: &str| text.get(..word.len()).is_some_and(|start| start.eq_ignore_ascii_case(word.as_bytes()));
    let printable = !bytes.iter().any(|byte| matches!(byte, 0..=8 | 14..=26 | 28..=31));
    if !exact && printable && (begins("solid") || begins("facet")) {
        return text_file(&String::from_utf8_lossy(bytes)).map_err(Into::into);
    }
    let Some(count) = announced else {
        let found = format!("{} that do not begin with 'solid'", plural(bytes.len(), "byte"));
        return Err(Refusal::new(None, found, "an STL file: text, or at least 84 bytes").into());
    };
    if !exact && printable {
        let found = "text that does not begin with 'solid'";
        return Err(Refusal::new(None, found, "an STL file, text or binary").into());
    }
    let whole = (bytes.len() - HEAD) / TRIANGLE;
    // Some programs leave the number at 0.
    let unset = count == 0 && whole > 0 && (bytes.len() - HEAD).is_multiple_of(TRIANGLE);
    let count = if unset { whole } else { count as usize };
    if whole < count {
        // Text with a stray control character, such as the end mark of DOS.
        if begins("solid")
            && let Ok(mesh) = text_file(&String::from_utf8_lossy(bytes).replace(['\0', '\u{1a}'], " "))
        {
            return Ok(mesh);
        }
        let found = format!("{} triangles announced, {whole} there: {} bytes", count, bytes.len());
        return Err(Refusal::new(None, found, "an STL file, text or binary, that is complete").into());
    }
    if count == 0 {
        return Err(Refusal::new(None, "no triangles", "a closed surface").into());
    }
    let mut mesh = Mesh::default();
    for triangle in bytes[HEAD..HEAD + TRIANGLE * count].chunks_exact(TRIANGLE) {
        let numbers = Number::Float.all(&triangle[12..48], false);
        mesh.polygons.push((mesh.points.len()..).take(3).collect());
        mesh.points.extend(numbers.chunks_exact(3).map(|p| [p[0], p[1], p[2]]));
    }
    if unset {
        mesh.notes.push(format!("read {} where 0 are announced", plural(count, "triangle")));
    } else {
        mesh.note("ignored", bytes.len() - HEAD - TRIANGLE * count, "byte", " after the last triangle");
    }
    Ok(mesh)
}

/// A word of a text file, in small letters, and its line.
type Word = (usize, String);

fn text_file(text: &str) -> Result<Mesh, Refusal> {
    let mut words = Words { lines: text.split('\n').enumerate(), current: Vec::new().into_iter(), line: 0 };
    let mut mesh = Mesh::default();
    let (mut solids, mut wrong_normals) = (0, 0);
    while let Some((line, word)) = words.next() {
        match word.as_str() {
            // A name follows, of any words.
            "solid" => {
                solids += 1;
                words.skip_line();
            }
            "endsolid" | "end" => words.skip_line(),
            "facet" => wrong_normals += usize::from(!facet(&mut words, line, &mut mesh)?),
            _ => return Err(Refusal::new(line, format!("the word '{word}'"), "facet, endsolid or solid")),
        }
    }
    if mesh.polygons.is_empty() {
        return Err(Refusal::new(None, "no facets", "an STL file, text or binary, of a closed surface"));
    }
    if solids > 1 {
        mesh.notes.push(format!("read {solids} solids as one surface"));
    }
    mesh.note("ignored", wrong_normals, "normal", " without numbers");
    Ok(mesh)
}

/// Reads what follows `facet`; returns whether the normal consists of numbers.
fn facet(words: &mut Words, line: usize, mesh: &mut Mesh) -> Result<bool, Refusal> {
    let number = mesh.polygons.len() + 1;
    let ends = || Refusal::new(None, format!("the end of the file within facet {number}"), "a complete file");
    let mut word = words.next().ok_or_else(ends)?;
    let mut normal = true;
    if word.1 == "normal" {
        // The normal follows from the corners.
        loop {
            word = words.next().ok_or_else(ends)?;
            if word.1 == "outer" {
                break;
            }
            normal &= real(&word.1).is_some_and(f64::is_finite);
            if word.0 > line + 1 {
                break;
            }
        }
    }
    for expected in ["outer", "loop"] {
        if word.1 != expected {
            return Err(Refusal::new(word.0, format!("the word '{}'", word.1), "outer loop"));
        }
        word = words.next().ok_or_else(ends)?;
    }
    let mut corners = Vec::new();
    while word.1 == "vertex" {
        let mut point = [0.0; 3];
        for x in &mut point {
            let (line, word) = words.next().ok_or_else(ends)?;
            let wrong = || Refusal::new(line, format!("'{word}', which is no number"), "vertex and three coordinates");
            *x = real(&word).ok_or_else(wrong)?;
        }
        corners.push(mesh.points.len());
        mesh.points.push(point);
        word = words.next().ok_or_else(ends)?;
    }
    if word.1 != "endloop" {
        return Err(Refusal::new(word.0, format!("the word '{}'", word.1), "vertex and three coordinates, or endloop"));
    }
    if corners.len() < 3 {
        let found = format!("facet {number} of {}", plural(corners.len(), "vertex"));
        return Err(Refusal::new(word.0, found, "three"));
    }
    let (line, word) = words.next().ok_or_else(ends)?;
    if word != "endfacet" {
        return Err(Refusal::new(line, format!("the word '{word}'"), "endfacet"));
    }
    mesh.polygons.push(corners);
    Ok(normal)
}

/// The words of a text, one after the other.
struct Words<'a> {
    lines: std::iter::Enumerate<std::str::Split<'a, char>>,
    current: std::vec::IntoIter<&'a str>,
    line: usize,
}

impl Words<'_> {
    fn next(&mut self) -> Option<Word> {
        loop {
            if let Some(word) = self.current.next() {
                return Some((self.line, word.to_ascii_lowercase()));
            }
            let (number, line) = self.lines.next()?;
            self.line = number + 1;
            self.current = line.split_whitespace().collect::<Vec<_>>().into_iter();
        }
    }

    fn skip_line(&mut self) {
        self.current = Vec::new().into_iter();
    }
}
