//! A real Prometheus beside a server that runs, and its checks of the files that are shipped for it. Left out with a word
//! where none can be had.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use super::cut::{ABOVE_M, MIDDLE_M, Stroke};
use super::exposition::get;
use super::harness::{Harness, soon};
use super::metrics::with_metrics;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The folder of `prometheus` and `promtool`.
fn programs() -> Option<PathBuf> {
    let said = Command::new(root().join("deploy/prometheus/fetch.sh")).output().expect("sh");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().to_owned();
    if !said.status.success() {
        println!("skipped: {}", text(&said.stderr));
        return None;
    }
    Some(text(&said.stdout).into())
}

/// What promtool says of some input; panics where it finds fault.
fn promtool(programs: &Path, arguments: &[&str], input: Stdio) -> String {
    let mut command = Command::new(programs.join("promtool"));
    let output = command.args(arguments).current_dir(root().join("deploy/prometheus")).stdin(input).output().unwrap();
    let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
    assert!(output.status.success(), "promtool {arguments:?}: {said}");
    said
}

/// It is killed where a test ends before it.
struct Prometheus(Child);

impl Drop for Prometheus {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Prometheus {
    /// One that scrapes this server four times a second and judges it by the rules that are shipped.
    fn start(programs: &Path, folder: &Path, metrics: SocketAddr) -> (Self, SocketAddr) {
        let address = std::net::TcpListener::bind(("127.0.0.1", 0)).unwrap().local_addr().unwrap();
        let rules = root().join("deploy/prometheus/alerts.yaml").canonicalize().unwrap();
        let config = format!(
            "global: {{scrape_interval: 250ms, evaluation_interval: 250ms}}\nrule_files: ['{}']\nscrape_configs:\n- \
             job_name: kerf\n  static_configs: [{{targets: ['{metrics}']}}]\n",
            rules.display()
        );
        std::fs::write(folder.join("prometheus.yaml"), config).unwrap();
        let mut command = Command::new(programs.join("prometheus"));
        command.arg("--config.file").arg(folder.join("prometheus.yaml"));
        command.arg("--storage.tsdb.path").arg(folder.join("data"));
        command.arg(format!("--web.listen-address={address}")).stdout(Stdio::null()).stderr(Stdio::null());
        (Self(command.spawn().unwrap()), address)
    }
}

/// The first value that a query has; `None` while it has none, or nobody answers.
async fn query(prometheus: SocketAddr, expression: &str) -> Option<f64> {
    tokio::net::TcpStream::connect(prometheus).await.ok()?;
    let (_, body) = get(prometheus, &format!("/api/v1/query?query={expression}")).await;
    let answer: serde_json::Value = serde_json::from_str(&body).ok()?;
    answer["data"]["result"][0]["value"][1].as_str()?.parse().ok()
}

async fn until(prometheus: SocketAddr, expression: &str, holds: impl Fn(f64) -> bool) {
    soon(expression, async {
        while !query(prometheus, expression).await.is_some_and(&holds) {
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_real_prometheus_scrapes_a_cut_and_raises_an_alert() {
    let Some(programs) = programs() else { return };
    let mut harness = Harness::with(|config| {
        with_metrics(config);
        config.session.hangs_after_s = 0.5;
    })
    .await;
    let session = harness.create().await.unwrap();
    let metrics = harness.server.metrics_address().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let (_prometheus, address) = Prometheus::start(&programs, folder.path(), metrics);
    until(address, "up", |up| up == 1.0).await;
    until(address, "kerf_parted_links_total", |parted| parted == 0.0).await;
    Stroke::begin(&harness, &session).await.press(ABOVE_M, MIDDLE_M).await;
    until(address, "kerf_parted_links_total", |parted| parted > 0.0).await;
    let p99 = "histogram_quantile(0.99,rate(kerf_step_seconds_bucket%7Bkind=%22paced%22%7D[10s]))";
    until(address, p99, |seconds| seconds > 0.0 && seconds < 10.0).await;

    let (let_go, held) = std::sync::mpsc::channel::<()>();
    let hangs = harness.server.registry().get(&session).unwrap();
    let hangs = tokio::spawn(async move { hangs.query(move |_| held.recv().is_err()).await });
    until(address, "ALERTS%7Balertname=%22KerfSessionHangs%22,alertstate=%22firing%22%7D", |fires| fires == 1.0).await;
    drop(let_go);
    assert!(hangs.await.unwrap().unwrap(), "it was let go");

    let (_, text) = get(metrics, "/metrics").await;
    std::fs::write(folder.path().join("metrics"), text).unwrap();
    let text = std::fs::File::open(folder.path().join("metrics")).unwrap();
    assert_eq!(promtool(&programs, &["check", "metrics"], text.into()), "", "promtool has remarks");
}

#[test]
fn the_files_that_are_shipped_for_prometheus_are_sound_and_alerts_come_when_they_are_meant_to() {
    let Some(programs) = programs() else { return };
    let check = |arguments: &[&str]| promtool(&programs, arguments, Stdio::null());
    check(&["check", "config", "prometheus.yaml"]);
    check(&["check", "rules", "alerts.yaml"]);
    check(&["test", "rules", "alerts_test.yaml"]);
    let read = |name: &str| std::fs::read_to_string(root().join("deploy/prometheus").join(name)).unwrap();
    let (alerts, tests, document) = (
        read("alerts.yaml"),
        read("alerts_test.yaml"),
        std::fs::read_to_string(root().join("docs/reference/metrics.md")).unwrap(),
    );
    let names: Vec<&str> = alerts.lines().filter_map(|line| line.trim().strip_prefix("- alert: ")).collect();
    assert!(names.len() >= 8, "{names:?}");
    for name in names {
        let tried = [format!("alertname: {name}, exp_alerts: []"), format!("alertname: {name}\n")];
        assert!(tried.iter().all(|test| tests.contains(test)), "{name} is tried both ways");
        assert!(document.contains(&format!("### {name}\n")), "docs/reference/metrics.md says what to do at {name}");
    }
}
