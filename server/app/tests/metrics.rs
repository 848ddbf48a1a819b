//! Who reads the metrics of a server that has TLS and tokens.

use std::net::SocketAddr;
use std::time::SystemTime;

use kerf_server::config::ServerConfig;
use kerf_server::serve::Server;
use tokio::io::{AsyncReadExt, AsyncWriteExt};

use super::process::soon;
use super::secured::Secured;
use super::tls::dial;

#[tokio::test(flavor = "multi_thread")]
async fn metrics_take_a_viewers_token_over_tls_and_tell_when_the_certificate_ends() {
    let secured = Secured::start(|config| config.metrics_listen = Some(([127, 0, 0, 1], 0).into())).await;
    let file = |name: &str| secured.folder.path().join(name);
    let address = secured.server.metrics_address().unwrap();
    let get = async |head: String| {
        let mut stream = dial(address, &[&file("certificate.pem")], "http/1.1").await.unwrap();
        let head = format!("GET /metrics HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n{head}\r\n");
        stream.write_all(head.as_bytes()).await.unwrap();
        let mut answer = Vec::new();
        let _ = soon("an answer", stream.read_to_end(&mut answer)).await;
        String::from_utf8(answer).unwrap()
    };
    assert!(get(String::new()).await.starts_with("HTTP/1.1 401 "));
    assert!(get("authorization: Bearer wrong\r\n".into()).await.starts_with("HTTP/1.1 401 "));
    let token = std::fs::read_to_string(file("viewer")).unwrap();
    let metrics = get(format!("authorization: Bearer {}\r\n", token.trim())).await;
    assert!(metrics.starts_with("HTTP/1.1 200 ") && !metrics.contains(token.trim()), "{metrics}");
    let expiry = metrics.lines().find_map(|line| line.strip_prefix("kerf_certificate_expiry_timestamp_seconds "));
    let now_s = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap().as_secs_f64();
    let years = (expiry.unwrap().parse::<f64>().unwrap() - now_s) / (365.25 * 86400.0);
    assert!((years - 10.0).abs() < 0.05, "{years} years");
}

#[tokio::test]
async fn metrics_that_others_can_reach_take_tls_and_tokens_too() {
    let mut config = ServerConfig { listen: SocketAddr::from(([127, 0, 0, 1], 0)), ..ServerConfig::default() };
    config.metrics_listen = Some(SocketAddr::from(([0, 0, 0, 0], 0)));
    let refused = Server::start(config).await.err().expect("it does not start");
    assert!(refused.to_string().starts_with("metrics_listen = 0.0.0.0:0: others can reach it there"), "{refused}");
}
