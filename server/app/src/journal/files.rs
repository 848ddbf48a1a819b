//! The files of a session's journal: `<session>.<number>.mcap`, the newest with the highest number.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use kerf_session::SessionId;

use crate::storage::PART;

const EXTENSION: &str = "mcap";
/// The folder of those that bring no session back.
const REFUSED: &str = "refused";

/// The files of a session's journal.
pub struct Files {
    pub folder: PathBuf,
    pub session: SessionId,
    /// Those there are, the newest last.
    pub before: Vec<PathBuf>,
}

impl Files {
    /// Those of all sessions in a folder.
    pub fn in_folder(folder: &Path) -> io::Result<BTreeMap<SessionId, Vec<PathBuf>>> {
        let mut found = BTreeMap::<SessionId, Vec<PathBuf>>::new();
        for entry in std::fs::read_dir(folder)? {
            let path = entry?.path();
            if let Some((session, _)) = parse(&path) {
                found.entry(session).or_default().push(path);
            }
        }
        // Numbers have as many digits, so that names are in their order.
        found.values_mut().for_each(|files| files.sort());
        Ok(found)
    }

    /// Removes what a server that was killed had not begun to write yet: of sessions that nobody knows, or of files that
    /// older ones stand in for.
    pub fn remove_parts(folder: &Path) -> io::Result<()> {
        for entry in std::fs::read_dir(folder)? {
            let path = entry?.path();
            if path.extension().is_some_and(|extension| extension == PART)
                && parse(&path.with_extension(EXTENSION)).is_some()
            {
                std::fs::remove_file(path)?;
            }
        }
        Ok(())
    }

    /// Moves files that bring no session back into a folder of their own, which may hold so much: of more the oldest are
    /// removed.
    pub fn set_aside(folder: &Path, files: &[PathBuf], max_bytes: u64) -> io::Result<()> {
        let aside = folder.join(REFUSED);
        std::fs::create_dir_all(&aside)?;
        for path in files {
            let to = aside.join(path.file_name().unwrap_or_default());
            std::fs::rename(path, &to)?;
            tracing::warn!(path = %to.display(), "the file of the journal is here now; moved back, the next server tries it again");
        }
        let mut kept = Vec::new();
        for entry in std::fs::read_dir(&aside)? {
            let entry = entry?;
            let metadata = entry.metadata()?;
            kept.push((metadata.modified()?, metadata.len(), entry.path()));
        }
        kept.sort();
        let mut bytes: u64 = kept.iter().map(|(_, bytes, _)| bytes).sum();
        for (_, freed, path) in kept {
            if bytes <= max_bytes {
                break;
            }
            std::fs::remove_file(&path)?;
            bytes -= freed;
            tracing::warn!(path = %path.display(), "removed: journals that bring no session back take more than max_journal_mib");
        }
        Ok(())
    }

    /// A name for the next one.
    pub fn next(&self) -> PathBuf {
        let next = self.before.last().and_then(|path| parse(path)).map_or(1, |(_, number)| number + 1);
        self.folder.join(format!("{}.{next:012}.{EXTENSION}", self.session))
    }
}

/// The session and the number of a file, if it is one of a journal.
fn parse(path: &Path) -> Option<(SessionId, u64)> {
    let name = path.file_name()?.to_str()?.strip_suffix(EXTENSION)?.strip_suffix('.')?;
    let (session, number) = name.rsplit_once('.')?;
    Some((session.parse().ok()?, number.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refused_files_go_to_a_folder_of_their_own_where_the_oldest_make_room() {
        let folder = tempfile::tempdir().unwrap();
        let file = |number: u64| folder.path().join(format!("session-0000002a-7.{number:012}.mcap"));
        for number in 1..=4 {
            std::fs::write(file(number), [0; 400]).unwrap();
            Files::set_aside(folder.path(), &[file(number)], 1000).unwrap();
            assert!(!file(number).exists());
            // Names do not tell how old a file is: two may be written within a tick of the file system's clock.
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        let kept = std::fs::read_dir(folder.path().join(REFUSED)).unwrap().map(|entry| entry.unwrap().file_name());
        let mut kept: Vec<_> = kept.map(|name| name.into_string().unwrap()).collect();
        kept.sort();
        assert_eq!(kept, ["session-0000002a-7.000000000003.mcap", "session-0000002a-7.000000000004.mcap"]);
        assert!(Files::in_folder(folder.path()).unwrap().is_empty());
    }

    #[test]
    fn files_are_found_by_session_in_the_order_of_their_numbers_and_the_next_follows() {
        let folder = tempfile::tempdir().unwrap();
        let session: SessionId = "session-0000002a-7".parse().unwrap();
        let mut files = Files { folder: folder.path().into(), session, before: Vec::new() };
        for _ in 0..11 {
            let next = files.next();
            std::fs::write(&next, "").unwrap();
            files.before.push(next);
        }
        for other in ["lock", "notes.mcap", "session-0000002a-7.mcap", "session-0000002a-8.000000000001.part"] {
            std::fs::write(folder.path().join(other), "").unwrap();
        }
        Files::remove_parts(folder.path()).unwrap();
        assert_eq!(Files::in_folder(folder.path()).unwrap(), BTreeMap::from([(session, files.before)]));
        let left = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path());
        assert!(left.into_iter().all(|path| path.extension().is_none_or(|extension| extension != PART)));
    }
}
