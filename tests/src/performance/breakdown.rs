//! The timing breakdown over a run, as the paper's Fig. 16.

use std::path::Path;

use anyhow::Result;
use kerf_physics::Stage;
use kerf_plot::{Axis, Chart, Curve, Figure};

use super::run::{COLLISION, FEM, Sample, TOPOLOGY, Viewer, builtin, stage_sum, stroke};

/// Steps whose times are averaged to a point of a curve, so that a curve can be read.
const STEPS_PER_POINT: usize = 10;

pub fn section(plots: &Path) -> Result<String> {
    let run = stroke(&builtin("liver")?, 1, Viewer::Watching, usize::MAX)?;
    let curve = |label: &str, of: &dyn Fn(&Sample) -> f64| {
        let mean = |samples: &[Sample]| {
            let ms = samples.iter().map(of).sum::<f64>() / samples.len() as f64;
            (samples[0].sim_time_s, ms)
        };
        Curve::line(label, run.samples.chunks(STEPS_PER_POINT).map(mean).collect())
    };
    let figure = Figure::new(
        "performance-breakdown",
        "A stroke through the liver, 1 kHz, one thread: time of each subroutine",
        Chart::new(
            Axis::linear("simulated time, s"),
            Axis::linear("time of a step, ms (means of ten)"),
            vec![
                curve("whole step", &|sample| sample.total_ms),
                curve("FEM", &|sample| stage_sum(sample, &FEM)),
                curve("collision", &|sample| stage_sum(sample, &COLLISION)),
                curve("fracture evolution", &|sample| stage_sum(sample, &[Stage::Fracture])),
                curve("topology and surface", &|sample| stage_sum(sample, &TOPOLOGY)),
                curve("surface adaptation", &|sample| stage_sum(sample, &[Stage::Adaptation])),
            ],
        ),
    );
    figure.draw(plots)?;
    let share = |stages: &[Stage]| {
        let sum = |of: &dyn Fn(&Sample) -> f64| run.samples.iter().map(of).sum::<f64>();
        100.0 * sum(&|sample| stage_sum(sample, stages)) / sum(&|sample| sample.total_ms)
    };
    Ok(format!(
        "\n## Breakdown over a run (the paper's Fig. 16)\n\n![Time of each subroutine over a stroke through the \
         liver](performance-breakdown.png)\n\nOf all time, FEM took {:.1} %, collision {:.1} %, fracture evolution \
         {:.1} %, topology and surface {:.1} %, surface adaptation {:.1} %.\n",
        share(&FEM),
        share(&COLLISION),
        share(&[Stage::Fracture]),
        share(&TOPOLOGY),
        share(&[Stage::Adaptation])
    ))
}
