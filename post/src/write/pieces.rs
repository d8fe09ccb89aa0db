//! `DISPLAY/KIND-NNNNNN.pvtp`: polygonal data of one time in several files, each with a range of the cells.
//!
//! A piece has the points of its cells alone; a point of cells in two pieces is in both.

use std::collections::HashMap;
use std::fmt::Write;
use std::ops::Range;

use vtkio::model::{Attribute, Attributes, DataArray, IOBuffer, PolyDataPiece, VertexNumbers};

use crate::write::display::vertex_numbers;
use crate::write::vtp::typed_bytes;

/// Cells of one category.
#[derive(Default)]
struct CellList {
    /// Points of all cells, one after the other.
    connectivity: Vec<u64>,
    /// End of each cell in `connectivity`.
    ends: Vec<u64>,
}

impl CellList {
    fn new(cells: &Option<VertexNumbers>) -> CellList {
        let (connectivity, ends) = cells.clone().map(VertexNumbers::into_xml).unwrap_or_default();
        CellList { connectivity, ends }
    }

    /// Points of each cell of a range.
    fn cells(&self, range: Range<usize>) -> impl Iterator<Item = &[u64]> {
        let end = |cells: usize| if cells == 0 { 0 } else { self.ends[cells - 1] as usize };
        range.map(move |cell| &self.connectivity[end(cell)..end(cell + 1)])
    }
}

/// Divides data into pieces of at most `max_cells` cells, in their order; data without cells are one piece.
///
/// # Panics
///
/// If `max_cells` is 0, or there are strips, which no kind of file has.
pub fn split_piece(piece: &PolyDataPiece, max_cells: usize) -> impl Iterator<Item = PolyDataPiece> {
    assert!(piece.strips.is_none(), "no kind of file has strips");
    // In the order of VTK's cells.
    let lists = [&piece.verts, &piece.lines, &piece.polys].map(CellList::new);
    let count = lists.iter().map(|list| list.ends.len()).sum::<usize>();
    (0..count.max(1))
        .step_by(max_cells)
        .map(move |first| cell_range(piece, &lists, first..count.min(first.saturating_add(max_cells))))
}

/// Piece with the cells of a range, counted over all categories.
fn cell_range(piece: &PolyDataPiece, lists: &[CellList; 3], range: Range<usize>) -> PolyDataPiece {
    let mut cells_before = 0;
    let ranges = lists.each_ref().map(|list| {
        let list_row = |row: usize| row.saturating_sub(cells_before).min(list.ends.len());
        let list_range = list_row(range.start)..list_row(range.end);
        cells_before += list.ends.len();
        list_range
    });
    let all = lists.iter().zip(&ranges).flat_map(|(list, range)| list.cells(range.clone()));
    let mut points: Vec<u64> = all.flatten().copied().collect();
    points.sort_unstable();
    points.dedup();
    let piece_numbers: HashMap<u64, u64> = points.iter().copied().zip(0..).collect();
    let [verts, lines, polys] = [0, 1, 2].map(|category| {
        let cells = lists[category].cells(ranges[category].clone());
        vertex_numbers(cells.map(|cell| cell.iter().map(|point| piece_numbers[point]).collect::<Vec<u64>>()))
    });
    let point_rows: Vec<usize> = points.iter().map(|&point| point as usize).collect();
    let cell_rows: Vec<usize> = range.collect();
    PolyDataPiece {
        points: selected_rows(&piece.points, &point_rows, 3),
        verts,
        lines,
        polys,
        strips: None,
        data: Attributes {
            point: selected_attributes(&piece.data.point, &point_rows),
            cell: selected_attributes(&piece.data.cell, &cell_rows),
        },
    }
}

fn selected_attributes(attributes: &[Attribute], rows: &[usize]) -> Vec<Attribute> {
    let arrays = attributes.iter().filter_map(|attribute| match attribute {
        Attribute::DataArray(array) => Some(array),
        Attribute::Field { .. } => None,
    });
    let selected_array = |array: &DataArray| DataArray {
        data: selected_rows(&array.data, rows, array.elem.num_comp() as usize),
        ..array.clone()
    };
    arrays.map(selected_array).map(Attribute::DataArray).collect()
}

/// Rows of `components` numbers each.
fn selected_rows(numbers: &IOBuffer, rows: &[usize], components: usize) -> IOBuffer {
    fn select<T: Copy>(numbers: &[T], rows: &[usize], components: usize) -> Vec<T> {
        rows.iter().flat_map(|row| &numbers[row * components..(row + 1) * components]).copied().collect()
    }
    match numbers {
        IOBuffer::F64(values) => select(values, rows, components).into(),
        IOBuffer::U64(values) => select(values, rows, components).into(),
        IOBuffer::U32(values) => select(values, rows, components).into(),
        IOBuffer::U16(values) => select(values, rows, components).into(),
        IOBuffer::U8(values) => select(values, rows, components).into(),
        other => unreachable!("no array for ParaView has the type {:?}", other.scalar_type()),
    }
}

/// The `.pvtp` file: arrays as in `piece`, and the names of the files of the pieces.
pub fn pvtp_text(piece: &PolyDataPiece, files: &[String]) -> String {
    let mut text = String::from(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"PPolyData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n<PPolyData GhostLevel=\"0\">\n",
    );
    for (tag, attributes) in [("PPointData", &piece.data.point), ("PCellData", &piece.data.cell)] {
        writeln!(text, "<{tag}>").expect("writing to a string");
        for attribute in attributes {
            let Attribute::DataArray(DataArray { name, elem, data }) = attribute else { continue };
            let (kind, components) = (typed_bytes(data).0, elem.num_comp());
            writeln!(text, "<PDataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\"/>")
                .expect("writing to a string");
        }
        writeln!(text, "</{tag}>").expect("writing to a string");
    }
    text += "<PPoints>\n<PDataArray type=\"Float64\" Name=\"Points\" NumberOfComponents=\"3\"/>\n</PPoints>\n";
    for file in files {
        writeln!(text, "<Piece Source=\"{file}\"/>").expect("writing to a string");
    }
    text + "</PPolyData>\n</VTKFile>\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::derive::fragments::find_fragments;
    use crate::math::Vec3;
    use crate::samples::Scene;
    use crate::write::display::{FILE_KINDS, display_piece};

    fn f64s(numbers: &IOBuffer) -> &[f64] {
        match numbers {
            IOBuffer::F64(values) => values,
            other => panic!("{other:?}"),
        }
    }

    /// Coordinates of the points of each cell, in the order of the categories.
    fn drawn_cells(piece: &PolyDataPiece) -> Vec<Vec<Vec<f64>>> {
        let points: Vec<&[f64]> = f64s(&piece.points).chunks(3).collect();
        let lists = [&piece.verts, &piece.lines, &piece.polys].map(CellList::new);
        let cells = lists.iter().flat_map(|list| list.cells(0..list.ends.len()));
        cells.map(|cell| cell.iter().map(|&k| points[k as usize].to_vec()).collect()).collect()
    }

    #[test]
    fn pieces_have_the_cells_and_arrays_of_the_whole() {
        let mut scene = Scene::default();
        let (a, b) = (scene.grain([0.0; 3], 1.0), scene.grain([2.0, 0.0, 0.0], 1.0));
        let cube = scene.cube([0.0, 0.0, 3.0], 1.0);
        scene.plate([0.0, 0.0, -1.1], [1.0, 1.0, 0.1]);
        scene.contact_at(a, b, [1.0, 0.0, 0.0], -Vec3::x());
        scene.contact_at(a, cube, [0.0, 0.0, 1.0], Vec3::z());
        let frame = scene.frame();
        for kind in FILE_KINDS {
            let whole = display_piece(&frame, &find_fragments(&frame), kind).unwrap();
            let count = drawn_cells(&whole).len();
            for max_cells in 1..=count {
                let pieces: Vec<PolyDataPiece> = split_piece(&whole, max_cells).collect();
                assert_eq!(pieces.len(), count.div_ceil(max_cells), "{kind}");
                assert_eq!(pieces.iter().flat_map(drawn_cells).collect::<Vec<_>>(), drawn_cells(&whole), "{kind}");
                for (k, attribute) in whole.data.cell.iter().enumerate() {
                    let Attribute::DataArray(array) = attribute else { panic!() };
                    let rows = pieces.iter().map(|piece| match &piece.data.cell[k] {
                        Attribute::DataArray(of_piece) => of_piece.data.len(),
                        Attribute::Field { .. } => panic!(),
                    });
                    assert_eq!(rows.sum::<usize>(), array.data.len(), "{kind} {}", array.name);
                }
            }
        }
        let grains = display_piece(&frame, &find_fragments(&frame), "grains").unwrap();
        let radii = |piece: &PolyDataPiece| match &piece.data.point[0] {
            Attribute::DataArray(array) => f64s(&array.data).to_vec(),
            Attribute::Field { .. } => panic!(),
        };
        assert_eq!(split_piece(&grains, 2).flat_map(|piece| radii(&piece)).collect::<Vec<_>>(), radii(&grains));
        let empty = display_piece(&Scene::default().frame(), &[], "contacts").unwrap();
        assert_eq!(split_piece(&empty, 1).map(|piece| drawn_cells(&piece).len()).collect::<Vec<_>>(), [0]);
        let text = pvtp_text(&grains, &["a.vtp".into(), "b.vtp".into()]);
        assert!(text.contains("<PDataArray type=\"Float64\" Name=\"stress\" NumberOfComponents=\"9\"/>"), "{text}");
        assert!(text.contains("<Piece Source=\"a.vtp\"/>\n<Piece Source=\"b.vtp\"/>\n"), "{text}");
    }
}
