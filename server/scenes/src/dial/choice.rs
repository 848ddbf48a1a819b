//! Settles what a scene or a session asks of the dial.

use std::fmt;
use std::path::Path;

use kerf_physics::scene::{DialDesc, SceneDesc};
use kerf_physics::{Scene, SceneProblems, SoundScene};

use super::pareto::{ParetoError, ParetoFront, ParetoPoint};
use super::setting::{FinerRegions, Setting, fingerprint, states_finer};

/// Measured Pareto fronts, one per scene; of several for one scene the first holds.
#[derive(Clone, Debug, Default)]
pub struct ParetoFronts(Vec<ParetoFront>);

/// What the dial was set to.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// What was asked for.
    pub asked: DialDesc,
    /// What the scene was set to; `None` where its objects differ.
    pub setting: Option<Setting>,
    /// What the setting was measured to cost and to err; `None` where it was not measured.
    pub expected: Option<ParetoPoint>,
    /// Where it was measured.
    pub hardware: String,
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.setting {
            Some(s) => {
                let finer = if s.finer == FinerRegions::Stated { "as stated" } else { "left out" };
                let Setting { level, voxel_scale, rate_hz, relative_tolerance, element, .. } = s;
                write!(
                    f,
                    "dial {}: level {level}, voxels x {voxel_scale}, {rate_hz} Hz, tolerance {relative_tolerance:.1e}, \
                     elements {}, finer regions {finer}; ",
                    self.asked,
                    element.name()
                )?;
            }
            None => write!(f, "dial {}: objects of several settings; ", self.asked)?,
        }
        let Some(point) = &self.expected else { return write!(f, "not measured for this scene") };
        let keeps_up = if point.load() > 1.0 { "slower than real time" } else { "in real time" };
        write!(
            f,
            "expected: {:.3} ms a step in the median, p99 {:.3} ms, {keeps_up}, error {:.2} % (measured on {})",
            point.median_ms,
            point.p99_ms,
            100.0 * point.error(),
            self.hardware
        )
    }
}

/// Why the dial cannot be set as asked.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DialError {
    /// Nothing was measured for the scene.
    #[error("dial: no Pareto front was measured for scene `{scene}`; `kerf-server tradeoff` measures one")]
    NoParetoFront {
        /// The scene.
        scene: String,
    },
    /// Nothing was measured at the scene's rate, which the dial leaves alone: hands are served at it.
    #[error("dial: nothing was measured at rate_hz = {rate_hz}; measured are {measured}")]
    Rate {
        /// The scene's.
        rate_hz: f64,
        /// Those that were, as a list.
        measured: String,
    },
    /// No measured setting is as cheap or as exact.
    #[error("dial.{field} = {value}: no measured setting reaches it; the nearest that can be had is {nearest:.4}")]
    Infeasible {
        /// `budget_ms` or `max_error`.
        field: &'static str,
        /// What was asked for.
        value: f64,
        /// The least value that would have been granted.
        nearest: f64,
    },
    /// The scene does not allow the setting.
    #[error("dial: {0}")]
    Scene(#[from] SceneProblems),
}

/// Largest file of a Pareto front, bytes: some hundred thousand settings.
const MAX_PARETO_BYTES: u64 = 16 << 20;

impl ParetoFronts {
    /// The Pareto fronts of the built-in scenes.
    ///
    /// # Panics
    /// Never: a test reads them.
    #[must_use]
    pub fn builtin() -> Self {
        let liver = ParetoFront::parse("liver.csv", include_str!("../../pareto/liver.csv"));
        Self(vec![liver.expect("it comes with the program")])
    }

    /// These Pareto fronts with those of a folder's `*.csv` before them.
    ///
    /// # Errors
    /// The folder or the first file that cannot be read.
    pub fn with_folder(mut self, folder: &Path) -> Result<Self, ParetoError> {
        let failed =
            |path: &Path, e: std::io::Error| ParetoError { file: path.display().to_string(), message: e.to_string() };
        let entries = std::fs::read_dir(folder).map_err(|e| failed(folder, e))?;
        let mut paths = Vec::new();
        for entry in entries {
            paths.push(entry.map_err(|e| failed(folder, e))?.path());
        }
        paths.retain(|path| path.extension().is_some_and(|extension| extension == "csv"));
        paths.sort();
        for (index, path) in paths.iter().enumerate() {
            let bytes = std::fs::metadata(path).map_err(|e| failed(path, e))?.len();
            if bytes > MAX_PARETO_BYTES {
                let message = format!("{bytes} bytes are more than the limit of {MAX_PARETO_BYTES}");
                return Err(ParetoError { file: path.display().to_string(), message });
            }
            let text = std::fs::read_to_string(path).map_err(|e| failed(path, e))?;
            self.0.insert(index, ParetoFront::parse(&path.display().to_string(), &text)?);
        }
        Ok(self)
    }

    /// The Pareto front of a scene, whatever the scene's own setting.
    #[must_use]
    pub fn of(&self, scene: &Scene) -> Option<&ParetoFront> {
        let wanted = fingerprint(scene);
        self.0.iter().find(|pareto| pareto.fingerprint() == Some(wanted))
    }

    /// Sets a scene to what it asks of the dial or, before that, to what is `asked` for it. `None`: nobody
    /// asks for anything, and the scene stays as it is.
    ///
    /// # Errors
    /// See [`DialError`].
    pub fn settle(
        &self,
        scene: SoundScene,
        asked: Option<DialDesc>,
    ) -> Result<(SoundScene, Option<Choice>), DialError> {
        let Some(asked) = asked.or(scene.desc.dial) else { return Ok((scene, None)) };
        let mut scene = scene.into_scene();
        scene.desc.dial = None;
        let pareto = self.of(&scene);
        let expected = match asked {
            DialDesc::Level(level) => {
                set_level(&mut scene.desc, level);
                let stated = Setting::of(&scene.desc);
                pareto.and_then(|pareto| pareto.points.iter().find(|point| Some(point.setting()) == stated))
            }
            DialDesc::BudgetMs(value) => {
                let wish =
                    Wish { field: "budget_ms", value, bounded: |point| point.median_ms, least: ParetoPoint::error };
                Some(wish.choose(pareto, &scene.desc)?)
            }
            DialDesc::MaxError(value) => {
                let wish =
                    Wish { field: "max_error", value, bounded: ParetoPoint::error, least: |point| point.median_ms };
                Some(wish.choose(pareto, &scene.desc)?)
            }
        };
        if let Some(point) = expected {
            point.setting().apply(&mut scene.desc);
        }
        let setting = expected.map(ParetoPoint::setting).or_else(|| Setting::of(&scene.desc));
        let scene = scene.judge()?;
        let hardware = pareto.and_then(|pareto| pareto.notes.get("hardware")).cloned().unwrap_or_default();
        let choice = Choice { asked, setting, expected: expected.copied(), hardware };
        Ok((scene, Some(choice)))
    }
}

fn set_level(desc: &mut SceneDesc, level: u8) {
    for object in &mut desc.objects {
        object.level = level;
        object.finer.retain(|finer| finer.level < level);
    }
}

/// What is asked of a measured setting: one measure is bounded, of what fits the other decides.
struct Wish {
    field: &'static str,
    value: f64,
    bounded: fn(&ParetoPoint) -> f64,
    least: fn(&ParetoPoint) -> f64,
}

impl Wish {
    /// The point of a scene's Pareto front that the wish leads to, among those at the scene's rate.
    fn choose<'a>(&self, pareto: Option<&'a ParetoFront>, desc: &SceneDesc) -> Result<&'a ParetoPoint, DialError> {
        let pareto = pareto.ok_or_else(|| DialError::NoParetoFront { scene: desc.name.clone() })?;
        let applies = |point: &&ParetoPoint| point.finer == FinerRegions::LeftOut || states_finer(desc);
        let at_rate = || pareto.points.iter().filter(applies).filter(|point| point.rate_hz == desc.rate_hz);
        let nearest = at_rate().map(self.bounded).min_by(f64::total_cmp).ok_or_else(|| {
            let mut rates: Vec<f64> = pareto.points.iter().map(|point| point.rate_hz).collect();
            rates.sort_by(f64::total_cmp);
            rates.dedup();
            let measured = rates.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
            DialError::Rate { rate_hz: desc.rate_hz, measured }
        })?;
        let by = |a: &&ParetoPoint, b: &&ParetoPoint| {
            let [a, b] = [a, b].map(|point| [(self.least)(point), (self.bounded)(point)]);
            a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1]))
        };
        let feasible = at_rate().filter(|point| (self.bounded)(point) <= self.value);
        feasible.min_by(by).ok_or(DialError::Infeasible { field: self.field, value: self.value, nearest })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalog;

    #[test]
    fn a_choice_is_told_in_the_words_of_a_scene() {
        let scene = catalog::builtin("liver").unwrap();
        let (_, choice) = ParetoFronts::default().settle(scene, Some(DialDesc::Level(1))).unwrap();
        let told = choice.unwrap().to_string();
        assert!(
            told.starts_with("dial level = 1: level 1, voxels x 1, 1000 Hz, tolerance 1.0e-3, elements by_content"),
            "{told}"
        );
    }

    fn pareto_fronts(scene: &Scene, points: &[(u8, f64, f64)]) -> ParetoFronts {
        let point = |&(level, median_ms, error): &(u8, f64, f64)| ParetoPoint {
            level,
            voxel_scale: 1.0,
            rate_hz: 1000.0,
            relative_tolerance: 1e-3,
            element: kerf_physics::scene::ElementKind::ByContent,
            finer: FinerRegions::LeftOut,
            elements: 1,
            displacement_rms_error: error,
            displacement_max_error: 0.0,
            force_rms_error: 0.0,
            cut_depth_error: 0.0,
            cut_area_error: 0.0,
            energy_residual: 0.0,
            median_ms,
            p99_ms: 2.0 * median_ms,
            memory_mib: 1.0,
        };
        ParetoFronts(vec![ParetoFront { points: points.iter().map(point).collect(), ..ParetoFront::of(scene) }])
    }

    fn liver() -> (SoundScene, ParetoFronts) {
        let scene = catalog::builtin("liver").unwrap();
        let pareto_fronts =
            pareto_fronts(&scene, &[(0, 20.0, 0.01), (1, 4.0, 0.02), (2, 1.0, 0.05), (3, 0.5, 0.2), (4, 0.6, 0.3)]);
        (scene, pareto_fronts)
    }

    fn level_for(asked: DialDesc) -> Result<u8, DialError> {
        let (scene, pareto_fronts) = liver();
        let (scene, choice) = pareto_fronts.settle(scene, Some(asked))?;
        assert_eq!(choice.unwrap().setting.unwrap().level, scene.desc.objects[0].level);
        Ok(scene.desc.objects[0].level)
    }

    #[test]
    fn a_budget_buys_the_most_exact_setting_and_an_error_the_cheapest() {
        assert_eq!(level_for(DialDesc::BudgetMs(4.0)), Ok(1));
        assert_eq!(level_for(DialDesc::BudgetMs(0.9)), Ok(3));
        assert_eq!(level_for(DialDesc::MaxError(0.05)), Ok(2));
        assert_eq!(level_for(DialDesc::MaxError(1.0)), Ok(3));
        assert_eq!(level_for(DialDesc::Level(1)), Ok(1));
    }

    #[test]
    fn what_cannot_be_had_is_refused_with_the_nearest_that_can() {
        let refused = |asked| level_for(asked).unwrap_err().to_string();
        assert!(
            refused(DialDesc::BudgetMs(0.1)).contains("budget_ms = 0.1")
                && refused(DialDesc::BudgetMs(0.1)).contains("0.5000")
        );
        assert!(refused(DialDesc::MaxError(1e-3)).contains("0.0100"));
    }

    #[test]
    fn a_scene_asks_and_a_session_has_the_last_word() {
        let (scene, pareto_fronts) = liver();
        let scene = scene.with(|desc| desc.dial = Some(DialDesc::Level(0))).unwrap();
        let (scene, choice) = pareto_fronts.settle(scene, Some(DialDesc::Level(3))).unwrap();
        let choice = choice.unwrap();
        assert_eq!((choice.asked, scene.desc.objects[0].level, scene.desc.dial), (DialDesc::Level(3), 3, None));
        assert!(choice.to_string().contains("level 3") && choice.to_string().contains("20.00 %"), "{choice}");
        assert_eq!(pareto_fronts.settle(scene, None).unwrap().1, None);
    }

    #[test]
    fn without_a_pareto_front_a_level_can_be_had_and_an_error_cannot() {
        let scene = catalog::builtin("jelly").unwrap();
        let (_, pareto_fronts) = liver();
        let error = pareto_fronts.settle(scene.clone(), Some(DialDesc::MaxError(0.1))).unwrap_err();
        assert_eq!(error, DialError::NoParetoFront { scene: "jelly".into() });
        let (_, choice) = pareto_fronts.settle(scene, Some(DialDesc::Level(1))).unwrap();
        let choice = choice.unwrap();
        assert_eq!((choice.setting.unwrap().level, choice.expected), (1, None));
    }

    #[test]
    fn the_builtin_pareto_fronts_are_of_the_builtin_scenes_as_they_are() {
        for pareto in &ParetoFronts::builtin().0 {
            let scene = catalog::builtin(&pareto.notes["scene"]).unwrap();
            assert_eq!(pareto.fingerprint(), Some(fingerprint(&scene)), "{} is to be measured again", scene.desc.name);
        }
    }

    #[test]
    fn the_rate_is_not_the_dials_to_change() {
        let (scene, pareto_fronts) = liver();
        let scene = scene.with(|desc| desc.rate_hz = 500.0).unwrap();
        let error = pareto_fronts.settle(scene, Some(DialDesc::BudgetMs(4.0))).unwrap_err();
        assert_eq!(error, DialError::Rate { rate_hz: 500.0, measured: "1000".into() });
    }
}
