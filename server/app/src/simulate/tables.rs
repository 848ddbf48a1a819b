//! The tables of a run: a row per step in each of `tool.csv`, `energy.csv`, `tracked_points.csv` and
//! `profile.csv`.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use anyhow::{Context, Result, ensure};
use kerf_physics::energy_terms::{ENERGY_TERMS, EnergyTerm, TermKind};
use kerf_physics::stage::Stage;
use kerf_physics::step_io::{EnergyStep, StepOutput};
use kerf_physics::{Pose, SceneDesc, Vec3};
use kerf_script::POSE_COLUMNS;

use crate::convert::script_pose;

/// The table whose rows begin with the step.
const PROFILE: &str = "profile.csv";
/// More than a row of it takes, bytes.
const MOST_OF_A_ROW: i64 = 4096;

/// Open tables of a run.
pub struct Tables {
    tool: csv::Writer<File>,
    energy: csv::Writer<File>,
    tracked_points: csv::Writer<File>,
    profile: csv::Writer<File>,
    tool_names: Vec<String>,
    /// Booked so far.
    energy_j: EnergyStep,
}

impl Tables {
    /// Creates the tables of a run of so many steps in a folder, which is created, too, and writes their headers.
    ///
    /// # Errors
    /// The tables of a longer run stand there, or a file cannot be written.
    pub fn create(folder: &Path, scene: &SceneDesc, steps: u64) -> Result<Self> {
        let standing = standing_steps(&folder.join(PROFILE)).unwrap_or(0);
        ensure!(
            standing <= steps,
            "a run of {standing} steps stands in {}, and this one has {steps}: name another folder, or remove that one",
            folder.display()
        );
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
        let create = |name: &str, header: Vec<String>| -> Result<csv::Writer<File>> {
            let path = folder.join(name);
            let mut writer = csv::Writer::from_path(&path).with_context(|| path.display().to_string())?;
            writer.write_record(header)?;
            Ok(writer)
        };
        let points = scene.tracked_points.iter();
        let axes = points.flat_map(|point| ["x", "y", "z"].map(|axis| format!("{}_u{axis}_m", point.name)));
        Ok(Self {
            tool: create("tool.csv", tool_header())?,
            energy: create("energy.csv", energy_header())?,
            tracked_points: create("tracked_points.csv", std::iter::once("time_s".to_owned()).chain(axes).collect())?,
            profile: create(PROFILE, profile_header())?,
            tool_names: scene.tools.iter().map(|tool| tool.name.clone()).collect(),
            energy_j: EnergyStep::default(),
        })
    }

    /// Adds the rows of a step.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn push(&mut self, output: &StepOutput) -> Result<()> {
        self.push_tools(output)?;
        self.push_energy(output)?;
        self.push_tracked_points(output)?;
        self.push_profile(output)
    }

    /// Writes what is still in memory.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn finish(mut self) -> Result<()> {
        for writer in [&mut self.tool, &mut self.energy, &mut self.tracked_points, &mut self.profile] {
            writer.flush()?;
        }
        Ok(())
    }

    fn push_tools(&mut self, output: &StepOutput) -> Result<()> {
        for (name, tool) in self.tool_names.iter().zip(&output.tools) {
            let cells = |p: Pose| script_pose(&p).cells();
            let pose = tool.pose.map_or_else(Default::default, cells);
            let wrench = [tool.wrench.force_n, tool.wrench.torque_nm];
            let values = wrench.iter().flat_map(components).chain([tool.cutting_length_m.to_string()]);
            let row = [time(output), name.clone()].into_iter().chain(pose).chain(values);
            self.tool.write_record(row)?;
        }
        Ok(())
    }

    fn push_energy(&mut self, output: &StepOutput) -> Result<()> {
        self.energy_j.book(&output.energy);
        let values = ENERGY_TERMS.iter().map(|term| term.of(&self.energy_j).to_string());
        let ratio = self.energy_j.residual_over_tool_work().map_or(String::new(), |ratio| ratio.to_string());
        Ok(self.energy.write_record(std::iter::once(time(output)).chain(values).chain([ratio]))?)
    }

    fn push_tracked_points(&mut self, output: &StepOutput) -> Result<()> {
        let values = output.tracked_displacement_m.iter().flat_map(components);
        Ok(self.tracked_points.write_record(std::iter::once(time(output)).chain(values))?)
    }

    fn push_profile(&mut self, output: &StepOutput) -> Result<()> {
        let counts = [output.solve.iterations, output.solve.solves, output.fracture.parted_links];
        let stages = output.profile.stage_ns.iter().map(|ns| ns.map_or(String::new(), |ns| ns.to_string()));
        let row = [output.step.to_string(), time(output), output.profile.total_ns().to_string()];
        Ok(self.profile.write_record(row.into_iter().chain(counts.map(|n| n.to_string())).chain(stages))?)
    }
}

/// Steps of the run whose table this is, whether it came to its end or not; `None` where there is none.
fn standing_steps(profile: &Path) -> Option<u64> {
    let mut file = File::open(profile).ok()?;
    let length = file.metadata().ok()?.len();
    file.seek(SeekFrom::End(-MOST_OF_A_ROW.min(length as i64))).ok()?;
    let mut text = String::new();
    file.read_to_string(&mut text).ok()?;
    let mut steps = text.lines().rev().filter_map(|row| row.split(',').next()?.parse().ok());
    steps.next()
}

fn time(output: &StepOutput) -> String {
    // Nine digits: a nanosecond, so that the product of step and dt prints as it is meant.
    format!("{:.9}", output.sim_time_s)
}

fn components(vector: &Vec3) -> impl Iterator<Item = String> {
    let vector = *vector;
    (0..3).map(move |axis| vector[axis].to_string())
}

fn owned<const N: usize>(names: [&str; N]) -> impl Iterator<Item = String> {
    names.map(str::to_owned).into_iter()
}

fn tool_header() -> Vec<String> {
    let pose = owned(["time_s", "tool"]).chain(owned(POSE_COLUMNS));
    let wrench = ["force_x_n", "force_y_n", "force_z_n", "torque_x_nm", "torque_y_nm", "torque_z_nm"];
    pose.chain(owned(wrench)).chain(owned(["cutting_length_m"])).collect()
}

fn energy_header() -> Vec<String> {
    let column = |term: &EnergyTerm| match term.kind {
        TermKind::Level => term.name.to_owned(),
        TermKind::Work | TermKind::Spent => format!("total_{}", term.name),
    };
    let terms = ENERGY_TERMS.iter().map(column);
    owned(["time_s"]).chain(terms).chain(owned(["residual_over_tool_work"])).collect()
}

fn profile_header() -> Vec<String> {
    let counts = owned(["step", "time_s", "total_ns", "iterations", "solves", "parted_links"]);
    counts.chain(Stage::ALL.map(|stage| format!("{}_ns", stage.name()))).collect()
}

#[cfg(test)]
mod tests {
    use kerf_scenes::catalog;

    use super::*;

    #[test]
    fn a_longer_run_is_not_written_over() {
        let folder = tempfile::tempdir().unwrap();
        let scene = catalog::builtin("liver").unwrap().into_scene().desc;
        let mut tables = Tables::create(&folder.path().join("run"), &scene, 12).unwrap();
        for step in 1..=12 {
            let tracked_displacement_m = vec![Vec3::zeros(); scene.tracked_points.len()];
            tables.push(&StepOutput { step, tracked_displacement_m, ..StepOutput::default() }).unwrap();
        }
        tables.finish().unwrap();
        let refused = Tables::create(&folder.path().join("run"), &scene, 11).err().unwrap().to_string();
        assert!(refused.starts_with("a run of 12 steps stands in ") && refused.contains("has 11"), "{refused}");
        assert_eq!(standing_steps(&folder.path().join("run/profile.csv")), Some(12));
        Tables::create(&folder.path().join("run"), &scene, 12).unwrap();
        assert_eq!(standing_steps(&folder.path().join("run/profile.csv")), None);
    }

    #[test]
    fn rows_have_the_headers_width_and_booked_terms_are_summed() {
        let folder = tempfile::tempdir().unwrap();
        let scene = catalog::builtin("liver").unwrap().into_scene().desc;
        let mut output = StepOutput { sim_time_s: 0.001, ..StepOutput::default() };
        output.tools.push(Default::default());
        output.tracked_displacement_m = vec![Vec3::x(), Vec3::y()];
        output.energy.fracture_j = 0.25;
        output.energy.elastic_j = 3.0;
        (output.energy.tool_work_j, output.energy.residual_j) = (2.0, -0.5);
        let mut tables = Tables::create(folder.path(), &scene, 2).unwrap();
        tables.push(&output).unwrap();
        tables.push(&output).unwrap();
        tables.finish().unwrap();
        for name in ["tool", "energy", "tracked_points", "profile"] {
            let mut reader = csv::Reader::from_path(folder.path().join(format!("{name}.csv"))).unwrap();
            let header = reader.headers().unwrap().clone();
            // The reader refuses rows of another width.
            let rows: Vec<_> = reader.records().collect::<Result<_, _>>().unwrap();
            assert_eq!(rows.len(), 2, "{name}");
            if name == "energy" {
                let column = |name: &str| header.iter().position(|h| h == name).unwrap();
                assert_eq!(&rows[1][column("total_fracture_j")], "0.5");
                assert_eq!(&rows[1][column("elastic_j")], "3");
                assert_eq!(&rows[1][column("total_residual_j")], "-1");
                assert_eq!(&rows[1][column("residual_over_tool_work")], "-0.25");
            }
        }
    }
}
