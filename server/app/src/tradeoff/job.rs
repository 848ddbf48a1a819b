//! What one run of the sweep is to do.

use std::path::PathBuf;

use anyhow::Result;
use kerf_physics::Scene;
use kerf_physics::StateHasher;
use kerf_physics::scene::{FinerDesc, ShapeDesc};
use kerf_scenes::catalog;
use kerf_scenes::dial::{FinerRegions, ParetoFront, Setting};
use serde::{Deserialize, Serialize};

use super::points::Point;

/// What a run is to do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Job {
    /// Name of a built-in scene, or path of a scene's file.
    pub scene: String,
    /// The tools' script; `None`: the scene's default stroke.
    pub script: Option<PathBuf>,
    /// Hash of the scene as it stands and of the script's text: a run is of these.
    pub inputs: u64,
    /// What is changed in the scene.
    pub setting: Setting,
    /// Lower and upper corner, m, of the box around the stroke. It becomes a level finer where the setting
    /// keeps regions and the scene has none.
    pub stroke: Option<[[f64; 3]; 2]>,
    /// Level around the stroke, above the setting's, which holds elsewhere.
    #[serde(default)]
    pub level_around_stroke: Option<u8>,
    /// Cap of the solver's iterations instead of the scene's.
    pub max_iterations: Option<u32>,
    /// Simulated time, s.
    pub duration_s: f64,
    /// Times at which the points are sampled, evenly spaced to the end.
    pub samples: u32,
    /// Points of the surface.
    pub points: Vec<Point>,
    /// Points whose displacement at the end is kept.
    pub profile: Vec<Point>,
    /// Threads lent to the steps.
    pub threads: usize,
    /// Script's time at which the run begins, s.
    pub start_s: f64,
    /// Time of computing after which the run ends, s.
    pub limit_s: Option<f64>,
}

impl Job {
    /// The scene with the setting applied, which may not be sound.
    ///
    /// # Errors
    /// The scene cannot be had.
    pub fn scene(&self) -> Result<Scene> {
        let mut scene = catalog::load(&self.scene)?.into_scene();
        self.setting.apply(&mut scene.desc);
        if let Some(stroke) = self.stroke {
            let finer = |shape: ShapeDesc, level: u8| FinerDesc { shape, level };
            let [min_m, max_m] = stroke;
            for object in &mut scene.desc.objects {
                match (self.level_around_stroke, self.setting.finer, self.setting.level.checked_sub(1)) {
                    (Some(level), _, _) => {
                        object.level = level;
                        object.finer = beyond(stroke).map(|shape| finer(shape, self.setting.level)).into();
                    }
                    (None, FinerRegions::Stated, Some(level)) => {
                        object.finer = vec![finer(ShapeDesc::Box { min_m, max_m }, level)];
                    }
                    _ => {}
                }
            }
        }
        scene.desc.solver.max_iterations = self.max_iterations.unwrap_or(scene.desc.solver.max_iterations);
        Ok(scene)
    }

    /// Hash of what the run's results depend on besides the machine.
    #[must_use]
    pub fn inputs_of(scene: &Scene, script: &str) -> u64 {
        let mut hash = StateHasher::default();
        let settings = toml::to_string(&scene.desc).expect("a scene was read from TOML");
        // The Pareto front's fingerprint covers the meshes.
        let fingerprint = &ParetoFront::of(scene).notes["fingerprint"];
        for text in [settings.as_str(), fingerprint, script, crate::VERSION] {
            text.bytes().for_each(|byte| hash.word(u64::from(byte)));
        }
        hash.finish()
    }
}

/// Six boxes that hold together all that is outside a box.
fn beyond([min_m, max_m]: [[f64; 3]; 2]) -> [ShapeDesc; 6] {
    const FAR_M: f64 = 1e3;
    std::array::from_fn(|face| {
        let (mut lower, mut upper) = ([-FAR_M; 3], [FAR_M; 3]);
        if face % 2 == 0 {
            upper[face / 2] = min_m[face / 2];
        } else {
            lower[face / 2] = max_m[face / 2];
        }
        ShapeDesc::Box { min_m: lower, max_m: upper }
    })
}

#[cfg(test)]
mod tests {
    use kerf_physics::World;

    use super::*;

    #[test]
    fn only_around_the_stroke_elements_are_as_large_as_said() {
        let setting =
            Setting { level: 0, ..crate::tradeoff::sweep::own_setting(&catalog::builtin("rubber").unwrap().desc) };
        let stroke = [[-0.01, -1.0, -0.01], [0.01, 1.0, 0.01]];
        let job = Job {
            scene: "rubber".into(),
            script: None,
            inputs: 0,
            setting,
            stroke: Some(stroke),
            level_around_stroke: Some(1),
            max_iterations: Some(7),
            duration_s: 1.0,
            samples: 1,
            points: Vec::new(),
            profile: Vec::new(),
            threads: 1,
            start_s: 0.0,
            limit_s: None,
        };
        let scene = job.scene().unwrap().judge().unwrap();
        assert_eq!(scene.desc.solver.max_iterations, 7);
        let world = World::new(&scene).unwrap();
        let body = world.bodies()[0];
        let half_m = body.grid().voxel_size_m();
        let mut seen = [0; 2];
        for element in 0..body.element_count() {
            let (centre_m, level) = (body.rest_centre_m(element), body.element_level(element));
            seen[usize::from(level)] += 1;
            // Elements across the border are voxels.
            let is_inside = [0, 2].iter().all(|a| centre_m[*a].abs() + half_m < stroke[1][*a]);
            assert!(!is_inside || level == 1, "{centre_m:?}");
            let is_outside = [0, 2].iter().any(|a| centre_m[*a].abs() - half_m > stroke[1][*a]);
            assert!(!is_outside || level == 0, "{centre_m:?}");
        }
        assert!(seen.iter().all(|count| *count > 50), "{seen:?}");
    }
}
