//! A snapshot as a file, to be kept, sent, and gone back to by another program that runs the same scene.
//!
//! [`MAGIC`], [`FORMAT`], a checksum of all that follows, a header, the state and what the last step reported. What
//! follows from the state is left out and made anew as the file is read. Whoever wrote the file could also have driven
//! the tools: that it has not come to harm and fits the scene is checked, that somebody has simulated it is not.

use super::World;
use super::description::SceneIdentity;
use super::snapshot::Snapshot;
use super::state::State;
use crate::step_io::StepOutput;
use crate::walk::{self, WalkError};
use crate::workers::Workers;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// What a file of a snapshot begins with.
pub const MAGIC: [u8; 8] = *b"KERFSNAP";
/// Goes up whenever what is walked changes: a file of another format is refused.
pub const FORMAT: u32 = 10;
/// Characters of a name from a file that an error repeats: names of scenes are shorter.
const MOST_TOLD: usize = 64;
/// Bytes before what the checksum is of.
const HEAD: usize = MAGIC.len() + size_of::<u32>() + size_of::<u64>();

/// Why a file of a snapshot is not taken.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LoadError {
    /// It is something else, or less than a head.
    #[error("it is no snapshot of a world: it does not begin with \"KERFSNAP\"")]
    NoSnapshot,
    /// It was written by a program of another format.
    #[error("format: it is {found}, and this program reads {FORMAT}")]
    Format {
        /// That of the file.
        found: u32,
    },
    /// It has come to harm.
    #[error("checksum: the file says {told:016x}, and its bytes give {found:016x}: it is cut off or changed")]
    Checksum {
        /// What the file says.
        told: u64,
        /// What its bytes give.
        found: u64,
    },
    /// The program that wrote it or the scene it is of is another one.
    #[error("{field}: the file is of {found}, and this is {wanted}")]
    Other {
        /// What differs.
        field: &'static str,
        /// That of the file.
        found: String,
        /// That of here.
        wanted: String,
    },
    /// The scene it is of states something else there.
    #[error("{field}: the scene that the file is of states it otherwise")]
    OtherScene {
        /// Path of the first field that differs.
        field: String,
    },
    /// It does not fit together.
    #[error("it does not fit together: {0}")]
    Broken(String),
}

impl From<WalkError> for LoadError {
    fn from(error: WalkError) -> Self {
        Self::Broken(error.to_string())
    }
}

/// What a file is of, and what the state in it hashes to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Header {
    program: String,
    target: String,
    scene: SceneIdentity,
    step: u64,
    state_hash: u64,
}

impl Header {
    fn of(snapshot: &Snapshot) -> Self {
        Self {
            program: env!("CARGO_PKG_VERSION").into(),
            target: std::env::consts::ARCH.into(),
            scene: (*snapshot.scene).clone(),
            step: snapshot.step(),
            state_hash: snapshot.state_hash(),
        }
    }

    /// Refuses what was written for anything else than `own` is of.
    fn check(&self, own: &Self) -> Result<(), LoadError> {
        let pairs = [
            ("program", told(&self.program), own.program.clone()),
            ("target", told(&self.target), own.target.clone()),
            ("scene.name", format!("`{}`", told(&self.scene.name)), format!("`{}`", own.scene.name)),
            ("scene.rate_hz", format!("{} Hz", self.scene.rate_hz), format!("{} Hz", own.scene.rate_hz)),
        ];
        if let Some((field, found, wanted)) = pairs.into_iter().find(|(_, found, wanted)| found != wanted) {
            return Err(LoadError::Other { field, found, wanted });
        }
        match self.scene.difference(&own.scene) {
            Some(path) => Err(LoadError::OtherScene { field: format!("scene.{}", told(path)) }),
            None => Ok(()),
        }
    }
}

impl Snapshot {
    /// The snapshot as a file.
    #[must_use]
    pub fn save(&self) -> Vec<u8> {
        self.save_with(&())
    }

    /// The snapshot as a file, with what its owner knows besides.
    #[must_use]
    pub fn save_with(&self, besides: &impl Serialize) -> Vec<u8> {
        let mut file = Vec::new();
        file.extend(MAGIC);
        file.extend(FORMAT.to_le_bytes());
        file.extend([0; size_of::<u64>()]);
        walk::encode(&Header::of(self), &mut file);
        walk::encode(&self.state, &mut file);
        walk::encode(&self.output, &mut file);
        walk::encode(besides, &mut file);
        let checksum = walk::checksum(&file[HEAD..]);
        file[HEAD - size_of::<u64>()..HEAD].copy_from_slice(&checksum.to_le_bytes());
        file
    }

    /// The snapshot in a file, of the scene of this one. It costs about what making the scene does.
    ///
    /// # Errors
    /// The file is of another format, program, target or scene, has come to harm, or does not fit together.
    pub fn load(&self, file: &[u8]) -> Result<Self, LoadError> {
        self.load_with::<()>(file).map(|(snapshot, ())| snapshot)
    }

    /// The same, with what [`Self::save_with`] was given besides.
    ///
    /// # Errors
    /// As of [`Self::load`].
    pub fn load_with<T: DeserializeOwned>(&self, file: &[u8]) -> Result<(Self, T), LoadError> {
        let mut rest = body(file)?;
        let header: Header = walk::decode(&mut rest)?;
        header.check(&Header::of(self))?;
        let mut state: State = walk::decode(&mut rest)?;
        let output: StepOutput = walk::decode(&mut rest)?;
        let besides: T = walk::decode(&mut rest)?;
        if !rest.is_empty() {
            return Err(LoadError::Broken(format!("{} bytes are left over", rest.len())));
        }
        state.complete(&self.state, &Workers::serial())?;
        let loaded = Self { scene: self.scene.clone(), state, output };
        if loaded.state_hash() != header.state_hash || loaded.step() != header.step {
            return Err(LoadError::Broken("its state is not the one that the header tells of".into()));
        }
        Ok((loaded, besides))
    }
}

impl World {
    /// The state as a file: [`Snapshot::save`] of a snapshot of now.
    #[must_use]
    pub fn save(&self) -> Vec<u8> {
        self.snapshot().save()
    }

    /// Goes on from the state in a file that [`World::save`] made of this scene, in this or another process.
    ///
    /// # Errors
    /// As [`Snapshot::load`] says; the world is then as it was.
    pub fn load(&mut self, file: &[u8]) -> Result<(), LoadError> {
        let snapshot = self.snapshot().load(file)?;
        self.restore(&snapshot);
        Ok(())
    }
}

/// As much of a name from a file as an error repeats, on one line.
fn told(name: &str) -> String {
    name.chars().take(MOST_TOLD).flat_map(char::escape_debug).collect()
}

/// What follows the checksum, which is right.
fn body(file: &[u8]) -> Result<&[u8], LoadError> {
    let head = file.strip_prefix(&MAGIC).ok_or(LoadError::NoSnapshot)?;
    let (format, head) = head.split_first_chunk().ok_or(LoadError::NoSnapshot)?;
    let found = u32::from_le_bytes(*format);
    if found != FORMAT {
        return Err(LoadError::Format { found });
    }
    let (checksum, body) = head.split_first_chunk().ok_or(LoadError::NoSnapshot)?;
    let (told, found) = (u64::from_le_bytes(*checksum), walk::checksum(body));
    if told != found {
        return Err(LoadError::Checksum { told, found });
    }
    Ok(body)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::support::busy::Busy;
    use crate::walk::places::places;
    use std::collections::BTreeMap;
    use std::ops::Range;
    use std::panic::catch_unwind;

    /// A world in which all is in play, and the bytes of its state.
    fn busy_state() -> (Snapshot, Vec<u8>) {
        let mut busy = Busy::new(0);
        busy.run(140);
        let own = busy.world.snapshot();
        let mut bytes = Vec::new();
        walk::encode(&own.state, &mut bytes);
        (own, bytes)
    }

    /// As of a file that somebody has changed on purpose: without the checksum the hash of the state stands in the way.
    #[test]
    fn a_changed_byte_with_a_checksum_that_is_right_leads_to_no_other_state() {
        let mut busy = Busy::new(0);
        busy.run(60);
        let (own, file) = (busy.world.snapshot(), busy.world.save());
        let mut refused = 0;
        for at in (HEAD..file.len()).step_by(file.len() / 199) {
            let mut changed = file.clone();
            changed[at] ^= 1 << (at % 8);
            let checksum = walk::checksum(&changed[HEAD..]);
            changed[HEAD - size_of::<u64>()..HEAD].copy_from_slice(&checksum.to_le_bytes());
            match own.load(&changed) {
                Ok(loaded) => assert_eq!(own.difference(&loaded), None, "byte {at}"),
                Err(_) => refused += 1,
            }
        }
        assert!(refused > 150, "{refused} are refused");
    }

    #[test]
    fn a_spring_of_tissue_without_nodes_or_at_a_body_that_is_not_there_is_refused() {
        let (own, bytes) = busy_state();
        let of_springs = |what: &str| -> Vec<_> {
            let is_of =
                |field: &String| field.starts_with("tissue") && field.contains("springs.[]") && field.ends_with(what);
            places(&own.state).into_iter().filter(|(field, _)| is_of(field)).map(|(_, at)| at).collect()
        };
        let (bodies, counts) = (of_springs(".body"), of_springs(".count"));
        assert!(!bodies.is_empty() && bodies.len() == counts.len(), "{} bodies, {} counts", bodies.len(), counts.len());
        for (emptied, misplaced) in [(true, false), (false, true), (true, true)] {
            let mut changed = bytes.clone();
            counts.iter().filter(|_| emptied).for_each(|at| changed[at.clone()].fill(0));
            bodies.iter().filter(|_| misplaced).for_each(|at| changed[at.clone()].fill(0x3f));
            let mut state: State = walk::decode(&mut &changed[..]).expect("numbers in the place of numbers");
            let refused = state.complete(&own.state, &Workers::serial());
            assert!(refused.is_err(), "without nodes: {emptied}, at another body: {misplaced}");
        }
    }

    /// Also where the checksum and the hash are made to fit.
    #[test]
    #[ignore = "slow: thousands of states, a minute"]
    fn a_state_is_completed_or_refused_whatever_stands_in_a_field() {
        let (own, bytes) = busy_state();
        let mut by_field: BTreeMap<String, Vec<Range<usize>>> = BTreeMap::new();
        for (field, at) in places(&own.state) {
            by_field.entry(field).or_default().push(at);
        }
        let mut refused = 0;
        for (field, at) in &by_field {
            let [first, last] = [&at[..1], &at[at.len() - 1..]];
            for (places, value) in
                [first, last, at].into_iter().flat_map(|places| [0, 1, 0x3f, 0xff].map(|v| (places, v)))
            {
                let mut changed = bytes.clone();
                places.iter().for_each(|at| changed[at.clone()].fill(value));
                let complete = || {
                    let mut state = walk::decode::<State>(&mut &changed[..])?;
                    state.complete(&own.state, &Workers::serial())?;
                    Ok::<_, LoadError>(walk::hash(&state))
                };
                match catch_unwind(complete) {
                    Ok(completed) => refused += u32::from(completed.is_err()),
                    Err(_) => panic!("{value:#x} in {} of `{field}`", places.len()),
                }
            }
        }
        assert!(refused > 1500, "{refused} are refused");
    }

    #[test]
    fn every_number_of_the_state_that_is_another_makes_another_hash() {
        let (Snapshot { state, .. }, mut bytes) = busy_state();
        let hash = walk::hash(&state);
        let mut by_field: BTreeMap<String, (u32, u32)> = BTreeMap::new();
        for (field, at) in places(&state) {
            let (tried, moved) = by_field.entry(field).or_default();
            if *moved == 3 || *tried == 100 {
                continue;
            }
            *tried += 1;
            bytes[at.start] ^= 1;
            // Lengths, and what says which of several it is, may leave nothing that can be read.
            if let Ok(changed) = walk::decode::<State>(&mut &bytes[..]) {
                assert_ne!(walk::hash(&changed), hash, "byte {} says nothing", at.start);
                *moved += 1;
            }
            bytes[at.start] ^= 1;
        }
        let moved = by_field.values().filter(|(_, moved)| *moved > 0).count();
        println!("{moved} of {} fields", by_field.len());
        for field in [
            "tools.[].pose",
            "slots.[].contacts",
            "tissue",
            "slots.[].tension",
            "slots.[].body.state.elements.[].branch",
        ] {
            let of_field = by_field.iter().filter(|(path, (_, moved))| path.starts_with(field) && *moved > 0);
            assert!(of_field.count() > 0, "`{field}` is not in play");
        }
        assert!(moved > 150, "{moved} of {} fields: {by_field:?}", by_field.len());
    }
}
