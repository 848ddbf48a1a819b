//! Errors of a run against the reference.

use kerf_session::dial::FrontPoint;

use super::job::Run;
use super::samples::{Samples, WINDOWS_PER_SAMPLE};

/// Error of displacements or of forces, and what it is over.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Deviation {
    error2: f64,
    reference2: f64,
    largest_error2: f64,
    largest_reference2: f64,
}

impl Deviation {
    fn between<'a>(pairs: impl Iterator<Item = (&'a [f32; 3], &'a [f32; 3])>) -> Self {
        let square = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>();
        pairs.fold(Self::default(), |mut sum, (run, reference)| {
            let (error2, reference2) = (
                square([0, 1, 2].map(|i| f64::from(run[i]) - f64::from(reference[i]))),
                square(reference.map(f64::from)),
            );
            sum.error2 += error2;
            sum.reference2 += reference2;
            sum.largest_error2 = sum.largest_error2.max(error2);
            sum.largest_reference2 = sum.largest_reference2.max(reference2);
            sum
        })
    }

    fn rms(&self) -> f64 {
        over(self.error2, self.reference2).sqrt()
    }

    fn max(&self) -> f64 {
        over(self.largest_error2, self.largest_reference2).sqrt()
    }
}

/// An error over what it is relative to; 0 where there is nothing to be relative to.
fn over(error: f64, reference: f64) -> f64 {
    if reference > 0.0 { error / reference } else { 0.0 }
}

/// First and last window, exclusive, in which a tool felt a force; every window where none ever did.
#[must_use]
pub fn touching_windows(samples: &Samples) -> std::ops::Range<usize> {
    let touches = |tools: &Vec<[f32; 3]>| tools.iter().flatten().any(|f| *f != 0.0);
    let first = samples.force_n.iter().position(touches);
    let last = samples.force_n.iter().rposition(touches);
    first.zip(last).map_or(0..samples.force_n.len(), |(first, last)| first..last + 1)
}

/// A run's errors and cost as a point of the front.
#[must_use]
pub fn point(run: &Run, reference: &Run) -> FrontPoint {
    let windows = touching_windows(&reference.samples);
    // Sample `i` is taken at the end of the windows `i * per_sample ..`.
    let per_sample = WINDOWS_PER_SAMPLE as usize;
    let is_moving = |sample: &usize| windows.contains(&(sample * per_sample + per_sample - 1));
    let [ours, theirs] = [&run.samples, &reference.samples];
    let moving = (0..theirs.displacement_m.len()).filter(is_moving);
    let displacement =
        Deviation::between(moving.flat_map(|i| ours.displacement_m[i].iter().zip(&theirs.displacement_m[i])));
    let force = Deviation::between(windows.clone().flat_map(|i| ours.force_n[i].iter().zip(&theirs.force_n[i])));
    let relative = |ours: f64, theirs: f64| over((ours - theirs).abs(), theirs);
    let setting = run.job.setting;
    FrontPoint {
        level: setting.level,
        voxel_scale: setting.voxel_scale,
        rate_hz: setting.rate_hz,
        relative_tolerance: setting.relative_tolerance,
        element: setting.element,
        finer: setting.finer,
        elements: run.elements,
        displacement_rms_error: displacement.rms(),
        displacement_max_error: displacement.max(),
        force_rms_error: force.rms(),
        cut_depth_error: relative(run.cut_depth_m, reference.cut_depth_m),
        cut_area_error: relative(run.cut_area_m2, reference.cut_area_m2),
        energy_residual: over(run.residual_j.abs(), run.work_j.abs()),
        median_ms: run.cost.median_ms,
        p99_ms: run.cost.p99_ms,
        memory_mib: run.cost.memory_mib,
    }
}
