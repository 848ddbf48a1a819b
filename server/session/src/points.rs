//! Named points that a session can go back to.

use kerf_physics::step_io::EnergyStep;
use kerf_physics::world::Snapshot;

use crate::error::SessionError;
use crate::governor::Governor;
use crate::recorder::InputLog;

/// Longest name of a point, bytes: a sentence. Names go into events, logs and lists.
pub const MAX_POINT_NAME_BYTES: usize = 64;

/// A point as its callers see it.
#[derive(Clone, Debug, PartialEq)]
pub struct PointInfo {
    /// Its name.
    pub name: String,
    /// Steps taken when it was saved.
    pub step: u64,
    /// Simulated time when it was saved, s.
    pub sim_time_s: f64,
}

/// What a session goes back to. Counts of what happened to the session (late steps, faults) are not in
/// it: they did happen.
pub(crate) struct Point {
    pub snapshot: Snapshot,
    pub sim_time_s: f64,
    pub energy: EnergyStep,
    pub relative_tolerance: f64,
    pub governor: Option<Governor>,
    pub next_tolerance: Option<f64>,
    /// The inputs that led here: a session that has gone back is recorded as if what came after had never
    /// been, also where it then goes on to a point of that other way.
    pub log: InputLog,
}

/// The points of a session, in the order of saving.
pub(crate) struct Points {
    points: Vec<(String, Point)>,
    max_points: usize,
}

impl Points {
    pub fn new(max_points: usize) -> Self {
        Self { points: Vec::new(), max_points }
    }

    /// Refuses a name that [`Self::save`] would not take.
    pub fn check(&self, name: &str) -> Result<(), SessionError> {
        if name.is_empty() || name.len() > MAX_POINT_NAME_BYTES {
            return Err(SessionError::PointName { bytes: name.len(), limit: MAX_POINT_NAME_BYTES });
        }
        let is_known = self.index(name).is_some();
        match self.points.len() < self.max_points || is_known {
            true => Ok(()),
            false => Err(SessionError::TooManyPoints { limit: self.max_points }),
        }
    }

    /// Keeps a point, in place of one of the same name.
    pub fn save(&mut self, name: String, point: Point) -> Result<(), SessionError> {
        self.check(&name)?;
        self.points.retain(|(known, _)| *known != name);
        self.points.push((name, point));
        Ok(())
    }

    pub fn get(&self, name: &str) -> Result<&Point, SessionError> {
        self.index(name).map(|index| &self.points[index].1).ok_or_else(|| Self::unknown(name))
    }

    pub fn delete(&mut self, name: &str) -> Result<(), SessionError> {
        let index = self.index(name).ok_or_else(|| Self::unknown(name))?;
        self.points.remove(index);
        Ok(())
    }

    pub fn list(&self) -> Vec<PointInfo> {
        let info = |(name, point): &(String, Point)| PointInfo {
            name: name.clone(),
            step: point.snapshot.step(),
            sim_time_s: point.sim_time_s,
        };
        self.points.iter().map(info).collect()
    }

    fn index(&self, name: &str) -> Option<usize> {
        self.points.iter().position(|(known, _)| known == name)
    }

    fn unknown(name: &str) -> SessionError {
        SessionError::NoPoint { name: name.chars().take(MAX_POINT_NAME_BYTES).collect() }
    }
}
