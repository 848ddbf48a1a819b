//! The web viewer's files, kept in the program: `make viewer` puts them into `client/web/dist` before it is built.
//! They stand beside the services on the same port: a service's path has two parts, a file's has one.

use axum::Router;
use axum::body::Body;
use axum::extract::Path;
use axum::http::{HeaderMap, Response, StatusCode};
use axum::routing::get;
use rust_embed::RustEmbed;

use crate::{book, embedded};

#[derive(RustEmbed)]
#[folder = "../../client/web/dist"]
struct Files;

/// Said by a server that was built without the viewer.
const ABSENT: &str = include_str!("viewer_absent.html");

/// Scripts, pictures and calls come from this server and nowhere else.
const POLICY: &str = "default-src 'self'; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; \
                      base-uri 'none'; frame-ancestors 'none'";

/// The services' routes, the book's and the viewer's.
pub fn routes(services: Router) -> Router {
    let page = |headers: HeaderMap| async move { page(&headers) };
    let file = |Path(name): Path<String>, headers: HeaderMap| async move { file(&name, &headers) };
    book::routes(services).route("/", get(page)).route("/{file}", get(file))
}

fn page(headers: &HeaderMap) -> Response<Body> {
    match Files::get("index.html") {
        Some(_) => file("index.html", headers),
        None => embedded::answer(StatusCode::OK, "text/html; charset=utf-8", POLICY, Body::from(ABSENT)),
    }
}

fn file(name: &str, headers: &HeaderMap) -> Response<Body> {
    embedded::file::<Files>(name, headers, POLICY)
}
