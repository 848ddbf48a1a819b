//! `docs/strokes.md`, from the tallies of a run.

use std::fmt::Write as _;

use super::campaign::Tally;

/// What is reported.
pub struct Report<'a> {
    /// The command that was given.
    pub command: &'a str,
    /// Seed of the run.
    pub seed: u64,
    /// Strokes through each model that were asked for.
    pub strokes: u32,
    /// One for each model.
    pub tallies: &'a [Tally],
    /// Resident set of the process, MB: highest in the first tenth of the strokes, and highest of all.
    pub resident_mb: Option<[f64; 2]>,
}

impl Report<'_> {
    /// The report in Markdown.
    #[must_use]
    pub fn markdown(&self) -> String {
        let mut text = preface(self.command, self.seed);
        if self.tallies.iter().any(|tally| tally.strokes < self.strokes) {
            _ = writeln!(
                text,
                "The run was cut off before all of its strokes were made: these are the figures so far.\n"
            );
        }
        text.push_str(
            "| model | voxels | h, mm | strokes | that cut | bodies | steps | links parted | spared | area, m^2 | most pieces \
             | least piece, voxels | left out | faults | dV/(A h), worst | residual/work, worst | lone cracks | state hash | failures |\n\
             |---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
        );
        for tally in self.tallies {
            _ = writeln!(text, "{}", row(tally));
        }
        if let Some([early, most]) = self.resident_mb {
            _ = writeln!(
                text,
                "\nResident set of the process: at most {early:.0} MB in the first tenth of the strokes, {most:.0} MB in all."
            );
        }
        text.push_str("\n## What does not hold\n\n");
        if self.tallies.iter().all(|tally| tally.failures == 0) {
            text.push_str("Nothing was found.\n");
        }
        for tally in self.tallies {
            tally.findings.iter().for_each(|finding| _ = writeln!(text, "- {}: {finding}", tally.name));
        }
        text
    }
}

/// A line of the table.
#[must_use]
pub fn row(tally: &Tally) -> String {
    let t = tally;
    format!(
        "| {} | {} | {:.2} | {} | {} | {} | {} | {} | {} | {:.3} | {} | {} | {} | {} | {:.4} | {:.1e} | {} | {:016x} | {} |",
        t.name,
        t.voxels,
        t.voxel_m * 1e3,
        t.strokes,
        t.cutting_strokes,
        t.bodies,
        t.steps,
        t.parted_links,
        t.spared_links,
        t.cut_area_m2,
        t.most_pieces,
        t.least_piece,
        t.left_out,
        t.faults,
        t.volume_ratio,
        t.residual_ratio,
        t.lone_cracks,
        t.state_hash,
        t.failures,
    )
}

fn preface(command: &str, seed: u64) -> String {
    format!(
        "# Arbitrary strokes\n\n\
         Written by `{command}`, seed {seed}. Each stroke has a seed of its own, drawn from that: a blade (four of\n\
         five times straight, else a sine or an arc) comes from any side, at any attitude, at 0.05 to 1 m/s, aimed at\n\
         any place of the model's box, slicing by up to half its way, and is lifted where it ends: between a fifth of\n\
         the way and beyond the far side. The liver is the built-in one, the others are meshes of its size (0.2 m)\n\
         and material, held at their foot; gravity and loads are off, so that what is cut off stays in reach. A body\n\
         whose largest piece is below a quarter of its voxels, or that 15 strokes in a row parted nothing of, gives\n\
         way to a fresh one.\n\n\
         Asked after every stroke: no step rolled back, no panic, every number finite; every voxel in one element and\n\
         in one piece, no piece of fewer than 8 voxels (those that a mesh has at first are left out); every edge of the surface passed equally often in both\n\
         directions, and the surface followed from patch to patch equal to one built anew (when a body is given up);\n\
         enclosed rest volume within A h/10 of the uncut one (A: area the fronts swept in this body, h: voxel edge);\n\
         the energy the ledger leaves unexplained within 1e-2 of the tools' work. A lone crack is a parted link whose\n\
         faces share no edge with another link's.\n\n"
    )
}
