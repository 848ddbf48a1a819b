//! What a driver that feels adds: the models of its tool's contact.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use kerf_physics::Stage;

use super::run::{Stroke, builtin, cell, mean, quantile, stage_sum};

/// Models a second, and how many steps of the liver that is.
const RATES: [(u32, usize); 3] = [(60, 17), (250, 4), (1000, 1)];

pub fn section(_plots: &Path) -> Result<String> {
    let mut text = String::from(
        "\n## What a driver that feels costs\n\nThe liver at 1 kHz, one thread, with a model of the blade's contact so many \
         times a second. A model is made of a few iterations of the solve ([contact model](contact-model.md)); they end early where \
         the tissue is as it was. A driver that renders no forces, as Python's, is made none.\n\n| models, Hz | mean of a model while \
         the blade touches, ms | its 95th percentile | of the time of all steps | whole step, mean, ms |\n|---|---|---|---|---|\n",
    );
    let scene = builtin("liver")?;
    let plain = Stroke::ALONE.run(&scene)?;
    writeln!(text, "| none | | | | {} |", cell(mean(plain.samples.iter().map(|sample| sample.total_ms))))?;
    for (rate_hz, steps_per_model) in RATES {
        let run = Stroke { steps_per_model, ..Stroke::ALONE }.run(&scene)?;
        // Below this the blade touched nothing.
        let touches = |ms: &f64| *ms > 0.01;
        let models = || run.samples.iter().map(|s| stage_sum(s, &[Stage::ContactModel])).filter(touches);
        let total_ms: f64 = run.samples.iter().map(|sample| sample.total_ms).sum();
        let share = 100.0 * models().sum::<f64>() / total_ms;
        let [each, slow] = [mean(models()), quantile(models(), 0.95)].map(cell);
        let whole = cell(total_ms / run.samples.len() as f64);
        writeln!(text, "| {rate_hz} | {each} | {slow} | {share:.0} % | {whole} |")?;
    }
    Ok(text)
}
