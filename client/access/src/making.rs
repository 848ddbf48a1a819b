//! A session that a client waits for.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use kerf_proto::v1::make_session_response::State;
use kerf_proto::v1::session_service_client::SessionServiceClient;
use kerf_proto::v1::{self, MakingStage};
use tonic::{Request, Status};

use crate::Wire;

/// Ticks of the whole bar.
const WHOLE: u64 = 1000;

/// Creates a session. A bar tells meanwhile how far its scene is, where people look at the terminal.
///
/// # Errors
/// The server's.
pub async fn make_session(
    client: &mut SessionServiceClient<Wire>,
    request: v1::CreateSessionRequest,
    timeout: Duration,
) -> Result<v1::CreateSessionResponse, Status> {
    let mut request = Request::new(v1::MakeSessionRequest { request: Some(request) });
    request.set_timeout(timeout);
    let mut answers = client.make_session(request).await?.into_inner();
    let style = ProgressStyle::with_template("{bar:24} {percent} % {wide_msg}");
    let bar = ProgressBar::new(WHOLE).with_style(style.expect("the template is sound"));
    while let Some(answer) = answers.message().await? {
        match answer.state {
            Some(State::Progress(progress)) => {
                bar.set_position((f64::from(progress.share) * WHOLE as f64) as u64);
                bar.set_message(in_plain_words(&progress));
            }
            Some(State::Created(created)) => {
                bar.finish_and_clear();
                return Ok(created);
            }
            None => {}
        }
    }
    Err(Status::unavailable("the server ended the call without a session"))
}

/// What the server does to the tissue.
fn in_plain_words(progress: &v1::MakingProgress) -> String {
    let work = match progress.stage() {
        MakingStage::Unspecified | MakingStage::Reading => return "reads the scene".into(),
        MakingStage::Voxels => "fills its voxels",
        MakingStage::Elements => "joins voxels to elements",
        MakingStage::Solver => "sets up the solver",
        MakingStage::Equilibrium => "lets it settle under its tension",
    };
    let which = match progress.objects {
        0 | 1 => "the tissue".into(),
        objects => format!("tissue {} of {objects}", progress.object + 1),
    };
    match progress.voxels {
        0 => format!("makes {which}: {work}"),
        voxels => format!("makes {which}, {voxels} voxels: {work}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_says_which_tissue_how_large_and_what_is_done() {
        let mut progress = v1::MakingProgress { objects: 2, object: 1, voxels: 30_420, ..Default::default() };
        progress.set_stage(MakingStage::Solver);
        assert_eq!(in_plain_words(&progress), "makes tissue 2 of 2, 30420 voxels: sets up the solver");
        progress = v1::MakingProgress { objects: 1, ..Default::default() };
        progress.set_stage(MakingStage::Voxels);
        assert_eq!(in_plain_words(&progress), "makes the tissue: fills its voxels");
        progress.set_stage(MakingStage::Reading);
        assert_eq!(in_plain_words(&progress), "reads the scene");
    }
}
