//! PLY, as text or binary in either order of bytes: the elements `vertex` and `face`.

use kerf_physics::scene::TriangleMesh;

use super::{index, number, push_fan};
use crate::kind::Kind;

pub(super) fn parse(bytes: &[u8]) -> Result<TriangleMesh, String> {
    let header = Header::read(bytes)?;
    let mut rows = Rows { bytes: &bytes[header.bytes..], encoding: header.encoding, line: header.lines };
    let mut mesh = TriangleMesh::default();
    for element in &header.elements {
        element.check()?;
        for index in 0..element.count {
            let mut row = Row::default();
            // Rows of other elements are read too: that is how they are skipped.
            let read = rows.read(element, &mut row).and_then(|()| match element.name.as_str() {
                "vertex" => row.vertex().map(|position| mesh.positions.push(position)),
                "face" => push_fan(&mut mesh, &row.corners),
                _ => Ok(()),
            });
            read.map_err(|message| match header.encoding {
                Encoding::Text => format!("line {}: {message}", rows.line),
                _ => format!("{} {index}: {message}", element.name),
            })?;
        }
    }
    let rest = rows.bytes.trim_ascii().len();
    if rest > 0 {
        return Err(format!("{rest} bytes follow the last row that the header promises; export it again"));
    }
    let count = mesh.positions.len();
    match mesh.triangles.as_flattened().iter().max() {
        Some(vertex) if *vertex as usize >= count => {
            Err(format!("a face names vertex {vertex}; the file's are 0 to {}", count.saturating_sub(1)))
        }
        _ => Ok(mesh),
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Encoding {
    Text,
    LittleEndian,
    BigEndian,
}

/// The type that a word of the header names.
fn kind_of(word: &str) -> Result<Kind, String> {
    Ok(match word {
        "char" | "int8" => Kind::I8,
        "uchar" | "uint8" => Kind::U8,
        "short" | "int16" => Kind::I16,
        "ushort" | "uint16" => Kind::U16,
        "int" | "int32" => Kind::I32,
        "uint" | "uint32" => Kind::U32,
        "float" | "float32" => Kind::F32,
        "double" | "float64" => Kind::F64,
        other => return Err(format!("`{other}` is not a type of PLY, as float or uchar are")),
    })
}

struct Property {
    name: String,
    kind: Kind,
    /// Of the number of entries, where it is a list.
    count: Option<Kind>,
}

struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

impl Element {
    /// Whether it has what it is read for.
    fn check(&self) -> Result<(), String> {
        let has = |wanted: &str| self.properties.iter().any(|p| p.name == wanted && p.count.is_none());
        match self.name.as_str() {
            name if self.properties.is_empty() => Err(format!("header: element {name} has no property")),
            "vertex" => match ["x", "y", "z"].into_iter().find(|axis| !has(axis)) {
                Some(axis) => Err(format!("header: element vertex has no property {axis}")),
                None => Ok(()),
            },
            "face" if !self.properties.iter().any(|p| is_corners(&p.name) && p.count.is_some()) => {
                Err("header: element face has no property list vertex_indices".into())
            }
            _ => Ok(()),
        }
    }
}

fn is_corners(name: &str) -> bool {
    name == "vertex_indices" || name == "vertex_index"
}

struct Header {
    encoding: Encoding,
    elements: Vec<Element>,
    bytes: usize,
    lines: usize,
}

impl Header {
    fn read(bytes: &[u8]) -> Result<Self, String> {
        let mut header = Self { encoding: Encoding::Text, elements: Vec::new(), bytes: 0, lines: 0 };
        for line in bytes.split_inclusive(|byte| *byte == b'\n') {
            header.bytes += line.len();
            header.lines += 1;
            let words: Vec<_> = str::from_utf8(line).unwrap_or_default().split_whitespace().collect();
            if header.lines == 1 && words != ["ply"] {
                return Err("line 1: a PLY file begins with `ply`".into());
            }
            if words == ["end_header"] {
                return Ok(header);
            }
            header.take(&words).map_err(|message| format!("line {}: {message}", header.lines))?;
        }
        Err("the file is cut off: it ends before `end_header`; export it again".into())
    }

    fn take(&mut self, words: &[&str]) -> Result<(), String> {
        match *words {
            ["ply"] | ["comment" | "obj_info", ..] => {}
            ["format", encoding, _] => {
                self.encoding = match encoding {
                    "ascii" => Encoding::Text,
                    "binary_little_endian" => Encoding::LittleEndian,
                    "binary_big_endian" => Encoding::BigEndian,
                    other => return Err(format!("`{other}` is not a format of PLY")),
                }
            }
            ["element", name, count] => {
                let count = count.parse().map_err(|_| format!("`{count}` is not a number of rows"))?;
                self.elements.push(Element { name: name.into(), count, properties: Vec::new() });
            }
            ["property", "list", count, kind, name] => {
                let count = Some(kind_of(count)?);
                self.property(Property { name: name.into(), kind: kind_of(kind)?, count })?;
            }
            ["property", kind, name] => {
                self.property(Property { name: name.into(), kind: kind_of(kind)?, count: None })?;
            }
            _ => return Err(format!("`{}` has no place in the header of a PLY file", words.join(" "))),
        }
        Ok(())
    }

    fn property(&mut self, property: Property) -> Result<(), String> {
        let element = self.elements.last_mut().ok_or("a property stands before the first element")?;
        element.properties.push(property);
        Ok(())
    }
}

/// What is kept of a row.
#[derive(Default)]
struct Row {
    position: [f64; 3],
    corners: Vec<u32>,
}

impl Row {
    fn vertex(&self) -> Result<[f64; 3], String> {
        let is_finite = self.position.iter().all(|x| x.is_finite());
        if is_finite { Ok(self.position) } else { Err("a coordinate is not finite".into()) }
    }

    fn take(&mut self, name: &str, value: f64) -> Result<(), String> {
        match name {
            "x" => self.position[0] = value,
            "y" => self.position[1] = value,
            "z" => self.position[2] = value,
            _ if is_corners(name) => {
                self.corners.push(index(value).ok_or_else(|| format!("{value} is not a vertex"))?);
            }
            _ => {}
        }
        Ok(())
    }
}

/// What is still to be read.
struct Rows<'a> {
    bytes: &'a [u8],
    encoding: Encoding,
    line: usize,
}

impl Rows<'_> {
    fn read(&mut self, element: &Element, row: &mut Row) -> Result<(), String> {
        if self.encoding != Encoding::Text {
            return fill(row, element, |kind| self.binary(kind));
        }
        let mut line = "";
        while line.is_empty() {
            if self.bytes.is_empty() {
                return Err(format!("the file is cut off: a row of `{}` is missing; export it again", element.name));
            }
            let end = self.bytes.iter().position(|byte| *byte == b'\n').map_or(self.bytes.len(), |newline| newline + 1);
            line = str::from_utf8(&self.bytes[..end]).map_err(|_| "is not text in UTF-8".to_owned())?.trim();
            (self.bytes, self.line) = (&self.bytes[end..], self.line + 1);
        }
        let mut words = line.split_whitespace();
        fill(row, element, |_| number(words.next().ok_or("the row ends too early")?))?;
        match words.next() {
            Some(word) => Err(format!("`{word}` follows what a row of `{}` has", element.name)),
            None => Ok(()),
        }
    }

    fn binary(&mut self, kind: Kind) -> Result<f64, String> {
        let is_big = self.encoding == Encoding::BigEndian;
        let (value, rest) = kind.take(self.bytes, is_big).ok_or("the file is cut off here; export it again")?;
        self.bytes = rest;
        Ok(value)
    }
}

/// Reads a row's numbers one after the other.
fn fill(row: &mut Row, element: &Element, mut next: impl FnMut(Kind) -> Result<f64, String>) -> Result<(), String> {
    for property in &element.properties {
        let entries = property.count.map_or(Ok(1.0), &mut next)?;
        for _ in 0..entries as u64 {
            row.take(&property.name, next(property.kind)?)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "ply\nformat ascii 1.0\ncomment by hand\nelement vertex 4\nproperty double x\nproperty float y\n\
                          property float z\nproperty uchar red\nelement edge 1\nproperty int a\nelement face 1\n\
                          property list uchar int vertex_indices\nend_header\n";
    const ROWS: &str = "0 0 0 9\n1 0 0 9\n1 1 .5 9\n0 1 0 9\n7\n4 0 1 2 3\n";

    fn binary(is_big: bool) -> Vec<u8> {
        let format = if is_big { "binary_big_endian" } else { "binary_little_endian" };
        let mut bytes = HEADER.replace("ascii", format).into_bytes();
        let mut put = |little: &[u8]| {
            let at = bytes.len();
            bytes.extend(little);
            if is_big {
                bytes[at..].reverse();
            }
        };
        for [x, y, z] in [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.5], [0.0f32, 1.0, 0.0]] {
            put(&f64::from(x).to_le_bytes());
            put(&y.to_le_bytes());
            put(&z.to_le_bytes());
            put(&[9]);
        }
        put(&7i32.to_le_bytes());
        put(&[4]);
        (0..4i32).for_each(|vertex| put(&vertex.to_le_bytes()));
        bytes
    }

    #[test]
    fn text_and_bytes_of_either_order_with_foreign_elements_are_the_same_mesh() {
        let mesh = parse(format!("{HEADER}{ROWS}").as_bytes()).unwrap();
        assert_eq!(mesh.positions[2], [1.0, 1.0, 0.5]);
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        for is_big in [false, true] {
            assert_eq!(parse(&binary(is_big)).as_ref(), Ok(&mesh));
        }
    }

    #[test]
    fn what_is_wrong_is_told_with_its_line() {
        for (right, wrong, told) in [
            ("4 0 1 2 3", "2 0 1", "line 19: a face has at least three corners, not 2"),
            ("4 0 1 2 3", "4 0 1 2", "line 19: the row ends too early"),
            ("4 0 1 2 3", "3 0 1 2 3", "line 19: `3` follows what a row of `face` has"),
            ("4 0 1 2 3", "3 0 1 -2", "line 19: -2 is not a vertex"),
            ("4 0 1 2 3", "3 0 1 4", "a face names vertex 4; the file's are 0 to 3"),
            ("1 1 .5 9", "1 1 x 9", "line 16: `x` is not a finite number"),
            ("4 0 1 2 3\n", "", "line 18: the file is cut off: a row of `face` is missing; export it again"),
            (
                "4 0 1 2 3\n",
                "4 0 1 2 3\n0 1 2\n",
                "5 bytes follow the last row that the header promises; export it again",
            ),
            ("property float z", "property float h", "header: element vertex has no property z"),
            ("property int a", "property integer a", "line 10: `integer` is not a type of PLY, as float or uchar are"),
            ("element face 1", "element face one", "line 11: `one` is not a number of rows"),
            ("ply\n", "plx\n", "line 1: a PLY file begins with `ply`"),
        ] {
            let text = format!("{HEADER}{ROWS}").replacen(right, wrong, 1);
            assert_eq!(parse(text.as_bytes()), Err(told.to_owned()), "{wrong}");
        }
    }

    #[test]
    fn bytes_that_end_too_early_or_too_late_are_refused() {
        let bytes = binary(false);
        assert_eq!(parse(&bytes[..bytes.len() - 1]), Err("face 0: the file is cut off here; export it again".into()));
        assert_eq!(
            parse(b"ply\nformat ascii 1.0\n"),
            Err("the file is cut off: it ends before `end_header`; export it again".into())
        );
        assert!(parse(&[&bytes[..], &[0]].concat()).unwrap_err().starts_with("1 bytes follow"));
    }
}
