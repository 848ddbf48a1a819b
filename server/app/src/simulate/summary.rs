//! The summary of a run: `summary.json`.

use std::collections::BTreeMap;

use kerf_physics::step_io::StepOutput;
use kerf_physics::{Vec3, World};
use serde::Serialize;

/// What a run amounted to. Times are `null` where no such step was taken.
#[derive(Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Name of the scene.
    pub scene: String,
    /// Steps per simulated second, Hz.
    pub rate_hz: f64,
    /// Levels of the objects, in order.
    pub levels: Vec<u8>,
    /// Threads that were lent to the steps.
    pub threads: usize,
    /// Fine voxels.
    pub voxels: usize,
    /// Composite elements at the end.
    pub composite_elements: usize,
    /// Nodes at the end.
    pub nodes: usize,
    /// Vertices of the surface at the end.
    pub surface_vertices: usize,
    /// Triangles of the surface at the end.
    pub surface_triangles: usize,
    /// Pieces at the end.
    pub parts: usize,
    /// Area that parted, m^2, reference configuration.
    pub cut_area_m2: f64,
    /// Links that parted.
    pub parted_links: u64,
    /// Tools that entered the scene and felt no force, by their place in the scene.
    pub tools_without_contact: Vec<usize>,
    /// Links that were crossed and spared: parting them would have set free a few voxels.
    pub spared_links: u64,
    /// Steps taken.
    pub steps: u64,
    /// Steps in which links parted.
    pub fracture_steps: u64,
    /// Steps in which state that was not finite, or had energy from nowhere, was rolled back.
    pub faults: u64,
    /// Solves that did not get to their tolerance and were taken up again.
    pub retried_solves: u64,
    /// Steps that were taken though their solve did not get there.
    pub unconverged_steps: u64,
    /// Steps that were taken though contacts had not settled.
    pub unsettled_steps: u64,
    /// Pieces that fell out of the scene's reach and were put away.
    pub pieces_put_away: u64,
    /// Median duration of the steps in which no link parted, ms.
    pub step_ms_median_without_fracture: Option<f64>,
    /// Median duration of the steps in which links parted, ms.
    pub step_ms_median_with_fracture: Option<f64>,
    /// 99th percentile of the duration of all steps, ms.
    pub step_ms_p99: Option<f64>,
    /// Solver iterations per step.
    pub solver_iterations_mean: f64,
    /// Relative residual at the end of a quasi-static run.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relaxed_residual: Option<f64>,
    /// Whether a quasi-static run came to rest.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub converged: Option<bool>,
    /// Hash of the state at the end, 16 hexadecimal digits.
    pub state_hash: String,
    /// Hash of the surface's structure at the end, 16 hexadecimal digits.
    pub surface_hash: String,
    /// Version of this program.
    pub version: &'static str,
}

/// Sums over the steps of a run.
#[derive(Debug, Default)]
pub struct Tally {
    without_fracture_ns: Vec<u64>,
    with_fracture_ns: Vec<u64>,
    iterations: u64,
    faults: u64,
    retried_solves: u64,
    unconverged_steps: u64,
    unsettled_steps: u64,
    pieces_put_away: u64,
    parted_links: u64,
    spared_links: u64,
    cut_area_m2: f64,
    /// Whether each tool that entered has felt a force.
    felt: BTreeMap<usize, bool>,
}

impl Tally {
    /// Adds a step.
    pub fn push(&mut self, output: &StepOutput) {
        let parted = output.fracture.parted_links;
        let times = if parted > 0 { &mut self.with_fracture_ns } else { &mut self.without_fracture_ns };
        times.push(output.profile.total_ns());
        self.iterations += u64::from(output.solve.iterations);
        self.faults += u64::from(output.fault.is_some());
        self.retried_solves += u64::from(output.solve.retries);
        self.unconverged_steps += u64::from(output.solve.is_unconverged);
        self.unsettled_steps += u64::from(output.solve.unsettled_n_s > 0.0);
        self.pieces_put_away += u64::from(output.put_away);
        self.parted_links += u64::from(parted);
        self.spared_links += u64::from(output.fracture.spared_links);
        self.cut_area_m2 += output.fracture.cut_area_m2;
        for (tool, state) in output.tools.iter().enumerate().filter(|(_, state)| state.pose.is_some()) {
            *self.felt.entry(tool).or_default() |= state.wrench.force_n != Vec3::zeros();
        }
    }

    /// The summary of what was added and of the world as it is now.
    pub fn summary(self, world: &mut World) -> Summary {
        let counts = world.counts();
        let (fracture_steps, steps) =
            (self.with_fracture_ns.len(), self.with_fracture_ns.len() + self.without_fracture_ns.len());
        let all_ns = [self.with_fracture_ns.as_slice(), &self.without_fracture_ns].concat();
        Summary {
            voxels: counts.voxels,
            composite_elements: counts.composite_elements,
            nodes: counts.nodes,
            surface_vertices: counts.surface_vertices,
            surface_triangles: counts.surface_triangles,
            parts: counts.parts,
            cut_area_m2: self.cut_area_m2,
            parted_links: self.parted_links,
            spared_links: self.spared_links,
            tools_without_contact: self.felt.iter().filter(|(_, felt)| !**felt).map(|(tool, _)| *tool).collect(),
            steps: steps as u64,
            fracture_steps: fracture_steps as u64,
            faults: self.faults,
            retried_solves: self.retried_solves,
            unconverged_steps: self.unconverged_steps,
            unsettled_steps: self.unsettled_steps,
            pieces_put_away: self.pieces_put_away,
            step_ms_median_without_fracture: quantile_ms(self.without_fracture_ns, 0.5),
            step_ms_median_with_fracture: quantile_ms(self.with_fracture_ns, 0.5),
            step_ms_p99: quantile_ms(all_ns, 0.99),
            solver_iterations_mean: self.iterations as f64 / steps.max(1) as f64,
            state_hash: format!("{:016x}", world.state_hash()),
            surface_hash: format!("{:016x}", world.surface_hash()),
            version: crate::VERSION,
            ..Summary::default()
        }
    }
}

/// The smallest value that at least a share `quantile` of the values do not exceed, ms.
pub fn quantile_ms(mut values_ns: Vec<u64>, quantile: f64) -> Option<f64> {
    values_ns.sort_unstable();
    let rank = (values_ns.len() as f64 * quantile).ceil() as usize;
    values_ns.get(rank.saturating_sub(1)).map(|ns| *ns as f64 / 1e6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_nearest_ranks() {
        let values: Vec<u64> = (1..=100).rev().map(|n| n * 1_000_000).collect();
        assert_eq!(quantile_ms(values.clone(), 0.5), Some(50.0));
        assert_eq!(quantile_ms(values, 0.99), Some(99.0));
        assert_eq!(quantile_ms(vec![7_000_000], 0.99), Some(7.0));
        assert_eq!(quantile_ms(vec![], 0.5), None);
    }
}
