//! Points of a blade's edge from a text file.

use kerf_physics::scene::MAX_EDGE_POINTS;

/// Reads points, three numbers a line with commas or blanks between them; `#` begins a remark, empty lines
/// are passed over. In metres, after `scale_m_per_unit`.
///
/// # Errors
/// The first line that is not a point, or that there are more than [`MAX_EDGE_POINTS`].
pub(crate) fn parse(bytes: &[u8], scale_m_per_unit: f64) -> Result<Vec<[f64; 3]>, String> {
    let text = std::str::from_utf8(bytes).map_err(|e| e.to_string())?;
    let mut points_m = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.is_empty() {
            continue;
        }
        if points_m.len() == MAX_EDGE_POINTS {
            return Err(format!("line {}: more than {MAX_EDGE_POINTS} points", i + 1));
        }
        let point = point(line).ok_or_else(|| format!("line {}: `{line}` is not three finite numbers", i + 1))?;
        points_m.push(point.map(|x| x * scale_m_per_unit));
    }
    Ok(points_m)
}

fn point(line: &str) -> Option<[f64; 3]> {
    let words = line.split(|c: char| c == ',' || c.is_whitespace()).filter(|word| !word.is_empty());
    let numbers: Vec<f64> = words.map(|word| word.parse().ok()).collect::<Option<_>>()?;
    numbers.iter().all(|x| x.is_finite()).then_some(numbers)?.try_into().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_read_with_commas_or_blanks_and_scaled() {
        let text = b"# x, y, z in mm\n-20, 0, 0\n\n0 -1.5 2e0 # the tip\n20\t0,\t0\n";
        assert_eq!(parse(text, 0.5).unwrap(), [[-10.0, 0.0, 0.0], [0.0, -0.75, 1.0], [10.0, 0.0, 0.0]]);
    }

    #[test]
    fn what_is_no_point_is_told_with_its_line() {
        for line in ["1 2", "1 2 3 4", "1 2 x", "1 2 nan"] {
            let told = parse(format!("0 0 0\n{line}\n").as_bytes(), 1.0).unwrap_err();
            assert!(told.contains("line 2") && told.contains(line), "{told}");
        }
        let many = "0 0 0\n".repeat(MAX_EDGE_POINTS + 1);
        assert!(parse(many.as_bytes(), 1.0).unwrap_err().contains("more than 4096 points"));
    }
}
