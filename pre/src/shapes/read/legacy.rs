//! VTK legacy files: polygonal data, ASCII or BINARY, versions 1 to 5.

use super::{Cells, Mesh, Number, Piece, Refusal, real};

const KIND: &str = "polygonal data of VTK, legacy or XML";

/// Reads a file. Binary numbers are big-endian by definition; a file that makes sense only as little-endian is read so.
pub fn read(bytes: &[u8]) -> Result<Mesh, Refusal> {
    let whole = |big_endian: bool| {
        let piece = Cursor { bytes, at: 0, line: 1 }.piece(big_endian)?;
        let mut mesh = Mesh::default();
        piece.add_to(&mut mesh).map_err(|found| Refusal::new(None, found, KIND))?;
        Ok(mesh)
    };
    whole(true).or_else(|refusal| {
        let mut mesh = whole(false).map_err(|_| refusal)?;
        mesh.notes.push("read as little-endian, which legacy files should not be".into());
        Ok(mesh)
    })
}

struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Line of the last word, in ASCII files.
    line: usize,
}

/// How numbers are written.
#[derive(Clone, Copy)]
struct Form {
    binary: bool,
    big_endian: bool,
}

impl<'a> Cursor<'a> {
    fn piece(mut self, big_endian: bool) -> Result<Piece, Refusal> {
        let head = self.text_line();
        let version = head.trim().to_ascii_lowercase();
        let Some(version) = version.strip_prefix("# vtk datafile version") else {
            return Err(Refusal::new(1, "no line '# vtk DataFile Version'", KIND));
        };
        let offsets = version.trim().split('.').next().and_then(|major| major.parse::<u32>().ok()) >= Some(5);
        self.text_line();
        let form = match self.word().to_ascii_lowercase().as_str() {
            "ascii" => Form { binary: false, big_endian },
            "binary" => Form { binary: true, big_endian },
            other => return Err(self.refusal(format!("the word '{other}'"), "ASCII or BINARY")),
        };
        let (dataset, kind) = (self.word().to_ascii_lowercase(), self.word().to_ascii_uppercase());
        if dataset != "dataset" || kind != "POLYDATA" {
            let found = if dataset == "dataset" { format!("DATASET {kind}") } else { format!("the word '{dataset}'") };
            return Err(self.refusal(found, "DATASET POLYDATA; in ParaView: Extract Surface"));
        }
        let mut piece = Piece::default();
        let mut points = false;
        loop {
            match self.word().to_ascii_uppercase().as_str() {
                "POINTS" => {
                    let count = self.count("the number of points")?;
                    let number = self.number()?;
                    piece.coordinates = self.numbers(count.saturating_mul(3), number, form, "points")?;
                    points = true;
                }
                "POLYGONS" => piece.polygons = self.cells(form, offsets)?,
                "TRIANGLE_STRIPS" => piece.strips = self.cells(form, offsets)?,
                "VERTICES" | "LINES" => {
                    let cells = self.cells(form, offsets)?;
                    piece.ignored += cells.ends.strip_prefix(&[0.0]).unwrap_or(&cells.ends).len();
                }
                "METADATA" => while !self.text_line().trim().is_empty() || self.skipped_first_line() {},
                "FIELD" => self.field(form)?,
                // Values at points and cells come last.
                "" | "POINT_DATA" | "CELL_DATA" => break,
                other => return Err(self.refusal(format!("the word '{other}'"), "POINTS, POLYGONS or TRIANGLE_STRIPS")),
            }
        }
        if !points {
            return Err(self.refusal("no POINTS".into(), KIND));
        }
        if piece.polygons.ends.is_empty() && piece.strips.ends.is_empty() {
            return Err(self.refusal("no polygons".into(), "POLYGONS or TRIANGLE_STRIPS"));
        }
        Ok(piece)
    }

    /// Whether the line just read was the rest of that with METADATA.
    fn skipped_first_line(&self) -> bool {
        let before = self.bytes[..self.at].trim_ascii_end();
        self.at < self.bytes.len() && before.to_ascii_uppercase().ends_with(b"METADATA")
    }

    fn cells(&mut self, form: Form, offsets: bool) -> Result<Cells, Refusal> {
        let (count, size) = (self.count("the number of cells")?, self.count("the number of corners")?);
        if !offsets {
            let numbers = self.numbers(size, Number::Signed(4), form, "corners")?;
            return Cells::counted(&numbers, count).map_err(|found| self.refusal(found, KIND));
        }
        let mut lists = [("OFFSETS", count), ("CONNECTIVITY", size)].map(|(name, count)| (name, count, Vec::new()));
        for (name, count, list) in &mut lists {
            let word = self.word();
            if !word.eq_ignore_ascii_case(name) {
                return Err(self.refusal(format!("the word '{word}'"), name));
            }
            let number = self.number()?;
            *list = self.numbers(*count, number, form, "corners")?;
        }
        let [(_, _, ends), (_, _, corners)] = lists;
        Ok(Cells { corners, ends })
    }

    /// Skips arrays that belong to the whole file.
    fn field(&mut self, form: Form) -> Result<(), Refusal> {
        self.word();
        for _ in 0..self.count("the number of arrays")? {
            self.word();
            let components = self.count("the number of components")?;
            let count = components.saturating_mul(self.count("the number of tuples")?);
            let number = self.number()?;
            self.numbers(count, number, form, "a field")?;
        }
        Ok(())
    }

    fn number(&mut self) -> Result<Number, Refusal> {
        let word = self.word();
        Number::of(&word).ok_or_else(|| self.refusal(format!("numbers of the type '{word}'"), "float, double or int"))
    }

    fn count(&mut self, what: &str) -> Result<usize, Refusal> {
        let word = self.word();
        word.parse().map_err(|_| self.refusal(format!("'{word}'"), what))
    }

    fn numbers(&mut self, count: usize, number: Number, form: Form, what: &str) -> Result<Vec<f64>, Refusal> {
        if form.binary {
            self.text_line();
            let rest = &self.bytes[self.at.min(self.bytes.len())..];
            let size = count.saturating_mul(number.size());
            let Some(own) = rest.get(..size) else {
                let found = format!("{what}: {count} numbers announced, {} there", rest.len() / number.size());
                return Err(self.refusal(found, "a complete file"));
            };
            self.at += size;
            return Ok(number.all(own, form.big_endian));
        }
        // Never more than the file has words, whatever number it announces.
        let mut numbers = Vec::new();
        while numbers.len() < count {
            let word = self.word();
            if word.is_empty() {
                let found = format!("{what}: {count} numbers announced, {} there", numbers.len());
                return Err(self.refusal(found, "a complete file"));
            }
            numbers.push(real(&word).ok_or_else(|| self.refusal(format!("'{word}', which is no number"), what))?);
        }
        Ok(numbers)
    }

    /// The next word, empty at the end.
    fn word(&mut self) -> String {
        while let Some(byte) = self.bytes.get(self.at).filter(|byte| byte.is_ascii_whitespace()) {
            self.line += usize::from(*byte == b'\n');
            self.at += 1;
        }
        let rest = &self.bytes[self.at..];
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        self.at += length;
        String::from_utf8_lossy(&rest[..length]).into_owned()
    }

    /// The rest of the line, without its end.
    fn text_line(&mut self) -> String {
        let rest: &'a [u8] = &self.bytes[self.at..];
        let length = rest.iter().position(|byte| *byte == b'\n').unwrap_or(rest.len());
        self.at = (self.at + length + 1).min(self.bytes.len());
        self.line += 1;
        String::from_utf8_lossy(&rest[..length]).into_owned()
    }

    fn refusal(&self, found: String, expected: &str) -> Refusal {
        let found = if found == "the word ''" { "the end of the file".into() } else { found };
        Refusal::new(self.line, found, expected)
    }
}
