//! Triangle meshes from OBJ, STL and PLY files.

use std::io::{BufReader, Cursor};
use std::path::Path;

use kerf_physics::scene::TriangleMesh;
use ply_rs_bw::{parser, ply};

/// Reads a mesh; the format is that of the file's extension. Polygons are cut into fans.
///
/// # Errors
/// What is wrong with the text, in the words of the format's reader.
pub(crate) fn parse(path: &Path, bytes: &[u8]) -> Result<TriangleMesh, String> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    match extension.as_str() {
        "obj" => parse_obj(bytes),
        "stl" => parse_stl(bytes),
        "ply" => parse_ply(bytes),
        other => Err(format!("`.{other}` is not one of .obj, .stl, .ply")),
    }
}

fn parse_obj(bytes: &[u8]) -> Result<TriangleMesh, String> {
    // Materials stand in other files and say nothing about the shape.
    let no_materials = |_: &Path| Ok(Default::default());
    let (models, _) = tobj::load_obj_buf(&mut Cursor::new(bytes), &tobj::LoadOptions::default(), no_materials)
        .map_err(|e| e.to_string())?;
    let mut mesh = TriangleMesh::default();
    for model in models.into_iter().map(|m| m.mesh) {
        let first = mesh.positions.len() as u32;
        let (points, _) = model.positions.as_chunks::<3>();
        mesh.positions.extend(points.iter().map(|p| p.map(f64::from)));
        if model.face_arities.is_empty() {
            model.indices.chunks(3).for_each(|face| push_fan(&mut mesh, face, first));
        } else {
            let mut rest = model.indices.as_slice();
            for arity in model.face_arities {
                let (face, after) = rest.split_at(arity as usize);
                push_fan(&mut mesh, face, first);
                rest = after;
            }
        }
    }
    Ok(mesh)
}

fn parse_stl(bytes: &[u8]) -> Result<TriangleMesh, String> {
    let stl = stl_io::read_stl(&mut Cursor::new(bytes)).map_err(|e| e.to_string())?;
    Ok(TriangleMesh {
        positions: stl.vertices.iter().map(|v| v.0.map(f64::from)).collect(),
        triangles: stl.faces.iter().map(|f| f.vertices.map(|v| v as u32)).collect(),
    })
}

fn parse_ply(bytes: &[u8]) -> Result<TriangleMesh, String> {
    let mut reader = parser::Reader::new(BufReader::new(bytes));
    let rows = parser::Parser::<PlyRow>::new();
    let header = rows.read_header(&mut reader).map_err(|e| e.to_string())?;
    let mut mesh = TriangleMesh::default();
    for (name, element) in &header.elements {
        // Rows of other elements are read too: that is how they are skipped.
        let read = rows.read_payload_for_element(&mut reader, element, &header).map_err(|e| e.to_string())?;
        match name.as_str() {
            "vertex" => mesh.positions = read.iter().map(|row| row.position).collect(),
            "face" => read.iter().for_each(|row| push_fan(&mut mesh, &row.indices, 0)),
            _ => {}
        }
    }
    Ok(mesh)
}

/// A vertex or a face of a PLY file, whichever its properties make it.
struct PlyRow {
    position: [f64; 3],
    indices: Vec<u32>,
}

impl ply::PropertyAccess for PlyRow {
    fn new() -> Self {
        Self { position: [0.0; 3], indices: Vec::new() }
    }

    fn set_property(&mut self, key: &str, property: ply::Property) -> ply::PropertyAccessResult {
        let coordinate = match property {
            ply::Property::Double(value) => value,
            ref other => other.to_f32_lossy().map_or(f64::NAN, f64::from),
        };
        match key {
            "x" => self.position[0] = coordinate,
            "y" => self.position[1] = coordinate,
            "z" => self.position[2] = coordinate,
            "vertex_index" | "vertex_indices" => self.indices = property.to_u32_list().unwrap_or_default(),
            _ => {}
        }
        ply::PropertyAccessResult::Set
    }
}

fn push_fan(mesh: &mut TriangleMesh, face: &[u32], first: u32) {
    let fan = face.windows(2).skip(1).map(|edge| [face[0] + first, edge[0] + first, edge[1] + first]);
    mesh.triangles.extend(fan);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polygons_of_an_obj_become_fans_across_groups() {
        let text = "g a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\ng b\nv 0 0 1\nf 1 2 5\n";
        let mesh = parse(Path::new("quad.OBJ"), text.as_bytes()).unwrap();
        assert_eq!(mesh.triangles.len(), 3);
        assert!(mesh.triangles.iter().flatten().all(|v| (*v as usize) < mesh.positions.len()));
    }

    #[test]
    fn a_ply_with_foreign_elements_is_read() {
        let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
                    property uchar red\nelement edge 1\nproperty int a\nelement face 1\n\
                    property list uchar int vertex_indices\nend_header\n\
                    0 0 0 9\n1 0 0 9\n1 1 0.125 9\n0 1 0 9\n7\n4 0 1 2 3\n";
        let mesh = parse(Path::new("a.ply"), text.as_bytes()).unwrap();
        assert_eq!(mesh.positions[2], [1.0, 1.0, 0.125]);
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn an_ascii_stl_is_read() {
        let text = "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid s\n";
        let mesh = parse(Path::new("a.stl"), text.as_bytes()).unwrap();
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (3, 1));
    }

    #[test]
    fn other_formats_are_refused_by_name() {
        assert!(parse(Path::new("a.step"), b"").unwrap_err().contains(".step"));
        assert!(parse(Path::new("a.ply"), b"plx").is_err());
    }
}
