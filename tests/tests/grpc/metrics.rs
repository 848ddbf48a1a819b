//! Metrics of a server that runs: what moves when something happens, what nobody is told by them, and that documents,
//! dashboard and alerts speak of metrics that there are.

use std::fs::read_to_string;
use std::path::PathBuf;
use std::sync::mpsc;

use kerf_physics::{Scene, SceneDesc};
use kerf_proto::v1;
use kerf_server::config::ServerConfig;
use kerf_session::{Owner, SessionOptions};
use tokio::io::AsyncReadExt as _;
use tokio::net::TcpStream;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

use super::cut::{ABOVE_M, FOOT_M, Stroke, Watcher};
use super::exposition::{Exposition, get, metrics_in};
use super::harness::{BLOCK, Harness, no_expiry, soon};

pub fn with_metrics(config: &mut ServerConfig) {
    no_expiry(config);
    config.metrics_listen = Some(([127, 0, 0, 1], 0).into());
}

pub async fn scrape(harness: &Harness) -> Exposition {
    Exposition::scrape(harness.server.metrics_address().expect("metrics are served")).await
}

fn file(path: &str) -> String {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("..");
    read_to_string(root.join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

#[tokio::test(flavor = "multi_thread")]
async fn what_a_cut_changes_moves_and_what_it_does_not_stays() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = Harness::with(|config| {
        with_metrics(config);
        config.journal_dir = Some(folder.path().into());
    })
    .await;
    let idle = scrape(&harness).await;
    assert_eq!((idle.value("kerf_sessions{state=\"running\"}"), idle.value("kerf_journals")), (0.0, 0.0));
    let session = harness.create().await.unwrap();
    let watcher = Watcher::join(&harness, harness.channel.clone(), &session).await;
    let mut stroke = Stroke::begin(&harness, &session).await;
    let before = scrape(&harness).await;
    stroke.press(ABOVE_M, FOOT_M).await;
    let after = scrape(&harness).await;

    for series in [
        "kerf_step_seconds_count{kind=\"paced\"}",
        "kerf_step_seconds_sum{kind=\"paced\"}",
        "kerf_step_seconds_bucket{kind=\"paced\",le=\"+Inf\"}",
        "kerf_step_stage_seconds_total{stage=\"velocities\"}",
        "kerf_step_stage_seconds_total{stage=\"fracture\"}",
        "kerf_parted_links_total",
        "kerf_tool_work_joules_total",
        "kerf_energy_residual_joules_total",
        "kerf_sent_bytes_total",
        "kerf_received_bytes_total",
    ] {
        assert!(after.value(series) > before.value(series), "{series}: {}", after.value(series));
    }
    for (series, value) in [
        ("kerf_sessions{state=\"running\"}", 1.0),
        ("kerf_sessions{state=\"failed\"}", 0.0),
        ("kerf_sessions_hanging", 0.0),
        ("kerf_viewers", 1.0),
        ("kerf_drivers", 1.0),
        ("kerf_connections", 1.0),
        ("kerf_journals", 1.0),
        ("kerf_faults_total{kind=\"energy\"}", 0.0),
        ("kerf_faults_total{kind=\"panic\"}", 0.0),
        ("kerf_journal_errors_total{kind=\"broken_off\"}", 0.0),
        ("kerf_step_seconds_count{kind=\"called\"}", 0.0),
    ] {
        assert_eq!(after.value(series), value, "{series}");
    }
    let parted = after.value("kerf_parted_links_total");
    assert!(after.value("kerf_journal_lag_seconds") < 5.0 && parted > 10.0, "{parted} links");
    assert!(after.value("kerf_sessions_memory_bytes") > 0.0 && after.value("process_resident_memory_bytes") > 1e6);
    let own = format!("kerf_session_away_seconds{{session=\"{session}\"}}");
    assert!(after.value(&own) < 5.0);
    let buckets = after.series.iter().filter(|(name, _)| name.starts_with("kerf_step_seconds_bucket"));
    assert_eq!(buckets.count(), 2 * 17, "each has all of its buckets");

    drop((stroke, watcher));
    let close = v1::CloseSessionRequest { session_id: session.clone() };
    harness.sessions.close_session(close).await.unwrap();
    let closed = scrape(&harness).await;
    assert!(!closed.series.contains_key(&own), "a session's own go with it");
    assert_eq!(closed.value("kerf_parted_links_total"), parted, "what was counted stays");
    assert_eq!(closed.value("kerf_viewers") + closed.value("kerf_journals"), 0.0);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_refusal_is_counted_by_the_limit_that_was_in_the_way() {
    let mut harness = Harness::with(|config| {
        with_metrics(config);
        config.session.max_sessions = 1;
    })
    .await;
    harness.create().await.unwrap();
    let full = harness.create().await;
    let unknown = harness.sessions.pause_session(v1::PauseSessionRequest { session_id: "session-0-0".into() }).await;
    assert!(full.is_err() && unknown.is_err());
    get(harness.server.address(), "/no/such/page").await;
    let refused = scrape(&harness).await;
    for reason in ["max_sessions", "not_found", "no_such_call"] {
        assert_eq!(refused.value(&format!("kerf_refused_requests_total{{reason=\"{reason}\"}}")), 1.0, "{reason}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_refused_connection_is_counted_by_the_limit_that_was_in_the_way() {
    let limits = ["max_connections_per_peer", "max_connections"];
    for limit in limits {
        let harness = Harness::with(|config| {
            with_metrics(config);
            match limit {
                "max_connections" => config.transport.max_connections = 2,
                _ => config.transport.max_connections_per_peer = 2,
            }
        })
        .await;
        // With that of the harness one more than may be.
        let _open = TcpStream::connect(harness.server.address()).await.unwrap();
        let mut last = TcpStream::connect(harness.server.address()).await.unwrap();
        // Closed, if not reset.
        let end = soon("the end of the last", last.read(&mut [0])).await;
        assert!(matches!(end, Ok(0) | Err(_)), "{end:?}");
        let scraped = scrape(&harness).await;
        for reason in limits {
            let series = format!("kerf_refused_connections_total{{reason=\"{reason}\"}}");
            assert_eq!(scraped.value(&series), f64::from(u8::from(reason == limit)), "{reason} at {limit} = 2");
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn metrics_are_named_and_labelled_as_prometheus_wants_and_tell_of_no_private_session() {
    let mut harness = Harness::with(with_metrics).await;
    let open = harness.create().await.unwrap();
    let scene = Scene { desc: toml::from_str::<SceneDesc>(BLOCK).unwrap(), meshes: Default::default() };
    let owner = Some(Owner { name: "anna-of-ward-4".into(), is_private: true });
    let options = SessionOptions { owner, ..SessionOptions::default() };
    let private = harness.server.registry().create(scene.judge().unwrap(), options).await.unwrap();
    let (_, text) = get(harness.server.metrics_address().unwrap(), "/metrics").await;
    assert!(text.contains(&open) && !text.contains(&private.id().to_string()) && !text.contains("anna-of-ward-4"));
    let exposition = Exposition::parse(&text);
    assert_eq!(exposition.value("kerf_sessions{state=\"running\"}"), 2.0, "it counts all the same");
    for (name, family) in &exposition.families {
        assert!(name.starts_with("kerf_") || name.starts_with("process_"), "{name}");
        assert!(family.help.len() > 10 && family.help.ends_with('.'), "{name}: {}", family.help);
        assert_eq!(name.ends_with("_total"), family.kind == "counter", "{name}");
        let known = ["kind", "state", "stage", "reason", "session", "version", "protocol_version"];
        assert!(family.labels.iter().all(|label| known.contains(&label.as_str())), "{name}: {:?}", family.labels);
        let names_session = name.starts_with("kerf_session_");
        assert_eq!(family.labels.contains("session"), names_session, "{name}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_but_metrics_is_served_where_they_are_and_they_are_not_served_elsewhere() {
    let harness = Harness::with(with_metrics).await;
    let metrics = harness.server.metrics_address().unwrap();
    assert!(get(metrics, "/").await.0.contains(" 404 "));
    assert!(get(harness.server.address(), "/metrics").await.0.contains(" 404 "));
    assert!(Harness::start().await.server.metrics_address().is_none(), "none unless it is asked for");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_session_whose_thread_hangs_fails_the_check_of_sessions_and_lists_wait_for_nobody() {
    let mut harness = Harness::with(|config| {
        with_metrics(config);
        config.session.hangs_after_s = 0.5;
    })
    .await;
    let (stuck, well) = (harness.create().await.unwrap(), harness.create().await.unwrap());
    let mut health = HealthClient::new(harness.channel.clone());
    let mut check = async |service: &str| {
        health.check(HealthCheckRequest { service: service.into() }).await.unwrap().into_inner().status()
    };
    assert_eq!(check("kerf.sessions").await, ServingStatus::Serving);
    // What a session is asked to do it does on its own thread: this is in its way until it is let go.
    let (let_go, held) = mpsc::channel::<()>();
    let session = harness.server.registry().get(&stuck).unwrap();
    let hangs = tokio::spawn(async move { session.query(move |_| held.recv().is_err()).await });
    soon("the check to fail", async {
        while check("kerf.sessions").await != ServingStatus::NotServing {
            tokio::time::sleep(std::time::Duration::from_millis(20)).await;
        }
    })
    .await;
    assert_eq!(check("").await, ServingStatus::Serving, "the others need it");
    let listed = harness.sessions.list_sessions(v1::ListSessionsRequest {}).await.unwrap().into_inner().sessions;
    let of = |id: &str| listed.iter().find(|session| session.session_id == id).unwrap().vitals.unwrap();
    assert_eq!((of(&stuck).hangs, of(&well).hangs), (true, false));
    let scraped = scrape(&harness).await;
    assert_eq!(scraped.value("kerf_sessions_hanging"), 1.0);
    let away = |id: &str| scraped.value(&format!("kerf_session_away_seconds{{session=\"{id}\"}}"));
    assert!(away(&stuck) >= 0.5 && away(&well) < away(&stuck));

    drop(let_go);
    assert!(hangs.await.unwrap().unwrap(), "it was let go");
    soon("the check to pass", async {
        while check("kerf.sessions").await != ServingStatus::Serving {
            tokio::time::sleep(std::time::Duration::from_millis(20)).await;
        }
    })
    .await;
    assert_eq!(scrape(&harness).await.value("kerf_sessions_hanging"), 0.0);
}

/// All that there is to see: a session, and a refusal.
async fn all() -> Exposition {
    let mut harness = Harness::with(with_metrics).await;
    harness.create().await.unwrap();
    get(harness.server.address(), "/no/such/page").await;
    scrape(&harness).await
}

#[tokio::test(flavor = "multi_thread")]
async fn the_document_has_every_metric_as_the_server_tells_it() {
    let row = |name: &str, of: &super::exposition::Family| {
        let labels = of.labels.iter().map(|label| format!("`{label}`")).collect::<Vec<_>>().join(", ");
        format!("| `{name}` | {} | {labels} | {} |", of.kind, of.help)
    };
    let rows: Vec<String> = all().await.families.iter().map(|(name, family)| row(name, family)).collect();
    let document = file("docs/reference/metrics.md");
    let told: Vec<&str> =
        document.lines().filter(|line| line.starts_with("| `kerf_") || line.starts_with("| `process_")).collect();
    assert_eq!(told, rows, "docs/reference/metrics.md should have:\n{}", rows.join("\n"));
}

#[tokio::test(flavor = "multi_thread")]
async fn the_dashboard_and_the_alerts_ask_for_metrics_that_there_are() {
    let there = all().await;
    let dashboard: serde_json::Value = serde_json::from_str(&file("deploy/grafana/kerf.json")).unwrap();
    let alerts = file("deploy/prometheus/alerts.yaml");
    let mut expressions = Vec::new();
    expressions_of(&dashboard, &mut expressions);
    let shown = expressions.len();
    expressions.extend(alerts.lines().filter_map(|line| Some(line.trim().strip_prefix("expr: ")?.to_owned())));
    assert!(shown > 40 && expressions.len() >= shown + 8, "{shown} of {}", expressions.len());
    let asked: Vec<String> = expressions.iter().flat_map(|expression| metrics_in(expression)).collect();
    for name in &asked {
        assert!(name == "up" || there.family_of(name).is_some(), "{name}: there is no such metric");
    }
    // The job is Prometheus's own label.
    let selected: Vec<_> = expressions.iter().flat_map(|expression| selected_in(expression)).collect();
    assert!(selected.iter().any(|(_, label)| label == "kind=\"paced\""), "{selected:?}");
    for (name, label) in selected.iter().filter(|(_, label)| !label.starts_with("job=")) {
        let is_there = |series: &String| series.starts_with(&format!("{name}{{")) && series.contains(label.as_str());
        assert!(there.series.keys().any(is_there), "{name}{{{label}}}: there is no such series");
    }
    // And nothing is told that no panel shows.
    let of = |name: &String| there.family_of(name).unwrap_or_default();
    let asked: Vec<String> = asked.iter().map(of).collect();
    let unseen: Vec<_> =
        there.families.keys().filter(|name| *name != "process_virtual_memory_bytes" && !asked.contains(name)).collect();
    assert!(unseen.is_empty(), "{unseen:?}");
}

/// What an expression of PromQL selects by: a series' name, and each label that it wants to be equal to something.
fn selected_in(expression: &str) -> Vec<(String, String)> {
    let pieces: Vec<&str> = expression.split('{').collect();
    let is_part = |character: char| character.is_ascii_alphanumeric() || character == '_';
    let mut selected = Vec::new();
    for pair in pieces.windows(2) {
        let name = pair[0].rsplit(|character| !is_part(character)).next().unwrap_or_default();
        let labels = pair[1].split('}').next().unwrap_or_default().split(',').map(str::trim);
        let equal = labels.filter(|label| label.contains("=\"") && !label.contains("!="));
        selected.extend(equal.map(|label| (name.to_owned(), label.to_owned())));
    }
    selected
}

fn expressions_of(value: &serde_json::Value, expressions: &mut Vec<String>) {
    match value {
        serde_json::Value::Object(fields) => fields.iter().for_each(|(name, value)| match value.as_str() {
            Some(text) if name == "expr" => expressions.push(text.into()),
            _ => expressions_of(value, expressions),
        }),
        serde_json::Value::Array(values) => values.iter().for_each(|value| expressions_of(value, expressions)),
        _ => {}
    }
}
