//! What clients send in parts: so much of it, so many at a time, whatever it is. What is not whole gives way to what comes
//! later, so that it holds nothing that others need.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use kerf_proto::v1;
use prost::Message;
use tonic::Streaming;

use crate::config::TransportLimits;
use crate::places::{Place, Places};
use crate::status::RequestError;

/// Bytes of a part: well below what clients of gRPC take unasked (4 MiB), and so many that a part costs little beside its
/// bytes.
pub const PART_BYTES: usize = 256 << 10;
/// Most files of a scene: some dozen times what a scene with a mesh for each region has. Empty ones cost memory too.
const MAX_SCENE_FILES: usize = 1000;

/// What is on its way, in either direction.
pub struct InParts {
    places: Arc<Places>,
    max_uploads: usize,
    max_bytes: usize,
    /// What a call may take.
    pub limit_s: f64,
}

impl InParts {
    /// Nothing yet.
    pub fn new(limits: &TransportLimits) -> Self {
        Self {
            places: Places::new(limits.max_uploads),
            max_uploads: limits.max_uploads,
            max_bytes: limits.max_upload_bytes,
            limit_s: limits.request_timeout_s,
        }
    }

    /// Reads something to its end, unless it gives way to another or takes too long. Nothing takes its place away then.
    pub async fn receive<T>(
        &self,
        connection: Option<SocketAddr>,
        read: impl Future<Output = Result<T, RequestError>>,
    ) -> Result<(T, Place), RequestError> {
        let mut place = self.take(connection)?;
        let limit_s = self.limit_s;
        let whole = tokio::select! {
            read = tokio::time::timeout(Duration::from_secs_f64(limit_s), read) => {
                read.map_err(|_| RequestError::UnreadInTime { limit_s })??
            }
            () = place.given_up() => return Err(self.too_many()),
        };
        place.keep();
        Ok((whole, place))
    }

    /// A place for what is handed out.
    pub fn take(&self, connection: Option<SocketAddr>) -> Result<Place, RequestError> {
        self.places.take(connection).ok_or_else(|| self.too_many())
    }

    pub fn too_many(&self) -> RequestError {
        RequestError::TooManyUploads { limit: self.max_uploads }
    }

    /// Whether so many bytes are not too many.
    pub fn check_size(&self, bytes: usize) -> Result<(), RequestError> {
        if bytes > self.max_bytes { Err(RequestError::UploadSize { limit: self.max_bytes }) } else { Ok(()) }
    }

    /// Reads a file to its end, whose first bytes have come; `data` takes them out of a part.
    pub async fn file<T>(
        &self,
        begun: Vec<u8>,
        mut parts: Streaming<T>,
        data: impl Fn(T) -> Vec<u8>,
    ) -> Result<Vec<u8>, RequestError> {
        let (mut file, mut next) = (Vec::new(), begun);
        loop {
            self.check_size(file.len() + next.len())?;
            file.extend_from_slice(&next);
            match next_of(&mut parts).await? {
                Some(part) => next = data(part),
                None => return Ok(file),
            }
        }
    }

    /// Reads a request for a session, and the files that follow it.
    pub async fn scene(
        &self,
        mut parts: Streaming<v1::UploadSceneRequest>,
    ) -> Result<v1::CreateSessionRequest, RequestError> {
        let missing = RequestError::Missing { field: "request" };
        let Some(mut next) = next_of(&mut parts).await? else { return Err(missing) };
        let Some(mut request) = next.request.take() else { return Err(missing) };
        let mut files = SceneFiles { bytes: request.encoded_len(), files: std::mem::take(&mut request.files) };
        loop {
            files.push(self, next.file_name, &next.data)?;
            match next_of(&mut parts).await? {
                Some(part) => next = part,
                None => return Ok(v1::CreateSessionRequest { files: files.files, ..request }),
            }
        }
    }
}

/// Files of a scene as they come.
#[derive(Default)]
pub struct SceneFiles {
    pub files: Vec<v1::SceneFile>,
    /// Of all that has come.
    pub bytes: usize,
}

impl SceneFiles {
    /// Takes a part of the last file, or of a new one where it has a name.
    pub fn push(&mut self, in_parts: &InParts, file_name: String, data: &[u8]) -> Result<(), RequestError> {
        self.bytes += file_name.len() + data.len();
        in_parts.check_size(self.bytes)?;
        if !file_name.is_empty() {
            self.files.push(v1::SceneFile { name: file_name, data: Vec::new() });
        }
        if self.files.len() > MAX_SCENE_FILES {
            let message = format!("file_name: a scene has at most {MAX_SCENE_FILES} files");
            return Err(RequestError::SceneText { message });
        }
        match self.files.last_mut() {
            Some(file) => file.data.extend_from_slice(data),
            None if data.is_empty() => {}
            None => return Err(RequestError::Missing { field: "file_name" }),
        }
        Ok(())
    }
}

/// The next part; `None` after the last.
pub async fn next_of<T>(parts: &mut Streaming<T>) -> Result<Option<T>, RequestError> {
    parts.message().await.map_err(|status| RequestError::Transport(Box::new(status)))
}
