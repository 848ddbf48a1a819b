//! Triangle meshes from OBJ, STL, PLY, VTK's XML and Gmsh's MSH files.
//!
//! What is wrong is told with its line, or with the row where a file is binary. A file that is cut off and one that
//! goes on after its end are refused: what was meant is not known.

mod cells;
#[cfg(test)]
mod foreign_tests;
mod msh;
mod obj;
mod ply;
mod stl;
mod vtk;

use std::path::Path;

use kerf_physics::scene::TriangleMesh;

/// Most numbers that a file may unpack to: as many as the largest file has where none is packed and each has four bytes.
pub(crate) const MAX_NUMBERS: u64 = 1 << 26;

/// Reads a mesh; the format is that of the file's extension. Polygons are cut into fans, and of cells with a volume the
/// boundary is read. A file that is packed may unpack to so many numbers.
///
/// # Errors
/// Where the file is wrong, and what is wrong there.
pub(crate) fn parse(path: &Path, bytes: &[u8], max_numbers: u64) -> Result<TriangleMesh, String> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    match extension.as_str() {
        "obj" => obj::parse(text(bytes)?),
        "stl" => stl::parse(bytes),
        "ply" => ply::parse(bytes),
        "vtu" | "vtp" => vtk::parse(bytes, max_numbers),
        "msh" => msh::parse(bytes),
        other => Err(format!(
            "`.{other}` is not one of .obj, .stl, .ply, .vtu, .vtp, .msh; export the mesh in one of these formats"
        )),
    }
}

/// The text that bytes are.
fn text(bytes: &[u8]) -> Result<&str, String> {
    std::str::from_utf8(bytes).map_err(|e| {
        let line = bytes[..e.valid_up_to()].iter().filter(|byte| **byte == b'\n').count() + 1;
        format!("line {line}: is not text in UTF-8")
    })
}

/// A finite number.
fn number(word: &str) -> Result<f64, String> {
    let value = word.parse::<f64>().ok().filter(|value| value.is_finite());
    value.ok_or_else(|| format!("`{word}` is not a finite number"))
}

/// The vertex that a number names.
fn index(value: f64) -> Option<u32> {
    let is_index = value >= 0.0 && value <= f64::from(u32::MAX) && value.fract() == 0.0;
    is_index.then_some(value as u32)
}

/// The first three of some words as the coordinates of a point.
fn point<'a>(mut words: impl Iterator<Item = &'a str>) -> Result<[f64; 3], String> {
    let mut point = [0.0; 3];
    for (coordinate, axis) in point.iter_mut().zip(["x", "y", "z"]) {
        let word = words.next().ok_or_else(|| format!("a vertex has three coordinates; {axis} is missing"))?;
        *coordinate = number(word)?;
    }
    Ok(point)
}

/// Adds a polygon as a fan of triangles.
fn push_fan(mesh: &mut TriangleMesh, corners: &[u32]) -> Result<(), String> {
    if corners.len() < 3 {
        return Err(format!("a face has at least three corners, not {}", corners.len()));
    }
    mesh.triangles.extend(corners.windows(2).skip(1).map(|edge| [corners[0], edge[0], edge[1]]));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_formats_are_refused_by_name() {
        assert!(parse(Path::new("a.step"), b"", MAX_NUMBERS).unwrap_err().contains(".step"));
        let told = parse(Path::new("a.OBJ"), b"v 0 0 0\n\xff", MAX_NUMBERS).unwrap_err();
        assert_eq!(told, "line 2: is not text in UTF-8");
    }
}
