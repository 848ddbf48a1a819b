//! The documents as a book, kept in the program and served below `/docs`: `make docs` puts it into `docs/book` before
//! the program is built.

use axum::Router;
use axum::body::Body;
use axum::extract::Path;
use axum::http::{HeaderMap, Response, StatusCode};
use axum::response::Redirect;
use axum::routing::get;
use rust_embed::RustEmbed;

use crate::embedded;

#[derive(RustEmbed)]
#[folder = "../../docs/book"]
struct Files;

/// Said by a server that was built without the book.
const ABSENT: &str = "This server was built without its documents. Run `make docs` and build it again, or read docs/ in \
                      the repository.\n";

/// mdBook's pages have scripts of their own in them, and no text of anybody else's. Everything comes from this server.
const POLICY: &str = "default-src 'self'; img-src 'self' data:; style-src 'self' 'unsafe-inline'; \
                      script-src 'self' 'unsafe-inline'; font-src 'self' data:; base-uri 'none'; frame-ancestors 'none'";

/// Adds the book to other routes.
pub fn routes(others: Router) -> Router {
    let page = |Path(name): Path<String>, headers: HeaderMap| async move { page(&name, &headers) };
    let start = |headers: HeaderMap| async move { page_of_folder("", &headers) };
    // The book's links are relative, so its start has to be a folder.
    let folder = || async { Redirect::permanent("/docs/") };
    others.route("/docs", get(folder)).route("/docs/", get(start)).route("/docs/{*page}", get(page))
}

fn page(name: &str, headers: &HeaderMap) -> Response<Body> {
    match name.strip_suffix('/') {
        Some(folder) => page_of_folder(&format!("{folder}/"), headers),
        None => embedded::file::<Files>(name, headers, POLICY),
    }
}

fn page_of_folder(folder: &str, headers: &HeaderMap) -> Response<Body> {
    if Files::get("index.html").is_none() {
        return embedded::answer(StatusCode::NOT_FOUND, "text/plain; charset=utf-8", POLICY, Body::from(ABSENT));
    }
    embedded::file::<Files>(&format!("{folder}index.html"), headers, POLICY)
}
