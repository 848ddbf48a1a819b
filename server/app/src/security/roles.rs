//! What a role may do: one table, by the path of a call. What is not in it nobody may do.

use axum::http::Method;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What the holder of a token is. Each may do what those before it may.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Sees what there is.
    Viewer,
    /// Creates sessions, drives their tools, and takes them where it likes.
    Driver,
    /// All that there is: private sessions and the end of others' sessions, too.
    Operator,
}

impl Role {
    /// As a file of tokens has it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Viewer => "viewer",
            Self::Driver => "driver",
            Self::Operator => "operator",
        }
    }
}

/// What a request needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    /// Nothing: anybody may.
    Nothing,
    /// A token of this role, or of one that may more.
    Role(Role),
}

use Need::{Nothing, Role as Of};

/// What each call needs. Two rules make most of it: what changes nothing that others see is a viewer's, and what
/// moves, takes or ends something is a driver's. Which session it may be about is judged where the session is known.
pub const CALLS: &[(&str, Need)] = &[
    // The scenes' texts come with the program, or lie in a folder that is there to be offered.
    ("/kerf.v1.SessionService/ListScenes", Of(Role::Viewer)),
    ("/kerf.v1.SessionService/GetScene", Of(Role::Viewer)),
    ("/kerf.v1.SessionService/DescribeSession", Of(Role::Viewer)),
    ("/kerf.v1.SessionService/ListSessions", Of(Role::Viewer)),
    ("/kerf.v1.SessionService/ListCheckpoints", Of(Role::Viewer)),
    // Memory and cores are taken by it: the scarcest that a server has.
    ("/kerf.v1.SessionService/CreateSession", Of(Role::Driver)),
    ("/kerf.v1.SessionService/MakeSession", Of(Role::Driver)),
    ("/kerf.v1.SessionService/UploadScene", Of(Role::Driver)),
    ("/kerf.v1.SessionService/SendSceneFile", Of(Role::Driver)),
    // A driver ends the sessions that are its own; the service sees to it. Operators end any.
    ("/kerf.v1.SessionService/CloseSession", Of(Role::Driver)),
    ("/kerf.v1.SessionService/PauseSession", Of(Role::Driver)),
    ("/kerf.v1.SessionService/ResumeSession", Of(Role::Driver)),
    ("/kerf.v1.SessionService/StepSession", Of(Role::Driver)),
    ("/kerf.v1.SessionService/StepSessions", Of(Role::Driver)),
    ("/kerf.v1.SessionService/ResetSession", Of(Role::Driver)),
    ("/kerf.v1.SessionService/SaveCheckpoint", Of(Role::Driver)),
    ("/kerf.v1.SessionService/RestoreCheckpoint", Of(Role::Driver)),
    ("/kerf.v1.SessionService/DeleteCheckpoint", Of(Role::Driver)),
    // It takes one of few places for files, and copies the state on the session's own thread.
    ("/kerf.v1.SessionService/DownloadCheckpoint", Of(Role::Driver)),
    ("/kerf.v1.SessionService/UploadCheckpoint", Of(Role::Driver)),
    // Who may drive a session may show it.
    ("/kerf.v1.SessionService/InviteViewer", Of(Role::Driver)),
    // It hands all of a session to whoever is named, or takes one that nobody of this server made.
    ("/kerf.v1.SessionService/MoveSession", Of(Role::Operator)),
    ("/kerf.v1.SessionService/TakeSession", Of(Role::Operator)),
    // All who watch a recording are taken to another time.
    ("/kerf.v1.SessionService/SeekReplay", Of(Role::Driver)),
    ("/kerf.v1.ControlService/Control", Of(Role::Driver)),
    ("/kerf.v1.ControlService/SendPose", Of(Role::Driver)),
    ("/kerf.v1.ViewService/View", Of(Role::Viewer)),
    ("/kerf.v1.ViewService/Acknowledge", Of(Role::Viewer)),
    // Put together once for all who ask; the viewer shows cuts by it.
    ("/kerf.v1.ViewService/GetInterior", Of(Role::Viewer)),
    // Whoever starts servers asks whether one lives, and has no token of it. The answer is one word.
    ("/grpc.health.v1.Health/Check", Nothing),
    ("/grpc.health.v1.Health/Watch", Nothing),
    // What it tells is public with the program; who has a token may ask for it.
    ("/grpc.reflection.v1.ServerReflection/ServerReflectionInfo", Of(Role::Viewer)),
    ("/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", Of(Role::Viewer)),
];

/// Where metrics are read, on their own address.
pub const METRICS_PATH: &str = "/metrics";

/// What a request needs; `None`: there is nothing there.
pub fn need(method: &Method, path: &str) -> Option<Need> {
    if let Some((_, need)) = CALLS.iter().find(|(call, _)| *call == path) {
        return Some(*need);
    }
    if path == METRICS_PATH {
        // They have ids of sessions, as lists do.
        return (*method == Method::GET).then_some(Of(Role::Viewer));
    }
    // The viewer's own files and the book, in which no secret is: the page has to be there before it can say a token.
    let is_book = path.starts_with("/docs/");
    let is_file = is_book || path.strip_prefix('/').is_some_and(|name| !name.contains('/'));
    (is_file && [Method::GET, Method::HEAD].contains(method)).then_some(Nothing)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use prost::Message;
    use prost_types::FileDescriptorSet;

    use super::*;

    /// The paths of all calls in a compiled file.
    fn calls(descriptors: &[u8]) -> impl Iterator<Item = String> {
        let set = FileDescriptorSet::decode(descriptors).unwrap();
        set.file.into_iter().flat_map(|file| {
            let package = file.package().to_owned();
            file.service.into_iter().flat_map(move |service| {
                let service_path = format!("/{package}.{}", service.name());
                let call =
                    move |method: prost_types::MethodDescriptorProto| format!("{service_path}/{}", method.name());
                service.method.into_iter().map(call).collect::<Vec<_>>()
            })
        })
    }

    #[test]
    fn every_call_has_a_row_and_every_row_a_call() {
        let sets = [
            kerf_proto::FILE_DESCRIPTOR_SET,
            tonic_health::pb::FILE_DESCRIPTOR_SET,
            tonic_reflection::pb::v1::FILE_DESCRIPTOR_SET,
            tonic_reflection::pb::v1alpha::FILE_DESCRIPTOR_SET,
        ];
        let there: BTreeSet<String> = sets.into_iter().flat_map(calls).collect();
        let listed: BTreeSet<String> = CALLS.iter().map(|(path, _)| (*path).to_owned()).collect();
        assert_eq!(there, listed);
        assert_eq!(CALLS.len(), listed.len(), "a call has two rows");
    }

    #[test]
    fn what_is_not_in_the_table_nobody_may_do() {
        for path in [
            "/kerf.v1.SessionService/DropTables",
            "/kerf.v1.SessionService",
            "/a/b",
            "",
            "//",
            "/kerf.v1.ViewService/View/",
        ] {
            assert_eq!(need(&Method::POST, path), None, "{path}");
        }
        assert_eq!(need(&Method::GET, "/a/b"), None);
        assert_eq!(need(&Method::GET, "/index.html"), Some(Nothing));
        assert_eq!(need(&Method::POST, "/index.html"), None);
        assert_eq!(need(&Method::GET, METRICS_PATH), Some(Of(Role::Viewer)));
        assert_eq!(need(&Method::POST, METRICS_PATH), None);
        assert_eq!(need(&Method::GET, "/docs/explanation/method.html"), Some(Nothing));
        assert_eq!(need(&Method::POST, "/docs/explanation/method.html"), None);
    }
}
