//! Closed pieces as binary STL, metres, +y up, a file each.
//!
//! STL has no vertices of its own, and readers join the corners of triangles that are at the same place. The walls of a cut
//! that nothing opens are, so each is moved a little into its body.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Path, PathBuf};

use crate::glb::{Object, add, area_normal, pieces, unit};
use crate::surface::{Face, Surface, Triangle};

/// How far a wall of a cut is moved into its body, m: readers take places 10 nm from each other for one.
const WALL_INSET_M: f32 = 1e-7;
/// Text that readers skip. It does not begin with "solid", as files of text do.
const HEADER: &[u8; 80] = b"Kerf, binary STL, metres                                                        ";

/// Writes each closed piece of each object into a folder that is there, as `<object>-<number>.stl`, the largest of an
/// object first. Characters that a name of a file may not have are `_`. Answers with the files.
///
/// # Errors
/// A file cannot be written.
pub fn write_pieces(folder: &Path, objects: &[Object]) -> io::Result<Vec<PathBuf>> {
    let mut stems = BTreeSet::new();
    let mut paths = Vec::new();
    for object in objects {
        let mut stem: String = object.name.chars().map(|c| if is_plain(c) { c } else { '_' }).collect();
        // Names of objects differ, what is left of them may not.
        while !stems.insert(stem.clone()) {
            stem.push('_');
        }
        let surface = with_walls_inset(&object.surface);
        for (number, triangles) in (1..).zip(pieces(&surface)) {
            let path = folder.join(format!("{stem}-{number}.stl"));
            std::fs::write(&path, encode(&surface, &triangles))?;
            paths.push(path);
        }
    }
    Ok(paths)
}

/// Whether every file system takes a character in a name.
fn is_plain(c: char) -> bool {
    c.is_alphanumeric() || matches!(c, ' ' | '-' | '_' | '.')
}

/// Triangles of a surface as the bytes of a file.
fn encode(surface: &Surface, triangles: &[Triangle]) -> Vec<u8> {
    let mut stl = Vec::with_capacity(84 + 50 * triangles.len());
    stl.extend(HEADER);
    stl.extend((triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        let normal = unit(area_normal(surface, triangle)).unwrap_or_default();
        let corners_m = triangle.vertices.map(|vertex| surface.positions_m[vertex as usize]);
        stl.extend([normal].iter().chain(&corners_m).flatten().flat_map(|c| c.to_le_bytes()));
        // Attributes, of which there are none.
        stl.extend([0; 2]);
    }
    stl
}

/// A surface whose walls of cuts are moved into their body.
fn with_walls_inset(surface: &Surface) -> Surface {
    let mut normals: BTreeMap<u32, [f32; 3]> = BTreeMap::new();
    for triangle in surface.triangles.iter().filter(|triangle| triangle.face == Face::Cut) {
        let normal = area_normal(surface, triangle);
        for vertex in triangle.vertices {
            let sum = normals.entry(vertex).or_default();
            *sum = add(*sum, normal);
        }
    }
    let mut moved = surface.clone();
    for (vertex, normal) in normals {
        // What two walls share may have none: there they do not part.
        if let Some(outward) = unit(normal) {
            let position_m = &mut moved.positions_m[vertex as usize];
            *position_m = add(*position_m, outward.map(|c| -WALL_INSET_M * c));
        }
    }
    moved
}

#[cfg(test)]
mod tests {
    use super::*;

    type Facet = [[f32; 3]; 4];

    /// The normal and the corners of each facet of a file.
    fn read(path: &Path) -> Vec<Facet> {
        let bytes = std::fs::read(path).expect("a file");
        assert!(!bytes.starts_with(b"solid"));
        let count = u32::from_le_bytes(bytes[80..84].try_into().expect("four bytes")) as usize;
        assert_eq!(bytes.len(), 84 + 50 * count);
        let number = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().expect("four bytes"));
        let facet =
            |facet: &[u8]| std::array::from_fn(|v| std::array::from_fn(|c| number(&facet[12 * v + 4 * c..][..4])));
        bytes[84..].chunks(50).map(facet).collect()
    }

    /// The volume, m^3, of a body that is closed where corners at the same place are one: every edge is passed once each
    /// way. Its normals point out of it.
    fn volume_m3(facets: &[Facet]) -> f32 {
        let place = |corner: [f32; 3]| corner.map(|c| (f64::from(c) * 1e8).round() as i64);
        let edges: Vec<_> = facets
            .iter()
            .flat_map(|[_, a, b, c]| [[a, b], [b, c], [c, a]].map(|ends| ends.map(|end| place(*end))))
            .collect();
        let different: BTreeSet<_> = edges.iter().copied().collect();
        assert_eq!(different.len(), edges.len(), "an edge of more than two facets");
        assert!(edges.iter().all(|[a, b]| different.contains(&[*b, *a])), "an edge of one facet");
        let of_origin = |[normal, a, b, c]: &Facet| {
            let triangle = Triangle { vertices: [0, 1, 2], face: Face::Skin, region: 0 };
            let across = area_normal(&Surface { positions_m: vec![*a, *b, *c], triangles: vec![triangle] }, &triangle);
            let outward = unit(across).expect("an area");
            assert!((0..3).all(|i| (outward[i] - normal[i]).abs() < 1e-6), "{outward:?} {normal:?}");
            (0..3).map(|i| a[i] * across[i]).sum::<f32>() / 6.0
        };
        facets.iter().map(of_origin).sum()
    }

    fn add_triangles(surface: &mut Surface, face: Face, triangles: &[[u32; 3]]) {
        surface.triangles.extend(triangles.iter().map(|vertices| Triangle { vertices: *vertices, face, region: 0 }));
    }

    /// A tetrahedron, and after it a body that is cut along the first's base: the walls of the cut meet in an edge and
    /// are at the same place. All walls are.
    fn half_cut() -> Surface {
        let mut surface = Surface {
            positions_m: vec![
                [0.0, 0.0, 0.0],
                [1.0, 0.0, 0.0],
                [0.0, 1.0, 0.0],
                [0.0, 0.0, 1.0],
                // The ends of the cut's walls, the edge at which they meet, and what is above and below of them.
                [0.0, 0.0, 0.0],
                [0.0, 0.0, 0.0],
                [1.0, 0.0, 0.0],
                [0.0, 1.0, 0.0],
                [1.0, 1.0, 1.0],
                [1.0, 1.0, -1.0],
            ],
            triangles: Vec::new(),
        };
        add_triangles(&mut surface, Face::Cut, &[[0, 2, 1]]);
        add_triangles(&mut surface, Face::Skin, &[[0, 1, 3], [1, 2, 3], [2, 0, 3]]);
        add_triangles(&mut surface, Face::Cut, &[[4, 7, 6], [5, 6, 7]]);
        let skin = [[4, 6, 8], [7, 4, 8], [6, 9, 8], [7, 8, 9], [6, 5, 9], [5, 7, 9]];
        add_triangles(&mut surface, Face::Skin, &skin);
        surface
    }

    #[test]
    fn each_piece_is_a_closed_file_though_walls_touch_and_the_largest_is_the_first() {
        let folder = std::env::temp_dir().join(format!("kerf-stl-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        let object = |name: &str| Object { name: name.into(), surface: half_cut(), ..Object::default() };
        let paths = write_pieces(&folder, &[object("liver"), object("a/b"), object("a_b")]).expect("files");
        let names = ["liver-1.stl", "liver-2.stl", "a_b-1.stl", "a_b-2.stl", "a_b_-1.stl", "a_b_-2.stl"];
        assert_eq!(paths, names.map(|name| folder.join(name)));
        let facets: Vec<_> = paths[..2].iter().map(|path| read(path)).collect();
        assert_eq!([facets[0].len(), facets[1].len()], [8, 4]);
        let volumes_m3 = [volume_m3(&facets[0]), volume_m3(&facets[1])];
        assert!((volumes_m3[0] - 2.0 / 3.0).abs() < 1e-5 && (volumes_m3[1] - 1.0 / 6.0).abs() < 1e-5, "{volumes_m3:?}");
        std::fs::remove_dir_all(folder).expect("a folder");
    }
}
