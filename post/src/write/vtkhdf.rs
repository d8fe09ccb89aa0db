//! `DISPLAY/KIND.vtkhdf`: polygonal data at all times of a run in one file, in VTK's format on HDF5.
//!
//! The format is version 2.0 of VTKHDF, `PolyData` with `Steps`, one part at each time. Each array has the rows of all times
//! in a row; offsets in `Steps` say where those of a time begin.

use std::path::{Path, PathBuf};

use cd_formats::atomic::GrowingFile;
use cd_formats::error::{Fault, Faults};
use vtkio::model::{Attribute, DataArray, IOBuffer, PolyDataPiece, VertexNumbers};

use crate::write::hdf5::{self, ArrayType, AttributeValue, GrowingArray, HdfGroup, SUPERBLOCK_BYTES};

/// Categories of cells, in the order of VTK's cells.
const CELL_CATEGORIES: [&str; 4] = ["Vertices", "Lines", "Polygons", "Strips"];

/// File that gets the data of one time after the other.
pub struct VtkhdfFile {
    path: PathBuf,
    file: GrowingFile,
    times: Vec<f64>,
    points: GrowingArray,
    /// Number of points of each time.
    point_counts: Vec<i64>,
    cells: [CellCategory; 4],
    /// Arrays of points and of cells by name, known from the first time on.
    attributes: [Vec<(String, GrowingArray)>; 2],
}

/// Cells of one category.
struct CellCategory {
    connectivity: GrowingArray,
    /// First position in `connectivity` of each cell of a time, and the end.
    offsets: GrowingArray,
    cell_counts: Vec<i64>,
    connectivity_counts: Vec<i64>,
}

impl CellCategory {
    fn new() -> CellCategory {
        let integers = || GrowingArray::new(ArrayType::I64, None);
        CellCategory {
            connectivity: integers(),
            offsets: integers(),
            cell_counts: Vec::new(),
            connectivity_counts: Vec::new(),
        }
    }

    /// Appends the cells of one time.
    fn append(&mut self, file: &mut GrowingFile, cells: Option<VertexNumbers>) -> Result<(), Faults> {
        let (connectivity, ends) = cells.map(VertexNumbers::into_xml).unwrap_or_default();
        self.cell_counts.push(ends.len() as i64);
        self.connectivity_counts.push(connectivity.len() as i64);
        // VTK's type of indices is signed; these numbers have the same bits.
        self.connectivity.append(file, &u64_bytes(&connectivity))?;
        self.offsets.append(file, &u64_bytes(&[0]))?;
        self.offsets.append(file, &u64_bytes(&ends))
    }

    fn into_group(self, file: &mut GrowingFile) -> Result<HdfGroup, Faults> {
        Ok(HdfGroup::default()
            .with_array("Connectivity", self.connectivity)
            .with_array("NumberOfCells", integer_array(file, &self.cell_counts, None)?)
            .with_array("NumberOfConnectivityIds", integer_array(file, &self.connectivity_counts, None)?)
            .with_array("Offsets", self.offsets))
    }
}

impl VtkhdfFile {
    /// Starts a file, which appears at `path` when it is finished.
    pub fn create(path: &Path) -> Result<VtkhdfFile, Faults> {
        Ok(VtkhdfFile {
            path: path.to_path_buf(),
            file: GrowingFile::create(path, SUPERBLOCK_BYTES)?,
            times: Vec::new(),
            points: GrowingArray::new(ArrayType::F64, Some(3)),
            point_counts: Vec::new(),
            cells: std::array::from_fn(|_| CellCategory::new()),
            attributes: [Vec::new(), Vec::new()],
        })
    }

    /// Appends the data at `time`, s. Arrays of one name must have one type at all times.
    ///
    /// Errors: arrays with other names than at the first time, or a file that cannot be written.
    pub fn append(&mut self, time: f64, piece: PolyDataPiece) -> Result<(), Faults> {
        let first = self.times.is_empty();
        if !first {
            self.expect_same_arrays(time, &piece)?;
        }
        let file = &mut self.file;
        self.times.push(time);
        self.point_counts.push((piece.points.len() / 3) as i64);
        self.points.append(file, &number_bytes(&piece.points).1)?;
        for (category, cells) in self.cells.iter_mut().zip([piece.verts, piece.lines, piece.polys, piece.strips]) {
            category.append(file, cells)?;
        }
        for (arrays, data) in self.attributes.iter_mut().zip([piece.data.point, piece.data.cell]) {
            for (k, attribute) in data.into_iter().enumerate() {
                let Attribute::DataArray(DataArray { name, elem, data }) = attribute else { continue };
                let (number_type, bytes) = number_bytes(&data);
                if first {
                    let components = Some(u64::from(elem.num_comp())).filter(|count| *count > 1);
                    arrays.push((name.clone(), GrowingArray::new(number_type, components)));
                }
                arrays[k].1.append(file, &bytes)?;
            }
        }
        Ok(())
    }

    /// Checks that a piece has the arrays of the first time: walls get slopes when gravity begins in the run, for example.
    fn expect_same_arrays(&self, time: f64, piece: &PolyDataPiece) -> Result<(), Faults> {
        for (arrays, data) in self.attributes.iter().zip([&piece.data.point, &piece.data.cell]) {
            let names = data.iter().filter_map(|attribute| match attribute {
                Attribute::DataArray(array) => Some(array.name.as_str()),
                Attribute::Field { .. } => None,
            });
            let (found, known): (Vec<&str>, Vec<&str>) =
                (names.collect(), arrays.iter().map(|(name, _)| name.as_str()).collect());
            if found != known {
                let found = format!("{} at {time} s", found.join(", "));
                let expected = format!("expected {} as at the first time; or use --vtk-format vtp", known.join(", "));
                return Err(Fault::new(&self.path, None, "arrays", found, expected).into());
            }
        }
        Ok(())
    }

    /// Completes the file.
    pub fn finish(mut self) -> Result<(), Faults> {
        let file = &mut self.file;
        let offsets = |counts: &[i64]| -> Vec<i64> {
            counts.iter().scan(0, |sum, count| Some(std::mem::replace(sum, *sum + count))).collect()
        };
        // A row for each time, a column for each category of cells.
        let cell_offsets = |counts: fn(&CellCategory) -> &[i64]| -> Vec<i64> {
            let columns = self.cells.each_ref().map(|category| offsets(counts(category)));
            (0..self.times.len()).flat_map(|time| columns.each_ref().map(|column| column[time])).collect()
        };
        let mut times = GrowingArray::new(ArrayType::F64, None);
        times.append(file, &number_bytes(&IOBuffer::F64(self.times.clone())).1)?;
        let parts: Vec<i64> = (0..).take(self.times.len()).collect();
        let steps = HdfGroup::default()
            .with_attribute("NSteps", AttributeValue::Integer(self.times.len() as i64))
            .with_array("Values", times)
            .with_array("PartOffsets", integer_array(file, &parts, None)?)
            .with_array("NumberOfParts", integer_array(file, &vec![1; parts.len()], None)?)
            .with_array("PointOffsets", integer_array(file, &offsets(&self.point_counts), None)?)
            .with_array("CellOffsets", integer_array(file, &cell_offsets(|cells| &cells.cell_counts), Some(4))?)
            .with_array(
                "ConnectivityIdOffsets",
                integer_array(file, &cell_offsets(|cells| &cells.connectivity_counts), Some(4))?,
            );
        let mut root = HdfGroup::default()
            .with_attribute("Version", AttributeValue::Integers(vec![2, 0]))
            .with_attribute("Type", AttributeValue::Text("PolyData".into()))
            .with_array("NumberOfPoints", integer_array(file, &self.point_counts, None)?)
            .with_array("Points", self.points);
        for (name, category) in CELL_CATEGORIES.into_iter().zip(self.cells) {
            root = root.with_group(name, category.into_group(file)?);
        }
        for (name, arrays) in ["PointData", "CellData"].into_iter().zip(self.attributes) {
            let add = |group: HdfGroup, (name, array): (String, GrowingArray)| group.with_array(&name, array);
            root = root.with_group(name, arrays.into_iter().fold(HdfGroup::default(), add));
        }
        hdf5::finish_file(self.file, HdfGroup::default().with_group("VTKHDF", root.with_group("Steps", steps)))
    }
}

/// Array of integers that is complete.
fn integer_array(file: &mut GrowingFile, values: &[i64], components: Option<u64>) -> Result<GrowingArray, Faults> {
    let mut array = GrowingArray::new(ArrayType::I64, components);
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    array.append(file, &bytes)?;
    Ok(array)
}

fn u64_bytes(values: &[u64]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// Type and little-endian bytes of the numbers of an array.
fn number_bytes(numbers: &IOBuffer) -> (ArrayType, Vec<u8>) {
    match numbers {
        IOBuffer::F64(values) => (ArrayType::F64, values.iter().flat_map(|value| value.to_le_bytes()).collect()),
        IOBuffer::U64(values) => (ArrayType::Unsigned(8), u64_bytes(values)),
        IOBuffer::U32(values) => {
            (ArrayType::Unsigned(4), values.iter().flat_map(|value| value.to_le_bytes()).collect())
        }
        IOBuffer::U16(values) => {
            (ArrayType::Unsigned(2), values.iter().flat_map(|value| value.to_le_bytes()).collect())
        }
        IOBuffer::U8(values) => (ArrayType::Unsigned(1), values.clone()),
        other => unreachable!("no array for ParaView has the type {:?}", other.scalar_type()),
    }
}

#[cfg(test)]
mod tests {
    use hdf5_reader::Hdf5File;
    use hdf5_reader::group::Group;

    use super::*;
    use crate::derive::fragments::find_fragments;
    use crate::frame::Frame;
    use crate::math::Vec3;
    use crate::samples::Scene;
    use crate::write::display::{FILE_KINDS, display_piece};

    /// A frame with `contacts` contacts between a grain, a cube and a plate.
    fn frame(contacts: usize) -> Frame {
        let mut scene = Scene::default();
        let grain = scene.grain([0.0; 3], 1.0);
        scene.plate([0.0, 0.0, -1.1], [1.0, 1.0, 0.1]);
        let cube = scene.cube([0.0, 0.0, 3.0], 1.0);
        for _ in 0..contacts {
            scene.contact_at(grain, cube, [0.0, 0.0, 1.0], Vec3::z());
        }
        scene.frame()
    }

    fn integers(group: &Group, name: &str) -> Vec<i64> {
        group.dataset(name).unwrap().read_array::<i64>().unwrap().iter().copied().collect()
    }

    #[test]
    fn each_time_has_its_rows_and_offsets() {
        let folder = tempfile::tempdir().unwrap();
        let frames = [0, 2, 1].map(frame);
        for kind in FILE_KINDS {
            let path = folder.path().join(kind);
            let mut file = VtkhdfFile::create(&path).unwrap();
            for (time, frame) in [0.0, 0.5, 2.0].into_iter().zip(&frames) {
                file.append(time, display_piece(frame, &find_fragments(frame), kind).unwrap()).unwrap();
            }
            file.finish().unwrap();
            let file = Hdf5File::open(&path).unwrap();
            let root = file.root_group().unwrap().group("VTKHDF").unwrap();
            assert_eq!(root.attribute("Version").unwrap().read_1d::<i64>().unwrap(), [2, 0]);
            assert_eq!(root.attribute("Type").unwrap().read_string().unwrap(), "PolyData");
            let steps = root.group("Steps").unwrap();
            assert_eq!(steps.attribute("NSteps").unwrap().read_1d::<i64>().unwrap(), [3]);
            let times = steps.dataset("Values").unwrap().read_array::<f64>().unwrap();
            assert!(times.iter().eq(&[0.0, 0.5, 2.0]));
            // Vertices, lines, polygons, strips of each time: one grain and one cube, a line a contact, a box a plate.
            let counts = CELL_CATEGORIES.map(|name| integers(&root.group(name).unwrap(), "NumberOfCells"));
            let expected = match kind {
                "grains" => [[2; 3], [0; 3], [0; 3], [0; 3]],
                "contacts" => [[0; 3], [0, 2, 1], [0; 3], [0; 3]],
                _ => [[0; 3], [0; 3], [6; 3], [0; 3]],
            };
            assert_eq!(counts, expected.map(Vec::from), "{kind}");
            let cells: i64 = counts.iter().flatten().sum();
            let points: i64 = integers(&root, "NumberOfPoints").iter().sum();
            assert_eq!(root.dataset("Points").unwrap().shape(), [points as u64, 3], "{kind}");
            for (name, rows) in [("PointData", points), ("CellData", cells)] {
                for array in root.group(name).unwrap().datasets().unwrap() {
                    assert_eq!(array.shape()[0], rows as u64, "{kind} {}", array.name());
                }
            }
        }
        let file = Hdf5File::open(folder.path().join("contacts")).unwrap();
        let root = file.root_group().unwrap().group("VTKHDF").unwrap();
        let steps = root.group("Steps").unwrap();
        assert_eq!(integers(&steps, "PointOffsets"), [0, 2, 4]);
        assert_eq!(integers(&steps, "CellOffsets"), [0, 0, 0, 0, 0, 0, 0, 0, 0, 2, 0, 0]);
        assert_eq!(integers(&steps, "ConnectivityIdOffsets"), [0, 0, 0, 0, 0, 0, 0, 0, 0, 4, 0, 0]);
        let lines = root.group("Lines").unwrap();
        assert_eq!(integers(&lines, "Offsets"), [0, 0, 2, 4, 0, 2]);
        assert_eq!(integers(&lines, "Connectivity"), [0, 1, 0, 1, 0, 1]);
    }

    #[test]
    fn arrays_that_change_are_faults() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = VtkhdfFile::create(&folder.path().join("a")).unwrap();
        let piece = || display_piece(&frame(0), &find_fragments(&frame(0)), "walls").unwrap();
        let mut other = piece();
        other.data.cell.push(crate::write::display::scalar_attribute("face_slope", vec![0.0; 6]));
        file.append(0.0, piece()).unwrap();
        let message = file.append(0.5, other).unwrap_err().to_string();
        assert!(
            message.contains("arrays: id, force, moment, face_slope at 0.5 s; expected id, force, moment"),
            "{message}"
        );
        file.append(0.5, piece()).unwrap();
    }

    #[test]
    fn no_file_appears_unless_it_is_finished() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = VtkhdfFile::create(&folder.path().join("a")).unwrap();
        file.append(0.0, display_piece(&frame(1), &find_fragments(&frame(1)), "grains").unwrap()).unwrap();
        drop(file);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
