//! VTK's XML files of unstructured grids (`.vtu`) and of polygons (`.vtp`): vertices and cells, with numbers as words, as
//! base64 or behind the XML, packed by zlib or not ("VTK File Formats", VTK documentation). Data at points and cells,
//! points and lines say nothing about the shape.

mod document;
mod numbers;

use kerf_physics::scene::TriangleMesh;

use self::document::{Document, Piece, Section};
use self::numbers::Numbers;
use super::cells::{Cells, Shape};
use super::index;

pub(super) fn parse(bytes: &[u8], max_numbers: u64) -> Result<TriangleMesh, String> {
    let document = Document::read(bytes)?;
    let mut numbers = Numbers { packing: document.packing, appended: document.appended, left: max_numbers };
    let mut cells = Cells::default();
    for (number, piece) in document.pieces.iter().enumerate() {
        read_piece(&mut numbers, piece, &mut cells).map_err(|message| format!("piece {number}: {message}"))?;
    }
    cells.surface()
}

fn read_piece(numbers: &mut Numbers<'_>, piece: &Piece<'_>, cells: &mut Cells) -> Result<(), String> {
    let first = cells.vertices();
    if piece.points > 0 {
        let array = piece.array(Section::Points, None).ok_or("Points has no array")?;
        let coordinates = numbers.of(array).map_err(|message| format!("Points: {message}"))?;
        let (points, rest) = coordinates.as_chunks::<3>();
        if points.len() as u64 != piece.points || !rest.is_empty() {
            let found = coordinates.len();
            return Err(format!("Points has {found} numbers, not the three each of {} points", piece.points));
        }
        for (number, point) in points.iter().enumerate() {
            cells.push_vertex(*point).map_err(|message| format!("point {number}: {message}"))?;
        }
    }
    u32::try_from(cells.vertices()).map_err(|_| "there are more than 2^32 points")?;
    let of_section = |section, name| Part { piece, section, name, first: first as u32 };
    if let Some(part) = of_section(Section::Cells, "Cells").in_piece() {
        let types = part.numbers_of(numbers, "types")?;
        let promised = piece.cells;
        if types.len() as u64 != promised {
            return Err(format!("Cells: types has {} entries, not one for each of {promised} cells", types.len()));
        }
        let mut types = types.into_iter();
        let read = part.each(numbers, |corners| push_typed(cells, types.next().unwrap_or_default(), corners))?;
        if read as u64 != promised {
            return Err(format!("Cells: offsets has {read} entries, not one for each of {promised} cells"));
        }
    }
    if let Some(part) = of_section(Section::Polygons, "Polys").in_piece() {
        part.each(numbers, |corners| cells.push_polygon(corners))?;
    }
    if let Some(part) = of_section(Section::Strips, "Strips").in_piece() {
        part.each(numbers, |corners| cells.push_strip(corners))?;
    }
    Ok(())
}

/// Cells of one section of a piece.
struct Part<'a> {
    piece: &'a Piece<'a>,
    section: Section,
    name: &'static str,
    /// The piece's first vertex.
    first: u32,
}

impl Part<'_> {
    /// Nothing where the piece has none of these arrays, as one without cells may.
    fn in_piece(self) -> Option<Self> {
        self.piece.array(self.section, None).is_some().then_some(self)
    }

    fn numbers_of(&self, numbers: &mut Numbers<'_>, name: &str) -> Result<Vec<f64>, String> {
        let array = self.piece.array(self.section, Some(name));
        let array = array.ok_or_else(|| format!("{} has no array {name}", self.name))?;
        numbers.of(array).map_err(|message| format!("{}: {name}: {message}", self.name))
    }

    /// Gives the vertices of each cell, and tells how many cells there are.
    fn each(
        &self,
        numbers: &mut Numbers<'_>,
        mut push: impl FnMut(&[u32]) -> Result<(), String>,
    ) -> Result<usize, String> {
        let connectivity = self.numbers_of(numbers, "connectivity")?;
        let offsets = self.numbers_of(numbers, "offsets")?;
        let (mut begin, mut corners) = (0, Vec::new());
        for (cell, offset) in offsets.iter().enumerate() {
            let at = |message: String| format!("{}: cell {cell}: {message}", self.name);
            let end = index(*offset).map(|end| end as usize);
            let nodes = end.and_then(|end| connectivity.get(begin..end)).ok_or_else(|| {
                at(format!("it ends at {offset}, which is not between {begin} and {}", connectivity.len()))
            })?;
            corners.clear();
            for node in nodes {
                let known = index(*node).filter(|node| u64::from(*node) < self.piece.points);
                corners.push(
                    self.first
                        + known
                            .ok_or_else(|| at(format!("it names point {node}; the piece has {}", self.piece.points)))?,
                );
            }
            push(&corners).map_err(at)?;
            begin += nodes.len();
        }
        if begin != connectivity.len() {
            let all = connectivity.len();
            return Err(format!("{}: connectivity has {all} entries, and offsets ends at {begin}", self.name));
        }
        Ok(offsets.len())
    }
}

/// Adds a cell of a type of VTK (vtkCellType.h).
fn push_typed(cells: &mut Cells, number: f64, nodes: &[u32]) -> Result<(), String> {
    // How many nodes a cell has, where its type says so: those of any order do not.
    let (shape, exactly) = match index(number).unwrap_or_default() {
        1 | 3 | 21 | 35 | 2 | 4 | 68 | 75 => (Shape::Thin, None),
        5 => (Shape::Triangle, Some(3)),
        22 => (Shape::Triangle, Some(6)),
        34 => (Shape::Triangle, Some(7)),
        69 | 76 => (Shape::Triangle, None),
        6 => return cells.push_strip(nodes),
        7 => return cells.push_polygon(nodes),
        8 => match nodes {
            [a, b, c, d] => return cells.push(Shape::Quadrilateral, &[*a, *b, *d, *c]),
            _ => (Shape::Quadrilateral, Some(4)),
        },
        9 => (Shape::Quadrilateral, Some(4)),
        30 => (Shape::Quadrilateral, Some(6)),
        23 => (Shape::Quadrilateral, Some(8)),
        28 => (Shape::Quadrilateral, Some(9)),
        70 | 77 => (Shape::Quadrilateral, None),
        10 => (Shape::Tetrahedron, Some(4)),
        24 => (Shape::Tetrahedron, Some(10)),
        71 | 78 => (Shape::Tetrahedron, None),
        11 => match nodes {
            [a, b, c, d, e, f, g, h] => return cells.push(Shape::Hexahedron, &[*a, *b, *d, *c, *e, *f, *h, *g]),
            _ => (Shape::Hexahedron, Some(8)),
        },
        12 => (Shape::Hexahedron, Some(8)),
        25 => (Shape::Hexahedron, Some(20)),
        33 => (Shape::Hexahedron, Some(24)),
        29 => (Shape::Hexahedron, Some(27)),
        72 | 79 => (Shape::Hexahedron, None),
        13 => (Shape::Wedge, Some(6)),
        31 => (Shape::Wedge, Some(12)),
        26 => (Shape::Wedge, Some(15)),
        32 => (Shape::Wedge, Some(18)),
        73 | 80 => (Shape::Wedge, None),
        14 => (Shape::Pyramid, Some(5)),
        27 => (Shape::Pyramid, Some(13)),
        37 => (Shape::Pyramid, Some(19)),
        74 | 81 => (Shape::Pyramid, None),
        _ => return Err(format!("cell type {number} is not read; export linear or quadratic cells, or their surface")),
    };
    match exactly {
        Some(exactly) if nodes.len() != exactly => {
            Err(format!("a cell of type {number} has {exactly} nodes, not {}", nodes.len()))
        }
        _ => cells.push(shape, nodes),
    }
}

#[cfg(test)]
mod tests {
    use super::super::MAX_NUMBERS;
    use super::*;

    const TEXT: &[u8] = include_bytes!("../../../../../tests/corpus/bar-ascii.vtu");
    const PACKED: &[u8] = include_bytes!("../../../../../tests/corpus/bar-blocks.vtu");
    const FACES: &[u8] = include_bytes!("../../../../../tests/corpus/box-ascii.vtp");
    const INLINE: &[u8] = include_bytes!("../../../../../tests/corpus/bar-inline.vtu");

    /// What is said about a text with something else in it.
    fn told(text: &[u8], right: &str, wrong: &str) -> String {
        let text = str::from_utf8(text).unwrap();
        let changed = text.replacen(right, wrong, 1);
        assert_ne!(text, changed);
        parse(changed.as_bytes(), MAX_NUMBERS).unwrap_err()
    }

    #[test]
    fn what_is_wrong_is_told_with_its_place() {
        for (right, wrong, expected) in [
            ("2.5 0.5", "2.5 nan", "piece 0: Points: `nan` is not a finite number"),
            ("2.5 0.5", "2.5", "piece 0: Points has 77 numbers, not the three each of 26 points"),
            (
                "NumberOfPoints=\"26\"",
                "NumberOfPoints=\"18446744073709551615\"",
                "piece 0: Points has 78 numbers, not the three each of 18446744073709551615 points",
            ),
            (
                "NumberOfPoints=\"26\"",
                "NumberOfPoints=\"many\"",
                "line 4: NumberOfPoints is `many`, which is not a number of things",
            ),
            (
                "NumberOfCells=\"16\"",
                "NumberOfCells=\"17\"",
                "piece 0: Cells: types has 16 entries, not one for each of 17 cells",
            ),
            ("0 4 1 5 3 7", "0 4 1 5 3 26", "piece 0: Cells: cell 0: it names point 26; the piece has 26"),
            ("0 4 1 5 3 7", "0 4 1 5 3 -7", "piece 0: Cells: cell 0: it names point -7; the piece has 26"),
            ("0 4 1 5 3 7", "0 4 1 5 3", "piece 0: Cells: cell 15: it ends at 73, which is not between 72 and 72"),
            ("0 4 1 5 3 7", "0 4 1 5 3 7 7", "piece 0: Cells: connectivity has 74 entries, and offsets ends at 73"),
            ("8 14 20", "8 4 20", "piece 0: Cells: cell 1: it ends at 4, which is not between 8 and 73"),
            ("8 14 20", "8 15 20", "piece 0: Cells: cell 1: a cell of type 13 has 6 nodes, not 7"),
            ("66 70 72 73", "66 70 73", "piece 0: Cells: offsets has 15 entries, not one for each of 16 cells"),
            (
                "11 13 13",
                "11 42 13",
                "piece 0: Cells: cell 1: cell type 42 is not read; export linear or quadratic cells, or their surface",
            ),
            ("\"types\"", "\"sorts\"", "piece 0: Cells has no array types"),
            (
                "Float64",
                "Float80",
                "line 10: array Points: `Float80` is not a type of numbers, as Float32 or Int64 are",
            ),
            (
                "format=\"ascii\"",
                "format=\"hex\"",
                "line 10: array Points: format is `hex`; ascii, binary and appended are read",
            ),
            (
                "LittleEndian",
                "MiddleEndian",
                "line 2: byte_order is `MiddleEndian`; LittleEndian and BigEndian are read",
            ),
            ("UInt32", "UInt16", "line 2: header_type is `UInt16`; UInt32 and UInt64 are read"),
            (
                "UnstructuredGrid",
                "ImageData",
                "line 2: the file is of type `ImageData`; UnstructuredGrid and PolyData are read",
            ),
            (
                "header_type",
                "compressor=\"vtkLZ4DataCompressor\" header_type",
                "line 2: compressor is `vtkLZ4DataCompressor`; vtkZLibDataCompressor is read: export it so, or not packed",
            ),
            ("</VTKFile>", "", "the file is cut off: it does not end with `</VTKFile>`; export it again"),
        ] {
            assert_eq!(told(TEXT, right, wrong), expected, "{wrong}");
        }
        let mismatched = told(TEXT, "</Cells>", "</Cell>");
        assert!(mismatched.starts_with("line 60: ill-formed document"), "{mismatched}");
        // The last array is that of the polygons.
        let (before, behind) = str::from_utf8(FACES).unwrap().rsplit_once("offsets").unwrap();
        let without = format!("{before}beginnings{behind}");
        assert_eq!(parse(without.as_bytes(), MAX_NUMBERS), Err("piece 0: Polys has no array offsets".into()));
    }

    #[test]
    fn a_file_may_not_unpack_to_more_numbers_than_the_limit_before_it_takes_memory_for_them() {
        // 78 coordinates, 73 nodes, 16 offsets, 16 types.
        assert!(parse(PACKED, 183).is_ok());
        let told = parse(PACKED, 182).unwrap_err();
        assert!(told.ends_with("its header promises 16 numbers; 15 are left of those that a file may have"), "{told}");
        let begin = PACKED.windows(2).position(|bytes| bytes == b" _").unwrap() + 2;
        // How many blocks there are, how long, how long the last one is, and how long the first is when packed.
        for (at, expected) in [
            (0, "its header promises"),
            (8, "its header promises"),
            (16, "its header promises"),
            (24, "the array is cut off"),
        ] {
            let mut bytes = PACKED.to_vec();
            bytes[begin + at..begin + at + 7].fill(0xff);
            let told = parse(&bytes, MAX_NUMBERS).unwrap_err();
            assert!(told.starts_with("piece 0: Points: ") && told.contains(expected), "{at}: {told}");
        }
        // A length without blocks, of which there is none.
        let mut bytes = INLINE.to_vec();
        let text = bytes.windows(4).position(|window| window == b"AAAC").unwrap();
        bytes[text..text + 4].copy_from_slice(b"//8A");
        let told = parse(&bytes, MAX_NUMBERS).unwrap_err();
        assert!(told.contains("its header promises 5368") && told.contains("67108864 are left"), "{told}");
    }

    #[test]
    fn bytes_that_are_cut_off_or_changed_are_refused() {
        for (cut, end) in
            [(PACKED, "\n  </AppendedData>"), (INLINE, "</UnstructuredGrid>"), (TEXT, "</UnstructuredGrid>")]
        {
            let whole = cut.windows(end.len()).rposition(|window| window == end.as_bytes()).unwrap();
            parse(&[&cut[..whole], end.as_bytes(), b"</VTKFile>"].concat(), MAX_NUMBERS).unwrap();
            (1..whole).step_by(7).for_each(|length| {
                parse(&cut[..length], MAX_NUMBERS).unwrap_err();
                parse(&[&cut[..length], end.as_bytes(), b"</VTKFile>"].concat(), MAX_NUMBERS).unwrap_err();
            });
        }
        // Within the first packed block.
        let begin = PACKED.windows(2).position(|bytes| bytes == b"x^").unwrap();
        let mut bytes = PACKED.to_vec();
        bytes[begin + 4..begin + 12].fill(0x55);
        let told = parse(&bytes, MAX_NUMBERS).unwrap_err();
        assert!(told.starts_with("piece 0: Points: block 0: ") && told.ends_with("(zlib)"), "{told}");
        assert!(told_of_appended("offset=\"0\"", "offset=\"9999\"").contains("Points: offset is 9999, and"), "bytes");
        let text = str::from_utf8(INLINE).unwrap().replacen("AAAC", "AA*C", 1);
        let told = parse(text.as_bytes(), MAX_NUMBERS).unwrap_err();
        assert!(told.starts_with("piece 0: Points: ") && told.ends_with("(base64)"), "{told}");
    }

    fn told_of_appended(right: &str, wrong: &str) -> String {
        let text = include_str!("../../../../../tests/corpus/bar-base64-zlib.vtu");
        told(text.as_bytes(), right, wrong)
    }
}
