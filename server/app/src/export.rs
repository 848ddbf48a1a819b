//! Surfaces of a session that runs, as files.

use std::path::Path;

use kerf_access::Wire;
use kerf_proto::v1::session_service_client::SessionServiceClient;
use kerf_proto::v1::view_service_client::ViewServiceClient;
use kerf_proto::{MAX_MESSAGE_BYTES, PROTOCOL_VERSION, v1};
use kerf_replica::glb::{self, Object};
use kerf_replica::{Assembler, Replica, stl};
use tonic::Status;

/// Writes the surfaces of a session as they are now: into a file that ends in `.glb`, else into a folder, each closed piece as
/// STL. Says what was written, a line each.
pub async fn export(wire: Wire, session_id: &str, to: &Path) -> Result<Vec<String>, Status> {
    let objects = objects(wire, session_id).await?;
    let written = if to.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("glb")) {
        glb::write(to, &objects).map(|()| vec![to.to_owned()])
    } else {
        std::fs::create_dir_all(to).and_then(|()| stl::write_pieces(to, &objects))
    };
    let paths = written.map_err(|error| Status::unknown(format!("{}: {error}", to.display())))?;
    Ok(paths.iter().map(|path| path.display().to_string()).collect())
}

/// Every object with its surface, from the first picture that a viewer gets.
async fn objects(wire: Wire, session_id: &str) -> Result<Vec<Object>, Status> {
    let described = v1::DescribeSessionRequest { session_id: session_id.into() };
    let described = SessionServiceClient::new(wire.clone()).describe_session(described).await?.into_inner();
    let scene = described.session.and_then(|session| session.scene).unwrap_or_default();
    let request =
        v1::ViewRequest { protocol_version: PROTOCOL_VERSION, session_id: session_id.into(), ..Default::default() };
    let mut viewer = ViewServiceClient::new(wire).max_decoding_message_size(MAX_MESSAGE_BYTES);
    let mut seen = viewer.view(request).await?.into_inner();
    let (mut assembler, mut replica) = (Assembler::default(), Replica::default());
    let unreadable = |error| Status::data_loss(format!("what the server shows cannot be read: {error}"));
    while let Some(part) = seen.message().await? {
        let Some(v1::ViewResponse { message: Some(message), .. }) = assembler.take(part).map_err(unreadable)? else {
            continue;
        };
        replica.apply(&message).map_err(unreadable)?;
        if let Some(surfaces) = replica.surfaces() {
            return Ok(scene
                .objects
                .iter()
                .zip(surfaces)
                .map(|(object, surface)| Object::of(object, surface))
                .collect());
        }
    }
    Err(Status::unavailable("the session ended before it was seen"))
}
