//! Which setting a machine keeps: the first of several at which a trial is in time.

use std::fmt;

/// A setting is kept where less than this fraction of a trial's steps is late: half of what a run is to stay below,
/// since later strokes meet cut tissue.
const KEPT_LATE_SHARE: f64 = 0.01;

/// What a session may be run with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// Level of every object; absent: as the scene or the dial has it.
    pub level: Option<u32>,
    /// Steps per simulated second, Hz.
    pub rate_hz: f64,
}

impl fmt::Display for Setting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} steps a second", self.rate_hz)?;
        self.level.map_or(Ok(()), |level| write!(f, " at level {level}"))
    }
}

/// A setting and what became of a trial of it.
#[derive(Clone, Copy, Debug)]
struct Trial {
    setting: Setting,
    late_share: f64,
}

impl Trial {
    fn is_kept(&self) -> bool {
        self.late_share < KEPT_LATE_SHARE
    }
}

/// The settings in the order in which they are tried: every rate of a level before the next level.
pub fn candidates(levels: &[u32], rates_hz: &[f64]) -> impl Iterator<Item = Setting> {
    let levels = match levels {
        [] => vec![None],
        levels => levels.iter().copied().map(Some).collect(),
    };
    levels.into_iter().flat_map(move |level| rates_hz.iter().map(move |&rate_hz| Setting { level, rate_hz }))
}

/// The first setting that is kept, else the one of which least is late; says on the terminal what was found.
/// `late_share_at` runs a trial and returns the fraction of its steps that were late. `None` where there is none to
/// choose from, and one alone without a trial.
///
/// # Errors
/// A trial's.
pub async fn choose(
    candidates: impl Iterator<Item = Setting>,
    late_share_at: impl AsyncFn(Setting) -> anyhow::Result<f64>,
) -> anyhow::Result<Option<Setting>> {
    let candidates: Vec<Setting> = candidates.collect();
    if let [only] = candidates[..] {
        return Ok(Some(only));
    }
    let mut trials: Vec<Trial> = Vec::new();
    for setting in candidates {
        let trial = Trial { setting, late_share: late_share_at(setting).await? };
        eprintln!("tried {setting}: {:.1} % of them came late", 100.0 * trial.late_share);
        trials.push(trial);
        if trial.is_kept() {
            break;
        }
    }
    // The one that is kept is the last, and earlier than the others.
    let chosen = trials.iter().copied().min_by(|a, b| a.late_share.total_cmp(&b.late_share));
    if let Some(chosen) = &chosen {
        eprintln!("{}", text(chosen, &trials));
    }
    Ok(chosen.map(|trial| trial.setting))
}

/// What was found, for somebody who has not seen it before.
fn text(chosen: &Trial, trials: &[Trial]) -> String {
    let Trial { setting, late_share } = chosen;
    let late = format!("{:.1} % of them late", 100.0 * late_share);
    let coarser = match (trials.first().map(|first| first.setting.level), setting.level) {
        (Some(Some(first)), Some(level)) if level > first => {
            format!(" Level {first} was too much for it at every rate, so the tissue is made of coarser elements.")
        }
        _ => String::new(),
    };
    match chosen.is_kept() {
        true => format!("This machine keeps {setting}, with {late}.{coarser}"),
        false => format!(
            "This machine comes nearest to real time with {setting}, with {late}: the tissue moves more slowly than \
             the hand.{coarser}"
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATES_HZ: [f64; 3] = [1000.0, 500.0, 250.0];

    async fn chosen(levels: &[u32], late_share: impl Fn(Setting) -> f64) -> Option<Setting> {
        let late_share_at = async |setting| Ok(late_share(setting));
        choose(candidates(levels, &RATES_HZ), late_share_at).await.expect("trials")
    }

    #[tokio::test]
    async fn the_highest_rate_that_is_kept_is_taken_before_a_coarser_level() {
        let by_rate = |setting: Setting| if setting.rate_hz > 300.0 { 0.3 } else { 0.0 };
        assert_eq!(chosen(&[2, 3], by_rate).await, Some(Setting { level: Some(2), rate_hz: 250.0 }));
        assert_eq!(chosen(&[], by_rate).await, Some(Setting { level: None, rate_hz: 250.0 }));
    }

    #[tokio::test]
    async fn a_coarser_level_is_taken_where_no_rate_is_kept() {
        let by_both = |setting: Setting| match (setting.level, setting.rate_hz) {
            (Some(3), ..=500.0) => 0.009,
            _ => 0.01,
        };
        assert_eq!(chosen(&[2, 3], by_both).await, Some(Setting { level: Some(3), rate_hz: 500.0 }));
    }

    #[tokio::test]
    async fn where_nothing_is_kept_the_least_late_is_taken() {
        let late_share = |setting: Setting| if setting.rate_hz == 500.0 { 0.2 } else { 0.3 };
        assert_eq!(chosen(&[], late_share).await, Some(Setting { level: None, rate_hz: 500.0 }));
        let none = choose(candidates(&[1], &[]), async |_| Ok(0.0)).await.expect("no trial");
        assert_eq!(none, None);
        let only = choose(candidates(&[], &[60.0]), async |_| unreachable!("nothing to choose from")).await;
        assert_eq!(only.expect("no trial"), Some(Setting { level: None, rate_hz: 60.0 }));
    }

    #[test]
    fn the_last_line_says_what_the_machine_keeps_and_what_that_cost() {
        let trial = |level, rate_hz, late_share| Trial { setting: Setting { level, rate_hz }, late_share };
        let (fast, slow) = (trial(Some(2), 1000.0, 0.312), trial(Some(2), 500.0, 0.004));
        assert_eq!(
            text(&slow, &[fast, slow]),
            "This machine keeps 500 steps a second at level 2, with 0.4 % of them late."
        );
        let coarse = trial(Some(3), 60.0, 0.0);
        let said = text(&coarse, &[fast, coarse]);
        assert!(
            said.ends_with("Level 2 was too much for it at every rate, so the tissue is made of coarser elements.")
        );
        let said = text(&fast, &[fast]);
        assert!(said.contains("nearest to real time with 1000 steps a second at level 2, with 31.2 % of them late"));
    }
}
