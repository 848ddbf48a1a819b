//! Which step rate a machine keeps: the first of several at which a trial is in time.

/// A rate is kept where at most this fraction of a trial's steps is late: half of what a run is to stay below, since
/// later strokes meet cut tissue.
const KEPT_LATE_SHARE: f64 = 0.01;

/// A step rate and what became of a trial at it.
struct Trial {
    rate_hz: f64,
    late_share: f64,
}

impl Trial {
    fn is_kept(&self) -> bool {
        self.late_share <= KEPT_LATE_SHARE
    }
}

/// The first of the step rates, Hz, that is kept with a margin, else the last; says on the terminal which and why.
/// `late_share_at` runs a trial and returns the fraction of its steps that were late. `None` where there is no rate.
///
/// # Errors
/// A trial's.
pub async fn choose(
    rates_hz: &[f64],
    late_share_at: impl AsyncFn(f64) -> anyhow::Result<f64>,
) -> anyhow::Result<Option<f64>> {
    let mut trials = Vec::new();
    for &rate_hz in rates_hz {
        let trial = Trial { rate_hz, late_share: late_share_at(rate_hz).await? };
        let is_kept = trial.is_kept();
        trials.push(trial);
        if is_kept {
            break;
        }
    }
    if let Some(text) = text(&trials) {
        eprintln!("{text}");
    }
    Ok(trials.last().map(|trial| trial.rate_hz))
}

fn text(trials: &[Trial]) -> Option<String> {
    let (chosen, above) = trials.split_last()?;
    let share = |trial: &Trial| format!("{:.1} % late at {} Hz", 100.0 * trial.late_share, trial.rate_hz);
    let tried: Vec<String> = above.iter().chain([chosen]).map(share).collect();
    let verdict = if chosen.is_kept() { "" } else { "; no rate is kept, so EXPECT OVERLOAD" };
    Some(format!("step rate {} Hz (trial: {}){verdict}", chosen.rate_hz, tried.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(trials: &[(f64, f64)]) -> String {
        let trials: Vec<Trial> = trials.iter().map(|&(rate_hz, late_share)| Trial { rate_hz, late_share }).collect();
        text(&trials).expect("trials")
    }

    #[test]
    fn the_first_line_says_what_was_tried_and_chosen() {
        let kept = said(&[(1000.0, 0.312), (500.0, 0.004)]);
        assert_eq!(kept, "step rate 500 Hz (trial: 31.2 % late at 1000 Hz, 0.4 % late at 500 Hz)");
        assert!(said(&[(250.0, 0.5)]).ends_with("EXPECT OVERLOAD"));
        assert!(text(&[]).is_none());
    }

    #[tokio::test]
    async fn rates_are_tried_until_one_is_kept() {
        let late_share_at = async |rate_hz: f64| Ok(if rate_hz > 600.0 { 0.3 } else { 0.0 });
        assert_eq!(choose(&[1000.0, 500.0, 250.0], late_share_at).await.expect("trials"), Some(500.0));
        assert_eq!(choose(&[2000.0, 1000.0], late_share_at).await.expect("trials"), Some(1000.0));
        assert_eq!(choose(&[], late_share_at).await.expect("no trial"), None);
    }
}
