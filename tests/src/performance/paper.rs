//! The paper's Tables 1 and 2, its columns beside ours.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use kerf_physics::Stage;

use super::run::{FEM, Run, TOPOLOGY, Viewer, builtin, cell, liver, mean, quantile, stroke};

/// A row of the paper's Table 1 for a scene that comes with the program: means of a step, ms.
struct Row {
    scene: &'static str,
    voxels: u32,
    elements: u32,
    fem: f64,
    evolution: f64,
    collision: f64,
    topology: f64,
    adaptation: f64,
    fracture: f64,
    no_fracture: f64,
}

const TABLE_1: [Row; 5] = [
    row("jelly", 12_676, 240, [4.66, 0.50, 2.63, 15.76, 0.73, 23.55, 8.52]),
    row("tofu", 12_676, 240, [4.68, 0.49, 2.70, 14.46, 0.64, 22.33, 8.51]),
    row("rubber", 12_676, 240, [4.73, 0.45, 2.64, 14.41, 0.70, 22.23, 8.52]),
    row("cuboid", 59_248, 144, [2.91, 1.93, 5.81, 40.60, 6.73, 51.25, 17.38]),
    row("liver", 30_360, 559, [12.21, 1.79, 6.18, 20.22, 1.17, 40.41, 21.36]),
];

const fn row(scene: &'static str, voxels: u32, elements: u32, ms: [f64; 7]) -> Row {
    let [fem, evolution, collision, topology, adaptation, fracture, no_fracture] = ms;
    Row { scene, voxels, elements, fem, evolution, collision, topology, adaptation, fracture, no_fracture }
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
         a frame, at 60 Hz, one thread. The paper's processor and step are not stated there. Its surface mesh is \
         adapted where ours is not yet.\n\n\
         | model | | voxels | elements | FEM | evolution | collision | topology | adaptation | fracture | no fracture \
         |\n|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for row in &TABLE_1 {
        let Row { scene, voxels, elements, fem, evolution, collision, topology, adaptation, fracture, no_fracture } =
            row;
        writeln!(
            text,
            "| {scene} | paper | {voxels} | {elements} | {fem} | {evolution} | {collision} | {topology} | {adaptation} \
             | {fracture} | {no_fracture} |"
        )?;
        for rate_hz in [1000.0, FRAME_HZ] {
            let mut scene = builtin(row.scene)?;
            scene.desc.rate_hz = rate_hz;
            let run = stroke(&scene, 1, Viewer::Watching, usize::MAX)?;
            writeln!(text, "| | {rate_hz} Hz {}", columns(&run))?;
        }
    }
    text += &table_2()?;
    Ok(text)
}

fn columns(run: &Run) -> String {
    let all = |stages: &[Stage]| {
        let ran = run.samples.iter().filter(|sample| !sample.stage_ms[stages[0] as usize].is_nan());
        mean(ran.map(|sample| super::run::stage_sum(sample, stages)))
    };
    let total = |fracture: bool| mean(run.of_kind(fracture).map(|sample| sample.total_ms));
    let cells = [
        all(&FEM),
        all(&[Stage::Fracture]),
        all(&[Stage::Contact]),
        run.mean_stages_ms(true, &TOPOLOGY),
        f64::NAN,
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
