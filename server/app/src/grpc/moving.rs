//! Sessions that move between servers: what one puts down of a session the other goes on from, as from a journal.

use std::net::SocketAddr;
use std::sync::Arc;

use futures_util::stream;
use kerf_access::{Token, endpoint, root_cause};
use kerf_proto::v1;
use kerf_proto::v1::session_service_client::SessionServiceClient;
use kerf_session::{Registry, Session, SessionError, SessionId, SessionOptions};
use tonic::{Code, Status, Streaming};

use super::checkpoint_files::aside;
use super::in_parts::{InParts, PART_BYTES, next_of};
use super::in_time;
use crate::journal::{Journals, past, put_down};
use crate::recording::Recordings;
use crate::status::RequestError;

/// Moves sessions away and takes those that come.
#[derive(Clone)]
pub struct Moving {
    pub registry: Arc<Registry>,
    pub recordings: Arc<Recordings>,
    pub journals: Arc<Journals>,
    pub in_parts: Arc<InParts>,
}

impl Moving {
    /// Moves a session to another server; answers with the step that it goes on from there. One that is not taken goes on
    /// here. A caller that gives up changes nothing of that.
    pub async fn send(&self, session: Arc<Session>, to: v1::MoveSessionRequest) -> Result<u64, RequestError> {
        let this = self.clone();
        let sent = tokio::spawn(async move { this.send_now(&session, to).await });
        let panicked = |_| SessionError::Failed { message: "a panic while the session moved".into() };
        sent.await.map_err(panicked)?
    }

    async fn send_now(&self, session: &Arc<Session>, to: v1::MoveSessionRequest) -> Result<u64, RequestError> {
        let limit_s = self.in_parts.limit_s;
        let mut client = client(&to)?;
        let not_taken = |message| RequestError::NotTaken { to: to.to.clone(), message };
        let refused = |status: Status| {
            let cause = std::error::Error::source(&status).map(root_cause);
            not_taken(cause.unwrap_or_else(|| status.message().into()))
        };
        // Whether it answers, and is another one, is known before anything stands still.
        let asked = in_time(limit_s, async { client.list_sessions(v1::ListSessionsRequest {}).await.map_err(refused) });
        if asked.await?.into_inner().server_instance == self.registry.instance().to_string() {
            return Err(not_taken("it is this server".into()));
        }
        let left = in_time(limit_s, session.leave()).await;
        if matches!(left, Err(RequestError::Unresponsive { .. })) {
            // It may leave yet, and stays after that.
            let _ = in_time(limit_s, session.stay()).await;
        }
        let base = left?;
        let sent = async {
            let (moved, state) = (Arc::clone(session), Arc::clone(&base));
            let file = in_time(limit_s, aside(move || put_down(&moved, &state))).await?;
            let file = file.map_err(|error| not_taken(error.to_string()))?;
            self.in_parts.check_size(file.len())?;
            let first = v1::TakeSessionRequest { session_id: to.session_id.clone(), ..Default::default() };
            let part = |data: &[u8]| v1::TakeSessionRequest { data: data.to_vec(), ..Default::default() };
            let parts: Vec<_> = std::iter::once(first).chain(file.chunks(PART_BYTES).map(part)).collect();
            match client.take_session(stream::iter(parts)).await {
                Ok(taken) => Ok(taken.into_inner().step),
                Err(status) if !is_of_transport(&status) => Err(refused(status)),
                // The answer may be lost, and the session there all the same: in one place it goes on.
                Err(status) => {
                    let request = v1::DescribeSessionRequest { session_id: to.session_id.clone() };
                    let described = client.describe_session(request).await.ok();
                    let there = described.and_then(|described| described.into_inner().session);
                    there.map(|there| there.step).ok_or_else(|| refused(status))
                }
            }
        };
        match sent.await {
            Ok(step) => {
                in_time(limit_s, self.registry.close_moved(session, &to.to)).await?;
                self.journals.finish(session.id()).await;
                Ok(step)
            }
            Err(error) => {
                in_time(limit_s, session.stay()).await?;
                Err(error)
            }
        }
    }

    /// Takes a session that another server moves here; answers with the step that it goes on from.
    pub async fn take(
        &self,
        connection: Option<SocketAddr>,
        parts: Streaming<v1::TakeSessionRequest>,
    ) -> Result<u64, RequestError> {
        let limit_s = self.in_parts.limit_s;
        let ((id, file), place) = self.in_parts.receive(connection, self.read(parts)).await?;
        let options = SessionOptions {
            is_recorded: self.recordings.is_on(),
            is_journaled: self.journals.is_on(),
            ..SessionOptions::default()
        };
        let journals = Arc::clone(&self.journals);
        let kept = in_time(limit_s, aside(move || journals.keep(id, &file))).await?;
        let no_session = |error: anyhow::Error| RequestError::NoWholeSession { message: format!("{error:#}") };
        let kept = kept.map_err(|error| no_session(error.into()))?;
        let path = kept.path().to_owned();
        let read = move || {
            // Held to the end of the work, also where the other server has gone away.
            let _place = place;
            past::read(&[path]).map_err(no_session)
        };
        let session = in_time(limit_s, self.registry.bring_back(id, read, options)).await?;
        self.recordings.begin(&session);
        self.journals.go_on_from(&session, kept);
        Ok(in_time(limit_s, session.describe()).await?.step)
    }

    async fn read(&self, mut parts: Streaming<v1::TakeSessionRequest>) -> Result<(SessionId, Vec<u8>), RequestError> {
        let first = next_of(&mut parts).await?.ok_or(RequestError::Missing { field: "session_id" })?;
        let id: SessionId = first.session_id.parse()?;
        if self.registry.list().iter().any(|session| session.id() == id) {
            return Err(SessionError::Here { id: first.session_id }.into());
        }
        Ok((id, self.in_parts.file(first.data, parts, |part| part.data).await?))
    }
}

/// Whether it says nothing of what the server has done.
fn is_of_transport(status: &Status) -> bool {
    matches!(
        status.code(),
        Code::Unavailable | Code::Unknown | Code::Internal | Code::Cancelled | Code::DeadlineExceeded
    )
}

/// Where a session is to move, to be called.
fn client(to: &v1::MoveSessionRequest) -> Result<SessionServiceClient<kerf_access::Wire>, RequestError> {
    let no_address = || RequestError::NoAddress { address: to.to.chars().take(256).collect() };
    let is_url = ["http://", "https://"].iter().any(|scheme| to.to.starts_with(scheme)) && to.to.is_ascii();
    if !is_url {
        return Err(no_address());
    }
    let certificates = Some(to.ca_certificates.as_str()).filter(|pem| !pem.is_empty());
    let refused = |error: kerf_access::AccessError| match error {
        kerf_access::AccessError::Address { .. } => no_address(),
        other => RequestError::MoveAccess { field: "ca_certificates", message: other.to_string() },
    };
    let channel = endpoint(&to.to, certificates, None).map_err(refused)?.connect_lazy();
    let no_token = || RequestError::MoveAccess { field: "token", message: "it cannot be one".into() };
    let token = match to.token.as_str() {
        "" => Token::none(),
        text => Token::of(text).ok_or_else(no_token)?,
    };
    Ok(SessionServiceClient::new(token.over(channel)))
}
