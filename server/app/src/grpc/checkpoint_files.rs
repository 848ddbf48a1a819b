//! Checkpoints as files: out in parts, and in. Files are made and read on threads below those that step; a session's own
//! thread hands its state out and takes one in.

use std::net::SocketAddr;
use std::sync::Arc;

use futures_util::StreamExt;
use futures_util::stream::unfold;
use kerf_proto::v1;
use kerf_session::priority::stand_back;
use kerf_session::{FileError, Session, SessionError};
use tokio::sync::{mpsc, oneshot};
use tonic::{Status, Streaming};

use super::in_parts::{InParts, PART_BYTES, next_of};
use super::{Outgoing, in_time};
use crate::places::Place;
use crate::status::RequestError;

/// Parts that wait for the transport: one to be sent, and the next.
const PARTS_AHEAD: usize = 2;

/// Makes files and reads them.
#[derive(Clone)]
pub struct CheckpointFiles {
    in_parts: Arc<InParts>,
}

impl CheckpointFiles {
    pub fn new(in_parts: Arc<InParts>) -> Self {
        Self { in_parts }
    }

    /// The file of a checkpoint, or of the state as it is where the name is empty.
    pub async fn download(
        &self,
        connection: Option<SocketAddr>,
        session: &Session,
        name: &str,
    ) -> Result<Outgoing<v1::DownloadCheckpointResponse>, RequestError> {
        let place = self.in_parts.take(connection)?;
        let checkpoint = match name {
            "" => in_time(self.in_parts.limit_s, session.copy()).await,
            name => in_time(self.in_parts.limit_s, session.checkpoint(name)).await,
        }?;
        let (file, place) = in_time(self.in_parts.limit_s, aside(move || (checkpoint.save(), place))).await?;
        self.in_parts.check_size(file.len())?;
        let (parts, sent) = mpsc::channel(PARTS_AHEAD);
        tokio::spawn(send(file, place, parts, self.in_parts.too_many()));
        let next = async |mut sent: mpsc::Receiver<_>| sent.recv().await.map(|part| (part, sent));
        Ok(unfold(sent, next).boxed())
    }

    /// Reads a file to its end and keeps what is in it as a checkpoint; answers with its step. `find` finds a session.
    pub async fn upload(
        &self,
        connection: Option<SocketAddr>,
        parts: Streaming<v1::UploadCheckpointRequest>,
        find: impl Fn(&str) -> Result<Arc<Session>, RequestError>,
    ) -> Result<u64, RequestError> {
        let limit_s = self.in_parts.limit_s;
        let (Upload { session, name, file }, place) = self.in_parts.receive(connection, self.read(parts, find)).await?;
        let own = in_time(limit_s, session.copy()).await?;
        let read = move || {
            // Held to the end of the work, also where the client has gone away.
            let _place = place;
            own.load(&file)
        };
        let checkpoint = in_time(limit_s, aside(read)).await?.map_err(|error| match error {
            FileError::File(error) => RequestError::CheckpointFile { error },
            FileError::Session(error) => RequestError::Session(error),
        })?;
        in_time(limit_s, session.keep_checkpoint(&name, checkpoint)).await
    }

    async fn read(
        &self,
        mut parts: Streaming<v1::UploadCheckpointRequest>,
        find: impl Fn(&str) -> Result<Arc<Session>, RequestError>,
    ) -> Result<Upload, RequestError> {
        let first = next_of(&mut parts).await?.ok_or(RequestError::Missing { field: "session_id" })?;
        let session = find(&first.session_id)?;
        // What would be refused in the end is refused before it is read.
        session.check_checkpoint(&first.name).await?;
        let file = self.in_parts.file(first.data, parts, |part| part.data).await?;
        Ok(Upload { session, name: first.name, file })
    }
}

/// A file that has come whole.
struct Upload {
    session: Arc<Session>,
    name: String,
    file: Vec<u8>,
}

/// Sends a file as its reader takes it. A reader that is slow keeps the place until another needs it.
async fn send(
    file: Vec<u8>,
    mut place: Place,
    parts: mpsc::Sender<Result<v1::DownloadCheckpointResponse, Status>>,
    too_many: RequestError,
) {
    for data in file.chunks(PART_BYTES) {
        let part = v1::DownloadCheckpointResponse { data: data.to_vec() };
        tokio::select! {
            sent = parts.send(Ok(part)) => if sent.is_err() { return },
            () = place.given_up() => {
                drop(file);
                // A reader that has gone away needs no reason.
                let _ = parts.send(Err(too_many.into())).await;
                return;
            }
        }
    }
}

/// Does work on a thread of its own, below those that step.
pub async fn aside<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T, RequestError> {
    let (answer, answered) = oneshot::channel();
    let thread = std::thread::Builder::new().name("kerf-checkpoint".into()).spawn(move || {
        stand_back();
        // Who asked may have gone away.
        let _ = answer.send(work());
    });
    thread.map_err(|error| SessionError::NoThread { message: error.to_string() })?;
    // A file whose checksum is right and whose content makes no sense may end the work in a panic, which is logged.
    answered.await.map_err(|_| RequestError::CheckpointWork)
}
