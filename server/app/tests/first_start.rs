//! How a server begins that others can reach: not without TLS and tokens, unless it is told to; with a folder it makes
//! both itself, shows the token once, and logs it never.

use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use kerf_access::Access;
use kerf_proto::v1;
use kerf_proto::v1::session_service_client::SessionServiceClient;
use tonic::Code;

use super::process::soon;
use super::secured::list;
use super::tls;

/// A server that is killed where a test ends before it.
struct Served {
    child: Child,
    address: String,
}

impl Served {
    /// `kerf-server serve` on a free port of every address, and all that it says from its start to its listening and on.
    fn start(arguments: &[&str], output: &Path, log: &Path) -> Self {
        let port = std::net::TcpListener::bind(("127.0.0.1", 0)).unwrap().local_addr().unwrap().port();
        let mut command = Command::new(env!("CARGO_BIN_EXE_kerf-server"));
        command.args(["serve", "--listen", &format!("0.0.0.0:{port}")]).args(arguments).stdin(Stdio::null());
        command.stdout(File::create(output).unwrap()).stderr(File::create(log).unwrap());
        Self { child: command.spawn().unwrap(), address: format!("127.0.0.1:{port}") }
    }

    /// Ends it as an operator does.
    fn stop(mut self) {
        let told = Command::new("kill").args(["-TERM", &self.child.id().to_string()]).status().unwrap();
        assert!(told.success());
        assert!(self.child.wait().unwrap().success());
    }

    async fn connect(&self, access: &Access) -> SessionServiceClient<kerf_access::Wire> {
        soon("a server", async {
            loop {
                // Its certificate may not be there yet.
                if let Ok(endpoint) = access.endpoint(&self.address)
                    && let Ok(channel) = endpoint.connect().await
                {
                    return SessionServiceClient::new(access.token().unwrap().over(channel));
                }
                tokio::time::sleep(std::time::Duration::from_millis(20)).await;
            }
        })
        .await
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        // It may have ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn read(path: &Path) -> String {
    let mut text = Vec::new();
    File::open(path).unwrap().read_to_end(&mut text).unwrap();
    String::from_utf8_lossy(&text).into_owned()
}

#[test]
fn a_server_that_others_can_reach_does_not_start_without_tls_and_tokens() {
    let folder = tempfile::tempdir().unwrap();
    let tokens = folder.path().join("tokens.toml");
    std::fs::write(&tokens, "").unwrap();
    let with_tokens = format!("security.token_file={}", tokens.display());
    for (arguments, missing) in [
        (&["--listen", "0.0.0.0:0"][..], "neither TLS (security.certificate_file"),
        (&["--listen", "[::]:0"], "nor tokens (security.token_file)"),
        (&["--listen", "0.0.0.0:0", "--set", &with_tokens], "this server has no TLS"),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_kerf-server")).arg("serve").args(arguments).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && said.contains(missing), "{said}");
        for helps in ["--security-dir FOLDER", "--listen 127.0.0.1:0", "--insecure"] {
            assert!(said.contains(helps), "{said}");
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn told_to_be_insecure_it_starts_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let [output, log] = ["output", "log"].map(|name| folder.path().join(name));
    let served = Served::start(&["--insecure"], &output, &log);
    list(&mut served.connect(&Access::default()).await).await.unwrap();
    served.stop();
    let log = read(&log);
    assert!(log.contains("WARN") && log.contains("security.insecure: others can reach this server"), "{log}");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_first_token_is_shown_once_and_no_token_is_ever_logged() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    let security = file("security");
    let arguments = ["--security-dir", security.to_str().unwrap(), "--log-filter", "trace"];
    let served = Served::start(&arguments, &file("output"), &file("log"));
    let certificate = security.join("certificate.pem");
    let nobody = Access { ca_file: Some(certificate.clone()), token_file: None };
    let refused = list(&mut served.connect(&nobody).await).await.unwrap_err();
    assert_eq!(refused.code(), Code::Unauthenticated);
    assert!(refused.message().contains("kerf-server token new"), "{refused}");

    let shown = read(&file("output"));
    let token = shown.split_once("#token=").expect("a link").1.split_whitespace().next().unwrap().to_owned();
    let port = served.address.split_once(':').unwrap().1;
    assert!(shown.contains(&format!("    https://localhost:{port}/#token={token}\n")), "{shown}");
    assert!(shown.contains(&format!("\n    {token}\n")), "{shown}");
    std::fs::write(file("token"), &token).unwrap();
    let operator = Access { token_file: Some(file("token")), ..nobody.clone() };
    let mut client = served.connect(&operator).await;
    list(&mut client).await.unwrap();
    let scene = Some(v1::create_session_request::Scene::SceneName("jelly".into()));
    let created = client.create_session(v1::CreateSessionRequest { scene, ..Default::default() }).await.unwrap();
    let session_id = created.into_inner().session.unwrap().session_id;
    let guest = client.invite_viewer(v1::InviteViewerRequest { session_id }).await.unwrap().into_inner().token;
    // As a browser says it, right and wrong.
    let address = served.address.parse().unwrap();
    for said in [&token, &guest, "wrong-and-secret"] {
        let stream = tls::dial(address, &[&certificate], "http/1.1").await.unwrap();
        let heads = format!("authorization: Bearer {said}\r\n");
        tls::call(stream, "/kerf.v1.SessionService/ListSessions", &heads).await;
    }
    let ask = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_kerf-server"));
        command.arg("session").args(arguments).args(["--server", &served.address]).arg("--ca-file").arg(&certificate);
        command.output().unwrap()
    };
    assert_eq!(ask(&["health"]).stdout, b"serving\n");
    let listed = ask(&["list", "--token-file", file("token").to_str().unwrap()]);
    assert!(String::from_utf8_lossy(&listed.stdout).contains("jelly"), "{listed:?}");
    let refused = ask(&["list"]);
    assert!(String::from_utf8_lossy(&refused.stderr).contains("takes no call without a token"), "{refused:?}");
    served.stop();

    let served = Served::start(&arguments, &file("output-again"), &file("log-again"));
    list(&mut served.connect(&operator).await).await.unwrap();
    served.stop();
    assert_eq!(read(&file("output-again")), "");
    for log in ["log", "log-again"] {
        let log = read(&file(log));
        assert!(log.contains("TRACE") && log.contains("the certificate"), "too little is logged to tell");
        for secret in [&token, &guest, "wrong-and-secret", "authorization", "Bearer", "PRIVATE KEY"] {
            let said = log.lines().find(|line| line.to_lowercase().contains(&secret.to_lowercase()));
            assert_eq!(said, None, "{secret}");
        }
    }
    for kept in ["tokens.toml", "certificate.pem", "key.pem"] {
        let kept = security.join(kept);
        assert!(!read(&kept).contains(&token));
        let mode = std::os::unix::fs::PermissionsExt::mode(&std::fs::metadata(&kept).unwrap().permissions());
        assert_eq!(mode & 0o077, 0, "{}", kept.display());
    }
}
