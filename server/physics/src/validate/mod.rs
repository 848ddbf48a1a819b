//! What is wrong with a scene's values: every field that is out of its range, with value and limit.

mod overload;

use std::collections::BTreeSet;
use std::ops::{Deref, RangeInclusive};
use std::sync::Arc;

use crate::grid::voxelize::{Measures, measures};
use crate::scene::edge;
use crate::scene::text::{is_hidden, shortened};
use crate::scene::toughness::{asked_over_eh, carried_over_eh};
use crate::scene::wording::{brief, did_you_mean, out_of_range};
use crate::scene::{
    BladeDesc, CapsuleDesc, DialDesc, FractureRule, GrasperDesc, LoadDesc, MaterialDesc, Meshes, ObjectDesc,
    SCENE_VERSION, Scene, SceneDesc, SceneError, SceneProblems, ScissorsDesc, ShapeDesc, ToolShapeDesc,
};
use overload::Loaded;

/// Bodies are stepped one after the other; more than this is another kind of simulation.
pub(crate) const MAX_OBJECTS: usize = 64;
/// A tool's output is kept per step and per viewer.
pub(crate) const MAX_TOOLS: usize = 16;
/// A tracked point's output is kept per step.
pub(crate) const MAX_TRACKED_POINTS: usize = 1024;
/// Each region is tested at each voxel; material indices are 16 bits wide.
pub(crate) const MAX_REGIONS: usize = 256;
/// Fixed shapes and loads are each tested at each voxel.
pub(crate) const MAX_SHAPES: usize = 256;
/// Parts of a smooth union: each is evaluated at each cell.
pub(crate) const MAX_PARTS: usize = 64;
/// Names are printed in tables and used as labels of metrics.
pub(crate) const MAX_NAME_CHARS: usize = 64;

/// Voxels along a blade's edge: two markers stand in each, in every body.
pub(crate) const MAX_BLADE_VOXELS: f64 = 4096.0;
/// Radius of a probe in voxels: a surface has one point per voxel's face, and a sharper probe slips between
/// them.
pub(crate) const MIN_PROBE_VOXELS: f64 = 2.0;
/// Level of an object: elements of 16 voxels a side.
pub(crate) const MAX_LEVEL: u8 = 4;
/// Voxels along an object's longest edge.
pub(crate) const MAX_RESOLUTION: f64 = 4096.0;
/// Ratio of the largest to the smallest Young's modulus in one object: beyond it the single-precision
/// solve loses what the soft part does.
pub(crate) const MAX_STIFFNESS_CONTRAST: f64 = 1e6;
/// Voxels that a pressure wave may cross in a step in an object that nothing holds. The inverse square is
/// the fraction of mass beside stiffness in the matrix, which drowns in the rounding of `f32`: free blocks
/// squeezed by a fifth begin to explode at 310, at 220 where they stiffen by c = 10. (What is held has no
/// motion that only mass resists, and no such limit.)
pub(crate) const MAX_FREE_WAVE_VOXELS: f64 = 100.0;
/// Edges of a voxel, m: from cells in a dish to whole carcasses.
const VOXEL_SIZE_M: RangeInclusive<f64> = 1e-5..=1.0;
/// Radius within which a grasper takes hold, m: from micromanipulators to a hand.
const JAW_RADIUS_M: RangeInclusive<f64> = 1e-4..=0.1;

/// Largest coordinate and length, m. Beyond it voxels of the smallest size lose their digits in `f32`.
const MAX_LENGTH_M: f64 = 1e3;
/// Smallest length that a shape may have, m.
const MIN_LENGTH_M: f64 = 1e-6;

impl Scene {
    /// This scene as one that a world is made of.
    ///
    /// # Errors
    /// Everything that is wrong with the values.
    pub fn judge(self) -> Result<SoundScene, SceneProblems> {
        let problems = self.problems();
        if problems.is_empty() { Ok(SoundScene(Arc::new(self))) } else { Err(SceneProblems(problems)) }
    }

    /// Everything that is wrong with the values, in the order of the fields.
    #[must_use]
    pub fn problems(&self) -> Vec<SceneError> {
        problems(&self.desc, &self.meshes)
    }
}

/// A scene whose values are within their limits, by [`Scene::judge`].
#[derive(Clone, Debug)]
pub struct SoundScene(Arc<Scene>);

impl SoundScene {
    /// The same scene with its description changed, judged once more.
    ///
    /// # Errors
    /// Everything that is wrong with the values then.
    pub fn with(self, change: impl FnOnce(&mut SceneDesc)) -> Result<Self, SceneProblems> {
        let mut scene = self.into_scene();
        change(&mut scene.desc);
        scene.judge()
    }

    /// The scene, to be changed and judged once more.
    #[must_use]
    pub fn into_scene(self) -> Scene {
        Arc::unwrap_or_clone(self.0)
    }
}

impl From<SoundScene> for Arc<Scene> {
    fn from(sound: SoundScene) -> Self {
        sound.0
    }
}

impl Deref for SoundScene {
    type Target = Scene;

    fn deref(&self) -> &Scene {
        &self.0
    }
}

/// A scene with whatever values: what the limits are for is verified beyond them.
#[must_use]
pub fn unjudged(scene: Scene) -> SoundScene {
    SoundScene(Arc::new(scene))
}

fn problems(scene: &SceneDesc, meshes: &Meshes) -> Vec<SceneError> {
    let mut report = Report::default();
    if scene.version != SCENE_VERSION {
        report.refuse("version", format!("{} is not supported; this program reads {SCENE_VERSION}", scene.version));
    }
    report.name("name", &scene.name);
    let rate_is_sound = report.number("rate_hz", scene.rate_hz, 10.0..=10_000.0);
    report.vector("gravity_m_per_s2", &scene.gravity_m_per_s2, 1e3);
    if let Some(tolerance) = scene.solver.relative_tolerance {
        report.number("solver.relative_tolerance", tolerance, 1e-12..=0.5);
    }
    report.number("solver.max_iterations", f64::from(scene.solver.max_iterations), 1.0..=1e5);
    match scene.dial {
        Some(DialDesc::Level(level)) => _ = report.number("dial.level", f64::from(level), 0.0..=f64::from(MAX_LEVEL)),
        Some(DialDesc::BudgetMs(ms)) => _ = report.number("dial.budget_ms", ms, 1e-6..=1e6),
        Some(DialDesc::MaxError(error)) => _ = report.number("dial.max_error", error, 1e-9..=1e3),
        None => {}
    }
    if let Some(governor) = scene.governor
        && rate_is_sound
    {
        let least = scene.relative_tolerance().clamp(1e-12, 0.5);
        report.number("governor.max_relative_tolerance", governor.max_relative_tolerance, least..=0.5);
    }

    report.count("objects", scene.objects.len(), 1..=MAX_OBJECTS);
    report.unique("objects", scene.objects.iter().map(|o| o.name.as_str()));
    let mut voxel_sizes_m = Vec::new();
    for (i, object) in scene.objects.iter().enumerate() {
        let Some(Measures { voxel_size_m, extent_m }) = report.object(&format!("objects[{i}]"), object, meshes) else {
            continue;
        };
        if rate_is_sound {
            report.waves(scene.rate_hz, object, voxel_size_m);
        }
        if let Some(extent_m) = extent_m {
            report.loads(&format!("objects[{i}]"), &Loaded { object, extent_m }, &scene.gravity_m_per_s2);
        }
        voxel_sizes_m.push(voxel_size_m);
    }
    let largest_voxel_m = voxel_sizes_m.iter().copied().fold(0.0, f64::max);
    let smallest_voxel_m = voxel_sizes_m.into_iter().fold(f64::INFINITY, f64::min);
    report.count("tools", scene.tools.len(), 0..=MAX_TOOLS);
    report.unique("tools", scene.tools.iter().map(|t| t.name.as_str()));
    for (i, tool) in scene.tools.iter().enumerate() {
        let field = format!("tools[{i}].shape.{}", tool.shape.kind());
        match &tool.shape {
            ToolShapeDesc::Blade(blade) => report.blade(&field, blade, smallest_voxel_m),
            ToolShapeDesc::Scissors(scissors) => report.scissors(&field, scissors, smallest_voxel_m),
            ToolShapeDesc::Grasper(grasper) => report.grasper(&field, grasper),
            ToolShapeDesc::Probe(capsule) => report.capsule(&field, capsule, largest_voxel_m),
        }
        if let Some(handle) = tool.shape.handle() {
            report.capsule(&format!("{field}.handle"), handle, largest_voxel_m);
        }
    }
    report.count("tracked_points", scene.tracked_points.len(), 0..=MAX_TRACKED_POINTS);
    report.unique("tracked_points", scene.tracked_points.iter().map(|p| p.name.as_str()));
    for (i, point) in scene.tracked_points.iter().enumerate() {
        report.vector(&format!("tracked_points[{i}].position_m"), &point.position_m, MAX_LENGTH_M);
        if !scene.objects.iter().any(|o| o.name == point.object) {
            let meant = did_you_mean(&point.object, scene.objects.iter().map(|o| o.name.as_str()));
            report.refuse(
                format!("tracked_points[{i}].object"),
                format!("there is no object named `{}`{meant}", point.object),
            );
        }
    }
    report.problems
}

/// Collects problems; each method judges one kind of field.
#[derive(Default)]
struct Report {
    problems: Vec<SceneError>,
}

impl Report {
    fn refuse(&mut self, field: impl Into<String>, message: impl Into<String>) {
        self.problems.push(SceneError::Field { field: field.into(), message: message.into() });
    }

    /// A finite number within a range. Returns whether it is.
    fn number(&mut self, field: &str, value: f64, range: RangeInclusive<f64>) -> bool {
        let fits = range.contains(&value);
        if !fits {
            self.refuse(field, out_of_range(field, value, *range.start(), *range.end()));
        }
        fits
    }

    fn vector(&mut self, field: &str, value: &[f64; 3], limit: f64) -> bool {
        let fits = value.iter().all(|v| v.abs() <= limit);
        if !fits {
            self.refuse(field, format!("{value:?} is not within +-{limit} in each component"));
        }
        fits
    }

    fn length(&mut self, field: &str, value_m: f64) -> bool {
        self.number(field, value_m, MIN_LENGTH_M..=MAX_LENGTH_M)
    }

    fn count(&mut self, field: &str, count: usize, range: RangeInclusive<usize>) {
        if !range.contains(&count) {
            self.refuse(field, format!("{count} entries are not between {} and {}", range.start(), range.end()));
        }
    }

    fn name(&mut self, field: &str, name: &str) {
        if name.is_empty() || name.chars().count() > MAX_NAME_CHARS || name.chars().any(is_hidden) {
            let name = shortened(name, MAX_NAME_CHARS);
            self.refuse(field, format!("{name:?} is not a name of 1 to {MAX_NAME_CHARS} printable characters"));
        }
    }

    fn unique<'a>(&mut self, field: &str, names: impl Iterator<Item = &'a str>) {
        let mut seen = BTreeSet::new();
        for (i, name) in names.enumerate() {
            let field = format!("{field}[{i}].name");
            self.name(&field, name);
            if !seen.insert(name) {
                self.refuse(field, format!("`{name}` is taken by an earlier entry"));
            }
        }
    }

    /// Returns its size and its voxels', if they can be told.
    fn object(&mut self, field: &str, object: &ObjectDesc, meshes: &Meshes) -> Option<Measures> {
        let shape_is_sound = self.shape(&format!("{field}.shape"), &object.shape);
        let size_is_sound = self.voxel_size(field, object);
        let level_is_sound =
            self.number(&format!("{field}.level"), f64::from(object.level), 0.0..=f64::from(MAX_LEVEL));
        self.material(&format!("{field}.material"), &object.material);
        self.rate_of(&format!("{field}.material"), &object.material, object.fracture_rule);
        self.count(&format!("{field}.regions"), object.regions.len(), 0..=MAX_REGIONS);
        self.unique(&format!("{field}.regions"), object.regions.iter().map(|r| r.name.as_str()));
        for (i, region) in object.regions.iter().enumerate() {
            self.shape(&format!("{field}.regions[{i}].shape"), &region.shape);
            self.material(&format!("{field}.regions[{i}].material"), &region.material);
            self.rate_of(&format!("{field}.regions[{i}].material"), &region.material, object.fracture_rule);
        }
        if let Some(across) = object.min_elements_across {
            self.number(&format!("{field}.min_elements_across"), across, 1.0..=8.0);
        }
        self.count(&format!("{field}.finer"), object.finer.len(), 0..=MAX_SHAPES);
        for (i, finer) in object.finer.iter().enumerate() {
            self.shape(&format!("{field}.finer[{i}].shape"), &finer.shape);
            if finer.level >= object.level {
                let message = format!("{} is not below the object's level, {}", finer.level, object.level);
                self.refuse(format!("{field}.finer[{i}].level"), message);
            }
        }
        self.count(&format!("{field}.fixed"), object.fixed.len(), 0..=MAX_SHAPES);
        for (i, shape) in object.fixed.iter().enumerate() {
            self.shape(&format!("{field}.fixed[{i}]"), shape);
        }
        self.count(&format!("{field}.loads"), object.loads.len(), 0..=MAX_SHAPES);
        for (i, load) in object.loads.iter().enumerate() {
            self.load(&format!("{field}.loads[{i}]"), load);
        }
        self.contrast(field, object);
        let is_sound = shape_is_sound && size_is_sound && level_is_sound;
        if is_sound { self.elements(field, object, meshes) } else { None }
    }

    fn voxel_size(&mut self, field: &str, object: &ObjectDesc) -> bool {
        match (object.voxel_size_m, object.resolution) {
            (Some(size_m), None) => self.number(&format!("{field}.voxel_size_m"), size_m, VOXEL_SIZE_M),
            (None, Some(count)) => self.number(&format!("{field}.resolution"), f64::from(count), 1.0..=MAX_RESOLUTION),
            (given, _) => {
                let found = if given.is_some() { "both are" } else { "neither is" };
                let message = format!("give exactly one of voxel_size_m and resolution; {found} given");
                self.refuse(format!("{field}.voxel_size_m"), message);
                false
            }
        }
    }

    /// What depends on the size of the elements: the lattice's extent and each material's toughness.
    fn elements(&mut self, field: &str, object: &ObjectDesc, meshes: &Meshes) -> Option<Measures> {
        let measures = match measures(object, meshes) {
            Ok(measures) => measures?, // a mesh that is not at hand is judged when it is
            Err(problem) => {
                self.problems.push(problem.within(field));
                return None;
            }
        };
        let size_m = measures.voxel_size_m;
        if object.resolution.is_some() && !VOXEL_SIZE_M.contains(&size_m) {
            let (low, high) = (*VOXEL_SIZE_M.start(), *VOXEL_SIZE_M.end());
            let message = format!(
                "gives voxels of {} m, which is not between {} and {}; lengths are in metres, for a mesh by its \
                 scale_m_per_unit",
                brief(size_m),
                brief(low),
                brief(high)
            );
            self.refuse(format!("{field}.resolution"), message);
        }
        let levels = std::iter::once(object.level).chain(object.finer.iter().map(|f| f.level).min());
        for level in levels {
            self.toughness(&format!("{field}.material"), &object.material, object.fracture_rule, size_m, level);
            for (i, region) in object.regions.iter().enumerate() {
                let field = format!("{field}.regions[{i}].material");
                self.toughness(&field, &region.material, object.fracture_rule, size_m, level);
            }
        }
        Some(measures)
    }

    /// The way of a wave in a step, where nothing holds the object.
    fn waves(&mut self, rate_hz: f64, object: &ObjectDesc, voxel_size_m: f64) {
        if !object.fixed.is_empty() {
            return;
        }
        // Pressure waves: M = E (1 - nu) / ((1 + nu) (1 - 2 nu)).
        let speed_m_per_s = |m: &MaterialDesc| {
            let nu = m.poisson_ratio;
            let confined_pa = m.instantaneous_modulus_pa() * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu));
            (confined_pa / m.density_kg_per_m3).sqrt()
        };
        let speed_m_per_s = object.materials().map(speed_m_per_s).fold(0.0, f64::max);
        let voxels = speed_m_per_s / (rate_hz * voxel_size_m);
        // Of a material out of its range enough is said already.
        if voxels.is_finite() && voxels > MAX_FREE_WAVE_VOXELS {
            let message = format!(
                "{rate_hz} lets waves cross {voxels:.0} voxels of `{}` in a step, more than {MAX_FREE_WAVE_VOXELS}, and \
                 nothing holds it; raise rate_hz or hold it",
                object.name
            );
            self.refuse("rate_hz", message);
        }
    }

    /// What the loads ask of the object's elements.
    fn loads(&mut self, field: &str, loaded: &Loaded<'_>, gravity_m_per_s2: &[f64; 3]) {
        if let Some(over) = loaded.by_gravity(gravity_m_per_s2) {
            let message = over.message(&format!("the weight of `{}` loads it", loaded.object.name));
            self.refuse("gravity_m_per_s2", message);
        }
        for (i, load) in loaded.object.loads.iter().enumerate() {
            if let Some(over) = loaded.by(load) {
                self.refuse(format!("{field}.loads[{i}]"), over.message("it loads the object"));
            }
        }
    }

    /// Stiff and soft in one object, in whatever order: the first region that is too far from what
    /// came before it is named.
    fn contrast(&mut self, field: &str, object: &ObjectDesc) {
        let (mut softest, mut stiffest) =
            (object.material.young_modulus_pa, object.material.instantaneous_modulus_pa());
        for (i, region) in object.regions.iter().enumerate() {
            let young = region.material.young_modulus_pa;
            (softest, stiffest) = (softest.min(young), stiffest.max(region.material.instantaneous_modulus_pa()));
            if stiffest > MAX_STIFFNESS_CONTRAST * softest {
                let message = format!(
                    "{young} makes the object's stiffest material {:e} times as stiff as its softest, more than \
                     {MAX_STIFFNESS_CONTRAST:e}",
                    stiffest / softest
                );
                return self.refuse(format!("{field}.regions[{i}].material.young_modulus_pa"), message);
            }
        }
    }

    fn toughness(&mut self, field: &str, material: &MaterialDesc, rule: FractureRule, voxel_size_m: f64, level: u8) {
        let Some(asked) = asked_over_eh(material, rule, voxel_size_m, level) else { return };
        let carried = carried_over_eh(material, level);
        if asked <= carried {
            return;
        }
        let loaded = match rule {
            FractureRule::Front => format!(
                "Gc/(E H) = {:.3} with H = 2^{level} voxels of {} m, times initiation_ratio {} = {asked:.3},",
                asked / material.initiation_ratio,
                brief(voxel_size_m),
                material.initiation_ratio,
            ),
            FractureRule::LinkEnergy => format!(
                "a link of a voxel of {} m holds Gc at a line load of {asked:.3} E H with H = 2^{level} voxels, which",
                brief(voxel_size_m)
            ),
        };
        let message = format!(
            "{loaded} is more than the {carried:.3} that the element law carries with strain_stiffening {} at this level: \
             the elements would fold under the blade before they part; raise strain_stiffening (10 carries the \
             most) or lower fracture_energy_j_per_m2: docs/reference/scenes.md explains both and has materials that work",
            material.strain_stiffening,
        );
        self.refuse(format!("{field}.fracture_energy_j_per_m2"), message);
    }

    /// The link-energy rule knows no speed.
    fn rate_of(&mut self, field: &str, material: &MaterialDesc, rule: FractureRule) {
        if rule == FractureRule::LinkEnergy && material.rate.is_some() {
            self.refuse(format!("{field}.rate"), "has no part in fracture_rule `link_energy`; leave it out");
        }
    }

    fn material(&mut self, field: &str, material: &MaterialDesc) {
        let mut number = |name: &str, value: f64, range| self.number(&format!("{field}.{name}"), value, range);
        number("young_modulus_pa", material.young_modulus_pa, 1e2..=1e10);
        number("poisson_ratio", material.poisson_ratio, 0.0..=0.4999);
        number("density_kg_per_m3", material.density_kg_per_m3, 1.0..=2e4);
        number("rayleigh_alpha_per_s", material.rayleigh_alpha_per_s, 0.0..=1e4);
        number("rayleigh_beta_s", material.rayleigh_beta_s, 0.0..=10.0);
        if let Some(gc) = material.fracture_energy_j_per_m2 {
            number("fracture_energy_j_per_m2", gc, 1e-3..=1e7);
        }
        number("initiation_ratio", material.initiation_ratio, 1.0..=10.0);
        if let Some(rate) = &material.rate {
            number("rate.reference_speed_m_per_s", rate.reference_speed_m_per_s, 1e-6..=10.0);
            number("rate.exponent", rate.exponent, 0.0..=1.0);
        }
        // Under a blade that presses, 20 makes 3 % of the energy put in, 30 makes 6 %.
        number("strain_stiffening", material.strain_stiffening, 0.0..=20.0);
        number("friction_coefficient", material.friction_coefficient, 0.0..=10.0);
        if let Some(viscosity) = &material.viscosity {
            number("viscosity.relaxation_time_s", viscosity.relaxation_time_s, 1e-4..=1e4);
            number("viscosity.relaxing_modulus_ratio", viscosity.relaxing_modulus_ratio, 1e-6..=100.0);
        }
        if let Some(prestrain) = &material.prestrain {
            number("prestrain.strain", prestrain.strain, -0.2..=0.5);
            if let Some(along) = &prestrain.along {
                let length = along.iter().map(|c| c * c).sum::<f64>().sqrt();
                number("prestrain.along", length, 1e-6..=1e6);
            }
        }
    }

    fn shape(&mut self, field: &str, shape: &ShapeDesc) -> bool {
        let before = self.problems.len();
        match shape {
            ShapeDesc::Box { min_m, max_m } => {
                let finite = self.vector(&format!("{field}.box.min_m"), min_m, MAX_LENGTH_M)
                    & self.vector(&format!("{field}.box.max_m"), max_m, MAX_LENGTH_M);
                if finite && (0..3).any(|a| max_m[a] - min_m[a] < MIN_LENGTH_M) {
                    let limit = format!("{max_m:?} does not exceed min_m {min_m:?} by {MIN_LENGTH_M} on each axis");
                    self.refuse(format!("{field}.box.max_m"), limit);
                }
            }
            ShapeDesc::Sphere { center_m, radius_m } => {
                self.vector(&format!("{field}.sphere.center_m"), center_m, MAX_LENGTH_M);
                self.length(&format!("{field}.sphere.radius_m"), *radius_m);
            }
            ShapeDesc::Ellipsoid { center_m, semi_axes_m } => {
                self.vector(&format!("{field}.ellipsoid.center_m"), center_m, MAX_LENGTH_M);
                for (a, axis_m) in semi_axes_m.iter().enumerate() {
                    self.length(&format!("{field}.ellipsoid.semi_axes_m[{a}]"), *axis_m);
                }
            }
            ShapeDesc::Capsule { from_m, to_m, radius_m } => {
                self.vector(&format!("{field}.capsule.from_m"), from_m, MAX_LENGTH_M);
                self.vector(&format!("{field}.capsule.to_m"), to_m, MAX_LENGTH_M);
                self.length(&format!("{field}.capsule.radius_m"), *radius_m);
            }
            ShapeDesc::SmoothUnion { blend_m, parts, without } => {
                let field = format!("{field}.smooth_union");
                self.number(&format!("{field}.blend_m"), *blend_m, 0.0..=MAX_LENGTH_M);
                self.count(&format!("{field}.parts"), parts.len(), 1..=MAX_PARTS);
                self.count(&format!("{field}.without"), without.len(), 0..=MAX_PARTS);
                self.parts(&format!("{field}.parts"), parts);
                self.parts(&format!("{field}.without"), without);
            }
            ShapeDesc::Mesh { file, scale_m_per_unit, offset_m } => {
                if file.is_empty() {
                    self.refuse(format!("{field}.mesh.file"), "is empty");
                }
                self.number(&format!("{field}.mesh.scale_m_per_unit"), *scale_m_per_unit, 1e-9..=1e6);
                self.vector(&format!("{field}.mesh.offset_m"), offset_m, MAX_LENGTH_M);
            }
            ShapeDesc::LabelMap { file, labels, scale, offset_m } => {
                if file.is_empty() {
                    self.refuse(format!("{field}.label_map.file"), "is empty");
                }
                if labels.contains(&0) {
                    self.refuse(format!("{field}.label_map.labels"), "0 is what is outside; labels are 1 to 65535");
                }
                self.number(&format!("{field}.label_map.scale"), *scale, 1e-3..=1e3);
                self.vector(&format!("{field}.label_map.offset_m"), offset_m, MAX_LENGTH_M);
            }
        }
        self.problems.len() == before
    }

    fn parts(&mut self, field: &str, parts: &[ShapeDesc]) {
        for (i, part) in parts.iter().enumerate() {
            let field = format!("{field}[{i}]");
            if matches!(part, ShapeDesc::SmoothUnion { .. }) || part.mesh().is_some() {
                self.refuse(field, "a part of a union is a box, sphere, ellipsoid or capsule");
            } else {
                self.shape(&field, part);
            }
        }
    }

    fn load(&mut self, field: &str, load: &LoadDesc) {
        match load {
            LoadDesc::Traction { region, traction_pa, .. } => {
                self.shape(&format!("{field}.traction.region"), region);
                self.vector(&format!("{field}.traction.traction_pa"), traction_pa, 1e9);
            }
            LoadDesc::BodyForce { region, force_n_per_m3 } => {
                self.shape(&format!("{field}.body_force.region"), region);
                self.vector(&format!("{field}.body_force.force_n_per_m3"), force_n_per_m3, 1e9);
            }
        }
    }

    fn blade(&mut self, field: &str, blade: &BladeDesc, smallest_voxel_m: f64) {
        let width_is_sound = self.number(&format!("{field}.width_m"), blade.width_m, 1e-4..=10.0);
        self.number(&format!("{field}.height_m"), blade.height_m, 1e-4..=10.0);
        self.number(&format!("{field}.edge_half_width_m"), blade.edge_half_width_m, 1e-8..=1e-2);
        self.number(&format!("{field}.thickness_m"), blade.thickness_m, 0.0..=0.1);
        if let Some(angle_rad) = blade.wedge_angle_rad
            && self.number(&format!("{field}.wedge_angle_rad"), angle_rad, 0.01..=2.0)
            && blade.thickness_m == 0.0
        {
            self.refuse(format!("{field}.wedge_angle_rad"), "needs a thickness_m above 0 to grow to");
        }
        if let Some(coefficient) = blade.flank_friction {
            self.number(&format!("{field}.flank_friction"), coefficient, 1e-3..=2.0);
        }
        self.across(format!("{field}.width_m"), blade.width_m, smallest_voxel_m);
        if width_is_sound
            && let Some((at, message)) = edge::problem(&blade.edge, blade.width_m, smallest_voxel_m, MAX_BLADE_VOXELS)
        {
            self.refuse(format!("{field}.{at}"), message);
        }
    }

    fn scissors(&mut self, field: &str, scissors: &ScissorsDesc, smallest_voxel_m: f64) {
        self.number(&format!("{field}.blade_length_m"), scissors.blade_length_m, 1e-4..=10.0);
        self.number(&format!("{field}.blade_height_m"), scissors.blade_height_m, 1e-4..=10.0);
        self.number(&format!("{field}.max_angle_rad"), scissors.max_angle_rad, 0.1..=2.0);
        self.number(&format!("{field}.edge_half_width_m"), scissors.edge_half_width_m, 1e-8..=1e-2);
        self.number(&format!("{field}.thickness_m"), scissors.thickness_m, 0.0..=0.1);
        self.across(format!("{field}.blade_length_m"), scissors.blade_length_m, smallest_voxel_m);
    }

    /// A straight edge of this length over the smallest voxels.
    fn across(&mut self, field: String, length_m: f64, smallest_voxel_m: f64) {
        let along = length_m / smallest_voxel_m;
        if along > MAX_BLADE_VOXELS {
            let message = format!(
                "{} is {along:.0} of the smallest voxels, of {} m: more than {MAX_BLADE_VOXELS}; make the voxels \
                 larger or the edge shorter",
                brief(length_m),
                brief(smallest_voxel_m)
            );
            self.refuse(field, message);
        }
    }

    fn grasper(&mut self, field: &str, grasper: &GrasperDesc) {
        self.number(&format!("{field}.radius_m"), grasper.radius_m, JAW_RADIUS_M);
        if let Some(force_n) = grasper.max_force_n {
            self.number(&format!("{field}.max_force_n"), force_n, 1e-6..=1e6);
        }
    }

    fn capsule(&mut self, field: &str, capsule: &CapsuleDesc, largest_voxel_m: f64) {
        let fits = self.number(&format!("{field}.radius_m"), capsule.radius_m, 1e-4..=1.0);
        self.number(&format!("{field}.length_m"), capsule.length_m, 0.0..=10.0);
        if fits && capsule.radius_m < MIN_PROBE_VOXELS * largest_voxel_m {
            let message = format!(
                "{} is less than {MIN_PROBE_VOXELS} of the largest voxels, of {} m; make the voxels smaller or this \
                 larger",
                brief(capsule.radius_m),
                brief(largest_voxel_m)
            );
            self.refuse(format!("{field}.radius_m"), message);
        }
    }
}
