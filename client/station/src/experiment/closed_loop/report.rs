//! The table and the plot of the whole loop.

use std::fmt::Write as _;
use std::net::SocketAddr;
use std::path::Path;

use kerf_plot::{Axis, Chart, Curve, Figure};

use super::{GIVEN_J, GRIP_N_PER_M, GRIP_N_S_PER_M, Outcome, Quality, Rendering, STROKE, SWING_M, TISSUES, Trial};

/// Energies are drawn by decades, from here on, mJ.
const LEAST_SHOWN_MJ: f64 = 0.01;

/// Plays every trial through a server, draws the plot into a folder and returns the report's text.
///
/// # Errors
/// The server does not answer, or a file cannot be written.
pub fn report(server: SocketAddr, folder: &Path) -> anyhow::Result<String> {
    let mut text = format!(
        "## Through a network\n\nThese runs are in real time. The simulated Omni in a grip of {GRIP_N_PER_M} N/m and \
         {GRIP_N_S_PER_M} N s/m touches the liver, leans in by {} mm and waits, leans in by {} mm and waits. \
         gRPC goes through a proxy between station and server. The proxy delays messages in order and adds jitter up \
         to the given value each way. It stalls for 200 ms at a time, as TCP does after a loss. Soft is \
         `liver-tissue`, with {} of its forces felt; stiff is `liver`, with {}.\n\nThe error is the rms difference \
         between the hand's force and the server's at the same pose, over the server's rms force. It is given for the \
         whole stroke, and for the time at full force (neither faded nor ramped). During a stall the force fades out; \
         afterwards it returns within half a second. This causes most of the error over the whole stroke. A column \
         gives the share of the waiting time at full force. Hand swing and output energy are measured at full force \
         only. Calm means a swing of less than {} mm and less than {} mJ.\n\n| tissue | round \
         trip, ms | jitter, ms | stalls, % of the time | rendering | measured round trip, ms | error, % | in \
         full, % | greatest force, N | in full, % of the waits | swing, mm | energy, mJ | |\n|{}\n",
        -1e3 * STROKE[3][1],
        -1e3 * STROKE[5][1],
        TISSUES[0].force_scale,
        TISSUES[1].force_scale,
        1e3 * SWING_M,
        1e3 * GIVEN_J,
        "---|".repeat(13),
    );
    let mut played = Vec::new();
    for tissue in TISSUES {
        for quality in qualities() {
            for rendering in Rendering::ALL {
                let trial = Trial { tissue, quality, rendering };
                let outcome = trial.run(server)?.outcome;
                let row = trial.row(&outcome);
                eprint!("{row}");
                text += &row;
                played.push((trial, outcome));
            }
        }
    }
    let passive = || played.iter().filter(|(trial, _)| trial.rendering == Rendering::Passive);
    let calm = passive().filter(|(_, outcome)| outcome.is_calm()).count();
    write!(
        text,
        "\nWith local model and passivity the hand is calm in {calm} of {} rows.\n\n![error and energy by round trip on \
         the stiff liver](haptics-closed-loop.png)\n\nMessages that the \
         deadbands save over such a stroke; their effect is part of the error above:\n\n",
        passive().count()
    )?;
    for (trial, outcome) in passive().filter(|(trial, _)| trial.quality == Quality::default()) {
        let [poses, contacts] = outcome.sent_shares.map(|share| 100.0 * (1.0 - share));
        let name = trial.tissue.name;
        writeln!(text, "- {name} tissue, no delay: {poses:.0} % fewer poses and {contacts:.0} % fewer contacts")?;
    }
    text.push('\n');
    draw(&played, folder)?;
    Ok(text)
}

/// Error and energy by round trip, on the stiff liver over an even network.
fn draw(played: &[(Trial, Outcome)], folder: &Path) -> anyhow::Result<()> {
    let curves = |of: &dyn Fn(&Outcome) -> f64| {
        let curve = |rendering: Rendering| {
            let is_shown = |trial: &Trial| {
                let Quality { round_trip_s, .. } = trial.quality;
                (trial.tissue, trial.rendering, trial.quality)
                    == (TISSUES[1], rendering, Quality { round_trip_s, ..Quality::default() })
            };
            let shown = played.iter().filter(|(trial, _)| is_shown(trial));
            let points = shown.map(|(trial, outcome)| (1e3 * trial.quality.round_trip_s, of(outcome)));
            Curve::dotted_line(rendering.name(), points.collect())
        };
        Rendering::ALL.map(curve).to_vec()
    };
    let round_trip = || Axis::linear("round trip, ms");
    let error = curves(&|outcome| 100.0 * outcome.force_error);
    let energy = curves(&|outcome| (1e3 * outcome.given_j).max(LEAST_SHOWN_MJ));
    let charts = vec![
        Chart::new(round_trip(), Axis::log("force error, %"), error),
        Chart::new(round_trip(), Axis::log("energy given out in a wait, mJ"), energy),
    ];
    Figure::row("haptics-closed-loop", "Through a network, on the stiff liver", charts).draw(folder)?;
    Ok(())
}

impl Trial {
    pub(super) fn row(&self, outcome: &Outcome) -> String {
        let Quality { round_trip_s, jitter_s, stalled_share } = self.quality;
        let (tissue, rendering, word) = (self.tissue.name, self.rendering.name(), outcome.word());
        let Outcome { round_trip_s: measured_s, rendered_share, swing_m, given_j, greatest_n, .. } = outcome;
        let [error, full_error] = [outcome.force_error, outcome.full_error].map(|share| 100.0 * share);
        let [ms, jitter_ms, measured_ms] = [round_trip_s, jitter_s, *measured_s].map(|s| 1e3 * s);
        let [stalled, rendered] = [stalled_share, *rendered_share].map(|share| 100.0 * share);
        let [swing_mm, given_mj] = [swing_m, given_j].map(|si| 1e3 * si);
        format!(
            "| {tissue} | {ms:.0} | {jitter_ms:.0} | {stalled:.0} | {rendering} | {measured_ms:.0} | {error:.1} | {full_error:.1} | \
             {greatest_n:.2} | {rendered:.0} | {swing_mm:.2} | {given_mj:.2} | {word} |\n"
        )
    }
}

/// Networks that are tried: even ones, and ones with jitter and with stalls.
fn qualities() -> Vec<Quality> {
    let even = [0.0, 0.005, 0.02, 0.05, 0.1, 0.2].map(|round_trip_s| Quality { round_trip_s, ..Quality::default() });
    let uneven = [(0.02, 0.01, 0.0), (0.02, 0.01, 0.1), (0.1, 0.01, 0.0), (0.1, 0.01, 0.1)]
        .map(|(round_trip_s, jitter_s, stalled_share)| Quality { round_trip_s, jitter_s, stalled_share });
    [even.as_slice(), &uneven].concat()
}
