//! What lies outside the supported ranges, and what is said of it when a scene is loaded.

use kerf_physics::scene::{BladeDesc, LoadDesc, RegionDesc, Scene, ShapeDesc, ToolDesc};

use super::scenes::{Specimen, everywhere};

/// A scene with one value out of its range.
pub struct Refusal {
    /// The field that is to be named.
    pub field: &'static str,
    /// The range that is supported, for the report.
    pub range: &'static str,
    /// What was said of the value; empty: it was taken.
    pub said: Vec<String>,
}

impl Refusal {
    /// Whether exactly this field was named, with a limit of its range.
    #[must_use]
    pub fn holds(&self) -> bool {
        let limits = self.range.split(" to ").collect::<Vec<_>>();
        let names_field = |said: &String| said.starts_with(&format!("{}: ", self.field));
        let names_limit = |said: &String| limits.iter().any(|limit| said.contains(limit));
        self.said.len() == 1 && self.said.iter().all(|said| names_field(said) && names_limit(said))
    }
}

type Change = fn(&mut Scene);

/// Field, supported range as the message writes it, and two changes: below and beyond.
const RANGES: [(&str, &str, [Change; 2]); 14] = [
    ("rate_hz", "10 to 10000", [|s| s.desc.rate_hz = 9.99, |s| s.desc.rate_hz = 10_001.0]),
    (
        "gravity_m_per_s2",
        "-1000 to 1000",
        [|s| s.desc.gravity_m_per_s2[1] = -1001.0, |s| s.desc.gravity_m_per_s2[0] = 1001.0],
    ),
    (
        "objects[0].voxel_size_m",
        "0.00001 to 1",
        [|s| s.desc.objects[0].voxel_size_m = Some(9.9e-6), |s| s.desc.objects[0].voxel_size_m = Some(1.01)],
    ),
    ("objects[0].resolution", "0.00001 to 1", [|s| of_resolution(s, 1e-4, 11), |s| of_resolution(s, 11.0, 10)]),
    (
        "objects[0].material.young_modulus_pa",
        "100 to 10000000000",
        [
            |s| s.desc.objects[0].material.young_modulus_pa = 99.0,
            |s| s.desc.objects[0].material.young_modulus_pa = 1.01e10,
        ],
    ),
    (
        "objects[0].material.poisson_ratio",
        "0 to 0.4999",
        [|s| s.desc.objects[0].material.poisson_ratio = -0.01, |s| s.desc.objects[0].material.poisson_ratio = 0.49991],
    ),
    (
        "objects[0].material.density_kg_per_m3",
        "1 to 20000",
        [
            |s| s.desc.objects[0].material.density_kg_per_m3 = 0.99,
            |s| s.desc.objects[0].material.density_kg_per_m3 = 20_001.0,
        ],
    ),
    (
        "objects[0].material.strain_stiffening",
        "0 to 20",
        [
            |s| s.desc.objects[0].material.strain_stiffening = -0.1,
            |s| s.desc.objects[0].material.strain_stiffening = 20.1,
        ],
    ),
    (
        "objects[0].regions[0].material.young_modulus_pa",
        "1000000 to 1e6",
        [|s| beside(s, 9.9e-7), |s| beside(s, 1.01e6)],
    ),
    (
        "objects[0].loads[0].traction.traction_pa",
        "-1000000000 to 1000000000",
        [|s| stiff_and_drawn(s, -1.01e9), |s| stiff_and_drawn(s, 1.01e9)],
    ),
    ("gravity_m_per_s2", "0.5 E to 1.5 E", [|s| heavy(s, 0.0, 510.0), |s| heavy(s, 3.0, 755.0)]),
    ("objects[0].loads[0]", "0.5 E to 1.5 E", [|s| drawn(s, 5.1e3), |s| drawn(s, -5.1e3)]),
    ("rate_hz", "0 to 100", [|s| free(s, 1e10, 1000.0), |s| free(s, 1e6, 10.0)]),
    ("tools[0].shape.blade.width_m", "0.0001 to 4096", [|s| wide(s, 9.9e-5), |s| wide(s, 5.0)]),
];

fn wide(scene: &mut Scene, width_m: f64) {
    scene.desc.tools = vec![ToolDesc::blade("blade", BladeDesc::straight(width_m, 0.05))];
}

fn of_resolution(scene: &mut Scene, side_m: f64, resolution: u32) {
    let object = &mut scene.desc.objects[0];
    object.shape = ShapeDesc::Box { min_m: [0.0; 3], max_m: [side_m; 3] };
    object.voxel_size_m = None;
    object.resolution = Some(resolution);
    scene.desc.tools.clear();
}

/// Nothing holds the object, and waves cross it by the thousand voxels in a step.
fn free(scene: &mut Scene, young_modulus_pa: f64, rate_hz: f64) {
    scene.desc.rate_hz = rate_hz;
    scene.desc.objects[0].material.young_modulus_pa = young_modulus_pa;
    scene.desc.objects[0].fixed.clear();
}

/// A region so many times as stiff as the object.
fn beside(scene: &mut Scene, times: f64) {
    let object = &mut scene.desc.objects[0];
    object.material.young_modulus_pa = 1e3 / times.min(1.0);
    let young_modulus_pa = object.material.young_modulus_pa * times;
    let material = kerf_physics::scene::MaterialDesc { young_modulus_pa, ..object.material.clone() };
    object.regions.push(RegionDesc { name: "inside".into(), shape: everywhere(), material });
}

/// An object ten times as high, that stiffens with strain or does not.
fn heavy(scene: &mut Scene, strain_stiffening: f64, gravity_m_per_s2: f64) {
    let object = &mut scene.desc.objects[0];
    object.shape = ShapeDesc::Box { min_m: [0.0; 3], max_m: [1e-3, 1e-2, 1e-3] };
    object.material.strain_stiffening = strain_stiffening;
    object.material.density_kg_per_m3 *= if strain_stiffening > 0.0 { 2.0 } else { 1.0 };
    scene.desc.gravity_m_per_s2[1] = -gravity_m_per_s2;
}

/// A load beyond its own range, on a material that carries as much.
fn stiff_and_drawn(scene: &mut Scene, traction_pa: f64) {
    scene.desc.objects[0].material.young_modulus_pa = 1e10;
    drawn(scene, traction_pa);
}

fn drawn(scene: &mut Scene, traction_pa: f64) {
    let load = LoadDesc::Traction {
        region: everywhere(),
        face: kerf_physics::scene::Face::MaxY,
        traction_pa: [0.0, traction_pa, 0.0],
    };
    scene.desc.objects[0].loads.push(load);
}

/// Two values of each field just outside its range.
#[must_use]
pub fn refusals() -> Vec<Refusal> {
    let specimen = Specimen { voxel_size_m: 1e-3, voxels: [1; 3], ..Specimen::default() };
    let refused = |(field, range, changes): (&'static str, &'static str, [Change; 2])| {
        changes.map(|change| {
            let mut scene = specimen.scene(specimen.held_block(), 1);
            change(&mut scene);
            Refusal { field, range, said: scene.problems().iter().map(ToString::to_string).collect() }
        })
    };
    RANGES.into_iter().flat_map(refused).collect()
}
