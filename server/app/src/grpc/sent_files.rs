//! Files of scenes that come in a call a part, from clients that cannot stream up: kept until the call that names them.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use kerf_proto::v1;
use tokio::sync::{Notify, oneshot};

use super::in_parts::{InParts, SceneFiles};
use super::token;
use crate::places::Place;
use crate::security::caller::Caller;
use crate::status::RequestError;

/// The uploads that are not used yet.
#[derive(Clone)]
pub struct SentFiles {
    in_parts: Arc<InParts>,
    uploads: Arc<Uploads>,
}

type Uploads = Mutex<BTreeMap<String, Upload>>;

struct Upload {
    /// The token of who sends it, if there is one.
    sender: Option<String>,
    files: SceneFiles,
    /// Told of each part, and of the upload's end.
    heard: Arc<Notify>,
    /// Its place, once the upload is not among the others any more.
    place: oneshot::Receiver<Place>,
}

fn lock(uploads: &Uploads) -> MutexGuard<'_, BTreeMap<String, Upload>> {
    uploads.lock().unwrap_or_else(PoisonError::into_inner)
}

impl SentFiles {
    /// None yet.
    pub fn new(in_parts: Arc<InParts>) -> Self {
        Self { in_parts, uploads: Arc::default() }
    }

    /// Keeps a part. One that cannot be kept ends its upload.
    pub fn push(
        &self,
        connection: Option<SocketAddr>,
        caller: &Caller,
        part: v1::SendSceneFileRequest,
    ) -> Result<v1::SendSceneFileResponse, RequestError> {
        let v1::SendSceneFileRequest { mut upload_id, file_name, data } = part;
        if upload_id.is_empty() {
            upload_id = self.begin(connection, caller)?;
        }
        let mut uploads = lock(&self.uploads);
        let upload = uploads.get_mut(&upload_id).filter(|upload| upload.sender.as_deref() == caller.name());
        let upload = upload.ok_or_else(|| self.none())?;
        upload.heard.notify_one();
        let pushed = upload.files.push(&self.in_parts, file_name, &data);
        let received_bytes = upload.files.files.iter().map(|file| file.data.len() as u64).sum();
        if let Err(error) = pushed {
            uploads.remove(&upload_id);
            return Err(error);
        }
        Ok(v1::SendSceneFileResponse { upload_id, received_bytes })
    }

    /// The files of an upload, which is over then, and the place that they hold.
    pub async fn take(&self, caller: &Caller, upload_id: &str) -> Result<(Vec<v1::SceneFile>, Place), RequestError> {
        let upload = {
            let mut uploads = lock(&self.uploads);
            let is_own = uploads.get(upload_id).is_some_and(|upload| upload.sender.as_deref() == caller.name());
            is_own.then(|| uploads.remove(upload_id)).flatten()
        };
        let upload = upload.ok_or_else(|| self.none())?;
        upload.heard.notify_one();
        // Another may have got it in this moment.
        let place = upload.place.await.map_err(|_| self.none())?;
        place.keep();
        Ok((upload.files.files, place))
    }

    fn begin(&self, connection: Option<SocketAddr>, caller: &Caller) -> Result<String, RequestError> {
        let place = self.in_parts.take(connection)?;
        let (id, heard, (back, place_back)) = (token(), Arc::new(Notify::new()), oneshot::channel());
        let upload = Upload {
            sender: caller.name().map(str::to_owned),
            files: SceneFiles::default(),
            heard: Arc::clone(&heard),
            place: place_back,
        };
        lock(&self.uploads).insert(id.clone(), upload);
        let patience = Duration::from_secs_f64(self.in_parts.limit_s);
        tokio::spawn(watch(id.clone(), Arc::clone(&self.uploads), (place, back), heard, patience));
        Ok(id)
    }

    fn none(&self) -> RequestError {
        RequestError::NoUpload { limit_s: self.in_parts.limit_s }
    }
}

/// Forgets an upload that nothing is heard of, or whose place another gets.
async fn watch(
    id: String,
    uploads: Arc<Uploads>,
    (mut place, back): (Place, oneshot::Sender<Place>),
    heard: Arc<Notify>,
    patience: Duration,
) {
    while lock(&uploads).contains_key(&id) {
        let goes_on = tokio::select! {
            () = place.given_up() => false,
            heard = tokio::time::timeout(patience, heard.notified()) => heard.is_ok(),
        };
        if !goes_on {
            lock(&uploads).remove(&id);
            return;
        }
    }
    // Whoever took the files may have gone away.
    let _ = back.send(place);
}
