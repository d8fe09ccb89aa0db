//! Reader of VTK legacy files: polygonal data, ASCII or BINARY, versions 1 to 5.

use super::vtk::{CellLists, NumberType, PolyDataPiece};
use cd_formats::mesh::{PolygonMesh, ReadError, coordinate, parse_real};

const FILE_KIND: &str = "polygonal data of VTK, legacy or XML";
/// Arrays that are read over.
const FIELD: &str = "a field";

/// Reads a file. Binary numbers are big-endian by definition; a file that makes sense only as little-endian is read so.
/// Errors: the first word or block that does not fit the format, or cells with wrong numbers of points.
pub fn read(bytes: &[u8]) -> Result<PolygonMesh, ReadError> {
    let read_as = |big_endian: bool| {
        let piece = LegacyReader { bytes, offset: 0, line: 1 }.read_piece(big_endian)?;
        let mut mesh = PolygonMesh::default();
        piece.add_to(&mut mesh).map_err(|error| ReadError::new(None, error.to_string(), FILE_KIND))?;
        Ok(mesh)
    };
    read_as(true).or_else(|error| {
        let mut mesh = read_as(false).map_err(|_| error)?;
        mesh.notes.push("read as little-endian, which legacy files should not be".into());
        Ok(mesh)
    })
}

/// Reader of a file, word by word.
struct LegacyReader<'a> {
    bytes: &'a [u8],
    /// Next byte.
    offset: usize,
    /// Line of the last word, in ASCII files.
    line: usize,
}

/// Form in which numbers are written.
#[derive(Clone, Copy)]
struct NumberFormat {
    binary: bool,
    big_endian: bool,
}

impl<'a> LegacyReader<'a> {
    fn read_piece(mut self, big_endian: bool) -> Result<PolyDataPiece, ReadError> {
        let mut head = self.next_text_line();
        while head.trim().is_empty() && self.offset < self.bytes.len() {
            head = self.next_text_line();
        }
        let version = head.trim().to_ascii_lowercase();
        let Some(version) = version.strip_prefix("# vtk datafile version") else {
            return Err(ReadError::new(1, "no line '# vtk DataFile Version'", FILE_KIND));
        };
        let has_offsets = version.trim().split('.').next().and_then(|major| major.parse::<u32>().ok()) >= Some(5);
        self.next_text_line();
        let form = match self.next_word().to_ascii_lowercase().as_str() {
            "ascii" => NumberFormat { binary: false, big_endian },
            "binary" => NumberFormat { binary: true, big_endian },
            other => return Err(self.error_here(format!("the word '{other}'"), "ASCII or BINARY")),
        };
        let (dataset, kind) = (self.next_word().to_ascii_lowercase(), self.next_word().to_ascii_uppercase());
        if dataset != "dataset" || kind != "POLYDATA" {
            let found = if dataset == "dataset" { format!("DATASET {kind}") } else { format!("the word '{dataset}'") };
            return Err(self.error_here(found, "DATASET POLYDATA; in ParaView: Extract Surface"));
        }
        let mut piece = PolyDataPiece::default();
        let mut has_points = false;
        loop {
            match self.next_word().to_ascii_uppercase().as_str() {
                "POINTS" => {
                    let count = self.read_count("the number of points")?;
                    let number = self.read_number_type()?;
                    piece.coordinates = self.read_numbers(count.saturating_mul(3), number, form, "points")?;
                    has_points = true;
                }
                "POLYGONS" => piece.polygons = self.read_cells(form, has_offsets)?,
                "TRIANGLE_STRIPS" => piece.strips = self.read_cells(form, has_offsets)?,
                "VERTICES" | "LINES" => {
                    let cells = self.read_cells(form, has_offsets)?;
                    piece.ignored += cells.ends.strip_prefix(&[0.0]).unwrap_or(&cells.ends).len();
                }
                "METADATA" => while !self.next_text_line().trim().is_empty() || self.skipped_first_line() {},
                "FIELD" => self.skip_field(form)?,
                // Values at points and cells come last.
                "" | "POINT_DATA" | "CELL_DATA" => break,
                // Some programs fill a file with zero bytes, as in STL.
                other if other.bytes().all(|byte| byte == 0) => break,
                other => {
                    return Err(self.error_here(format!("the word '{other}'"), "POINTS, POLYGONS or TRIANGLE_STRIPS"));
                }
            }
        }
        if !has_points {
            return Err(self.error_here("no POINTS".into(), FILE_KIND));
        }
        if piece.polygons.ends.is_empty() && piece.strips.ends.is_empty() {
            return Err(self.error_here("no polygons".into(), "POLYGONS or TRIANGLE_STRIPS"));
        }
        Ok(piece)
    }

    /// Whether the line just read was the rest of the line with METADATA.
    fn skipped_first_line(&self) -> bool {
        let before = self.bytes[..self.offset].trim_ascii_end();
        self.offset < self.bytes.len() && before.to_ascii_uppercase().ends_with(b"METADATA")
    }

    /// Reads cells; with offsets, as from version 5 on, the ends of cells and their corners are lists of their own.
    fn read_cells(&mut self, form: NumberFormat, has_offsets: bool) -> Result<CellLists, ReadError> {
        let (count, size) = (self.read_count("the number of cells")?, self.read_count("the number of corners")?);
        if !has_offsets {
            let numbers = self.read_numbers(size, NumberType::Signed(4), form, "corners")?;
            return CellLists::from_counted(&numbers, count)
                .map_err(|error| self.error_here(error.to_string(), FILE_KIND));
        }
        let mut lists = [("OFFSETS", count), ("CONNECTIVITY", size)].map(|(name, count)| (name, count, Vec::new()));
        for (name, count, list) in &mut lists {
            let word = self.next_word();
            if !word.eq_ignore_ascii_case(name) {
                return Err(self.error_here(format!("the word '{word}'"), name));
            }
            let number = self.read_number_type()?;
            *list = self.read_numbers(*count, number, form, "corners")?;
        }
        let [(_, _, ends), (_, _, corners)] = lists;
        Ok(CellLists { corners, ends })
    }

    /// Skips arrays that belong to the whole file.
    fn skip_field(&mut self, form: NumberFormat) -> Result<(), ReadError> {
        self.next_word();
        for _ in 0..self.read_count("the number of arrays")? {
            self.next_word();
            let components = self.read_count("the number of components")?;
            let count = components.saturating_mul(self.read_count("the number of tuples")?);
            let number = self.read_number_type()?;
            self.read_numbers(count, number, form, FIELD)?;
        }
        Ok(())
    }

    fn read_number_type(&mut self) -> Result<NumberType, ReadError> {
        let word = self.next_word();
        NumberType::from_name(&word)
            .ok_or_else(|| self.error_here(format!("numbers of the type '{word}'"), "float, double or int"))
    }

    /// Reads a count, which errors call `name`.
    fn read_count(&mut self, name: &'static str) -> Result<usize, ReadError> {
        let word = self.next_word();
        word.parse().map_err(|_| self.error_here(format!("'{word}'"), name))
    }

    /// Reads an array of numbers, which errors call `name`.
    fn read_numbers(
        &mut self,
        count: usize,
        number: NumberType,
        form: NumberFormat,
        name: &'static str,
    ) -> Result<Vec<f64>, ReadError> {
        if form.binary {
            self.next_text_line();
            let rest = &self.bytes[self.offset.min(self.bytes.len())..];
            let size = count.saturating_mul(number.byte_size());
            let Some(array_bytes) = rest.get(..size) else {
                let found = format!("{name}: {count} numbers announced, {} found", rest.len() / number.byte_size());
                return Err(self.error_here(found, "a complete file"));
            };
            self.offset += size;
            return Ok(number.decode_all(array_bytes, form.big_endian));
        }
        // Limited by the number of words in the file, not by the announced number.
        let mut numbers = Vec::new();
        while numbers.len() < count {
            let word = self.next_word();
            if word.is_empty() {
                let found = format!("{name}: {count} numbers announced, {} found", numbers.len());
                return Err(self.error_here(found, "a complete file"));
            }
            let value = match name {
                // Fields are not used, and may contain NaN.
                FIELD if parse_real(&word).is_some() => 0.0,
                _ => coordinate(&word).map_err(|error| self.error_here(error.to_string(), name))?,
            };
            numbers.push(value);
        }
        Ok(numbers)
    }

    /// Returns the next word, empty at the end.
    fn next_word(&mut self) -> String {
        while let Some(byte) = self.bytes.get(self.offset).filter(|byte| byte.is_ascii_whitespace()) {
            self.line += usize::from(*byte == b'\n');
            self.offset += 1;
        }
        let rest = &self.bytes[self.offset..];
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        self.offset += length;
        String::from_utf8_lossy(&rest[..length]).into_owned()
    }

    /// Returns the rest of the line, without its end.
    fn next_text_line(&mut self) -> String {
        let rest: &'a [u8] = &self.bytes[self.offset..];
        let length = rest.iter().position(|byte| *byte == b'\n').unwrap_or(rest.len());
        self.offset = (self.offset + length + 1).min(self.bytes.len());
        self.line += 1;
        String::from_utf8_lossy(&rest[..length]).into_owned()
    }

    fn error_here(&self, found: String, expected: &'static str) -> ReadError {
        let found = if found == "the word ''" { "the end of the file".into() } else { found };
        ReadError::new(self.line, found, expected)
    }
}
