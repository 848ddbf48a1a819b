//! Files that are kept in the program, as answers: with a tag that browsers ask by, packed where they are kept packed.

use axum::body::Body;
use axum::http::header::{
    ACCEPT_ENCODING, CACHE_CONTROL, CONTENT_ENCODING, CONTENT_SECURITY_POLICY, CONTENT_TYPE, ETAG, IF_NONE_MATCH,
    REFERRER_POLICY, VARY, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, HeaderValue, Response, StatusCode};
use rust_embed::{EmbeddedFile, RustEmbed};

/// The file of this name, under the policy of its pages.
pub fn file<Files: RustEmbed>(name: &str, headers: &HeaderMap, policy: &'static str) -> Response<Body> {
    let Some((found, is_packed)) = find::<Files>(name, headers) else {
        return answer(StatusCode::NOT_FOUND, "text/plain; charset=utf-8", policy, Body::from("no such file\n"));
    };
    let tag = tag(&found);
    if headers.get(IF_NONE_MATCH).is_some_and(|known| *known == tag) {
        return with_tag(answer(StatusCode::NOT_MODIFIED, content_type(name), policy, Body::empty()), tag, is_packed);
    }
    let body = Body::from(found.data.into_owned());
    with_tag(answer(StatusCode::OK, content_type(name), policy, body), tag, is_packed)
}

/// An answer of its own.
pub fn answer(status: StatusCode, content_type: &'static str, policy: &'static str, body: Body) -> Response<Body> {
    let mut response = Response::new(body);
    *response.status_mut() = status;
    let headers = response.headers_mut();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(content_type));
    headers.insert(CONTENT_SECURITY_POLICY, HeaderValue::from_static(policy));
    headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    response
}

/// The file, packed where it is kept packed and the browser can unpack it.
fn find<Files: RustEmbed>(name: &str, headers: &HeaderMap) -> Option<(EmbeddedFile, bool)> {
    let accepted = headers.get(ACCEPT_ENCODING).and_then(|value| value.to_str().ok()).unwrap_or_default();
    let packed = if accepted.contains("gzip") { Files::get(&format!("{name}.gz")) } else { None };
    packed.map(|file| (file, true)).or_else(|| Files::get(name).map(|file| (file, false)))
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
        Some("png") => "image/png",
        Some("webp") => "image/webp",
        Some("css") => "text/css; charset=utf-8",
        Some("svg") => "image/svg+xml",
        Some("txt") => "text/plain; charset=utf-8",
        Some("csv") => "text/csv; charset=utf-8",
        Some("woff2") => "font/woff2",
        _ => "application/octet-stream",
    }
}
