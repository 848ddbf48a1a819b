//! What came of each body: the second table of a run, and the figure that is drawn from it.

use kerf_plot::{Axis, Chart, Curve, Figure};
use serde::{Deserialize, Serialize};

use super::campaign::{MOST_RESIDUAL, Tally, VOLUME_FRACTION};

/// Ratios below this are drawn as this: a body that no blade has met has none.
const LEAST_DRAWN: f64 = 1e-6;

/// What came of the strokes through one body: a row of the table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BodyRow {
    /// The model's name.
    pub model: String,
    /// Seed of the body.
    pub seed: String,
    /// Strokes made.
    pub strokes: u32,
    /// Those in which links parted.
    pub cutting_strokes: u32,
    /// Area the fronts swept, m^2.
    pub cut_area_m2: String,
    /// Pieces, at most after a stroke.
    pub pieces: usize,
    /// Change of the enclosed volume over cut area times voxel edge, at most after a stroke.
    pub volume_ratio: String,
    /// Strokes after which it was beyond its bound.
    pub volume_misses: u32,
    /// Ledger's residual over the tools' work, at most after a stroke.
    pub residual: String,
    /// Pairs of triangles that pass through each other in the reference configuration, at most after a stroke.
    pub crossing_pairs: usize,
    /// Edges along which the skin folds back, more than before any cut; at most after a stroke.
    pub folded_edges: usize,
}

impl BodyRow {
    /// The row of a model's body.
    #[must_use]
    pub fn new(model: &str, seed: u64, tally: &Tally) -> Self {
        Self {
            model: model.to_owned(),
            seed: format!("{seed:016x}"),
            strokes: tally.strokes,
            cutting_strokes: tally.cutting_strokes,
            cut_area_m2: format!("{:.4}", tally.cut_area_m2),
            pieces: tally.most_pieces,
            volume_ratio: format!("{:.2e}", tally.volume_ratio),
            volume_misses: tally.volume_misses,
            residual: format!("{:.2e}", tally.residual_ratio),
            crossing_pairs: tally.crossing_pairs,
            folded_edges: tally.folded_edges,
        }
    }
}

/// Volume ratio and residual of every body in order of size, by model, under their limits.
#[must_use]
pub fn figure(rows: &[BodyRow]) -> Figure {
    let mut models: Vec<&str> = rows.iter().map(|row| row.model.as_str()).collect();
    models.dedup();
    let chart = |what: &str, of: fn(&BodyRow) -> &str, limit: f64| {
        let curve = |model: &&str| {
            let ratios = rows.iter().filter(|row| row.model == *model).filter_map(|row| of(row).parse::<f64>().ok());
            let mut ratios: Vec<f64> = ratios.map(|ratio| ratio.max(LEAST_DRAWN)).collect();
            ratios.sort_by(f64::total_cmp);
            let last = ratios.len().saturating_sub(1).max(1) as f64;
            let points = ratios.iter().enumerate().map(|(i, ratio)| (100.0 * i as f64 / last, *ratio)).collect();
            Curve::dotted_line(model, points)
        };
        let mut curves: Vec<Curve> = models.iter().map(curve).collect();
        curves.push(Curve::dashes("limit", (0.0, limit), (100.0, limit)).coloured(kerf_plot::BLACK));
        Chart::new(Axis::linear("share of the model's bodies, %"), Axis::log(what), curves)
    };
    let charts = vec![
        chart("volume ratio, worst of a body's strokes", |row| &row.volume_ratio, VOLUME_FRACTION),
        chart("residual, worst of a body's strokes", |row| &row.residual, MOST_RESIDUAL),
    ];
    Figure::row("strokes-bodies", "Enclosed volume and ledger after random strokes, by body", charts)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(model: &str, seed: u64, volume_ratio: f64) -> BodyRow {
        BodyRow::new(model, seed, &Tally { volume_ratio, residual_ratio: 1e-4, ..Tally::default() })
    }

    /// The figure as SVG.
    fn svg(rows: &[BodyRow]) -> String {
        let folder = tempfile::tempdir().expect("a folder");
        let [svg, _] = figure(rows).draw(folder.path()).expect("a figure");
        std::fs::read_to_string(svg).expect("its text")
    }

    #[test]
    fn the_figure_names_each_model_and_has_a_point_for_each_body_in_both_charts() {
        let rows = [row("liver", 1, 0.02), row("liver", 2, 0.0), row("horse", 3, 0.2)];
        let text = svg(&rows);
        for word in ["liver", "horse", "limit", "volume ratio", "residual"] {
            assert!(text.contains(word), "{word} is missing");
        }
        // One more stands in the legend for each model.
        assert_eq!(text.matches("<circle").count(), 2 * (rows.len() + 2));
    }

    #[test]
    fn a_row_of_a_body_is_read_as_it_was_written() {
        let folder = tempfile::tempdir().expect("a folder");
        let (path, rows) = (folder.path().join("bodies.csv"), [row("liver", u64::MAX, 0.1234)]);
        crate::rows::write(&path, &rows).expect("a file");
        assert_eq!(crate::rows::read::<BodyRow>(&path).expect("its rows"), rows);
        assert_eq!(rows[0].seed, "ffffffffffffffff");
    }
}
