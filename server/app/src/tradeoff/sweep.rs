//! Which settings are swept.

use clap::Args;
use kerf_physics::Vec3;
use kerf_physics::scene::{ElementKind, SceneDesc};
use kerf_scenes::dial::{FinerRegions, Setting};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::script::Script;
use crate::script::sweep;

/// Values of each axis; an axis that is not given has its defaults.
#[derive(Args, Clone, Debug, Default)]
pub struct Axes {
    /// Levels, 0 to 4. Default: 0 to 3, and the scene's.
    #[arg(long, value_name = "K,..", value_delimiter = ',', value_parser = clap::value_parser!(u8).range(0..=4))]
    pub levels: Vec<u8>,
    /// Relative tolerances of the solver, 1e-12 to 0.5. Default: 1e-2, 1e-3, 1e-5, and the scene's.
    #[arg(long, value_name = "TOL,..", value_delimiter = ',', value_parser = |text: &str| number(text, 1e-12, 0.5))]
    pub tolerances: Vec<f64>,
    /// Steps per simulated second, 10 to 10,000 Hz. Default: the scene's times 1/4, 1/2, 1, 2, and 60 Hz.
    #[arg(long, value_name = "HZ,..", value_delimiter = ',', value_parser = |text: &str| number(text, 10.0, 1e4))]
    pub rates: Vec<f64>,
    /// Edges of a voxel over the scene's, 0.25 to 8. Default: 1, 1.5, 2.
    #[arg(long, value_name = "X,..", value_delimiter = ',', value_parser = |text: &str| number(text, 0.25, 8.0))]
    pub voxel_scales: Vec<f64>,
    /// Kinds of element: by_content, galerkin, incompatible_modes, homogenised. Default: those that differ in
    /// the scene.
    #[arg(long, value_name = "KIND,..", value_delimiter = ',', value_parser = named::<ElementKind>)]
    pub elements: Vec<ElementKind>,
    /// Finer regions: left_out, stated (by the scene, or one a level finer around the stroke). Default: both.
    #[arg(long, value_name = "WHICH,..", value_delimiter = ',', value_parser = named::<FinerRegions>)]
    pub finer: Vec<FinerRegions>,
}

fn number(text: &str, least: f64, most: f64) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| format!("`{text}` is not a number"))?;
    if (least..=most).contains(&value) { Ok(value) } else { Err(format!("{value} is not between {least} and {most}")) }
}

fn named<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    serde_json::from_value(serde_json::Value::String(text.to_owned())).map_err(|e| e.to_string())
}

/// The scene's own setting.
#[must_use]
pub fn own_setting(desc: &SceneDesc) -> Setting {
    let states = desc.objects.iter().any(|object| !object.finer.is_empty());
    Setting {
        level: desc.objects[0].level,
        voxel_scale: 1.0,
        rate_hz: desc.rate_hz,
        relative_tolerance: desc.relative_tolerance(),
        element: desc.objects[0].element,
        finer: if states { FinerRegions::Stated } else { FinerRegions::LeftOut },
    }
}

/// The settings of a sweep, each once: levels x tolerances and levels x rates about the base setting (the
/// scene's own where the axes have it), and from there one axis at a time with a few pairs. The finest level
/// is not taken faster than the base: it is the dearest of all and has its own row of tolerances.
#[must_use]
pub fn settings(desc: &SceneDesc, axes: &Axes) -> Vec<Setting> {
    let own = own_setting(desc);
    let axes = axes.with_defaults(desc, &own);
    let base = Setting {
        level: pick(&axes.levels, own.level),
        voxel_scale: pick(&axes.voxel_scales, own.voxel_scale),
        rate_hz: pick(&axes.rates, own.rate_hz),
        relative_tolerance: pick(&axes.tolerances, own.relative_tolerance),
        element: pick(&axes.elements, own.element),
        finer: pick(&axes.finer, own.finer),
    };
    let finest = axes.levels.iter().copied().min().unwrap_or(base.level);
    let mut settings = vec![base];
    for &level in &axes.levels {
        let at = Setting { level, ..base };
        settings.extend(axes.tolerances.iter().map(|&relative_tolerance| Setting { relative_tolerance, ..at }));
        let is_affordable = |rate_hz: &f64| *rate_hz <= base.rate_hz || level > finest;
        settings.extend(axes.rates.iter().copied().filter(is_affordable).map(|rate_hz| Setting { rate_hz, ..at }));
        settings.extend(axes.elements.iter().map(|&element| Setting { element, ..at }));
        if level > 0 {
            settings.extend(axes.finer.iter().map(|&finer| Setting { finer, ..at }));
        }
        if level.abs_diff(base.level) <= 1 && level > 0 {
            settings.extend(axes.voxel_scales.iter().map(|&voxel_scale| Setting { voxel_scale, ..at }));
        }
    }
    let slower = axes.rates.iter().copied().filter(|rate_hz| *rate_hz < base.rate_hz);
    for at in slower.map(|rate_hz| Setting { rate_hz, ..base }) {
        let loose = axes.tolerances.iter().copied().fold(base.relative_tolerance, f64::max);
        settings.push(Setting { relative_tolerance: loose, ..at });
        settings.extend(axes.voxel_scales.iter().map(|&voxel_scale| Setting { voxel_scale, ..at }));
        settings.extend(axes.finer.iter().map(|&finer| Setting { finer, ..at }));
    }
    once(settings)
}

impl Axes {
    fn with_defaults(&self, desc: &SceneDesc, own: &Setting) -> Self {
        fn or<T: Clone>(given: &[T], default: Vec<T>) -> Vec<T> {
            if given.is_empty() { default } else { given.to_vec() }
        }
        let mut elements = vec![own.element, ElementKind::Galerkin];
        if desc.objects.iter().any(|object| !object.regions.is_empty()) {
            elements.extend([ElementKind::IncompatibleModes, ElementKind::Homogenised]);
        }
        let rates = [1.0, 0.25, 0.5, 2.0].map(|share| share * own.rate_hz).into_iter().chain([60.0]);
        let supported = rates.filter(|rate_hz| (10.0..=1e4).contains(rate_hz)).collect();
        Self {
            levels: once(or(&self.levels, vec![0, 1, 2, 3, own.level])),
            tolerances: once(or(&self.tolerances, vec![own.relative_tolerance, 1e-2, 1e-3, 1e-5])),
            rates: once(or(&self.rates, supported)),
            voxel_scales: once(or(&self.voxel_scales, vec![1.0, 1.5, 2.0])),
            elements: once(or(&self.elements, elements)),
            finer: once(or(&self.finer, vec![own.finer, FinerRegions::LeftOut, FinerRegions::Stated])),
        }
    }
}

/// `wanted` where it is among the values, else the first of them.
fn pick<T: Copy + PartialEq>(values: &[T], wanted: T) -> T {
    if values.contains(&wanted) { wanted } else { values.first().copied().unwrap_or(wanted) }
}

fn once<T: PartialEq>(values: Vec<T>) -> Vec<T> {
    values.into_iter().fold(Vec::new(), |mut distinct, value| {
        if !distinct.contains(&value) {
            distinct.push(value);
        }
        distinct
    })
}

/// A setting's name: of its file, and in tables.
#[must_use]
pub fn key(setting: &Setting) -> String {
    format!(
        "k{}-x{}-{}hz-{:e}-{}-{}",
        setting.level,
        setting.voxel_scale,
        setting.rate_hz,
        setting.relative_tolerance,
        name_of(setting.element),
        name_of(setting.finer),
    )
}

/// The name that a scene's file has for a kind.
#[must_use]
pub fn name_of(kind: impl Serialize) -> String {
    serde_json::to_value(kind).ok().and_then(|value| value.as_str().map(str::to_owned)).unwrap_or_default()
}

/// Lower and upper corner, m, of the box around all that the tools sweep, with a margin on every side; `None` where no
/// tool moves.
#[must_use]
pub fn stroke_box(desc: &SceneDesc, script: &Script, margin_m: f64) -> Option<[[f64; 3]; 2]> {
    let boxes = sweep::boxes(desc, script).into_iter().zip(&desc.tools);
    let grown = boxes.filter_map(|(corners, tool)| {
        let margin = Vec3::repeat(margin_m + sweep::reach_m(&tool.shape));
        corners.map(|[least, most]| [least - margin, most + margin])
    });
    let all = grown.reduce(|[least, most], [other_least, other_most]| [least.inf(&other_least), most.sup(&other_most)]);
    all.map(|corners| corners.map(Into::into))
}

#[cfg(test)]
mod tests {
    use kerf_scenes::catalog;

    use super::*;
    use crate::script::stroke::default_stroke;

    #[test]
    fn the_default_sweep_has_every_axis_and_each_setting_once() {
        let desc = catalog::builtin("liver").unwrap().into_scene().desc;
        let settings = settings(&desc, &Axes::default());
        for level in 0..=3 {
            for tolerance in [1e-2, 1e-3, 1e-5] {
                let has = |s: &&Setting| s.level == level && s.relative_tolerance == tolerance && s.rate_hz == 1000.0;
                assert!(settings.iter().any(|s| has(&s)), "{level} {tolerance}");
            }
        }
        for rate_hz in [60.0, 250.0, 500.0, 2000.0] {
            assert!(settings.iter().any(|s| s.rate_hz == rate_hz));
        }
        assert!(settings.iter().all(|s| s.level > 0 || s.rate_hz <= 1000.0));
        assert!(settings.iter().any(|s| s.element == ElementKind::Galerkin && s.level == 2));
        assert!(settings.iter().any(|s| s.finer == FinerRegions::Stated && s.level == 3));
        let mut keys: Vec<String> = settings.iter().map(key).collect();
        keys.sort();
        keys.dedup();
        assert_eq!(keys.len(), settings.len());
    }

    #[test]
    fn axes_that_are_given_are_all_there_is() {
        let desc = catalog::builtin("liver").unwrap().into_scene().desc;
        let axes = Axes {
            levels: vec![1, 2],
            tolerances: vec![1e-4],
            rates: vec![333.0],
            voxel_scales: vec![2.0],
            elements: vec![ElementKind::Galerkin],
            finer: vec![FinerRegions::LeftOut],
        };
        let keys: Vec<String> = settings(&desc, &axes).iter().map(key).collect();
        assert_eq!(keys, ["k2-x2-333hz-1e-4-galerkin-left_out", "k1-x2-333hz-1e-4-galerkin-left_out"]);
    }

    #[test]
    fn the_strokes_box_holds_the_whole_edge() {
        let scene = catalog::builtin("cuboid").unwrap();
        let [min_m, max_m] = stroke_box(&scene.desc, &default_stroke(&scene).unwrap(), 0.01).unwrap();
        // The edge is 60 mm long; the stroke goes from 1.05 to 0.2 of the 70 mm of height.
        for (found, meant) in min_m.iter().chain(&max_m).zip([-0.04, 0.004, -0.01, 0.04, 0.0835, 0.01]) {
            assert!((found - meant).abs() < 1e-9, "{min_m:?} {max_m:?}");
        }
        assert_eq!(stroke_box(&scene.desc, &Script::default(), 0.01), None);
    }
}
