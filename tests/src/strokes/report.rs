//! `docs/strokes.md`, from the tallies of a run.

use std::fmt::Write as _;

use super::campaign::Tally;

/// What is reported.
pub struct Report<'a> {
    /// Seed of the run.
    pub seed: u64,
    /// Strokes through each model that were asked for.
    pub strokes: u32,
    /// Strokes through one body, at most.
    pub per_body: u32,
    /// Voxels along a model's longest edge.
    pub resolution: u32,
    /// One for each model.
    pub models: &'a [Summary<'a>],
}

/// What came of all strokes through a model.
pub struct Summary<'a> {
    /// The model's name.
    pub name: &'a str,
    /// Its bodies summed up.
    pub tally: Tally,
    /// Highest resident set of the process in the first tenth of the strokes, bytes.
    pub early_resident_bytes: Option<u64>,
}

impl Report<'_> {
    /// The report in Markdown.
    #[must_use]
    pub fn markdown(&self) -> String {
        let mut text = self.preface();
        if self.models.iter().any(|model| model.tally.strokes < self.strokes) {
            _ = writeln!(
                text,
                "The run was cut off before all of its strokes were made: these are the figures so far.\n"
            );
        }
        text.push_str(
            "| model | voxels | h, mm | left out | strokes | that cut | bodies | steps | links parted | spared | area, m^2 | most pieces \
             | least piece, voxels | rolled back | dV/(A h), mean, worst | beyond 0.1 | residual/work, worst | lone cracks | memory, MB, early, all | last state | failures |\n\
             |---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
        );
        for model in self.models {
            _ = writeln!(text, "{}", row(model));
        }
        text.push_str("\n## What does not hold\n\n");
        if self.models.iter().all(|Summary { tally, .. }| tally.failures + tally.volume_misses == 0) {
            text.push_str("Nothing was found.\n");
        }
        for Summary { name, tally, .. } in self.models {
            if tally.volume_misses > 0 {
                let Tally { volume_misses, strokes, .. } = tally;
                _ = writeln!(
                    text,
                    "- {name}: after {volume_misses} of {strokes} strokes the enclosed volume was beyond its bound."
                );
            }
            tally.findings.iter().for_each(|finding| _ = writeln!(text, "- {name}: {finding}"));
        }
        text
    }

    fn preface(&self) -> String {
        let Self { seed, strokes, per_body, resolution, .. } = self;
        format!(
            "# Arbitrary strokes\n\n\
             Written by `make strokes`: `strokes --strokes {strokes} --per-body {per_body} --resolution {resolution} --seed {seed}`.\n\
             Each body has a seed, drawn from that, and its strokes are drawn from the body's: a blade (four of five times\n\
             straight, else a sine or an arc) comes from any side, at any attitude, at 0.05 to 1 m/s, aimed at any place\n\
             of the model's box, slicing by up to half its way, and is lifted where it ends: between a fifth of the way\n\
             and beyond the far side. The liver is the built-in one, the others are meshes (`STROKES_MODELS`) of its size,\n\
             0.2 m, and material, held at their foot; gravity and loads are off, so that what is cut off stays in reach. A\n\
             body gives way to a fresh one after {per_body} strokes, and earlier where its largest piece is below a quarter\n\
             of its voxels or 15 strokes in a row parted nothing of it.\n\n\
             Asked after every stroke: no step rolled back, no panic, every number finite; every voxel in one element and\n\
             in one piece, no piece of fewer than 8 voxels (those that a mesh has at first are left out); every edge of\n\
             the surface passed equally often in both directions, and the surface followed from patch to patch equal to\n\
             one built anew (when a body is given up); enclosed rest volume within A h/10 of the uncut one (A: area the\n\
             fronts swept in this body, h: voxel edge; the mean is over the bodies at their end); the energy the ledger\n\
             leaves unexplained within 1e-2 of the tools' work, at a tolerance of 1e-3 (at this rate's default, 4.8e-3, it\n\
             is up to 3e-2: it is what the solver leaves). A lone crack is a parted link whose faces share no edge with\n\
             another link's. Memory is the highest resident set of the process, which cuts a body on each\n\
             thread, in the first tenth of the strokes and in all.\n\n"
        )
    }
}

fn row(model: &Summary<'_>) -> String {
    let Summary { name, tally: t, early_resident_bytes } = model;
    let mb = |bytes: Option<u64>| bytes.map_or("-".to_owned(), |bytes| format!("{:.0}", bytes as f64 * 1e-6));
    format!(
        "| {name} | {} | {:.2} | {} | {} | {} | {} | {} | {} | {} | {:.3} | {} | {} | {} | {:.3}, {:.3} | {} | {:.1e} | {} | {}, {} | {:016x} | {} |",
        t.voxels,
        t.voxel_m * 1e3,
        t.left_out,
        t.strokes,
        t.cutting_strokes,
        t.bodies,
        t.steps,
        t.parted_links,
        t.spared_links,
        t.cut_area_m2,
        t.most_pieces,
        t.least_piece,
        t.faults,
        t.volume_change_m3 / (t.cut_area_m2 * t.voxel_m),
        t.volume_ratio,
        t.volume_misses,
        t.residual_ratio,
        t.lone_cracks,
        mb(*early_resident_bytes),
        mb(t.resident_bytes),
        t.state_hash,
        t.failures,
    )
}
