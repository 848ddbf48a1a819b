//! Traces, as a collector gets them, and what becomes of a server whose collector is not there.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::process::Stdio;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use kerf_proto::v1::{self, create_session_request};
use opentelemetry_proto::tonic::collector::trace::v1::trace_service_server::{TraceService, TraceServiceServer};
use opentelemetry_proto::tonic::collector::trace::v1::{ExportTraceServiceRequest, ExportTraceServiceResponse};
use opentelemetry_proto::tonic::common::v1::any_value::Value;
use opentelemetry_proto::tonic::trace::v1::Span;
use tokio::runtime::{Builder, Runtime};
use tonic::transport::Server;
use tonic::{Request, Response, Status};

use super::process::{BLOCK, Process, soon};

/// What a collector has got.
#[derive(Clone, Default)]
struct Collected(Arc<Mutex<Vec<Span>>>);

#[tonic::async_trait]
impl TraceService for Collected {
    async fn export(
        &self,
        request: Request<ExportTraceServiceRequest>,
    ) -> Result<Response<ExportTraceServiceResponse>, Status> {
        let scopes = request.into_inner().resource_spans.into_iter().flat_map(|resource| resource.scope_spans);
        self.0.lock().unwrap().extend(scopes.flat_map(|scope| scope.spans));
        Ok(Response::new(ExportTraceServiceResponse::default()))
    }
}

impl Collected {
    /// The first span of this name of which this holds, once it has come.
    async fn first(&self, name: &str, holds: impl Fn(&Attributes) -> bool) -> Span {
        soon(name, async {
            loop {
                let found = self.0.lock().unwrap().iter().find(|span| span.name == name && holds(&of(span))).cloned();
                match found {
                    Some(span) => break span,
                    None => tokio::time::sleep(Duration::from_millis(20)).await,
                }
            }
        })
        .await
    }
}

type Attributes = BTreeMap<String, String>;

/// A span's attributes as texts.
fn of(span: &Span) -> Attributes {
    let text = |value: Value| match value {
        Value::StringValue(text) => text,
        Value::IntValue(number) => number.to_string(),
        Value::DoubleValue(number) => number.to_string(),
        other => format!("{other:?}"),
    };
    let pairs = span.attributes.iter().cloned();
    pairs.filter_map(|pair| Some((pair.key, text(pair.value?.value?)))).collect()
}

fn free() -> SocketAddr {
    std::net::TcpListener::bind(("127.0.0.1", 0)).unwrap().local_addr().unwrap()
}

/// A collector on a runtime of its own, so that its connections end with it.
struct Collector(Option<Runtime>);

impl Collector {
    fn at(address: SocketAddr, collected: &Collected) -> Self {
        let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
        let service = TraceServiceServer::new(collected.clone());
        runtime.spawn(async move { Server::builder().add_service(service).serve(address).await.unwrap() });
        Self(Some(runtime))
    }
}

impl Drop for Collector {
    fn drop(&mut self) {
        self.0.take().unwrap().shutdown_background();
    }
}

fn traced(collector: SocketAddr) -> [String; 2] {
    ["--set".into(), format!("traces.endpoint=http://{collector}")]
}

/// A session whose steps are late: no machine keeps its rate.
async fn overload(process: &mut Process) -> String {
    let fine = BLOCK.replace("resolution = 6\nlevel = 1", "resolution = 24\nlevel = 0");
    assert_ne!(fine, BLOCK);
    let scene = Some(create_session_request::Scene::SceneToml(fine));
    let request = v1::CreateSessionRequest { scene, step_rate_hz: Some(4000.0), ..Default::default() };
    let created = soon("a session", process.client.create_session(request)).await.unwrap().into_inner();
    created.session.unwrap().session_id
}

#[tokio::test(flavor = "multi_thread")]
async fn a_collector_gets_requests_a_sessions_life_and_late_steps() {
    let (address, collected) = (free(), Collected::default());
    let _collector = Collector::at(address, &collected);
    let traced = traced(address);
    let mut process = Process::serve(&traced.each_ref().map(String::as_str), Stdio::inherit()).await;
    // What a client says of its own trace goes on in the server's.
    let trace_id = "4bf92f3577b34da6a3ce929d0e0e4736";
    let mut listing = Request::new(v1::ListSessionsRequest {});
    let parent = format!("00-{trace_id}-00f067aa0ba902b7-01");
    listing.metadata_mut().insert("traceparent", parent.parse().unwrap());
    process.client.list_sessions(listing).await.unwrap();
    let listed = collected.first("kerf.v1.SessionService/ListSessions", |_| true).await;
    assert_eq!(listed.trace_id.iter().map(|byte| format!("{byte:02x}")).collect::<String>(), trace_id);
    assert_eq!(of(&listed)["rpc.grpc.status_code"], "0");

    let session_id = overload(&mut process).await;
    let is_ours = |attributes: &Attributes| attributes.get("session.id") == Some(&session_id);
    let created = collected.first("kerf.v1.SessionService/CreateSession", is_ours).await;
    assert_eq!(of(&created)["scene.name"], "block");
    let late = collected.first("late step", is_ours).await;
    let lag_ms: f64 = of(&late)["lag_ms"].parse().unwrap();
    assert!(lag_ms > 0.0 && late.end_time_unix_nano > late.start_time_unix_nano, "{late:?}");

    let missing = v1::DescribeSessionRequest { session_id: "nobody".into() };
    process.client.describe_session(missing).await.unwrap_err();
    let refused = collected.first("kerf.v1.SessionService/DescribeSession", |_| true).await;
    assert_eq!(of(&refused)["rpc.grpc.status_code"], "5");

    let close = v1::CloseSessionRequest { session_id: session_id.clone() };
    soon("the end", process.client.close_session(close)).await.unwrap();
    let life = collected.first("session", is_ours).await;
    assert_eq!((of(&life)["scene.name"].as_str(), of(&life)["step_rate_hz"].as_str()), ("block", "4000"));
    assert_eq!((&late.parent_span_id, &late.trace_id), (&life.span_id, &life.trace_id));
    assert!(
        life.start_time_unix_nano <= late.start_time_unix_nano && late.end_time_unix_nano <= life.end_time_unix_nano
    );
    assert_eq!(life.links.iter().map(|link| &link.span_id).collect::<Vec<_>>(), [&created.span_id]);
    assert!(process.stop().success());
}

#[tokio::test(flavor = "multi_thread")]
async fn the_last_spans_are_sent_when_the_server_ends() {
    let (address, collected) = (free(), Collected::default());
    let _collector = Collector::at(address, &collected);
    let traced = traced(address);
    let mut process = Process::serve(&traced.each_ref().map(String::as_str), Stdio::inherit()).await;
    let session_id = process.stand().await;
    assert!(process.stop().success());
    collected.first("session", |attributes| attributes.get("session.id") == Some(&session_id)).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_collector_that_is_absent_or_goes_stops_no_session_and_is_warned_of_once() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("log");
    let address = free();
    let traced = traced(address);
    let stderr = Stdio::from(std::fs::File::create(&log).unwrap());
    let mut process = Process::serve(&traced.each_ref().map(String::as_str), stderr).await;
    let session_id = process.create().await.session.unwrap().session_id;
    let said = |words: &str| std::fs::read_to_string(&log).unwrap().matches(words).count();
    let says = async |words: &str, times: usize| {
        soon(words, async {
            while said(words) < times {
                tokio::time::sleep(Duration::from_millis(50)).await;
            }
        })
        .await;
    };
    says("no collector takes traces", 1).await;
    // More spans that are lost: each description is one.
    for _ in 0..3 {
        let step = process.until(&session_id, |_| true).await.step;
        process.until(&session_id, |described| described.step > step + 500).await;
    }
    // One comes, gets what is told from then on, and goes.
    let collected = Collected::default();
    let collector = Collector::at(address, &collected);
    let described = soon("a span", async {
        while collected.0.lock().unwrap().is_empty() {
            process.until(&session_id, |_| true).await;
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    });
    described.await;
    says("the collector takes traces again", 1).await;
    assert_eq!(said("no collector takes traces"), 1);
    drop(collector);
    process.until(&session_id, |_| true).await;
    says("no collector takes traces", 2).await;
    let step = process.until(&session_id, |_| true).await.step;
    process.until(&session_id, |described| described.step > step + 500).await;
    assert!(process.stop().success());
    assert_eq!(said("no collector takes traces"), 2, "{}", std::fs::read_to_string(&log).unwrap());
}
