//! Writer and reader of archives of npy arrays (`.npz`), the container of a snapshot.
//!
//! An archive is an uncompressed zip file with one file `NAME.npy` for each array, as `numpy.savez` writes it.

use std::fmt;
use std::io::{Cursor, Read, Seek, SeekFrom, Write};
use std::path::Path;

use bytemuck::Pod;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use crate::error::{Fault, Faults};

/// Element of an array: its npy type and the shape of one row.
pub trait ArrayElement: Pod {
    const DESCR: &'static str;
    const ROW: &'static [usize];
}

macro_rules! elements {
    ($($type:ty = $descr:literal, $row:expr;)+) => {
        $(impl ArrayElement for $type { const DESCR: &'static str = $descr; const ROW: &'static [usize] = &$row; })+
    };
}

elements! {
    f64 = "<f8", [];
    [f64; 3] = "<f8", [3];
    [f64; 4] = "<f8", [4];
    [[f64; 3]; 3] = "<f8", [3, 3];
    u64 = "<u8", [];
    [u64; 2] = "<u8", [2];
    u32 = "<u4", [];
    [u32; 2] = "<u4", [2];
    u16 = "<u2", [];
    u8 = "|u1", [];
}

/// First bytes of an npy file: the magic string and version 1.0 of the format.
const MAGIC_AND_VERSION: &[u8; 8] = b"\x93NUMPY\x01\x00";
/// Number of bytes before the header of an npy file: magic string, version, and length of the header in two bytes.
const PREFIX_LENGTH: usize = MAGIC_AND_VERSION.len() + 2;

/// Writer of an archive, array by array.
pub struct NpzWriter<W: Write + Seek>(ZipWriter<ArchiveTarget<W>>);

/// Target of an archive that keeps its first error and accepts all bytes after it, until [`NpzWriter::finish`] returns the
/// error: a [`ZipWriter`] that is dropped after an error would print it to stderr.
struct ArchiveTarget<W> {
    target: W,
    position: u64,
    length: u64,
    error: Option<std::io::Error>,
}

impl<W> ArchiveTarget<W> {
    /// Performs an operation on the target unless an earlier one has failed.
    fn attempt(&mut self, operation: impl FnOnce(&mut W) -> std::io::Result<()>) {
        if self.error.is_none() {
            self.error = operation(&mut self.target).err();
        }
    }
}

impl<W: Write> Write for ArchiveTarget<W> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.attempt(|target| target.write_all(bytes));
        self.position += bytes.len() as u64;
        self.length = self.length.max(self.position);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.attempt(W::flush);
        Ok(())
    }
}

impl<W: Seek> Seek for ArchiveTarget<W> {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        let position = match to {
            SeekFrom::Start(position) => Some(position),
            SeekFrom::Current(offset) => self.position.checked_add_signed(offset),
            SeekFrom::End(offset) => self.length.checked_add_signed(offset),
        };
        let position = position.ok_or(std::io::ErrorKind::InvalidInput)?;
        if position != self.position {
            self.attempt(|target| target.seek(SeekFrom::Start(position)).map(drop));
            self.position = position;
        }
        Ok(position)
    }
}

impl<W: Write + Seek> NpzWriter<W> {
    /// Writer of an empty archive to an empty target.
    pub fn new(target: W) -> Self {
        NpzWriter(ZipWriter::new(ArchiveTarget { target, position: 0, length: 0, error: None }))
    }

    /// Target with the archive; the first error of the target, if it had one.
    pub fn finish(self) -> zip::result::ZipResult<W> {
        let ArchiveTarget { target, error, .. } = self.0.finish()?;
        error.map_or(Ok(target), |error| Err(error.into()))
    }

    /// Adds the array `name`.
    pub fn add_array<T: ArrayElement>(&mut self, name: &str, rows: &[T]) -> zip::result::ZipResult<()> {
        let shape: String =
            std::iter::once(rows.len()).chain(T::ROW.iter().copied()).map(|n| format!("{n}, ")).collect();
        let mut header = format!("{{'descr': '{}', 'fortran_order': False, 'shape': ({shape}), }}", T::DESCR);
        // The format requires that the data start at a multiple of 64 bytes, behind a line break.
        let header_length = (PREFIX_LENGTH + header.len() + 1).next_multiple_of(64) - PREFIX_LENGTH;
        header.extend(std::iter::repeat_n(' ', header_length - 1 - header.len()));
        header.push('\n');
        // The default date of an entry is the first of the format, 1 January 1980.
        let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored).large_file(true);
        self.0.start_file(format!("{name}.npy"), options)?;
        self.0.write_all(MAGIC_AND_VERSION)?;
        self.0.write_all(&(header_length as u16).to_le_bytes())?;
        self.0.write_all(header.as_bytes())?;
        self.0.write_all(bytemuck::cast_slice(rows))?;
        Ok(())
    }
}

/// Defect of an archive or of one of its arrays.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NpzError {
    TruncatedFile,
    NoArchive,
    MissingArray,
    UnsupportedArray,
    DamagedArray,
    /// Magic bytes or version of another format.
    OtherVersion,
    TruncatedArray,
    BinaryHeader,
    /// Header of another type or order.
    OtherHeader(String),
    Shape {
        shape: Vec<usize>,
        bytes: usize,
    },
    RowCount {
        rows: usize,
        others: usize,
    },
}

impl fmt::Display for NpzError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            NpzError::TruncatedFile => f.write_str("the file is truncated"),
            NpzError::NoArchive => f.write_str("the file is no .npz file"),
            NpzError::MissingArray => f.write_str("is missing"),
            NpzError::UnsupportedArray => f.write_str("is compressed or encrypted"),
            NpzError::DamagedArray => f.write_str("is damaged"),
            NpzError::OtherVersion => f.write_str("is no npy array of version 1.0"),
            NpzError::TruncatedArray => f.write_str("is cut short"),
            NpzError::BinaryHeader => f.write_str("has a header that is no text"),
            NpzError::OtherHeader(header) => write!(f, "has the header {header}"),
            NpzError::Shape { shape, bytes } => write!(f, "has shape {shape:?} and {bytes} bytes of data"),
            NpzError::RowCount { rows, others } => write!(f, "has {rows} rows, others have {others}"),
        }
    }
}

impl std::error::Error for NpzError {}

/// Reader of an archive that gathers faults.
pub struct NpzReader<'a> {
    path: &'a Path,
    archive: ZipArchive<Cursor<Vec<u8>>>,
    pub faults: Faults,
}

impl<'a> NpzReader<'a> {
    /// Reader of the `bytes` of the file at `path`. Errors: bytes that are no archive.
    pub fn new(path: &'a Path, bytes: Vec<u8>) -> Result<Self, NpzError> {
        // The directory of the archive is at its end: without it, the file is incomplete.
        let begins_as_zip = bytes.starts_with(b"PK");
        let archive = ZipArchive::new(Cursor::new(bytes))
            .map_err(|_| if begins_as_zip { NpzError::TruncatedFile } else { NpzError::NoArchive })?;
        Ok(NpzReader { path, archive, faults: Faults::default() })
    }

    /// Whether there is an array `name`.
    pub fn has_array(&self, name: &str) -> bool {
        self.archive.index_for_name(&format!("{name}.npy")).is_some()
    }

    /// Reads the array `name`, of `rows` rows if that is known; `None` and a fault if it is missing or malformed. Rows
    /// with a number that is not finite are faults too.
    pub fn read_array<T: ArrayElement>(&mut self, name: &str, rows: Option<usize>) -> Option<Vec<T>> {
        let array = self.read_entry(name).and_then(|bytes| npy_rows::<T>(&bytes)).and_then(|array| match rows {
            Some(others) if others != array.len() => Err(NpzError::RowCount { rows: array.len(), others }),
            _ => Ok(array),
        });
        array
            .map_err(|error| {
                let expected = format!("expected an npy array of type {} with rows of shape {:?}", T::DESCR, T::ROW);
                self.faults.push(Fault::new(self.path, None, format!("array {name}"), error.to_string(), expected));
            })
            .ok()
            .inspect(|array| self.check_finite(name, array))
    }

    /// Adds a fault for each row of an array with a number that is not finite.
    fn check_finite<T: ArrayElement>(&mut self, name: &str, array: &[T]) {
        if T::DESCR != <f64 as ArrayElement>::DESCR {
            return;
        }
        for (number, row) in (1..).zip(array) {
            let row: &[f64] = bytemuck::cast_slice(std::slice::from_ref(row));
            if !row.iter().all(|x| x.is_finite()) {
                let (object, found) = (format!("array {name}, row {number}"), format!("{row:?}"));
                self.faults.push(Fault::new(self.path, None, object, found, "expected finite numbers"));
            }
        }
    }

    /// Returns the bytes of the npy file of an array.
    fn read_entry(&mut self, name: &str) -> Result<Vec<u8>, NpzError> {
        use zip::result::ZipError;
        let mut entry = self.archive.by_name(&format!("{name}.npy")).map_err(|error| match error {
            ZipError::FileNotFound => NpzError::MissingArray,
            ZipError::UnsupportedArchive(_) => NpzError::UnsupportedArray,
            _ => NpzError::DamagedArray,
        })?;
        let mut bytes = Vec::new();
        // The checksums detect damage.
        entry.read_to_end(&mut bytes).map_err(|_| NpzError::DamagedArray)?;
        Ok(bytes)
    }
}

/// Rows of an npy file of format version 1, C order.
fn npy_rows<T: ArrayElement>(bytes: &[u8]) -> Result<Vec<T>, NpzError> {
    let rest = bytes.strip_prefix(MAGIC_AND_VERSION).ok_or(NpzError::OtherVersion)?;
    let (header_length, rest) = rest.split_first_chunk().ok_or(NpzError::TruncatedArray)?;
    let header_length = u16::from_le_bytes(*header_length) as usize;
    let (header, data) = rest.split_at_checked(header_length).ok_or(NpzError::TruncatedArray)?;
    let header = std::str::from_utf8(header).map_err(|_| NpzError::BinaryHeader)?;
    if !header.contains(&format!("'descr': '{}'", T::DESCR)) || !header.contains("'fortran_order': False") {
        return Err(NpzError::OtherHeader(header.trim().to_string()));
    }
    let shape: Vec<usize> = header
        .split("'shape': (")
        .nth(1)
        .and_then(|rest| rest.split(')').next())
        .map(|inside| inside.split(',').filter_map(|n| n.trim().parse().ok()).collect())
        .unwrap_or_default();
    let row_bytes = size_of::<T>();
    if shape.is_empty() || shape[1..] != *T::ROW || shape[0].checked_mul(row_bytes) != Some(data.len()) {
        return Err(NpzError::Shape { shape, bytes: data.len() });
    }
    Ok(data.chunks_exact(row_bytes).map(bytemuck::pod_read_unaligned).collect())
}

#[cfg(test)]
mod tests {
    use zip::result::ZipError;

    use super::*;

    #[test]
    fn an_archive_that_finds_no_room_returns_the_error() {
        let written = |buffer: &mut [u8]| {
            let mut archive = NpzWriter::new(Cursor::new(buffer));
            archive.add_array("a", &[1.0; 50])?;
            archive.add_array("b", &[2.0; 50])?;
            archive.finish().map(|target| target.position() as usize)
        };
        let whole = written(&mut [0; 4096]).unwrap();
        assert!(written(&mut vec![0; whole]).is_ok());
        for capacity in (0..whole).step_by(7) {
            let Err(ZipError::Io(error)) = written(&mut vec![0; capacity]) else { panic!("{capacity}") };
            assert_eq!(error.kind(), std::io::ErrorKind::WriteZero);
        }
    }
}
