//! Gmsh's MSH, versions 2 and 4.1, as text or binary in either order of bytes ("Gmsh Reference Manual", file formats):
//! the sections `$Nodes` and `$Elements`. Geometry, groups, partitions and data say nothing about the shape.

use kerf_physics::scene::TriangleMesh;

use super::cells::{Cells, Shape};
use super::number;

pub(super) fn parse(bytes: &[u8]) -> Result<TriangleMesh, String> {
    let mut input = Input { whole: bytes, at: 0, encoding: Encoding::Text };
    let mut mesh = Mesh::default();
    mesh.read(&mut input).map_err(|message| format!("{}: {message}", input.place()))?;
    if mesh.tags.is_empty() {
        return Err("the file has no section $Nodes with nodes".into());
    }
    mesh.cells.surface()
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Encoding {
    Text,
    Binary { is_big: bool, is_wide: bool },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Version {
    Two,
    FourOne,
}

/// A file, and how far it is read.
struct Input<'a> {
    whole: &'a [u8],
    at: usize,
    encoding: Encoding,
}

impl<'a> Input<'a> {
    fn rest(&self) -> &'a [u8] {
        &self.whole[self.at..]
    }

    /// Where reading stands, for people.
    fn place(&self) -> String {
        match self.encoding {
            Encoding::Text => {
                let before = &self.whole[..self.at];
                format!("line {}", before.iter().filter(|byte| **byte == b'\n').count() + 1)
            }
            Encoding::Binary { .. } => format!("byte {}", self.at),
        }
    }

    fn skip_space(&mut self) {
        self.at += self.rest().len() - self.rest().trim_ascii_start().len();
    }

    /// The next word of text, which is not the name of a section.
    fn word(&mut self) -> Result<&'a str, String> {
        self.skip_space();
        let rest = self.rest();
        let word = &rest[..rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len())];
        match word {
            [] => Err("the file is cut off here; export it again".into()),
            [b'$', ..] => Err("the section ends before all that it promises".into()),
            _ => {
                let text = str::from_utf8(word).map_err(|_| "is not text in UTF-8")?;
                self.at += word.len();
                Ok(text)
            }
        }
    }

    /// So many bytes of a binary file.
    fn bytes<const N: usize>(&mut self, is_big: bool) -> Result<[u8; N], String> {
        let mut bytes = *self.rest().first_chunk::<N>().ok_or("the file is cut off here; export it again")?;
        self.at += N;
        if is_big {
            bytes.reverse();
        }
        Ok(bytes)
    }

    /// A number of type `int`.
    fn int(&mut self) -> Result<i64, String> {
        match self.encoding {
            Encoding::Text => self.whole_number().map(|number: i32| number.into()),
            Encoding::Binary { is_big, .. } => Ok(i32::from_le_bytes(self.bytes(is_big)?).into()),
        }
    }

    /// A number of type `int` that counts something.
    fn int_count(&mut self) -> Result<u64, String> {
        let count = self.int()?;
        u64::try_from(count).map_err(|_| format!("{count} is not a number of things"))
    }

    /// A number of type `size_t`.
    fn size(&mut self) -> Result<u64, String> {
        match self.encoding {
            Encoding::Text => self.whole_number(),
            Encoding::Binary { is_big, is_wide: true } => Ok(u64::from_le_bytes(self.bytes(is_big)?)),
            Encoding::Binary { is_big, is_wide: false } => Ok(u32::from_le_bytes(self.bytes(is_big)?).into()),
        }
    }

    fn whole_number<T: std::str::FromStr>(&mut self) -> Result<T, String> {
        let word = self.word()?;
        word.parse().map_err(|_| format!("`{word}` is not a whole number of the range that it may have here"))
    }

    fn float(&mut self) -> Result<f64, String> {
        match self.encoding {
            Encoding::Text => number(self.word()?),
            Encoding::Binary { is_big, .. } => Ok(f64::from_le_bytes(self.bytes(is_big)?)),
        }
    }

    fn position(&mut self) -> Result<[f64; 3], String> {
        Ok([self.float()?, self.float()?, self.float()?])
    }

    /// The name of the next section; `None` at the end of the file.
    fn section(&mut self) -> Result<Option<&'a str>, String> {
        self.skip_space();
        let rest = self.rest();
        if rest.is_empty() {
            return Ok(None);
        }
        let line = &rest[..rest.iter().position(|byte| *byte == b'\n').unwrap_or(rest.len())];
        let name = str::from_utf8(line).ok().and_then(|line| line.trim_end().strip_prefix('$'));
        let name = name.ok_or("the name of a section, as $Nodes, belongs here")?;
        // One byte of an end of line: what follows it may be binary.
        self.at += (line.len() + 1).min(rest.len());
        Ok(Some(name))
    }

    fn end_of(&mut self, name: &str) -> Result<(), String> {
        self.skip_space();
        let end = format!("$End{name}");
        if !self.rest().starts_with(end.as_bytes()) {
            return Err(format!("`{end}` belongs here, after all that the section promises"));
        }
        self.at += end.len();
        Ok(())
    }

    /// Goes to the end of a section that is not read.
    fn skip(&mut self, name: &str) -> Result<(), String> {
        let end = format!("$End{name}");
        let found = self.rest().windows(end.len()).position(|window| window == end.as_bytes());
        self.at += found.ok_or_else(|| format!("the file is cut off: it ends before `{end}`; export it again"))?;
        self.end_of(name)
    }
}

/// What is read of a file.
#[derive(Default)]
struct Mesh {
    cells: Cells,
    /// Each node's tag and its vertex, by tag once all are read.
    tags: Vec<(u64, u32)>,
}

impl Mesh {
    fn read(&mut self, input: &mut Input<'_>) -> Result<(), String> {
        if input.section()? != Some("MeshFormat") {
            return Err("a file of Gmsh begins with `$MeshFormat`".into());
        }
        let version = format(input)?;
        while let Some(name) = input.section()? {
            match (name, version) {
                ("Nodes", Version::Two) => self.nodes_2(input)?,
                ("Nodes", Version::FourOne) => self.nodes_4(input)?,
                ("Elements", Version::Two) => self.elements_2(input)?,
                ("Elements", Version::FourOne) => self.elements_4(input)?,
                _ => {
                    input.skip(name)?;
                    continue;
                }
            }
            input.end_of(name)?;
            if name == "Nodes" {
                self.tags.sort_unstable();
                if let Some([(tag, _), _]) = self.tags.windows(2).find(|pair| pair[0].0 == pair[1].0) {
                    return Err(format!("node {tag} is there twice"));
                }
            }
        }
        Ok(())
    }

    fn push_node(&mut self, tag: u64, position: [f64; 3]) -> Result<(), String> {
        let vertex = u32::try_from(self.cells.vertices()).map_err(|_| "there are more than 2^32 nodes")?;
        self.cells.push_vertex(position).map_err(|message| format!("node {tag}: {message}"))?;
        self.tags.push((tag, vertex));
        Ok(())
    }

    /// Adds an element, whose nodes are read into `nodes` by their tags.
    fn push_element(&mut self, element: u64, shape: Shape, nodes: &mut Vec<u32>, tags: &[u64]) -> Result<(), String> {
        nodes.clear();
        for tag in tags {
            let found = self.tags.binary_search_by_key(tag, |(tag, _)| *tag);
            let found =
                found.map_err(|_| format!("element {element} names node {tag}, which the file does not have"))?;
            nodes.push(self.tags[found].1);
        }
        self.cells.push(shape, nodes).map_err(|message| format!("element {element}: {message}"))
    }

    fn nodes_2(&mut self, input: &mut Input<'_>) -> Result<(), String> {
        for _ in 0..count_2(input)? {
            let tag = input.int_count()?;
            let position = input.position()?;
            self.push_node(tag, position)?;
        }
        Ok(())
    }

    fn elements_2(&mut self, input: &mut Input<'_>) -> Result<(), String> {
        let (mut vertices, mut nodes) = (Vec::new(), Vec::new());
        let mut left = count_2(input)?;
        while left > 0 {
            // As text each element tells its type, in a binary file many together do.
            let as_text = (input.encoding == Encoding::Text).then(|| input.int_count()).transpose()?;
            let (shape, nodes_each) = element_type(input.int()?)?;
            let together = if as_text.is_some() { 1 } else { input.int_count()? };
            let groups = input.int_count()?;
            left = left.checked_sub(together).ok_or("there are more elements than the section promises")?;
            for _ in 0..together {
                let element = as_text.map_or_else(|| input.int_count(), Ok)?;
                for _ in 0..groups {
                    input.int()?;
                }
                nodes.clear();
                for _ in 0..nodes_each {
                    nodes.push(input.int_count()?);
                }
                self.push_element(element, shape, &mut vertices, &nodes)?;
            }
        }
        Ok(())
    }

    fn nodes_4(&mut self, input: &mut Input<'_>) -> Result<(), String> {
        let (blocks, promised) = (input.size()?, input.size()?);
        let _tags = (input.size()?, input.size()?);
        let mut read = 0u64;
        for _ in 0..blocks {
            let (dimension, _entity) = (input.int_count()?, input.int()?);
            let parameters = if input.int()? == 0 { 0 } else { dimension };
            let nodes = input.size()?;
            // What a file cannot have is found as it ends, before memory is taken for it.
            let mut tags = Vec::new();
            for _ in 0..nodes {
                tags.push(input.size()?);
            }
            for tag in tags {
                let position = input.position()?;
                for _ in 0..parameters {
                    input.float()?;
                }
                self.push_node(tag, position)?;
                read += 1;
            }
        }
        as_promised("nodes", read, promised)
    }

    fn elements_4(&mut self, input: &mut Input<'_>) -> Result<(), String> {
        let (mut vertices, mut nodes) = (Vec::new(), Vec::new());
        let (blocks, promised) = (input.size()?, input.size()?);
        let _tags = (input.size()?, input.size()?);
        let mut read = 0u64;
        for _ in 0..blocks {
            let _entity = (input.int()?, input.int()?);
            let (shape, nodes_each) = element_type(input.int()?)?;
            for _ in 0..input.size()? {
                let element = input.size()?;
                nodes.clear();
                for _ in 0..nodes_each {
                    nodes.push(input.size()?);
                }
                self.push_element(element, shape, &mut vertices, &nodes)?;
                read += 1;
            }
        }
        as_promised("elements", read, promised)
    }
}

fn as_promised(what: &str, read: u64, promised: u64) -> Result<(), String> {
    if read == promised { Ok(()) } else { Err(format!("the section promises {promised} {what} and has {read}")) }
}

/// Reads the section that says what the others are like.
fn format(input: &mut Input<'_>) -> Result<Version, String> {
    let word = input.word()?;
    let version = match word {
        "2" | "2.0" | "2.1" | "2.2" => Version::Two,
        "4.1" => Version::FourOne,
        other => {
            let known = "2.2 and 4.1 are read; Gmsh writes them with -format msh22 and -format msh41";
            return Err(format!("`{other}` is not a version that is read: {known}"));
        }
    };
    let (is_binary, bytes) = (input.int()?, input.int()?);
    let is_wide = match (bytes, version) {
        (8, _) => true,
        (4, Version::FourOne) => false,
        _ => return Err(format!("data-size is {bytes} bytes; 8 are read")),
    };
    match is_binary {
        0 => {}
        1 => {
            // Binary numbers begin behind the end of the line.
            let line = input.rest().iter().position(|byte| *byte == b'\n');
            input.at += line.ok_or("the file is cut off here; export it again")? + 1;
            let one: [u8; 4] = input.bytes(false)?;
            let is_big = match one {
                [1, 0, 0, 0] => false,
                [0, 0, 0, 1] => true,
                _ => return Err("the order of bytes is told by a 1, which is not there".into()),
            };
            input.encoding = Encoding::Binary { is_big, is_wide };
        }
        other => return Err(format!("file-type is {other}; 0 is text, 1 is binary")),
    }
    input.end_of("MeshFormat")?;
    Ok(version)
}

/// How many nodes or elements a section of version 2 has: text on a line of its own, in binary files too.
fn count_2(input: &mut Input<'_>) -> Result<u64, String> {
    let count = input.whole_number()?;
    if input.encoding != Encoding::Text {
        let line = input.rest().iter().position(|byte| *byte == b'\n');
        input.at += line.ok_or("the file is cut off here; export it again")? + 1;
    }
    Ok(count)
}

/// The shape of a type of elements, and how many nodes it has.
fn element_type(number: i64) -> Result<(Shape, usize), String> {
    Ok(match number {
        15 => (Shape::Thin, 1),
        1 => (Shape::Thin, 2),
        8 => (Shape::Thin, 3),
        26 => (Shape::Thin, 4),
        27 => (Shape::Thin, 5),
        28 => (Shape::Thin, 6),
        2 => (Shape::Triangle, 3),
        9 => (Shape::Triangle, 6),
        20 => (Shape::Triangle, 9),
        21 => (Shape::Triangle, 10),
        22 => (Shape::Triangle, 12),
        23 | 24 => (Shape::Triangle, 15),
        25 => (Shape::Triangle, 21),
        3 => (Shape::Quadrilateral, 4),
        16 => (Shape::Quadrilateral, 8),
        10 => (Shape::Quadrilateral, 9),
        4 => (Shape::Tetrahedron, 4),
        11 => (Shape::Tetrahedron, 10),
        29 => (Shape::Tetrahedron, 20),
        30 => (Shape::Tetrahedron, 35),
        31 => (Shape::Tetrahedron, 56),
        5 => (Shape::Hexahedron, 8),
        17 => (Shape::Hexahedron, 20),
        12 => (Shape::Hexahedron, 27),
        92 => (Shape::Hexahedron, 64),
        93 => (Shape::Hexahedron, 125),
        6 => (Shape::Wedge, 6),
        18 => (Shape::Wedge, 15),
        13 => (Shape::Wedge, 18),
        7 => (Shape::Pyramid, 5),
        19 => (Shape::Pyramid, 13),
        14 => (Shape::Pyramid, 14),
        other => return Err(format!("element type {other} is not read; export linear or quadratic elements")),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO: &[u8] = include_bytes!("../../../../tests/corpus/box-22-text.msh");
    const TWO_BINARY: &[u8] = include_bytes!("../../../../tests/corpus/box-22-binary.msh");
    const FOUR: &[u8] = include_bytes!("../../../../tests/corpus/box-41-text.msh");
    const FOUR_BINARY: &[u8] = include_bytes!("../../../../tests/corpus/box-41-binary.msh");

    fn told(file: &[u8], right: &str, wrong: &str) -> String {
        let text = str::from_utf8(file).unwrap();
        let changed = text.replacen(right, wrong, 1);
        assert_ne!(text, changed);
        parse(changed.as_bytes()).unwrap_err()
    }

    #[test]
    fn what_is_wrong_is_told_with_its_line() {
        for (file, right, wrong, expected) in [
            (TWO, "9 0 1 1.5", "9 0 1 nan", "line 19: `nan` is not a finite number"),
            (TWO, "9 0 1 1.5", "9 0 1", "line 21: `0.5` is not a whole number of the range that it may have here"),
            (TWO, "9 0 1 1.5", "8 0 1 1.5", "line 23: node 8 is there twice"),
            (TWO, "$Nodes\n12", "$Nodes\n13", "line 23: the section ends before all that it promises"),
            (
                TWO,
                "$Nodes\n12",
                "$Nodes\n18446744073709551615",
                "line 23: the section ends before all that it promises",
            ),
            (TWO, "$Nodes\n12", "$Nodes\n-1", "line 10: `-1` is not a whole number of the range that it may have here"),
            (TWO, "9 4 3 10", "9 4 3 99", "line 26: element 1 names node 99, which the file does not have"),
            (TWO, "9 4 3 10", "9 4 3 -1", "line 26: -1 is not a number of things"),
            (TWO, "1 4 2", "1 34 2", "line 26: element type 34 is not read; export linear or quadratic elements"),
            (
                TWO,
                "$Elements\n36",
                "$Elements\n35",
                "line 61: `$EndElements` belongs here, after all that the section promises",
            ),
            (TWO, "$EndElements", "", "line 63: `$EndElements` belongs here, after all that the section promises"),
            (
                TWO,
                "2.2 0 8",
                "4 0 8",
                "line 2: `4` is not a version that is read: 2.2 and 4.1 are read; Gmsh writes them with -format msh22 and -format msh41",
            ),
            (TWO, "2.2 0 8", "2.2 0 4", "line 2: data-size is 4 bytes; 8 are read"),
            (TWO, "2.2 0 8", "2.2 2 8", "line 2: file-type is 2; 0 is text, 1 is binary"),
            (TWO, "$MeshFormat", "$Mesh", "line 2: a file of Gmsh begins with `$MeshFormat`"),
            (
                TWO,
                "$EndPhysicalNames",
                "",
                "line 5: the file is cut off: it ends before `$EndPhysicalNames`; export it again",
            ),
            (FOUR, "13 12 1 12", "13 11 1 12", "line 77: the section promises 11 nodes and has 12"),
            (
                FOUR,
                "13 12 1 12",
                "18446744073709551615 12 1 12",
                "line 78: the section ends before all that it promises",
            ),
            (
                FOUR,
                "0 1 0 1",
                "0 1 0 4294967296",
                "line 67: `1.5` is not a whole number of the range that it may have here",
            ),
            (FOUR, "1 18 1 18", "1 19 1 18", "line 99: the section promises 19 elements and has 18"),
            (FOUR, "3 1 4 18", "3 1 4 17", "line 98: the section promises 18 elements and has 17"),
            (FOUR, "9 4 3 10", "9 4 3 99", "line 82: element 1 names node 99, which the file does not have"),
        ] {
            assert_eq!(told(file, right, wrong), expected, "{wrong}");
        }
    }

    #[test]
    fn binary_files_that_are_cut_off_are_refused_at_every_length() {
        for file in [TWO, TWO_BINARY, FOUR, FOUR_BINARY] {
            parse(file).unwrap();
            for length in (0..file.trim_ascii_end().len()).step_by(5) {
                parse(&file[..length]).unwrap_err();
            }
        }
    }
}
