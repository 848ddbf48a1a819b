//! Wavefront OBJ: vertices and faces; normals, groups, materials and the rest say nothing about the shape.

use kerf_physics::scene::TriangleMesh;

use super::{point, push_fan};

pub(super) fn parse(text: &str) -> Result<TriangleMesh, String> {
    let mut mesh = TriangleMesh::default();
    // The greatest vertex that a face names, which may stand further down in the file, and the face's line.
    let mut greatest = (0, 0);
    for (line, statement) in statements(text) {
        let at = |message: String| format!("line {line}: {message}");
        let mut words = statement.split_whitespace();
        match words.next() {
            Some("v") => mesh.positions.push(point(words).map_err(at)?),
            Some("f") => {
                let known = mesh.positions.len();
                let corners: Vec<u32> = words.map(|word| corner(word, known)).collect::<Result<_, _>>().map_err(at)?;
                greatest =
                    corners.iter().map(|vertex| (*vertex, line)).fold(greatest, |a, b| if b.0 > a.0 { b } else { a });
                push_fan(&mut mesh, &corners).map_err(at)?;
            }
            _ => {}
        }
    }
    let (vertex, line) = greatest;
    if vertex as usize >= mesh.positions.len() && !mesh.triangles.is_empty() {
        let named = u64::from(vertex) + 1;
        return Err(format!("line {line}: a face names vertex {named}, the file has {}", mesh.positions.len()));
    }
    Ok(mesh)
}

/// Lines without their comments, those that end in a backslash joined with the next; by the number of the first.
fn statements(text: &str) -> impl Iterator<Item = (usize, String)> {
    let mut lines = text.lines().zip(1..);
    std::iter::from_fn(move || {
        let (first, number) = lines.next()?;
        let mut statement = first.to_owned();
        while statement.ends_with('\\') {
            statement.pop();
            statement.push(' ');
            statement += lines.next().map_or("", |(line, _)| line);
        }
        let end = statement.find('#').unwrap_or(statement.len());
        statement.truncate(end);
        Some((number, statement))
    })
}

/// The vertex of a face's corner, from 0: `7`, `7/1` or `7/1/2` are the seventh, `-1` is the last so far.
fn corner(word: &str, known: usize) -> Result<u32, String> {
    let name = word.split('/').next().unwrap_or_default();
    let index: i64 = name.parse().map_err(|_| format!("`{word}` is not a corner of a face"))?;
    let vertex = match index {
        1.. => index - 1,
        0 => return Err("a face names vertex 0; the first is 1".into()),
        _ => index + known as i64,
    };
    u32::try_from(vertex).map_err(|_| format!("a face names vertex {index}, {known} stand before it"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polygons_become_fans_across_groups() {
        let text = "g a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\ng b\nv 0 0 1\nf 1/1 2//5 5/2/3\n";
        let mesh = parse(text).unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 4]]);
    }

    #[test]
    fn comments_behind_numbers_and_lines_that_go_on_are_read() {
        let text = "v 0 0 .5 # the tip\nv 1 \\\r\n 0 0\nv 0 1 0 1.0 # weight\nf 1 \\\n2 \\\n3 # a face\nf -3 -2 -1\n";
        let mesh = parse(text).unwrap();
        assert_eq!(mesh.positions, [[0.0, 0.0, 0.5], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        assert_eq!(mesh.triangles, [[0, 1, 2]; 2]);
    }

    #[test]
    fn what_is_wrong_is_told_with_its_line() {
        let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
        for (wrong, told) in [
            ("f 1 2", "line 4: a face has at least three corners, not 2"),
            ("f 1 2 0", "line 4: a face names vertex 0; the first is 1"),
            ("f 1 2 9", "line 4: a face names vertex 9, the file has 3"),
            ("f 1 2 4294967296", "line 4: a face names vertex 4294967296, the file has 3"),
            ("f 1 2 -4", "line 4: a face names vertex -4, 3 stand before it"),
            ("f 1 2 c", "line 4: `c` is not a corner of a face"),
            ("v 1 \\\n2 x", "line 4: `x` is not a finite number"),
            ("\nv 1 nan 0", "line 5: `nan` is not a finite number"),
            ("v 1 2", "line 4: a vertex has three coordinates; z is missing"),
        ] {
            assert_eq!(parse(&format!("{vertices}{wrong}\n")), Err(told.to_owned()));
        }
    }
}
