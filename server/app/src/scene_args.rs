//! What `check`, `simulate` and `tradeoff` are given of a scene, and what is said of it before it runs.

use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Args;
use kerf_physics::scene::DialDesc;
use kerf_physics::{Scene, SceneError, SoundScene, World};
use kerf_scenes::catalog;
use kerf_scenes::dial::ParetoFronts;
use kerf_scenes::examine::{self, examine};

use crate::progress::{MakingBar, say};
use crate::script::Script;
use crate::script::stroke::default_stroke_in;
use crate::script::warnings;

/// A scene and what is changed in it.
#[derive(Args, Clone, Debug, Default)]
pub struct SceneArgs {
    /// Name of a built-in scene, or path of a scene's TOML file.
    pub scene: String,
    /// Poses over time, header `time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw`; `lift` for x_m lifts the tool. With
    /// `,opening` for tools with jaws, 0 (closed) to 1.
    /// Default: one stroke straight down through the middle of the first object that can be cut.
    #[arg(long, value_name = "FILE.csv")]
    pub script: Option<PathBuf>,
    /// What the dial is set to, instead of what the scene asks.
    #[command(flatten)]
    pub dial: DialOptions,
    /// Folder of measured Pareto fronts that go before those that come with the program.
    #[arg(long, value_name = "DIR")]
    pub pareto_fronts: Option<PathBuf>,
    /// Steps per simulated second instead of the scene's.
    #[arg(long, value_name = "HZ")]
    pub rate: Option<f64>,
    /// What warnings do.
    #[command(flatten)]
    pub warnings: WarningArgs,
}

/// What is asked of the dial from fast to exact.
#[derive(Args, Clone, Debug, Default)]
#[group(multiple = false)]
pub struct DialOptions {
    /// Level of every object instead of the scene's: elements of 2^LEVEL voxels a side.
    #[arg(long)]
    pub level: Option<u8>,
    /// The most exact measured setting whose steps take at most this long in the median, ms.
    #[arg(long, value_name = "MS")]
    pub budget_ms: Option<f64>,
    /// The cheapest measured setting that errs by at most this, relative to the reference solution.
    #[arg(long, value_name = "ERROR")]
    pub max_error: Option<f64>,
}

impl DialOptions {
    fn asked(&self) -> Option<DialDesc> {
        let level = self.level.map(DialDesc::Level);
        level.or(self.budget_ms.map(DialDesc::BudgetMs)).or(self.max_error.map(DialDesc::MaxError))
    }
}

/// What warnings do.
#[derive(Args, Clone, Copy, Debug, Default)]
pub struct WarningArgs {
    /// Ends with exit status 1 where there is a warning, too.
    #[arg(long)]
    pub deny_warnings: bool,
}

impl WarningArgs {
    /// Says the warnings on standard error.
    pub fn say(warnings: &[SceneError]) {
        warnings.iter().for_each(|warning| say(&format!("warning: {warning}")));
    }

    /// Whether the program may end well with so many warnings.
    ///
    /// # Errors
    /// There are warnings, and they are denied.
    pub fn judge(self, count: usize) -> Result<()> {
        match count {
            1.. if self.deny_warnings => bail!("{}, denied by --deny-warnings", counted(count, "warning")),
            _ => Ok(()),
        }
    }
}

/// A scene that can run as it was asked for.
pub struct Run {
    /// With the options applied.
    pub scene: SoundScene,
    /// What its tools do.
    pub script: Script,
    /// The scene at rest.
    pub world: World,
    /// What is hardly meant, each with its place in the scene's file.
    pub warnings: Vec<SceneError>,
}

impl SceneArgs {
    /// Reads, changes and builds the scene.
    ///
    /// # Errors
    /// The scene or the script cannot be read, or everything that it cannot run with.
    pub fn examine(&self) -> Result<Run> {
        let (scene, text) = catalog::open(&self.scene)?.judge()?;
        let scene = self.applied_to(scene)?;
        let bar = MakingBar::new();
        let examined = examine(&scene, &mut |making| bar.tell(making));
        bar.finish();
        let examine::Examined { world, mut warnings } = examined.map_err(|problems| text.refused(problems))?;
        let script = match &self.script {
            Some(path) => read_script(path, &scene)?,
            None => default_stroke_in(&world, &scene.desc),
        };
        warnings = warnings.into_iter().map(|warning| text.placed(warning)).collect();
        if let Some(path) = &self.script {
            warnings.extend(warnings::of(&path.display().to_string(), &script, &scene, &world));
        }
        Ok(Run { scene, script, world, warnings })
    }

    fn applied_to(&self, mut scene: SoundScene) -> Result<SoundScene> {
        if let Some(rate_hz) = self.rate {
            scene = scene.with(|desc| desc.rate_hz = rate_hz).context("with --rate applied")?;
        }
        let pareto_fronts = match &self.pareto_fronts {
            Some(folder) => ParetoFronts::builtin().with_folder(folder).context("--pareto-fronts")?,
            None => ParetoFronts::builtin(),
        };
        let (scene, choice) = pareto_fronts.settle(scene, self.dial.asked())?;
        if let Some(choice) = choice {
            say(&choice.to_string());
        }
        Ok(scene)
    }
}

/// The script in a file.
///
/// # Errors
/// The file cannot be read or is not a script for the scene's tools.
pub fn read_script(path: &Path, scene: &Scene) -> Result<Script> {
    let file = File::open(path).with_context(|| path.display().to_string())?;
    let tools: Vec<_> = scene.desc.tools.iter().map(|tool| tool.name.clone()).collect();
    Ok(kerf_script::read(file, &tools).with_context(|| path.display().to_string())?.into())
}

/// A number of things: `1 problem`, `2 problems`.
#[must_use]
pub fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}
