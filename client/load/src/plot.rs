//! The force on a tool over time, as a picture: what a run of the demo leaves.

use kerf_plot::{Axis, BLUE, Chart, Curve, Figure, GREY, RED, Stretch};

/// State of the tool at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Simulated time, s.
    pub time_s: f64,
    /// Force on the tool against its cutting direction, N.
    pub force_n: f64,
    /// How far the edge is below the undeformed surface, m; negative above it.
    pub depth_m: f64,
}

/// `force`: force over time above depth over time, with the strokes shaded and numbered and `reference_n` (for a
/// steady cut: Gc times the width of the edge) as a dashed line.
#[must_use]
pub fn force_over_time(samples: &[Sample], reference_n: Option<f64>, title: &str) -> Figure {
    let over_time = |value: fn(&Sample) -> f64| samples.iter().map(|s| (s.time_s, value(s))).collect::<Vec<_>>();
    let first_s = samples.first().map_or(0.0, |s| s.time_s);
    let last_s = samples.last().map_or(0.0, |s| s.time_s);
    // Room for a line where all samples are of one time.
    let end_s = if last_s > first_s { last_s } else { first_s + 1.0 };
    let time = || Axis::fitted("simulated time, s").over(first_s..end_s);
    let force = Curve::line("force", over_time(|s| s.force_n)).coloured(RED);
    let reference = reference_n.map(|reference_n| {
        // In three digits: it is known no better.
        let rounded_n: f64 = format!("{reference_n:.2e}").parse().unwrap_or(reference_n);
        let label = format!("Gc w = {rounded_n} N");
        Curve::dashes(&label, (first_s, reference_n), (end_s, reference_n)).coloured(GREY)
    });
    let curves = std::iter::once(force).chain(reference).collect();
    let strokes = strokes(samples);
    let unnamed = strokes.iter().map(|stroke| Stretch { label: String::new(), ..stroke.clone() }).collect();
    let upper = Chart::new(time(), Axis::linear("force on the tool, N"), curves).with_stretches(strokes);
    let depth = Curve::line("", over_time(|s| 1e3 * s.depth_m)).coloured(BLUE);
    let lower = Chart::new(time(), Axis::linear("depth, mm").downward(), vec![depth]).with_stretches(unnamed);
    Figure::column("force", title, [upper, lower], 480).sized((1200, 760))
}

/// Stretches of time in which the edge is below the surface, numbered.
fn strokes(samples: &[Sample]) -> Vec<Stretch> {
    let below = samples.chunk_by(|a, b| (a.depth_m > 0.0) == (b.depth_m > 0.0)).filter(|run| run[0].depth_m > 0.0);
    below
        .enumerate()
        .map(|(index, run)| Stretch {
            label: format!("stroke {}", index + 1),
            range: run[0].time_s..run[run.len() - 1].time_s,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two strokes: press, give, cut on at the plateau, lift.
    fn two_strokes() -> Vec<Sample> {
        (0..4000)
            .map(|i| {
                let time_s = f64::from(i) * 1e-3;
                let phase_s = time_s % 2.0;
                let depth_m = 0.03 * (phase_s - 0.3).min(1.7 - phase_s);
                let force_n = match phase_s {
                    p if p < 0.3 => 0.0,
                    p if p < 0.8 => 16.0 * ((p - 0.3) / 0.5).powi(2),
                    p if p < 1.0 => 8.0 + 8.0 * (-(p - 0.8) / 0.03).exp() + 0.2 * (400.0 * p).sin(),
                    _ => 0.0,
                };
                Sample { time_s, force_n, depth_m }
            })
            .collect()
    }

    #[test]
    fn strokes_are_the_stretches_below_the_surface() {
        let found = strokes(&two_strokes());
        assert_eq!(found.len(), 2);
        assert!((found[1].range.start - 2.3).abs() < 2e-3 && (found[1].range.end - 3.7).abs() < 2e-3, "{found:?}");
    }

    #[test]
    fn the_picture_shows_force_depth_and_strokes() {
        let directory = tempfile::tempdir().unwrap();
        let [svg, _] = force_over_time(&two_strokes(), Some(8.0), "Two strokes").draw(directory.path()).unwrap();
        let text = std::fs::read_to_string(svg).unwrap();
        for expected in
            ["Two strokes", "Gc w = 8 N", "stroke 2", "simulated time, s", "depth, mm", "force on the tool, N"]
        {
            assert!(text.contains(expected), "{expected} is missing");
        }
    }
}
