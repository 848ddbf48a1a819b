//! What each capability adds to a step of the liver.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use kerf_physics::scene::{ElementKind, FinerDesc, GovernorDesc, ShapeDesc};
use kerf_physics::{SceneDesc, SoundScene, StepInputs, Workers, World};
use kerf_server::script::stroke::default_stroke;
use kerf_session::clock::MonotonicClock;

use super::run::{Viewer, builtin, cell, quantile, stroke};

/// Steps without a tool, until the scene stands and then as many again.
const BARE_STEPS: usize = 600;
/// Runs of which the median is taken, the variants in turn, so that a machine that slows down slows all.
const ROUNDS: usize = 3;
/// Steps of a stroke until well into the cut, at 1 kHz.
const CUT_STEPS: usize = 1000;

type Change = fn(&mut SceneDesc);

/// Changes of the scene, each measured against the scene as it is, under the same stroke.
const SCENES: [(&str, Change); 7] = [
    ("as it is", |_| ()),
    ("no fracture energy: the blade presses and cannot cut", |desc| {
        desc.objects[0].material.fracture_energy_j_per_m2 = None;
    }),
    ("strain stiffening, c = 3", |desc| desc.objects[0].material.strain_stiffening = 3.0),
    ("no Rayleigh damping", |desc| {
        desc.objects[0].material.rayleigh_alpha_per_s = 0.0;
        desc.objects[0].material.rayleigh_beta_s = 0.0;
    }),
    ("a finer region around the cut (level 1)", |desc| {
        let shape = ShapeDesc::Box { min_m: [-0.035, 0.0, -0.012], max_m: [0.035, 0.2, 0.012] };
        desc.objects[0].finer = vec![FinerDesc { shape, level: 1 }];
    }),
    ("plain trilinear elements", |desc| desc.objects[0].element = ElementKind::Galerkin),
    ("a governor", |desc| desc.governor = Some(GovernorDesc { max_relative_tolerance: 0.1 })),
];

pub fn section(_plots: &Path) -> Result<String> {
    let mut text = String::from(
        "\n## What each capability costs\n\nMedians of a step of the liver at 1 kHz, one thread, ms; the variants take \
         turns. A stage that a scene does not require is not entered (`cargo test -p kerf-physics \
         pays_only_for_what_it_requires`).\n\n| step | elements | ms |\n|---|---|---|\n",
    );
    bare(&mut text)?;
    text += "\n| scene, under the same stroke | elements | without fracture | with |\n|---|---|---|---|\n";
    let mut rows = vec![(0, [Vec::new(), Vec::new()]); SCENES.len() + 1];
    for _ in 0..ROUNDS {
        for (row, (_, change)) in rows.iter_mut().zip(SCENES) {
            measure(row, &builtin("liver")?.with(change)?, Viewer::Absent)?;
        }
        measure(&mut rows[SCENES.len()], &builtin("liver")?, Viewer::Watching)?;
    }
    let names = SCENES.iter().map(|(name, _)| *name).chain(["as it is, and a viewer watches"]);
    for (name, (elements, times)) in names.zip(rows) {
        let [without, with] = times.map(|ms| cell(quantile(ms.into_iter(), 0.5)));
        writeln!(text, "| {name} | {elements} | {without} | {with} |")?;
    }
    Ok(text)
}

fn measure(row: &mut (usize, [Vec<f64>; 2]), scene: &SoundScene, viewer: Viewer) -> Result<()> {
    let run = stroke(scene, 1, viewer, CUT_STEPS)?;
    row.0 = run.counts.composite_elements;
    row.1[0].push(run.median_ms(false));
    row.1[1].push(run.median_ms(true));
    Ok(())
}

/// Steps that no tool touches: the scene at rest, with and without a blade above it.
fn bare(text: &mut String) -> Result<()> {
    let scene = builtin("liver")?;
    let no_tools = scene.clone().with(|desc| desc.tools.clear())?;
    let mut above = default_stroke(&scene)?;
    let entered = above.advance(0.0);
    for (name, scene, tools) in [
        ("at rest, a scene without tools", &no_tools, &[][..]),
        ("at rest, a tool lifted", &scene, &[]),
        ("at rest, a blade above it", &scene, &entered),
    ] {
        let mut world = World::new(scene)?;
        let elements = world.counts().composite_elements;
        let step = |world: &mut World| {
            let output = world.step(&Workers::serial(), &MonotonicClock, &StepInputs::of(tools));
            output.profile.total_ns() as f64 * 1e-6
        };
        (0..BARE_STEPS).for_each(|_| _ = step(&mut world));
        let ms = quantile((0..BARE_STEPS).map(|_| step(&mut world)), 0.5);
        writeln!(text, "| {name} | {elements} | {} |", cell(ms))?;
    }
    Ok(())
}
