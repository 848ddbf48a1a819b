//! How the cost of a step grows with voxels, elements and threads.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Result, ensure};
use kerf_plot::{Axis, Chart, Curve, Figure};
use kerf_server::machine::peak_memory_mib;

use super::run::{Run, Viewer, cell, liver, quantile, stroke};

/// Edges of the liver's voxels, m: 1,000 to 1.9 million of them.
const VOXELS_M: [f64; 8] = [0.010_96, 0.0063, 0.0035, 0.002_86, 0.002, 0.0014, 0.0011, 0.000_88];
/// A display's rate.
const FRAME_HZ: f64 = 60.0;
/// Steps of a stroke until well into the cut.
const CUT_STEPS: usize = 72;

/// The paper's Table 2 as cost per voxel: voxels, mean of a step, ms.
const PAPER: [(f64, f64); 4] = [(991.0, 1.63), (5001.0, 5.67), (30_360.0, 21.64), (55_706.0, 36.99)];

fn us_per_voxel(run: &Run) -> f64 {
    1e3 * median_ms(run) / run.counts.voxels as f64
}

fn median_ms(run: &Run) -> f64 {
    quantile(run.samples.iter().map(|sample| sample.total_ms), 0.5)
}

pub fn section(plots: &Path) -> Result<String> {
    let mut text = String::from(
        "\n## Growth with the number of voxels\n\nThe liver, 64 voxels to a composite element, 60 Hz, a stroke until \
         well into the cut, medians of all its steps. Memory is the highest of this process so far.\n\n\
         | voxels | elements | one thread, ms | us a voxel | two threads, ms | iterations a solve | memory, MiB |\n\
         |---|---|---|---|---|---|---|\n",
    );
    let mut per_voxel = Vec::new();
    for voxel_m in VOXELS_M {
        let scene = liver(voxel_m, 2, FRAME_HZ)?;
        let [one, two] = [1, 2].map(|threads| stroke(&scene, threads, Viewer::Absent, CUT_STEPS));
        let (one, two) = (one?, two?);
        ensure!(one.state_hash == two.state_hash, "threads changed the result at {} voxels", one.counts.voxels);
        per_voxel.push((one.counts.voxels as f64, us_per_voxel(&one)));
        writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} | {} |",
            one.counts.voxels,
            one.counts.composite_elements,
            cell(median_ms(&one)),
            cell(us_per_voxel(&one)),
            cell(median_ms(&two)),
            cell(one.iterations_per_solve()),
            cell(peak_memory_mib()?)
        )?;
    }
    let spread = quantile(per_voxel.iter().map(|point| point.1), 1.0) / quantile(per_voxel.iter().map(|p| p.1), 0.0);
    let paper = PAPER.map(|(voxels, ms)| (voxels, 1e3 * ms / voxels)).to_vec();
    let figure = Figure::new(
        "performance-voxels",
        "Cost of a step per voxel, liver, 64 voxels to an element, 60 Hz, one thread",
        Chart::new(
            Axis::log("voxels"),
            Axis::log("us a voxel"),
            vec![Curve::line("Kerf", per_voxel), Curve::line("the paper's Table 2, its machine", paper)],
        ),
    );
    figure.draw(plots)?;
    writeln!(
        text,
        "\nThe dearest voxel costs {spread:.2} times the cheapest.\n\n![Cost per voxel over the number of \
         voxels](performance-voxels.png)"
    )?;
    iterations(&mut text)?;
    Ok(text)
}

/// Iterations on ever smaller elements of one liver.
fn iterations(text: &mut String) -> Result<()> {
    *text += "\n## Iterations over the number of elements\n\nThe same liver, the same stroke, 60 Hz, residual 1e-3; \
              means over solves.\n\n| elements | level | voxel, mm | iterations a solve |\n|---|---|---|---|\n";
    for (voxel_m, level) in [(0.0035, 2), (0.0035, 1), (0.0035, 0), (0.001_86, 0)] {
        let run = stroke(&liver(voxel_m, level, FRAME_HZ)?, 2, Viewer::Absent, CUT_STEPS)?;
        let elements = run.counts.composite_elements;
        writeln!(text, "| {elements} | {level} | {} | {} |", 1e3 * voxel_m, cell(run.iterations_per_solve()))?;
    }
    Ok(())
}

/// One and several threads on bodies of some size, and the bits that they lead to.
pub fn threads(_plots: &Path) -> Result<String> {
    let mut text = String::from(
        "\n## Threads\n\nThe liver, 60 Hz, a stroke until well into the cut; medians of its steps, ms. Eight threads \
         share the machine's cores: they are here for their bits.\n\n\
         | elements | level | one thread | two | ratio | state after 1, 2, 8 |\n|---|---|---|---|---|---|\n",
    );
    for (voxel_m, level) in [(0.0035, 2), (0.0016, 2), (0.0035, 0)] {
        let scene = liver(voxel_m, level, FRAME_HZ)?;
        let mut runs = Vec::new();
        for threads in [1, 2, 8] {
            runs.push(stroke(&scene, threads, Viewer::Absent, CUT_STEPS)?);
        }
        let same = runs.iter().all(|run| run.state_hash == runs[0].state_hash);
        let [one, two] = [&runs[0], &runs[1]].map(median_ms);
        writeln!(
            text,
            "| {} | {level} | {} | {} | {:.2} | {} |",
            runs[0].counts.composite_elements,
            cell(one),
            cell(two),
            one / two,
            if same { "the same bits" } else { "DIFFERENT" }
        )?;
    }
    Ok(text)
}
