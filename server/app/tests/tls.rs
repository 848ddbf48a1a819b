//! TLS: what is spoken over it, and what becomes of connections when the certificate does.

use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use kerf_proto::v1::ListSessionsRequest;
use kerf_proto::v1::session_service_client::SessionServiceClient;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;
use tokio_rustls::rustls::crypto::ring::default_provider;
use tokio_rustls::rustls::pki_types::CertificateDer;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::{ClientConfig, RootCertStore};
use tonic::transport::Endpoint;

use super::process::soon;
use super::secured::{Secured, list};

/// A connection over TLS that offers this protocol, to a server that has one of these certificates.
pub async fn dial(
    address: SocketAddr,
    certificates: &[&Path],
    protocol: &str,
) -> std::io::Result<TlsStream<TcpStream>> {
    let mut roots = RootCertStore::empty();
    for path in certificates {
        roots.add(CertificateDer::from_pem_file(path).unwrap()).unwrap();
    }
    let config =
        ClientConfig::builder_with_provider(Arc::new(default_provider())).with_safe_default_protocol_versions();
    let mut config = config.unwrap().with_root_certificates(roots).with_no_client_auth();
    config.alpn_protocols = vec![protocol.into()];
    let stream = TcpStream::connect(address).await?;
    TlsConnector::from(Arc::new(config)).connect("localhost".try_into().unwrap(), stream).await
}

/// The answer to a call as gRPC-Web over HTTP/1.1, with an empty message.
pub async fn call(mut stream: TlsStream<TcpStream>, path: &str, heads: &str) -> String {
    let head = format!(
        "POST {path} HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\ncontent-type: application/grpc-web+proto\r\n\
         content-length: 5\r\n{heads}\r\n"
    );
    stream.write_all(head.as_bytes()).await.unwrap();
    stream.write_all(&[0; 5]).await.unwrap();
    let mut answer = Vec::new();
    // The end of TLS may be missing where the connection's end says it.
    let _ = soon("an answer", stream.read_to_end(&mut answer)).await;
    String::from_utf8_lossy(&answer).into_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn grpc_comes_over_http_2_and_a_browsers_over_http_1_1() {
    let secured = Secured::start(|_| ()).await;
    assert_eq!(list(&mut secured.sessions("viewer").await).await.unwrap(), [""; 0]);
    let certificate = secured.folder.path().join("certificate.pem");
    let dial = async || dial(secured.server.address(), &[&certificate], "http/1.1").await;
    let token = std::fs::read_to_string(secured.folder.path().join("viewer")).unwrap();
    let authorization = format!("authorization: Bearer {}\r\n", token.trim());

    let stream = dial().await.unwrap();
    assert_eq!(stream.get_ref().1.alpn_protocol(), Some(&b"http/1.1"[..]));
    let answer = call(stream, "/kerf.v1.SessionService/ListScenes", &authorization).await;
    assert!(answer.starts_with("HTTP/1.1 200") && answer.contains("gummy-bear"), "{answer}");
    let refused = call(dial().await.unwrap(), "/kerf.v1.SessionService/ListScenes", "").await;
    assert!(refused.contains("grpc-status: 16") && !refused.contains("gummy-bear"), "{refused}");
    // A token does not help a page of somebody else's.
    let foreign = format!("{authorization}origin: https://elsewhere.example\r\n");
    let refused = call(dial().await.unwrap(), "/kerf.v1.SessionService/ListScenes", &foreign).await;
    assert!(refused.contains("grpc-status: 7") && !refused.contains("gummy-bear"), "{refused}");
    let own = format!("{authorization}origin: https://localhost\r\n");
    assert!(call(dial().await.unwrap(), "/kerf.v1.SessionService/ListScenes", &own).await.contains("gummy-bear"));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_page_of_an_allowed_origin_needs_a_token_and_may_read_why() {
    let page = "https://lab.example";
    let secured = Secured::start(|config| config.security.allowed_origins = vec![page.into()]).await;
    let certificate = secured.folder.path().join("certificate.pem");
    let dial = async || dial(secured.server.address(), &[&certificate], "http/1.1").await.unwrap();
    let heads = format!("origin: {page}\r\n");
    let refused = call(dial().await, "/kerf.v1.SessionService/ListScenes", &heads).await;
    assert!(refused.contains("grpc-status: 16") && !refused.contains("gummy-bear"), "{refused}");
    assert!(refused.contains(&format!("access-control-allow-origin: {page}")), "{refused}");
    let token = std::fs::read_to_string(secured.folder.path().join("viewer")).unwrap();
    let heads = format!("{heads}authorization: Bearer {}\r\n", token.trim());
    assert!(call(dial().await, "/kerf.v1.SessionService/ListScenes", &heads).await.contains("gummy-bear"));
}

#[tokio::test(flavor = "multi_thread")]
async fn who_does_not_speak_tls_gets_nothing() {
    let secured = Secured::start(|_| ()).await;
    let plain = Endpoint::from_shared(format!("http://{}", secured.server.address())).unwrap().connect_lazy();
    let mut client = SessionServiceClient::new(plain);
    assert!(soon("a refusal", client.list_sessions(ListSessionsRequest {})).await.is_err());
    let other = tempfile::tempdir().unwrap();
    let stranger = other.path().join("certificate.pem");
    let made = rcgen::generate_simple_self_signed(["localhost".to_owned()]).unwrap();
    std::fs::write(&stranger, made.cert.pem()).unwrap();
    assert!(dial(secured.server.address(), &[&stranger], "h2").await.is_err());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_new_certificate_is_taken_while_connections_stand_and_a_bad_one_is_not() {
    let secured = Secured::start(|_| ()).await;
    let file = |name: &str| secured.folder.path().join(name);
    let mut before = secured.sessions("viewer").await;
    list(&mut before).await.unwrap();
    let old = file("old.pem");
    std::fs::copy(file("certificate.pem"), &old).unwrap();

    let made = rcgen::generate_simple_self_signed(["localhost".to_owned()]).unwrap();
    std::fs::write(file("certificate.pem"), made.cert.pem()).unwrap();
    // With the key of the one before it makes no pair.
    tokio::time::sleep(Duration::from_millis(1500)).await;
    dial(secured.server.address(), &[&old], "h2").await.unwrap();
    std::fs::write(file("key.pem"), made.signing_key.serialize_pem()).unwrap();
    soon("the new certificate", async {
        while dial(secured.server.address(), &[&file("certificate.pem")], "h2").await.is_err() {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    })
    .await;
    assert!(dial(secured.server.address(), &[&old], "h2").await.is_err());
    list(&mut before).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn who_takes_too_long_over_tls_is_let_go() {
    let secured = Secured::start(|config| config.transport.handshake_timeout_s = 0.3).await;
    for begun in [
        // Nothing; the head of a record that does not come; and TLS, but no word after it.
        &[][..],
        &[[22, 3, 1, 2, 0].as_slice(), &[1; 60]].concat(),
    ] {
        let mut stream = TcpStream::connect(secured.server.address()).await.unwrap();
        stream.write_all(begun).await.unwrap();
        let mut rest = Vec::new();
        let _ = soon("the end", stream.read_to_end(&mut rest)).await;
    }
    let mut silent =
        dial(secured.server.address(), &[&secured.folder.path().join("certificate.pem")], "h2").await.unwrap();
    let mut rest = Vec::new();
    let _ = soon("the end", silent.read_to_end(&mut rest)).await;
}
