//! What is kept of a run over time: displacements at common times, forces averaged over common windows.

use kerf_physics::World;
use serde::{Deserialize, Serialize};

use super::job::Job;
use super::points::Followed;

/// Windows of force per sample of displacement: a force that drops as the tissue gives is short.
pub const WINDOWS_PER_SAMPLE: u32 = 4;

/// Samples of a run; those that it did not reach are absent (displacements) or 0 (forces).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Samples {
    /// Displacement of each point, m, by time.
    pub displacement_m: Vec<Vec<[f32; 3]>>,
    /// Mean force on each tool, N, by window of time.
    pub force_n: Vec<Vec<[f32; 3]>>,
}

/// Takes the samples of a run. Between two steps displacements are linear in time and forces constant, so
/// that every rate has the same times.
pub struct Sampler {
    followed: Followed,
    start_s: f64,
    interval_s: f64,
    /// Displacements and time before the step, where a sample falls into it.
    before: Option<Vec<[f32; 3]>>,
    next: u32,
    count: u32,
    dt_s: f64,
    displacement_m: Vec<Vec<[f32; 3]>>,
    /// Integral of the force over time, N s.
    impulse_n_s: Vec<Vec<[f64; 3]>>,
}

impl Sampler {
    /// A sampler for a world at rest.
    #[must_use]
    pub fn new(world: &World, job: &Job, dt_s: f64) -> Self {
        let interval_s = job.duration_s / f64::from(job.samples);
        let tools = world.output().tools.len();
        Self {
            followed: Followed::new(&world.bodies(), &job.points),
            start_s: job.start_s,
            interval_s,
            before: None,
            next: (job.start_s / interval_s).floor() as u32 + 1,
            count: job.samples,
            dt_s,
            displacement_m: Vec::new(),
            impulse_n_s: vec![vec![[0.0; 3]; tools]; (job.samples * WINDOWS_PER_SAMPLE) as usize],
        }
    }

    /// To be called before each step.
    pub fn before_step(&mut self, world: &World) {
        let end_s = self.time_s(world) + self.dt_s;
        let is_due = self.next <= self.count && self.sample_s(self.next) <= end_s + self.slack_s();
        self.before = is_due.then(|| self.followed.displacements_m(&world.bodies()));
    }

    /// To be called after each step.
    pub fn after_step(&mut self, world: &World) {
        let end_s = self.time_s(world);
        let start_s = end_s - self.dt_s;
        if let Some(before) = self.before.take() {
            let after = self.followed.displacements_m(&world.bodies());
            while self.next <= self.count && self.sample_s(self.next) <= end_s + self.slack_s() {
                let share = ((self.sample_s(self.next) - start_s) / self.dt_s).clamp(0.0, 1.0) as f32;
                let between = |(a, b): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|i| a[i] + share * (b[i] - a[i]));
                self.displacement_m.push(before.iter().zip(&after).map(between).collect());
                self.next += 1;
            }
        }
        let window_s = self.interval_s / f64::from(WINDOWS_PER_SAMPLE);
        let first = (start_s / window_s).floor().max(0.0) as usize;
        for (index, impulses) in self.impulse_n_s.iter_mut().enumerate().skip(first) {
            let window_start_s = index as f64 * window_s;
            if window_start_s >= end_s {
                break;
            }
            let overlap_s = (end_s.min(window_start_s + window_s) - start_s.max(window_start_s)).max(0.0);
            for (impulse, tool) in impulses.iter_mut().zip(&world.output().tools) {
                (0..3).for_each(|i| impulse[i] += overlap_s * tool.wrench.force_n[i]);
            }
        }
    }

    /// The samples.
    #[must_use]
    pub fn finish(self) -> Samples {
        let window_s = self.interval_s / f64::from(WINDOWS_PER_SAMPLE);
        let mean = |impulse: &[f64; 3]| impulse.map(|i| (i / window_s) as f32);
        let force_n = self.impulse_n_s.iter().map(|tools| tools.iter().map(mean).collect()).collect();
        Samples { displacement_m: self.displacement_m, force_n }
    }

    fn time_s(&self, world: &World) -> f64 {
        self.start_s + world.output().sim_time_s
    }

    fn sample_s(&self, index: u32) -> f64 {
        f64::from(index) * self.interval_s
    }

    /// Rounding of times.
    fn slack_s(&self) -> f64 {
        1e-6 * self.dt_s
    }
}
