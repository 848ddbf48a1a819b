//! Stations and the load generator with a server that speaks TLS and asks for tokens.

use std::path::PathBuf;

use clap::Parser;
use kerf_access::Access;
use kerf_load::args::Args;
use kerf_physics::{Scene, SceneDesc};
use kerf_server::config::ServerConfig;
use kerf_server::security::roles::Role;
use kerf_server::security::token_command::{self, Action, New, TokenArgs};
use kerf_server::serve::Server;
use kerf_session::SessionOptions;
use kerf_station::config::ServerConfig as StationServer;
use kerf_station::link::{LinkState, SharedSession};
use tempfile::TempDir;

use super::harness::BLOCK;
use super::station::{drive_at, feels, link_where, says, until};

/// A server with a session of the block, and a folder with its certificate and tokens of this role and a wrong one.
struct Secured {
    folder: TempDir,
    server: Server,
    session_id: String,
}

impl Secured {
    async fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        for (name, role) in [("driver", Role::Driver), ("viewer", Role::Viewer)] {
            let (file, out) = (folder.path().join("tokens.toml"), Some(folder.path().join(name)));
            let new = New { name: name.into(), role, session: None, days: None, file, out };
            token_command::run(TokenArgs { action: Action::New(new) }).unwrap();
        }
        std::fs::write(folder.path().join("wrong"), "wrong").unwrap();
        let mut config = ServerConfig { listen: ([127, 0, 0, 1], 0).into(), ..ServerConfig::default() };
        config.security.dir = Some(folder.path().into());
        let server = Server::start(config).await.unwrap();
        let scene = Scene { desc: toml::from_str::<SceneDesc>(BLOCK).unwrap(), meshes: Default::default() };
        let scene = scene.judge().unwrap();
        let session = server.registry().create(scene, SessionOptions::default()).await.unwrap();
        Self { folder, server, session_id: session.id().to_string() }
    }

    fn url(&self) -> String {
        format!("https://localhost:{}", self.server.address().port())
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_station_feels_with_a_drivers_token_and_says_what_is_wrong_with_another() {
    let secured = Secured::start().await;
    let station = |token: &str| {
        let (ca_file, token_file) = (Some(secured.file("certificate.pem")), Some(secured.file(token)));
        drive_at(
            &SharedSession::join(&secured.session_id),
            0,
            StationServer { url: secured.url(), ca_file, token_file },
        )
    };
    until(&mut station("driver"), "contact", feels).await;
    for (token, word) in [("viewer", "takes a driver's"), ("wrong", "the token is not known")] {
        let link = link_where(&station(token), "the refusal", |link| link.state == LinkState::Failed).await;
        assert!(says(&link, word) && says(&link, "server.token_file"), "{link:?}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn kerf_load_drives_and_views_with_a_drivers_token_and_says_what_is_wrong_with_another() {
    let secured = Secured::start().await;
    let run = async |token: &str| {
        let mut args = Args::parse_from(["kerf-load", "--session", &secured.session_id, "--duration", "0.3"]);
        args.server = secured.url();
        let (ca_file, token_file) = (Some(secured.file("certificate.pem")), Some(secured.file(token)));
        args.access = Access { ca_file, token_file };
        kerf_load::run::run(&args).await
    };
    let report = run("driver").await.unwrap().report;
    assert!(report.view.states > 0 && report.contacts.received > 0, "{report}");
    for (token, word) in [("viewer", "takes a driver's"), ("wrong", "the token is not known")] {
        let refused = format!("{:#}", run(token).await.err().unwrap());
        assert!(refused.contains(word), "{refused}");
    }
}
