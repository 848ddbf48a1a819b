//! The web viewer's files, kept in the program: `make viewer` puts them into `client/web/dist` before it is built.
//! They stand beside the services on the same port: a service's path has two parts, a file's has one.

use axum::Router;
use axum::body::Body;
use axum::extract::Path;
use axum::http::header::{
    ACCEPT_ENCODING, CACHE_CONTROL, CONTENT_ENCODING, CONTENT_SECURITY_POLICY, CONTENT_TYPE, ETAG, IF_NONE_MATCH,
    REFERRER_POLICY, VARY, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, HeaderValue, Response, StatusCode};
use axum::routing::get;
use rust_embed::{EmbeddedFile, RustEmbed};

#[derive(RustEmbed)]
#[folder = "../../client/web/dist"]
struct Files;

/// Said by a server that was built without the viewer.
const ABSENT: &str = include_str!("viewer_absent.html");

/// Scripts, pictures and calls come from this server and nowhere else.
const POLICY: &str = "default-src 'self'; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; \
                      base-uri 'none'; frame-ancestors 'none'";

/// The services' routes and the viewer's.
pub fn routes(services: Router) -> Router {
    let page = |headers: HeaderMap| async move { page(&headers) };
    let file = |Path(name): Path<String>, headers: HeaderMap| async move { file(&name, &headers) };
    services.route("/", get(page)).route("/{file}", get(file))
}

fn page(headers: &HeaderMap) -> Response<Body> {
    match Files::get("index.html") {
        Some(_) => file("index.html", headers),
        None => answer(StatusCode::OK, "text/html; charset=utf-8", Body::from(ABSENT)),
    }
}

fn file(name: &str, headers: &HeaderMap) -> Response<Body> {
    let Some((found, is_packed)) = find(name, headers) else {
        return answer(StatusCode::NOT_FOUND, "text/plain; charset=utf-8", Body::from("no such file\n"));
    };
    let tag = tag(&found);
    if headers.get(IF_NONE_MATCH).is_some_and(|known| *known == tag) {
        return with_tag(answer(StatusCode::NOT_MODIFIED, content_type(name), Body::empty()), tag, is_packed);
    }
    with_tag(answer(StatusCode::OK, content_type(name), Body::from(found.data.into_owned())), tag, is_packed)
}

/// The file, packed where it is kept packed and the browser can unpack it.
fn find(name: &str, headers: &HeaderMap) -> Option<(EmbeddedFile, bool)> {
    let accepted = headers.get(ACCEPT_ENCODING).and_then(|value| value.to_str().ok()).unwrap_or_default();
    let packed = if accepted.contains("gzip") { Files::get(&format!("{name}.gz")) } else { None };
    packed.map(|file| (file, true)).or_else(|| Files::get(name).map(|file| (file, false)))
}

fn answer(status: StatusCode, content_type: &'static str, body: Body) -> Response<Body> {
    let mut response = Response::new(body);
    *response.status_mut() = status;
    let headers = response.headers_mut();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(content_type));
    headers.insert(CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
    headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    response
}

/// A browser keeps a file and asks each time whether it is still the same: names do not change with versions.
fn with_tag(mut response: Response<Body>, tag: HeaderValue, is_packed: bool) -> Response<Body> {
    let headers = response.headers_mut();
    headers.insert(ETAG, tag);
    headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-cache"));
    headers.insert(VARY, HeaderValue::from_static("accept-encoding"));
    if is_packed {
        headers.insert(CONTENT_ENCODING, HeaderValue::from_static("gzip"));
    }
    response
}

fn tag(file: &EmbeddedFile) -> HeaderValue {
    let hex: String = file.metadata.sha256_hash()[..8].iter().map(|byte| format!("{byte:02x}")).collect();
    HeaderValue::try_from(format!("\"{hex}\"")).expect("hexadecimal digits and quotes are a header's value")
}

fn content_type(name: &str) -> &'static str {
    match name.rsplit_once('.').map(|(_, ending)| ending) {
        Some("html") => "text/html; charset=utf-8",
        Some("js") => "text/javascript; charset=utf-8",
        Some("jpg") => "image/jpeg",
        Some("css") => "text/css; charset=utf-8",
        Some("svg") => "image/svg+xml",
        Some("txt") => "text/plain; charset=utf-8",
        _ => "application/octet-stream",
    }
}
