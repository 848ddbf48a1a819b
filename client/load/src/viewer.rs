//! Viewers: a view stream each, applied to a replica each.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use anyhow::{Context, bail};
use kerf_access::{Access, Wire};
use kerf_proto::v1::view_service_client::ViewServiceClient;
use kerf_proto::v1::{self, ViewResponse, view_response};
use kerf_replica::{Assembler, Replica, ReplicaError, Surface};
use prost::Message;
use tokio::sync::watch;
use tonic::Streaming;

use crate::session::{self, refused};
use crate::wire::FRAME_BYTES;

/// Times that a viewer starts over after its replica came apart. One is a bug to report; many would
/// only hide it in keyframes.
const MAX_RESTARTS: u64 = 10;
/// The first keyframe and state come at once, also from a paused session.
const FIRST_SURFACE_TIMEOUT: Duration = Duration::from_secs(30);

/// What the viewers have counted, all of them together.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ViewTotals {
    /// Keyframes applied.
    pub keyframes: u64,
    /// Patches applied.
    pub patches: u64,
    /// States applied.
    pub states: u64,
    /// Messages that did not fit the replica, or led to another surface than the server's.
    pub mismatches: u64,
    /// The first of them, for people.
    pub first_mismatch: Option<String>,
    /// Bytes that came in, framing included.
    pub bytes: u64,
    /// What the server said of its steps.
    pub server: Option<ServerSteps>,
    /// What it booked of energy until the last state.
    pub energy: Option<v1::EnergyLedger>,
}

/// What the server said of its steps in the states.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ServerSteps {
    /// Steps and late ones in the first state.
    pub first: (u64, u64),
    /// Steps and late ones in the last state.
    pub last: (u64, u64),
    /// Version of the structure in the last state.
    pub topology_version: u64,
    /// Steps that profiles have summed up.
    pub profiled_steps: u64,
    /// Duration of those steps, s.
    pub profiled_s: f64,
    /// Longest step, s.
    pub step_max_s: f64,
}

/// Totals that viewers add to and the progress line reads.
pub type SharedTotals = Arc<Mutex<ViewTotals>>;

/// A copy of the totals as they are now.
#[must_use]
pub fn snapshot(totals: &SharedTotals) -> ViewTotals {
    totals.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

/// The surfaces of a session's objects as they are now, from a stream of its own.
///
/// # Errors
/// The stream cannot be opened, breaks, or does not fit together.
pub async fn first_surfaces(channel: Wire, request: v1::ViewRequest) -> anyhow::Result<Vec<Surface>> {
    let read = async {
        let mut stream = subscribe(channel, request).await?;
        let mut replica = Replica::default();
        loop {
            let event = stream.next().await?;
            replica.apply(&event.message.context("the server sent an empty view event")?)?;
            if let Some(surfaces) = replica.surfaces() {
                return Ok(surfaces);
            }
        }
    };
    tokio::time::timeout(FIRST_SURFACE_TIMEOUT, read).await.context("the server showed no surface")?
}

/// Runs viewers on a thread of their own, each on its own connection as those of different people are, until `stop` turns
/// true; returns the surfaces that the first one has in the end.
///
/// # Errors
/// A stream cannot be opened, breaks, or does not fit together too often.
pub fn spawn(
    (server, access): (String, Access),
    request: v1::ViewRequest,
    viewers: u32,
    totals: SharedTotals,
    stop: watch::Receiver<bool>,
) -> std::io::Result<std::thread::JoinHandle<anyhow::Result<Vec<Surface>>>> {
    std::thread::Builder::new().name("kerf-load-view".to_owned()).spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        runtime.block_on(async {
            let mut tasks = Vec::new();
            for _ in 0..viewers {
                let channel = session::connect(&server, &access, Duration::ZERO).await?;
                tasks.push(tokio::spawn(watch_session(channel, request.clone(), totals.clone(), stop.clone())));
            }
            let mut replicas = Vec::new();
            for (index, task) in tasks.into_iter().enumerate() {
                replicas.push(task.await?.with_context(|| format!("viewer {index}"))?);
            }
            Ok(replicas.first().and_then(Replica::surfaces).unwrap_or_default())
        })
    })
}

async fn watch_session(
    channel: Wire,
    request: v1::ViewRequest,
    totals: SharedTotals,
    mut stop: watch::Receiver<bool>,
) -> anyhow::Result<Replica> {
    for _ in 0..=MAX_RESTARTS {
        let mut stream = subscribe(channel.clone(), request.clone()).await?;
        let mut replica = Replica::default();
        loop {
            let event = tokio::select! {
                _ = stop.wait_for(|stop| *stop) => return Ok(replica),
                event = stream.next() => event?,
            };
            if apply(&event, &mut replica, &totals)? == Replicated::Broken {
                break;
            }
        }
    }
    bail!("the replica came apart more than {MAX_RESTARTS} times")
}

/// Whether a replica can go on.
#[derive(Debug, PartialEq, Eq)]
enum Replicated {
    Intact,
    Broken,
}

fn apply(event: &ViewResponse, replica: &mut Replica, totals: &SharedTotals) -> anyhow::Result<Replicated> {
    let message = event.message.as_ref().context("the server sent an empty view event")?;
    let outcome = replica.apply(message);
    let mut totals = totals.lock().unwrap_or_else(PoisonError::into_inner);
    totals.bytes += event.encoded_len() as u64 + FRAME_BYTES;
    match outcome {
        Ok(()) => {
            totals.count(message);
            Ok(Replicated::Intact)
        }
        Err(error) => {
            totals.mismatch(&error);
            Ok(if error.needs_keyframe() { Replicated::Broken } else { Replicated::Intact })
        }
    }
}

impl ViewTotals {
    /// Adds what the viewers of another session have counted; energy stays that of this one.
    pub fn add(&mut self, other: &Self) {
        self.keyframes += other.keyframes;
        self.patches += other.patches;
        self.states += other.states;
        self.mismatches += other.mismatches;
        self.first_mismatch = self.first_mismatch.take().or_else(|| other.first_mismatch.clone());
        self.bytes += other.bytes;
        if let Some(steps) = &other.server {
            self.server.get_or_insert_default().add(steps);
        }
    }

    fn count(&mut self, message: &view_response::Message) {
        match message {
            view_response::Message::Keyframe(_) => self.keyframes += 1,
            view_response::Message::Patch(_) => self.patches += 1,
            view_response::Message::State(state) => {
                self.states += 1;
                self.energy = state.energy.or(self.energy);
                self.server.get_or_insert_with(|| ServerSteps::starting_at(state)).update(state);
            }
            // Drivers are told of faults too, and count them.
            view_response::Message::Event(_)
            | view_response::Message::Fault(_)
            | view_response::Message::Hello(_)
            | view_response::Message::Fragment(_) => {}
        }
    }

    fn mismatch(&mut self, error: &ReplicaError) {
        self.mismatches += 1;
        self.first_mismatch.get_or_insert_with(|| error.to_string());
    }
}

impl ServerSteps {
    fn starting_at(state: &v1::State) -> Self {
        Self { first: (state.step, state.late_steps), ..Self::default() }
    }

    fn update(&mut self, state: &v1::State) {
        self.last = (state.step, state.late_steps);
        self.topology_version = state.topology_version;
        if let Some(profile) = &state.profile {
            self.profiled_steps += u64::from(profile.steps);
            self.profiled_s += f64::from(profile.steps) * f64::from(profile.step_mean_s);
            self.step_max_s = f64::max(self.step_max_s, f64::from(profile.step_max_s));
        }
    }

    fn add(&mut self, other: &Self) {
        self.first = (self.first.0 + other.first.0, self.first.1 + other.first.1);
        self.last = (self.last.0 + other.last.0, self.last.1 + other.last.1);
        self.topology_version = self.topology_version.max(other.topology_version);
        self.profiled_steps += other.profiled_steps;
        self.profiled_s += other.profiled_s;
        self.step_max_s = f64::max(self.step_max_s, other.step_max_s);
    }

    /// Steps between the first state and the last one.
    #[must_use]
    pub fn steps(&self) -> u64 {
        self.last.0.saturating_sub(self.first.0)
    }

    /// Of these, steps that ended after their deadline.
    #[must_use]
    pub fn late_steps(&self) -> u64 {
        self.last.1.saturating_sub(self.first.1)
    }
}

/// A view stream whose messages are acknowledged as they are asked for.
struct View {
    stream: Streaming<ViewResponse>,
    assembler: Assembler,
    /// Number of the newest message that was read.
    read: watch::Sender<u64>,
}

async fn subscribe(channel: Wire, request: v1::ViewRequest) -> anyhow::Result<View> {
    let mut client = ViewServiceClient::new(channel).max_decoding_message_size(kerf_proto::MAX_MESSAGE_BYTES);
    let reply = client.view(request).await.map_err(|status| refused("opening the view stream", &status))?;
    let mut stream = reply.into_inner();
    let first = stream.message().await.map_err(|status| refused("the view stream broke", &status))?;
    let Some(ViewResponse { message: Some(view_response::Message::Hello(hello)), .. }) = first else {
        bail!("the server did not begin with a hello");
    };
    let (read, newest) = watch::channel(0);
    tokio::spawn(acknowledge(client, hello.viewer, newest));
    Ok(View { stream, assembler: Assembler::default(), read })
}

/// Tells the server what was read, one call at a time, until the stream is left or the server knows it no more.
async fn acknowledge(mut client: ViewServiceClient<Wire>, viewer: String, mut newest: watch::Receiver<u64>) {
    while newest.changed().await.is_ok() {
        let number = *newest.borrow_and_update();
        let request = v1::AcknowledgeRequest { viewer: viewer.clone(), number };
        if client.acknowledge(request).await.is_err() {
            return;
        }
    }
}

impl View {
    async fn next(&mut self) -> anyhow::Result<ViewResponse> {
        loop {
            let event = self.stream.message().await.map_err(|status| refused("the view stream broke", &status))?;
            let event = event.context("the server ended the view stream")?;
            if let Some(whole) = self.assembler.take(event)? {
                if whole.number > 0 {
                    self.read.send_replace(whole.number);
                }
                return Ok(whole);
            }
        }
    }
}
