//! The paper's Tables 1 and 2, its columns beside ours.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use kerf_physics::{SoundScene, Stage};

use super::models::{ARMADILLO, BUNNY, HORSE, Model};
use super::run::{COLLISION, FEM, Run, TOPOLOGY, Viewer, builtin, cell, liver, mean, quantile, stage_sum, stroke};

/// Where the scene of a row comes from.
enum Source {
    /// It comes with the program.
    Builtin(&'static str),
    /// A scanned mesh, which may be absent.
    Mesh(Model),
}
use Source::{Builtin, Mesh};

/// A row of the paper's Table 1: means of a step, ms.
struct Row {
    model: &'static str,
    source: Source,
    voxels: u32,
    elements: u32,
    /// FEM, evolution, collision, topology, adaptation; a step with fracture, one without.
    ms: [f64; 7],
}

const TABLE_1: [Row; 10] = [
    row("gummy bear", Builtin("gummy-bear"), 51_034, 899, [20.42, 1.89, 7.48, 30.17, 2.83, 59.96, 32.62]),
    row("jelly", Builtin("jelly"), 12_676, 240, [4.66, 0.50, 2.63, 15.76, 0.73, 23.55, 8.52]),
    row("tofu", Builtin("tofu"), 12_676, 240, [4.68, 0.49, 2.70, 14.46, 0.64, 22.33, 8.51]),
    row("rubber", Builtin("rubber"), 12_676, 240, [4.73, 0.45, 2.64, 14.41, 0.70, 22.23, 8.52]),
    row("cuboid (polyline)", Builtin("cuboid-polyline"), 59_248, 144, [2.91, 1.93, 5.81, 40.60, 6.73, 51.25, 17.38]),
    row("cuboid (sine)", Builtin("cuboid-sine"), 59_248, 144, [3.08, 2.04, 5.95, 41.70, 7.26, 52.77, 18.33]),
    row("liver", Builtin("liver"), 30_360, 559, [12.21, 1.79, 6.18, 20.22, 1.17, 40.41, 21.36]),
    row("horse", Mesh(HORSE), 4828, 68, [2.17, 0.32, 3.09, 4.24, 0.32, 10.14, 5.90]),
    row("armadillo", Mesh(ARMADILLO), 16_965, 109, [3.11, 0.58, 5.73, 16.94, 1.67, 26.36, 11.09]),
    row("bunny", Mesh(BUNNY), 44_221, 158, [4.30, 1.44, 8.47, 31.77, 2.89, 45.98, 17.10]),
];

const fn row(model: &'static str, source: Source, voxels: u32, elements: u32, ms: [f64; 7]) -> Row {
    Row { model, source, voxels, elements, ms }
}

impl Source {
    /// `None` where it is absent.
    fn scene(&self) -> Result<Option<SoundScene>> {
        match self {
            Builtin(name) => builtin(name).map(Some),
            Mesh(model) => model.scene(),
        }
    }
}

/// The paper's Table 2: voxels, composite elements, most, least and mean time of a step, ms.
const TABLE_2: [(u32, u32, f64, f64, f64); 4] = [
    (991, 29, 2.62, 1.61, 1.63),
    (5001, 107, 10.58, 5.14, 5.67),
    (30_360, 559, 41.24, 20.43, 21.64),
    (55_706, 998, 72.15, 35.28, 36.99),
];
/// Edge of the liver's voxels in the scene, and their number.
const LIVER_VOXEL_M: f64 = 0.0035;
const LIVER_VOXELS: f64 = 30_420.0;

/// A step of the paper's figures stands for a frame.
const FRAME_HZ: f64 = 60.0;

pub fn section(_plots: &Path) -> Result<String> {
    let mut text = String::from(
        "\n## The paper's Table 1\n\nMeans of a step, ms, as the paper has them; ours at 1 kHz and, where a step is \
         a frame, at 60 Hz, one thread. The paper's processor and step are not stated there. Each column is the mean \
         over the steps in which it ran. Collision is that of blade and tissue, and of the tissue with itself. At 1 \
         kHz the surface is adapted after the steps that are shown, 60 times a second.\n\n\
         | model | | voxels | elements | FEM | evolution | collision | topology | adaptation | fracture | no fracture \
         |\n|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for row in &TABLE_1 {
        text += &row.lines(usize::MAX)?;
    }
    text += &table_2()?;
    Ok(text)
}

impl Row {
    /// The paper's line and ours, over at most `max_steps` of a stroke.
    fn lines(&self, max_steps: usize) -> Result<String> {
        let Self { model, source, voxels, elements, ms } = self;
        let ms = ms.map(|ms| ms.to_string()).join(" | ");
        let mut text = format!("| {model} | paper | {voxels} | {elements} | {ms} |\n");
        let Some(mut scene) = source.scene()? else {
            return Ok(
                text + "| | absent: TEST_SHARED names no folder of meshes | - | - | - | - | - | - | - | - | - |\n"
            );
        };
        for rate_hz in [1000.0, FRAME_HZ] {
            scene = scene.with(|desc| desc.rate_hz = rate_hz)?;
            let run = stroke(&scene, 1, Viewer::Watching, max_steps)?;
            writeln!(text, "| | {rate_hz} Hz {}", columns(&run))?;
        }
        Ok(text)
    }
}

fn columns(run: &Run) -> String {
    let all = |stages: &[Stage]| {
        let ran = run.samples.iter().filter(|sample| !sample.stage_ms[stages[0] as usize].is_nan());
        mean(ran.map(|sample| stage_sum(sample, stages)))
    };
    let total = |fracture: bool| mean(run.of_kind(fracture).map(|sample| sample.total_ms));
    let cells = [
        all(&FEM),
        all(&[Stage::Fracture]),
        all(&COLLISION),
        run.mean_stages_ms(true, &TOPOLOGY),
        all(&[Stage::Adaptation]),
        total(true),
        total(false),
    ];
    let cells = cells.map(cell).join(" | ");
    format!("| {} | {} | {cells} |", run.counts.voxels, run.counts.composite_elements)
}

fn table_2() -> Result<String> {
    let mut text = String::from(
        "\n## The paper's Table 2\n\nThe liver at several resolutions, 64 voxels to a composite element; all steps of \
         a stroke, ms, one thread, 60 Hz.\n\n\
         | | voxels | elements | most | least | mean |\n|---|---|---|---|---|---|\n",
    );
    for (voxels, elements, most, least, average) in TABLE_2 {
        writeln!(text, "| paper | {voxels} | {elements} | {most} | {least} | {average} |")?;
        let voxel_m = LIVER_VOXEL_M * (LIVER_VOXELS / f64::from(voxels)).cbrt();
        let run = stroke(&liver(voxel_m, 2, FRAME_HZ)?, 1, Viewer::Watching, usize::MAX)?;
        let times = || run.samples.iter().map(|sample| sample.total_ms);
        let cells = [quantile(times(), 1.0), quantile(times(), 0.0), mean(times())].map(cell).join(" | ");
        writeln!(text, "| ours | {} | {} | {cells} |", run.counts.voxels, run.counts.composite_elements)?;
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_totals_are_the_sums_of_its_columns() {
        for Row { model, ms: [fem, evolution, collision, topology, adaptation, fracture, no_fracture], .. } in TABLE_1 {
            let always = fem + evolution + collision;
            // The horse's has its adaptation in it.
            let with_fracture = always + topology + if model == "horse" { adaptation } else { 0.0 };
            assert!((with_fracture - fracture).abs() < 0.015, "{model}: {with_fracture} {fracture}");
            assert!((always + adaptation - no_fracture).abs() < 0.015, "{model}: {}", always + adaptation);
        }
    }

    #[test]
    fn every_row_has_its_scene_or_says_that_it_is_absent() {
        for row in TABLE_1 {
            if row.source.scene().unwrap().is_none() {
                println!("SKIPPED: {} is absent", row.model);
            }
        }
    }

    #[test]
    fn a_row_has_the_papers_line_and_ours_at_both_rates() {
        let lines = TABLE_1[1].lines(3).unwrap();
        assert_eq!(lines.lines().count(), 3);
        assert!(lines.lines().all(|line| line.split('|').count() == 13), "{lines}");
        assert!(lines.lines().nth(1).is_some_and(|line| line.starts_with("| | 1000 Hz |")), "{lines}");
    }
}
