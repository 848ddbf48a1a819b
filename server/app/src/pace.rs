//! The step rate that this machine keeps.
//!
//! What a scene costs is told from its elements (`kerf_scenes::cost`), for the machine that those figures were taken on.
//! How much slower this one is, is measured once, when somebody first asks.

use std::sync::OnceLock;
use std::time::Instant;

use kerf_physics::{SoundScene, Workers, World};
use kerf_scenes::catalog;
use kerf_scenes::cost::Cost;
use kerf_session::LoggedInputs;
use kerf_session::clock::MonotonicClock;

use crate::script::stroke::default_stroke_in;

/// What is measured: small, soon built, and one of the paper's. Its blade is in the tissue for most of these steps.
const MEASURED: &str = "jelly";
const MEASURED_HZ: f64 = 125.0;
const FIRST_STEP: u64 = 20;
const LAST_STEP: u64 = 70;
/// Share of a step's time that steps may take: what is shown has to be made on the same cores, and a cut that has grown
/// long costs more.
const SHARE: f64 = 0.4;
/// Most that a rate is divided by: a stroke of a hand at fewer steps is felt as jerks.
const MOST_HALVINGS: u32 = 4;

/// The scene's step rate, halved until this machine keeps it. Measures, the first time: not for threads that may not wait.
#[must_use]
pub fn kept_rate_hz(scene: &SoundScene) -> f64 {
    static SLOWNESS: OnceLock<f64> = OnceLock::new();
    let told_s = Cost::of(scene).map_or(0.0, |cost| cost.step_s);
    fitted_hz(scene.desc.rate_hz, told_s * *SLOWNESS.get_or_init(measure))
}

fn fitted_hz(rate_hz: f64, step_s: f64) -> f64 {
    let halved = |halvings: u32| rate_hz / f64::from(1 << halvings);
    let keeps = (0..MOST_HALVINGS).find(|halvings| step_s * halved(*halvings) <= SHARE);
    halved(keeps.unwrap_or(MOST_HALVINGS))
}

/// Time of a step here over what it is told to be.
fn measure() -> f64 {
    measure_steps().unwrap_or_else(|error| {
        tracing::warn!("the machine's pace is not measured: {error:#}");
        1.0
    })
}

fn measure_steps() -> anyhow::Result<f64> {
    let scene = catalog::builtin(MEASURED)?.with(|desc| desc.rate_hz = MEASURED_HZ)?;
    let told_s = Cost::of(&scene)?.step_s;
    let mut world = World::new(&scene)?;
    let mut script = default_stroke_in(&world, &scene.desc);
    let mut begun = Instant::now();
    for step in 1..=LAST_STEP {
        if step == FIRST_STEP {
            begun = Instant::now();
        }
        let inputs: LoggedInputs = script.advance(step as f64 / MEASURED_HZ).into();
        world.step(&Workers::serial(), &MonotonicClock, &inputs.as_inputs());
    }
    let step_s = begun.elapsed().as_secs_f64() / (LAST_STEP - FIRST_STEP + 1) as f64;
    tracing::info!("a step of `{MEASURED}` takes {:.2} ms here", 1e3 * step_s);
    Ok(step_s / told_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_is_halved_until_it_is_kept_and_not_for_ever() {
        assert_eq!(fitted_hz(1000.0, 0.3e-3), 1000.0);
        assert_eq!(fitted_hz(1000.0, 1.0e-3), 250.0);
        assert_eq!(fitted_hz(1000.0, 1.0), 62.5);
        assert_eq!(fitted_hz(250.0, 0.0), 250.0);
    }

    #[test]
    fn a_machine_is_measured_and_larger_scenes_get_no_more_steps() {
        let slowness = measure_steps().unwrap();
        assert!((0.02..200.0).contains(&slowness), "{slowness}");
        let kept = |name| kept_rate_hz(&catalog::builtin(name).unwrap());
        assert!(kept("liver") <= kept("jelly"));
    }
}
