//! `docs/explanation/strokes.md`, from a table with a row for each model.

use std::fmt::Write as _;

use serde::{Deserialize, Serialize};

use super::campaign::Tally;

/// How a run was asked for.
#[derive(Clone, Copy, Debug)]
pub struct Asked {
    /// Seed of the run.
    pub seed: u64,
    /// Strokes through each model that were asked for.
    pub strokes: u32,
    /// Strokes through one body, at most.
    pub per_body: u32,
    /// Voxels along a model's longest edge.
    pub resolution: u32,
}

/// What came of all strokes through a model: a row of the table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// The model's name.
    pub model: String,
    /// Seed of the run.
    pub seed: u64,
    /// Strokes that were asked for.
    pub asked_strokes: u32,
    /// Strokes through one body, at most.
    pub per_body: u32,
    /// Voxels along its longest edge.
    pub resolution: u32,
    /// Fine voxels of a body.
    pub voxels: usize,
    /// Edge of a voxel, mm.
    pub voxel_mm: String,
    /// Voxels of a mesh's thin parts that were left out.
    pub left_out: u32,
    /// Strokes made.
    pub strokes: u32,
    /// Those in which links parted.
    pub cutting_strokes: u32,
    /// Bodies cut.
    pub bodies: u32,
    /// Steps taken.
    pub steps: u64,
    /// Links parted.
    pub parted_links: u64,
    /// Links spared, lest a piece below the least be set free.
    pub spared_links: u64,
    /// Area the fronts swept, m^2.
    pub cut_area_m2: String,
    /// Pieces of one body, at most.
    pub most_pieces: usize,
    /// Voxels of the smallest piece of all.
    pub least_piece_voxels: usize,
    /// Steps whose state was rolled back.
    pub rolled_back: u32,
    /// Change of the enclosed volume over cut area times voxel edge: mean over bodies.
    pub volume_ratio_mean: String,
    /// The same, at most.
    pub volume_ratio_worst: String,
    /// Strokes after which it was beyond its bound.
    pub volume_misses: u32,
    /// Ledger's residual over the tools' work, at most over bodies.
    pub residual_worst: String,
    /// Pairs of triangles that pass through each other in the reference configuration, at most after a stroke.
    pub crossing_pairs: usize,
    /// Edges along which the skin folds back, more than before any cut; at most after a stroke.
    pub folded_edges: usize,
    /// Cracks of one link that hang together with no other face, at most after a stroke.
    pub lone_cracks: usize,
    /// Highest resident set of the process in the first tenth of the strokes, MB; empty where it is not told.
    pub memory_early_mb: String,
    /// The same in all strokes.
    pub memory_mb: String,
    /// State hash of the last body.
    pub last_state: String,
    /// Requirements that failed, without that on the volume.
    pub failures: u32,
    /// The first of them in words.
    pub findings: String,
}

impl Row {
    /// The row of a model; `early_resident_bytes` is the memory in the first tenth of its strokes.
    #[must_use]
    pub fn new(name: &str, asked: Asked, tally: Tally, early_resident_bytes: Option<u64>) -> Self {
        let mb = |bytes: Option<u64>| bytes.map_or_else(String::new, |bytes| format!("{:.0}", bytes as f64 * 1e-6));
        Self {
            model: name.to_owned(),
            seed: asked.seed,
            asked_strokes: asked.strokes,
            per_body: asked.per_body,
            resolution: asked.resolution,
            voxels: tally.voxels,
            voxel_mm: format!("{:.2}", tally.voxel_m * 1e3),
            left_out: tally.left_out,
            strokes: tally.strokes,
            cutting_strokes: tally.cutting_strokes,
            bodies: tally.bodies,
            steps: tally.steps,
            parted_links: tally.parted_links,
            spared_links: tally.spared_links,
            cut_area_m2: format!("{:.3}", tally.cut_area_m2),
            most_pieces: tally.most_pieces,
            least_piece_voxels: tally.least_piece,
            rolled_back: tally.faults,
            volume_ratio_mean: format!("{:.3}", tally.volume_change_m3 / (tally.cut_area_m2 * tally.voxel_m)),
            volume_ratio_worst: format!("{:.3}", tally.volume_ratio),
            volume_misses: tally.volume_misses,
            residual_worst: format!("{:.1e}", tally.residual_ratio),
            crossing_pairs: tally.crossing_pairs,
            folded_edges: tally.folded_edges,
            lone_cracks: tally.lone_cracks,
            memory_early_mb: mb(early_resident_bytes),
            memory_mb: mb(tally.resident_bytes),
            last_state: format!("{:016x}", tally.state_hash),
            failures: tally.failures,
            findings: tally.findings.join("; "),
        }
    }
}

/// The page of a run's rows, measured at `commit`.
#[must_use]
pub fn page(rows: &[Row], commit: &str) -> String {
    let sum = |of: fn(&Row) -> u64| rows.iter().map(of).sum::<u64>();
    let (strokes, missed) = (sum(|row| row.strokes.into()), sum(|row| row.volume_misses.into()));
    let mut text = format!(
        "# Random strokes\n\n\
         {strokes} random strokes cut {} models. After {missed} of them ({:.2} %) the enclosed volume was beyond its \
         bound, so that limit is missed. The other requirements below failed {} times. {} steps were rolled back.\n\n",
        rows.len(),
        100.0 * missed as f64 / strokes.max(1) as f64,
        sum(|row| row.failures.into()),
        sum(|row| row.rolled_back.into()),
    );
    if let Some(row) = rows.first() {
        let Row { asked_strokes, per_body, resolution, seed, .. } = row;
        let _ = writeln!(
            text,
            "`make strokes` runs `strokes --strokes {asked_strokes} --per-body {per_body} --resolution {resolution} --seed \
             {seed}` and writes this page and its [tables](../reference/strokes/README.md). The figures are those of \
             commit {commit}. `make strokes-page` writes the page from the tables.\n"
        );
    }
    if rows.iter().any(|row| row.strokes < row.asked_strokes) {
        text.push_str("The run was cut off before all of its strokes were made: these are the figures so far.\n\n");
    }
    text.push_str(STROKES);
    text.push_str(
        "| model | strokes | that cut | volume ratio: mean, worst | strokes beyond 0.1 | residual, worst | crossing pairs, most | folded edges, most |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    for row in rows {
        let _ = writeln!(
            text,
            "| {} | {} | {} | {}, {} | {} | {} | {} | {} |",
            row.model,
            row.strokes,
            row.cutting_strokes,
            row.volume_ratio_mean,
            row.volume_ratio_worst,
            row.volume_misses,
            row.residual_worst,
            row.crossing_pairs,
            row.folded_edges,
        );
    }
    text.push_str(
        "\nVolume ratio: change of the enclosed rest volume over A h. Residual: the ledger's unexplained energy, over \
         the tools' work. Crossing pairs: triangles that pass through each other in the reference configuration, above those of the \
         uncut model, at most after a stroke. They have no limit: where cuts cross inside, walls may pass through walls. \
         Folded edges: edges of the skin whose triangles have normals more than 100 degrees apart, above those of the uncut \
         model, at most after a stroke.\n\n\
         ![Volume ratio and residual of every body, in order of size](../reference/strokes/strokes-bodies.png)\n\n\
         The largest volume ratio and the largest residual of every body, in order of size. A point above the dashed line \
         misses its limit.\n\n## What fails\n\n",
    );
    let failing = rows.iter().filter(|row| row.failures + row.volume_misses > 0);
    let mut lines: Vec<String> = Vec::new();
    for Row { model, volume_misses, strokes, volume_ratio_worst, findings, .. } in failing {
        if *volume_misses > 0 {
            lines.push(format!(
                "- {model}: the volume is beyond its bound after {volume_misses} of {strokes} strokes, worst ratio \
                 {volume_ratio_worst}, limit 0.1"
            ));
        }
        lines.extend(findings.split("; ").filter(|finding| !finding.is_empty()).map(|f| format!("- {model}: {f}")));
    }
    text.push_str(&if lines.is_empty() { "Nothing.\n".into() } else { lines.join("\n") + "\n" });
    text
}

const STROKES: &str = "## What a stroke is

Each body has a seed, and its strokes are drawn from it. A blade comes from any side, at any attitude, at 0.05 to 1 m/s. It
is aimed at any place of the model's box and slices by up to half its way. Four of five blades are straight, the others a
sine or an arc. The blade is lifted where the stroke ends, between a fifth of the way and beyond the far side.

The models are those of the paper, whose two cuboids are one here: they differ in the blade alone. Armadillo, bunny and horse
are scanned meshes of the liver's size, 0.2 m, and material, fixed at their foot. They do not come with Kerf:
`STROKES_MODELS` names their paths. Gravity and loads are off, so that severed pieces stay in reach. A body is replaced after
the strokes per body above, or earlier where its largest piece is below a quarter of its voxels or 15 strokes in a row cut
nothing.

## Requirements after every stroke

- No panic, no step rolled back, every number finite.
- Every voxel is in one element and in one piece. No piece has fewer than 8 voxels.
- Every edge of the surface is passed equally often in both directions. The surface that was followed patch by patch equals
  one built anew (when a body is replaced).
- No edge of the skin is folded that is not folded in the uncut model.
- The enclosed rest volume is within A h/10 of the uncut one, with A the area that the fronts swept in this body and h the
  voxel edge. This limit is counted apart from the others.
- The ledger leaves at most 1e-2 of the tools' work unexplained, at 125 Hz and a solver tolerance of 1e-3. At the default
  tolerance of that rate, 4.8e-3, the solver leaves a residual of up to 3e-2.

## Results

";
