//! STL, binary or as text.

use std::collections::BTreeMap;

use kerf_physics::scene::TriangleMesh;

use super::{point, text};

/// Bytes before the triangles of a binary file: 80 of remarks and their number.
const HEADER_BYTES: usize = 84;
/// Bytes of a triangle: a normal, three corners, two of anything.
const TRIANGLE_BYTES: usize = 50;

pub(super) fn parse(bytes: &[u8]) -> Result<TriangleMesh, String> {
    // Binary files may begin with the word, too; only their length tells.
    match promised_bytes(bytes) {
        Some(promised) if promised == bytes.len() => Ok(parse_binary(bytes)),
        _ if bytes.trim_ascii_start().starts_with(b"solid") && !bytes.contains(&0) => parse_text(text(bytes)?),
        None => Err(format!("{} bytes are less than the header of an STL file, {HEADER_BYTES}", bytes.len())),
        Some(promised) if promised > bytes.len() => Err(format!(
            "the file is cut off: its header promises {} triangles, {promised} bytes, and it has {}; export it again",
            (promised - HEADER_BYTES) / TRIANGLE_BYTES,
            bytes.len()
        )),
        Some(promised) => Err(format!("{} bytes follow the last triangle; export it again", bytes.len() - promised)),
    }
}

/// The length that a binary file's header promises.
fn promised_bytes(bytes: &[u8]) -> Option<usize> {
    let [a, b, c, d] = *bytes.get(HEADER_BYTES - 4..)?.first_chunk::<4>()?;
    Some(HEADER_BYTES + TRIANGLE_BYTES * u32::from_le_bytes([a, b, c, d]) as usize)
}

/// Corners at one place become one vertex.
#[derive(Default)]
struct Corners {
    mesh: TriangleMesh,
    by_place: BTreeMap<[u64; 3], u32>,
}

impl Corners {
    fn push(&mut self, corners: [[f64; 3]; 3]) {
        let vertices = corners.map(|corner| {
            // There are two zeros.
            *self.by_place.entry(corner.map(|x| (x + 0.0).to_bits())).or_insert_with(|| {
                self.mesh.positions.push(corner);
                self.mesh.positions.len() as u32 - 1
            })
        });
        self.mesh.triangles.push(vertices);
    }
}

fn parse_binary(bytes: &[u8]) -> TriangleMesh {
    let mut corners = Corners::default();
    let (triangles, _) = bytes[HEADER_BYTES..].as_chunks::<TRIANGLE_BYTES>();
    for triangle in triangles {
        let coordinate = |i: usize| f64::from(f32::from_le_bytes(std::array::from_fn(|k| triangle[12 + 4 * i + k])));
        corners.push(std::array::from_fn(|corner| std::array::from_fn(|axis| coordinate(3 * corner + axis))));
    }
    corners.mesh
}

fn parse_text(text: &str) -> Result<TriangleMesh, String> {
    let mut corners = Corners::default();
    let mut facet: Option<Vec<[f64; 3]>> = None;
    let mut is_open = false;
    for (line, number) in text.lines().zip(1..) {
        let at = |message: String| format!("line {number}: {message}");
        let mut words = line.split_whitespace();
        match words.next() {
            Some("solid") if !is_open => is_open = true,
            Some("endsolid") if is_open && facet.is_none() => is_open = false,
            Some("facet") if is_open && facet.is_none() => facet = Some(Vec::new()),
            Some("vertex") if facet.is_some() => {
                let corner = point(&mut words).map_err(at)?;
                facet.iter_mut().for_each(|corners| corners.push(corner));
            }
            Some("endfacet") if facet.is_some() => match facet.take().as_deref() {
                Some([a, b, c]) => corners.push([*a, *b, *c]),
                other => return Err(at(format!("a facet has three vertices, not {}", other.map_or(0, <[_]>::len)))),
            },
            Some("outer" | "endloop") if facet.is_some() => {}
            None => {}
            Some(word) => return Err(at(format!("`{word}` has no place here in an STL file"))),
        }
    }
    if is_open {
        Err("the file is cut off: it ends before `endsolid`; export it again".into())
    } else {
        Ok(corners.mesh)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n\
                        endfacet\nfacet normal 0 0 1\nouter loop\nvertex 1 0 0\nvertex 1 1 0\nvertex -0 1 0\nendloop\n\
                        endfacet\nendsolid s\n";

    /// The two triangles of the text.
    fn binary() -> Vec<u8> {
        let mut bytes = b"solid in spite of the word".to_vec();
        bytes.resize(80, 0);
        bytes.extend(2u32.to_le_bytes());
        for corners in [
            [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [-0.0, 1.0, 0.0]],
        ] {
            bytes.extend([0; 12]);
            bytes.extend(corners.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
            bytes.extend([0; 2]);
        }
        bytes
    }

    #[test]
    fn text_and_bytes_are_the_same_mesh_with_common_corners() {
        let mesh = parse(TEXT.as_bytes()).unwrap();
        assert_eq!((mesh.positions.len(), &mesh.triangles[..]), (4, &[[0, 1, 2], [1, 3, 2]][..]));
        assert_eq!(parse(&binary()), Ok(mesh));
    }

    #[test]
    fn a_file_that_is_cut_off_or_goes_on_is_refused() {
        let mut bytes = binary();
        let told = parse(&bytes[..150]).unwrap_err();
        assert!(told.contains("promises 2 triangles, 184 bytes, and it has 150"), "{told}");
        bytes.push(0);
        assert!(parse(&bytes).unwrap_err().starts_with("1 bytes follow"));
        assert!(parse(b"xyz").unwrap_err().contains("3 bytes are less"));
        let cut = &TEXT[..TEXT.find("endsolid").unwrap()];
        assert!(parse(cut.as_bytes()).unwrap_err().contains("ends before `endsolid`"));
    }

    #[test]
    fn what_is_wrong_in_a_text_is_told_with_its_line() {
        for (right, wrong, told) in [
            ("vertex 1 0 0", "vertex 1 O 0", "line 5: `O` is not a finite number"),
            ("vertex 1 0 0", "vertex 1 0", "line 5: a vertex has three coordinates; z is missing"),
            ("vertex 1 0 0\n", "", "line 7: a facet has three vertices, not 2"),
            ("outer", "inner", "line 3: `inner` has no place here in an STL file"),
            ("endsolid s\n", "endsolid s\nmore\n", "line 17: `more` has no place here in an STL file"),
        ] {
            assert_eq!(parse(TEXT.replacen(right, wrong, 1).as_bytes()), Err(told.to_owned()), "{wrong}");
        }
    }
}
