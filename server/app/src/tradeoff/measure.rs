//! Errors of a run against the reference.

use kerf_scenes::dial::ParetoPoint;

use super::process::Run;
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

/// A run's errors and cost as a point of the Pareto front.
#[must_use]
pub fn point(run: &Run, reference: &Run) -> ParetoPoint {
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
    ParetoPoint {
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

#[cfg(test)]
mod tests {
    use kerf_scenes::catalog;

    use super::*;
    use crate::tradeoff::job::Job;
    use crate::tradeoff::process::Cost;
    use crate::tradeoff::sweep::own_setting;

    /// Two points at two times; the tool is felt from window `from` on.
    fn run(displacement_m: [[f32; 3]; 4], from: usize, force_n: f32, cut_m: f64) -> Run {
        let force = |window: usize| vec![[0.0, if window < from { 0.0 } else { force_n }, 0.0]];
        let [a, b, c, d] = displacement_m;
        Run {
            job: Job {
                scene: "block".into(),
                script: None,
                inputs: 0,
                setting: own_setting(&catalog::builtin("liver").unwrap().desc),
                stroke: None,
                level_around_stroke: None,
                max_iterations: None,
                duration_s: 1.0,
                samples: 2,
                points: Vec::new(),
                profile: Vec::new(),
                threads: 1,
                start_s: 0.0,
                limit_s: None,
            },
            voxels: 8,
            elements: 1,
            steps: 10,
            faults: 0,
            worst_residual: 0.0,
            samples: Samples {
                displacement_m: vec![vec![a, b], vec![c, d]],
                force_n: (0..2 * WINDOWS_PER_SAMPLE as usize).map(force).collect(),
            },
            profile_m: Vec::new(),
            cut_depth_m: cut_m,
            cut_area_m2: 2.0 * cut_m,
            residual_j: -0.01,
            work_j: 2.0,
            cost: Cost { median_ms: 1.0, p99_ms: 2.0, memory_mib: 3.0, run_s: 4.0 },
        }
    }

    const REST: [f32; 3] = [0.0; 3];

    #[test]
    fn errors_are_as_worked_out_by_hand() {
        let reference = run([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [3.0, 0.0, 0.0], [0.0, 0.0, 2.0]], 0, 10.0, 0.05);
        let off = run([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [3.0, 0.0, 0.0], [0.0, 0.0, 1.0]], 0, 8.0, 0.04);
        let point = point(&off, &reference);
        // Errors 0.5 and 1; the reference's squares are 1, 1, 9 and 4.
        assert!((point.displacement_rms_error - (1.25f64 / 15.0).sqrt()).abs() < 1e-12);
        assert!((point.displacement_max_error - 1.0 / 3.0).abs() < 1e-12);
        assert!((point.force_rms_error - 0.2).abs() < 1e-12);
        assert!((point.cut_depth_error - 0.2).abs() < 1e-12 && (point.cut_area_error - 0.2).abs() < 1e-12);
        assert!((point.energy_residual - 0.005).abs() < 1e-12);
    }

    #[test]
    fn only_the_time_with_the_tool_counts() {
        let later = WINDOWS_PER_SAMPLE as usize;
        let reference = run([REST, REST, [2.0, 0.0, 0.0], REST], later, 10.0, 0.0);
        let off = run([[9.0, 0.0, 0.0], REST, [1.0, 0.0, 0.0], REST], later, 10.0, 0.01);
        let point = point(&off, &reference);
        assert!((point.displacement_rms_error - 0.5).abs() < 1e-12);
        // There is no cut to be relative to.
        assert_eq!([point.force_rms_error, point.cut_depth_error, point.cut_area_error], [0.0; 3]);
    }

    #[test]
    fn without_a_force_all_times_count() {
        let reference = run([[1.0, 0.0, 0.0], REST, [2.0, 0.0, 0.0], REST], 99, 0.0, 0.0);
        assert_eq!(touching_windows(&reference.samples), 0..2 * WINDOWS_PER_SAMPLE as usize);
        assert!((point(&run([REST; 4], 99, 0.0, 0.0), &reference).displacement_rms_error - 1.0).abs() < 1e-12);
    }
}
