//! Common parts of the readers of VTK files, legacy and XML: types of numbers, and cells of polygonal data.

use cd_formats::mesh::PolygonMesh;

/// Type of the numbers in a binary array of VTK, by its name in legacy or XML files.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NumberType {
    Signed(usize),
    Unsigned(usize),
    Float,
    Double,
}

impl NumberType {
    /// Type by its name in VTK's files; `None` for an unknown name.
    pub fn from_name(name: &str) -> Option<NumberType> {
        Some(match name.to_ascii_lowercase().as_str() {
            "char" | "int8" => NumberType::Signed(1),
            "unsigned_char" | "uint8" => NumberType::Unsigned(1),
            "short" | "int16" => NumberType::Signed(2),
            "unsigned_short" | "uint16" => NumberType::Unsigned(2),
            // The writers of VTK store identifiers as int in legacy files, although they have 8 bytes in memory.
            "int" | "int32" | "vtkidtype" | "vtktypeint32" => NumberType::Signed(4),
            "unsigned_int" | "uint32" | "vtktypeuint32" => NumberType::Unsigned(4),
            "long" | "int64" | "vtktypeint64" => NumberType::Signed(8),
            "unsigned_long" | "uint64" | "vtktypeuint64" => NumberType::Unsigned(8),
            "float" | "float32" => NumberType::Float,
            "double" | "float64" => NumberType::Double,
            _ => return None,
        })
    }

    /// Bytes of one number.
    pub fn byte_size(self) -> usize {
        match self {
            NumberType::Signed(size) | NumberType::Unsigned(size) => size,
            NumberType::Float => 4,
            NumberType::Double => 8,
        }
    }

    /// Numbers in `bytes`; a remainder at the end is ignored.
    pub fn decode_all(self, bytes: &[u8], big_endian: bool) -> Vec<f64> {
        let decode = |chunk: &[u8]| {
            let mut word = [0; 8];
            for (k, byte) in chunk.iter().enumerate() {
                word[if big_endian { chunk.len() - 1 - k } else { k }] = *byte;
            }
            let bits = u64::from_le_bytes(word);
            match self {
                NumberType::Unsigned(_) => bits as f64,
                NumberType::Signed(size) => {
                    let unused = 64 - 8 * size as u32;
                    (((bits << unused) as i64) >> unused) as f64
                }
                NumberType::Float => f64::from(f32::from_bits(bits as u32)),
                NumberType::Double => f64::from_bits(bits),
            }
        };
        bytes.chunks_exact(self.byte_size()).map(decode).collect()
    }
}

/// Points and cells that do not fit together.
#[derive(Debug, PartialEq)]
pub enum CellError {
    /// Number of coordinates that is not a multiple of 3.
    CoordinateCount(usize),
    /// Lists of corners end at `cell` of `count` cells.
    MissingCells { cell: usize, count: usize },
    /// Number of corners of a cell that exceeds the numbers left.
    CornerCount { cell: usize, count: usize, corners: f64, left: usize },
    /// End of a cell outside of the list of corners.
    CellEnd { cell: usize, end: f64, corners: usize },
    /// Index of a point that does not exist.
    PointIndex { cell: usize, index: f64, points: usize },
    /// More corners than the cells use.
    UnusedCorners { corners: usize, used: usize },
}

impl std::fmt::Display for CellError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            CellError::CoordinateCount(count) => write!(f, "{count} coordinates, which is not a multiple of 3"),
            CellError::MissingCells { cell, count } => write!(f, "the lists of corners end at cell {cell} of {count}"),
            CellError::CornerCount { cell, count, corners, left } => {
                write!(f, "cell {cell} of {count} with {corners} corners where {left} numbers follow")
            }
            CellError::CellEnd { cell, end, corners } => write!(f, "cell {cell} ends at corner {end} of {corners}"),
            CellError::PointIndex { cell, index, points } => {
                write!(f, "cell {cell} names point {index}, where points are 0 to {}", *points as f64 - 1.0)
            }
            CellError::UnusedCorners { corners, used } => write!(f, "{corners} corners, of which the cells use {used}"),
        }
    }
}

impl std::error::Error for CellError {}

/// One piece of polygonal data of VTK.
#[derive(Debug, Default)]
pub struct PolyDataPiece {
    pub coordinates: Vec<f64>,
    pub polygons: CellLists,
    pub strips: CellLists,
    /// Number of points and lines that are cells of their own.
    pub ignored: usize,
}

/// Corners of cells, one after the other, and where each cell ends.
#[derive(Debug, Default)]
pub struct CellLists {
    pub corners: Vec<f64>,
    pub ends: Vec<f64>,
}

impl CellLists {
    /// Converts the lists of legacy files before version 5: for each cell a count, then that number of corners. Errors: fewer
    /// than `count` cells, or a count that does not fit the rest of the list.
    pub fn from_counted(numbers: &[f64], count: usize) -> Result<CellLists, CellError> {
        let mut cells = CellLists::default();
        let mut rest = numbers;
        for cell in 1..=count {
            let Some((&corners, following)) = rest.split_first() else {
                return Err(CellError::MissingCells { cell, count });
            };
            let fits = corners >= 0.0 && corners <= following.len() as f64;
            if !fits {
                return Err(CellError::CornerCount { cell, count, corners, left: following.len() });
            }
            let (corners, next_cells) = following.split_at(corners as usize);
            cells.corners.extend(corners);
            cells.ends.push(cells.corners.len() as f64);
            rest = next_cells;
        }
        Ok(cells)
    }

    /// Corners of each cell; `points` is the number of points.
    fn corner_lists(&self, points: usize) -> Result<Vec<Vec<usize>>, CellError> {
        let (mut lists, mut begin) = (Vec::new(), 0);
        // Lists of legacy files from version 5 on begin with the start of the first cell, 0.
        let ends = self.ends.strip_prefix(&[0.0]).unwrap_or(&self.ends);
        for (cell, &end) in (1..).zip(ends) {
            if !(end >= begin as f64 && end <= self.corners.len() as f64) {
                return Err(CellError::CellEnd { cell, end, corners: self.corners.len() });
            }
            let corners = &self.corners[begin..end as usize];
            if let Some(&index) = corners.iter().find(|&&corner| !(corner >= 0.0 && corner < points as f64)) {
                return Err(CellError::PointIndex { cell, index, points });
            }
            lists.push(corners.iter().map(|&corner| corner as usize).collect());
            begin = end as usize;
        }
        if begin < self.corners.len() {
            return Err(CellError::UnusedCorners { corners: self.corners.len(), used: begin });
        }
        Ok(lists)
    }
}

impl PolyDataPiece {
    /// Appends the piece to a mesh. Errors: lists that do not fit together.
    pub fn add_to(&self, mesh: &mut PolygonMesh) -> Result<(), CellError> {
        if !self.coordinates.len().is_multiple_of(3) {
            return Err(CellError::CoordinateCount(self.coordinates.len()));
        }
        let (first, points) = (mesh.points.len(), self.coordinates.len() / 3);
        mesh.points.extend(self.coordinates.chunks_exact(3).map(|p| [p[0], p[1], p[2]]));
        let shifted_list = |list: Vec<usize>| -> Vec<usize> { list.into_iter().map(|k| first + k).collect() };
        mesh.polygons.extend(self.polygons.corner_lists(points)?.into_iter().map(shifted_list));
        for strip in self.strips.corner_lists(points)?.into_iter().map(shifted_list) {
            // Every second triangle of a strip has the opposite orientation.
            let oriented_triangle = |(k, corners): (usize, &[usize])| {
                if k % 2 == 0 { corners.to_vec() } else { vec![corners[1], corners[0], corners[2]] }
            };
            mesh.polygons.extend(strip.windows(3).enumerate().map(oriented_triangle));
        }
        mesh.note_ignored(self.ignored, "line or point element", "");
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn binary_numbers_of_all_kinds() {
        let of = |name: &str, bytes: &[u8]| NumberType::from_name(name).unwrap().decode_all(bytes, true);
        assert_eq!(of("char", &[0xff, 2]), [-1.0, 2.0]);
        assert_eq!(of("UInt8", &[0xff]), [255.0]);
        assert_eq!(of("short", &[0xff, 0xfe]), [-2.0]);
        assert_eq!(of("vtktypeint64", &[0, 0, 0, 0, 0, 0, 1, 2]), [258.0]);
        assert_eq!(of("float", &1.5f32.to_be_bytes()), [1.5]);
        assert_eq!(NumberType::from_name("Float64").unwrap().decode_all(&(-2.5f64).to_le_bytes(), false), [-2.5]);
        assert_eq!(NumberType::from_name("bit"), None);
    }
}
