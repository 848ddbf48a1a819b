//! A setting of the dial: what of a scene trades speed for accuracy.

use kerf_physics::Scene;
use kerf_physics::StateHasher;
use kerf_physics::scene::{ElementKind, SceneDesc, SolverDesc, default_level};
use serde::{Deserialize, Serialize};

/// Whether the finer regions that a scene states are kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FinerRegions {
    /// As the scene states them, where their level is below the setting's. Default.
    #[default]
    Stated,
    /// Left out: one level throughout.
    LeftOut,
}

/// A setting of the dial.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setting {
    /// Level of every object.
    pub level: u8,
    /// Edge of a voxel over that of the scene.
    pub voxel_scale: f64,
    /// Steps per simulated second, Hz.
    pub rate_hz: f64,
    /// Relative tolerance of the velocity solve.
    pub relative_tolerance: f64,
    /// How an element's stiffness follows from its voxels.
    pub element: ElementKind,
    /// What becomes of the finer regions.
    pub finer: FinerRegions,
}

impl Setting {
    /// The setting that a scene states, where all its objects state the same; `None` where they differ.
    #[must_use]
    pub fn of(desc: &SceneDesc) -> Option<Self> {
        let [first, others @ ..] = desc.objects.as_slice() else { return None };
        let agree = others.iter().all(|object| object.level == first.level && object.element == first.element);
        agree.then_some(Self {
            level: first.level,
            voxel_scale: 1.0,
            rate_hz: desc.rate_hz,
            relative_tolerance: desc.relative_tolerance(),
            element: first.element,
            finer: if states_finer(desc) { FinerRegions::Stated } else { FinerRegions::LeftOut },
        })
    }

    /// Changes a scene as the setting says. Whether it is supported is for [`Scene::problems`] to say.
    pub fn apply(&self, desc: &mut SceneDesc) {
        desc.rate_hz = self.rate_hz;
        desc.solver.relative_tolerance = Some(self.relative_tolerance);
        for object in &mut desc.objects {
            object.level = self.level;
            object.element = self.element;
            object.voxel_size_m = object.voxel_size_m.map(|size| size * self.voxel_scale);
            let coarser = |count: u32| (f64::from(count) / self.voxel_scale).round().max(1.0) as u32;
            object.resolution = object.resolution.map(coarser);
            object.finer.retain(|finer| self.finer == FinerRegions::Stated && finer.level < self.level);
        }
    }
}

/// Whether some object states finer regions.
#[must_use]
pub fn states_finer(desc: &SceneDesc) -> bool {
    desc.objects.iter().any(|object| !object.finer.is_empty())
}

/// Hash of what the dial leaves as it is in a scene: scenes of one fingerprint have one Pareto front.
#[must_use]
pub fn fingerprint(scene: &Scene) -> u64 {
    let mut desc = scene.desc.clone();
    desc.description.clear();
    desc.rate_hz = 0.0;
    // Any that is stated: it is the setting's. Pareto fronts have been measured with this one in the text.
    desc.solver = SolverDesc { relative_tolerance: Some(1e-3), ..SolverDesc::default() };
    (desc.dial, desc.governor) = (None, None);
    for object in &mut desc.objects {
        object.level = default_level();
        object.element = ElementKind::default();
        object.finer.clear();
        object.material.color = None;
        object.regions.iter_mut().for_each(|region| region.material.color = None);
    }
    let mut hash = StateHasher::default();
    let text = toml::to_string(&desc).expect("a scene was read from TOML");
    text.bytes().for_each(|byte| hash.word(u64::from(byte)));
    for (file, mesh) in &scene.meshes {
        file.bytes().for_each(|byte| hash.word(u64::from(byte)));
        mesh.positions.iter().for_each(|position| hash.floats(position));
        mesh.triangles.as_flattened().iter().for_each(|index| hash.word(u64::from(*index)));
    }
    hash.finish()
}
