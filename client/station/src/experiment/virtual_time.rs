//! How stiff tissue may be before the hand begins to shake, by round trip and by what the station renders.
//!
//! In virtual time, the same figures every time: the simulated Omni in a light grip leans 5 mm into a spring that a
//! server of one line answers for, so and so much later. Nothing but the servo itself is the real one.

use std::collections::VecDeque;
use std::fmt::Write as _;
use std::path::Path;

use kerf_plot::{Axis, Chart, Curve, Figure};
use kerf_script::Pose;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::Rendering;
use crate::config::{DeviceConfig, HandConfig, SimulatedConfig};
use crate::device::{Device, simulated::Simulated};
use crate::servo::core::Core;
use crate::servo::limits::clamped;
use crate::servo::model::{Along, LocalModel, Update};
use crate::servo::runner::settings;
use crate::servo::{Hand, Newest};

const DT_S: f64 = 1e-3;
/// Contacts come every so many steps: 250 Hz.
const CONTACT_STEPS: usize = 4;
const STEPS: usize = 5000;
/// What the hand does in the end is judged over these.
const JUDGED_STEPS: usize = 1000;
/// More than this is shaking, m.
const SWING_M: f64 = 0.5e-3;
/// How far the hand leans in, m.
const DEPTH_M: f64 = 5e-3;
/// Stiffness from and to which is searched, N/m.
const SEARCHED_N_PER_M: [f64; 2] = [5.0, 1e5];
/// Round trips, ms.
const ROUND_TRIPS_MS: [usize; 6] = [0, 5, 20, 50, 100, 200];

/// What is compared: what is rendered, and the share of the tissue's stiffness that the model says.
const KINDS: [(&str, Rendering, f64); 6] = [
    ("held force", Rendering::Held, 1.0),
    ("local model", Rendering::Model, 1.0),
    ("local model, passive", Rendering::Passive, 1.0),
    ("a third of the stiffness", Rendering::Model, 1.0 / 3.0),
    ("a third, passive", Rendering::Passive, 1.0 / 3.0),
    ("three times, passive", Rendering::Passive, 3.0),
];

/// One contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trial {
    /// What is rendered.
    pub rendering: Rendering,
    /// From a motion to the contact that reflects it, steps of 1 ms.
    pub round_trip_steps: usize,
    /// Of the tissue, N/m.
    pub stiffness_n_per_m: f64,
    /// Stiffness that the model says, as a share of the tissue's.
    pub model_share: f64,
}

/// What came of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// How far the hand swings in the end, m.
    pub swing_m: f64,
    /// Greatest energy that the device has given out beyond what it took in, J.
    pub given_j: f64,
    /// Force that is rendered less the tissue's at the same place, rms over rms.
    pub force_error: f64,
}

impl Trial {
    /// Plays it.
    #[must_use]
    pub fn run(&self) -> Outcome {
        let hand = HandConfig {
            stiffness_n_per_m: 100.0,
            damping_n_s_per_m: 1.0,
            path: vec![[0.0, 0.0, 0.0, 0.0], [1.0, 0.0, -DEPTH_M, 0.0]],
            ends: true,
            ..HandConfig::default()
        };
        let mut device = Simulated::new(&SimulatedConfig { hand, friction_n: 0.0, ..SimulatedConfig::default() });
        let mut limits = settings(device.info(), &DeviceConfig::default());
        if self.rendering != Rendering::Passive {
            limits.passivity = None;
        }
        let mut core = Core::new(limits);
        let tissue_n = |y_m: f64| self.stiffness_n_per_m * (-y_m).max(0.0);
        let mut on_the_way: VecDeque<f64> = std::iter::repeat_n(0.0, self.round_trip_steps + 1).collect();
        let (mut update, mut age_s, mut force_n) = (Update::default(), 0.0, Vector3::zeros());
        let (mut balance_j, mut given_j) = (0.0_f64, 0.0_f64);
        let (mut heights_m, mut wrong, mut right) = ([f64::MAX, f64::MIN], 0.0, 0.0);
        for step in 0..STEPS {
            let before_m = device.truth().0;
            let state = device.step(DT_S, &force_n);
            let now_m = device.truth().0;
            balance_j -= force_n.dot(&(now_m - before_m));
            given_j = given_j.max(-balance_j);
            let tool_m = on_the_way.pop_front().unwrap_or_default();
            if step % CONTACT_STEPS == 0 {
                update = self.contact(update.number + 1, tool_m, tissue_n(tool_m));
                age_s = 0.0;
            }
            let hand = Hand {
                pose: Pose { position_m: state.position_m, orientation: state.orientation },
                velocity_m_per_s: state.velocity_m_per_s,
            };
            let pose_age_s = age_s + self.round_trip_steps as f64 * DT_S;
            let rendered = core.tick(DT_S, &hand, None, Some(Newest { update: &update, age_s, pose_age_s }));
            let (tool_m, felt_n) = match self.rendering {
                Rendering::Held => {
                    let came_n = update.model.map_or_else(Vector3::zeros, |model| model.force_n);
                    force_n = clamped(came_n, limits.peak_force_n);
                    (state.position_m.y, came_n.y)
                }
                Rendering::Model | Rendering::Passive => {
                    force_n = rendered.force_n;
                    (rendered.tool.map_or(0.0, |tool| tool.position_m.y), rendered.contact_n.y)
                }
            };
            on_the_way.push_back(tool_m);
            age_s += DT_S;
            if step >= STEPS - JUDGED_STEPS {
                heights_m = [heights_m[0].min(now_m.y), heights_m[1].max(now_m.y)];
                wrong += (felt_n - tissue_n(tool_m)).powi(2);
                right += tissue_n(tool_m).powi(2);
            }
        }
        Outcome { swing_m: heights_m[1] - heights_m[0], given_j, force_error: (wrong / right.max(1e-12)).sqrt() }
    }

    fn contact(&self, number: u64, tool_m: f64, force_n: f64) -> Update {
        let stiffness = Matrix3::from_diagonal(&(Vector3::y() * (self.model_share * self.stiffness_n_per_m)));
        let orientation = UnitQuaternion::identity();
        let model = LocalModel {
            reference: Pose { position_m: Vector3::y() * tool_m, orientation },
            force_n: Vector3::y() * force_n,
            stiffness_n_per_m: stiffness,
            turning_n_per_rad: Matrix3::zeros(),
            velocity_m_per_s: Vector3::zeros(),
            damping_n_s_per_m: Matrix3::zeros(),
            along: Along::Pushes,
        };
        Update {
            number,
            model: (force_n > 0.0).then_some(model),
            blend_s: CONTACT_STEPS as f64 * DT_S,
            round_trip_s: self.round_trip_steps as f64 * DT_S,
            max_age_s: 0.1,
            ..Update::default()
        }
    }

    /// The stiffest tissue that does not make the hand shake, N/m, by halving.
    #[must_use]
    pub fn stiffest(self) -> f64 {
        let shakes = |stiffness_n_per_m| Self { stiffness_n_per_m, ..self }.run().swing_m > SWING_M;
        let [mut calm, mut shaking] = SEARCHED_N_PER_M;
        if !shakes(shaking) {
            return shaking;
        }
        while shaking / calm > 1.1 {
            let middle = (calm * shaking).sqrt();
            if shakes(middle) {
                shaking = middle;
            } else {
                calm = middle;
            }
        }
        calm
    }
}

/// Tissues that are tried at every round trip, N/m: soft, stiff, and stiffer than any device.
const TISSUES_N_PER_M: [f64; 3] = [100.0, 1000.0, 10_000.0];

/// Plays all trials, draws the plot into a folder and returns the report's text.
///
/// # Errors
/// A file cannot be written.
pub fn report(folder: &Path) -> anyhow::Result<String> {
    let mut text = String::from(
        "## The stiffest tissue by round trip\n\nThese runs are in virtual time. The simulated Omni (0.1 kg, 3.3 N, \
         500 N/m, encoders of 55 um) in a light grip (100 N/m, 1 N s/m) leans 5 mm into a spring. Contacts come at \
         250 Hz. Calm means a swing below 0.5 mm after 4 s. The search ends at 100,000 N/m. A wrong model has a third \
         of the tissue's stiffness, or three times it.\n\n| round trip, ms ",
    );
    let trial = |rendering, round_trip_steps, model_share| Trial {
        rendering,
        round_trip_steps,
        stiffness_n_per_m: 0.0,
        model_share,
    };
    let mut curves: Vec<Curve> = KINDS.iter().map(|(name, ..)| Curve::dotted_line(name, Vec::new())).collect();
    curves.iter().for_each(|curve| text += &format!("| {} ", curve.label));
    text += &format!("| coupling, N/m |\n|{}\n", "---|".repeat(KINDS.len() + 2));
    let coupling = settings(Simulated::new(&SimulatedConfig::default()).info(), &DeviceConfig::default()).coupling;
    for ms in ROUND_TRIPS_MS {
        let stiffest = KINDS.map(|(_, rendering, model_share)| trial(rendering, ms, model_share).stiffest());
        for (curve, stiffest) in curves.iter_mut().zip(stiffest) {
            // A round trip of nothing has no place by decades.
            curve.points.push((ms.max(1) as f64, stiffest));
        }
        let coupling = crate::servo::schedule::Schedule::stiffness_n_per_m(&coupling, ms as f64 * DT_S);
        write!(text, "| {ms} ")?;
        stiffest.iter().try_for_each(|stiffest| write!(text, "| {stiffest:.0} "))?;
        writeln!(text, "| {coupling:.0} |")?;
    }
    let chart = Chart::new(Axis::log("round trip, ms (0 is drawn at 1)"), Axis::log("stiffest tissue, N/m"), curves);
    Figure::new("haptics-stability", "Stiffest tissue that does not shake the hand", chart).draw(folder)?;
    text += "\nA model that is too soft lets the tool sink in before the server answers. Tool and tissue then push each other \
             back, and the controller brakes only the hand. So the server's stiffness has to be right.\n\
             \n![stiffest tissue by round trip](haptics-stability.png)\n\n## What is felt\n\nThe table has the swing \
             of the hand and the energy released beyond the energy absorbed. The force error is the rms difference \
             between the rendered contact's force and the tissue's at the same place, over the tissue's rms \
             force.\n\n| tissue, N/m | round trip, ms | rendering | swing, mm | energy, mJ | force error, % |\n\
             |---|---|---|---|---|---|\n";
    for stiffness_n_per_m in TISSUES_N_PER_M {
        for ms in ROUND_TRIPS_MS {
            for rendering in Rendering::ALL {
                let Outcome { swing_m, given_j, force_error } =
                    Trial { stiffness_n_per_m, ..trial(rendering, ms, 1.0) }.run();
                let [swing, given, error] = [1e3 * swing_m, 1e3 * given_j, 100.0 * force_error];
                let name = rendering.name();
                writeln!(text, "| {stiffness_n_per_m} | {ms} | {name} | {swing:.2} | {given:.2} | {error:.1} |")?;
            }
        }
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn with_model_and_passivity_no_round_trip_makes_the_hand_shake_as_held_forces_do() {
        let trial = |rendering, round_trip_steps, stiffness_n_per_m| {
            Trial { rendering, round_trip_steps, stiffness_n_per_m, model_share: 1.0 }.run()
        };
        for ms in [20, 100, 200] {
            assert!(trial(Rendering::Held, ms, 1000.0).swing_m > 5e-3, "{ms} ms");
            let passive = trial(Rendering::Passive, ms, 1000.0);
            assert!(passive.swing_m < SWING_M && passive.given_j < 2e-3, "{ms} ms: {passive:?}");
            assert!(passive.force_error < 0.05, "{ms} ms: {passive:?}");
        }
    }
}
