//! What lies beneath the surface, told to whoever asks.

use kerf_proto::v1::{self, view_service_client::ViewServiceClient};
use tonic::{Code, Status};
use tonic_types::StatusExt;

use super::cut::{ABOVE_M, FOOT_M, Stroke};
use super::harness::{BLOCK, Harness, no_expiry};

async fn interior(harness: &Harness, session_id: &str, object: u32) -> Result<v1::GetInteriorResponse, Status> {
    let mut views = ViewServiceClient::new(harness.channel.clone());
    let request = v1::GetInteriorRequest { session_id: session_id.into(), object };
    views.get_interior(request).await.map(tonic::Response::into_inner)
}

/// Links by their ends, as long as a voxel's edge at rest.
fn lengths_m<'a>(told: &'a v1::GetInteriorResponse, links: &'a [u32]) -> impl Iterator<Item = f32> + 'a {
    let at = |voxel: u32| &told.voxel_positions_m[3 * voxel as usize..][..3];
    links.chunks(2).map(move |ends| {
        let along = at(ends[0]).iter().zip(at(ends[1])).map(|(a, b)| (a - b).powi(2));
        along.sum::<f32>().sqrt()
    })
}

#[tokio::test]
async fn voxels_links_and_energies_are_those_of_the_block_at_rest_pressed_and_cut() {
    let mut harness = Harness::with(no_expiry).await;
    // Held in whole elements: of an element that is held in part, less than its voxels is strained.
    let scene = BLOCK.replace("-0.005, 0.02", "-0.004, 0.02");
    assert_ne!(scene, BLOCK);
    let session = harness.create_of(scene).await.unwrap();
    let stats = harness.server.registry().get(&session).unwrap().object_stats()[0];
    let at_rest = interior(&harness, &session, 0).await.unwrap();
    assert_eq!(at_rest.voxel_positions_m.len(), 3 * stats.voxels as usize);
    assert_eq!(at_rest.voxel_elements.len(), stats.voxels as usize);
    assert_eq!(at_rest.element_energies_j_per_m3.len(), stats.composite_elements as usize);
    // A box of a x b x c voxels has 3 a b c - a b - b c - c a links.
    let dims = [0, 1, 2].map(|i| ((stats.rest_max_m[i] - stats.rest_min_m[i]) / stats.voxel_size_m).round() as usize);
    let [a, b, c] = dims;
    assert_eq!(at_rest.intact_links.len() / 2, 3 * a * b * c - a * b - b * c - c * a);
    assert!(at_rest.parted_links.is_empty());
    let h = stats.voxel_size_m as f32;
    assert!(lengths_m(&at_rest, &at_rest.intact_links).all(|length_m| (length_m - h).abs() < 1e-4 * h));
    assert!(at_rest.element_energies_j_per_m3.iter().all(|energy| energy.abs() < 1e-3));

    // What the elements hold is the energy that the ledger has.
    let mut stroke = Stroke::begin(&harness, &session).await;
    stroke.press(ABOVE_M, FOOT_M).await;
    harness.pause(&session).await;
    let cut = interior(&harness, &session, 0).await.unwrap();
    let described = harness.describe(&session).await;
    assert_eq!((cut.step, cut.topology_version), (described.step, described.topology_version));
    assert_eq!(cut.intact_links.len() + cut.parted_links.len(), at_rest.intact_links.len());
    assert!(!cut.parted_links.is_empty());
    let mut voxels = vec![0u32; cut.element_energies_j_per_m3.len()];
    cut.voxel_elements.iter().for_each(|element| voxels[*element as usize] += 1);
    let energies = cut.element_energies_j_per_m3.iter().zip(&voxels);
    let told_j: f64 = energies.map(|(e, voxels)| f64::from(e * *voxels as f32) * f64::from(h.powi(3))).sum();
    let booked_j = described.energy.unwrap().elastic_j;
    assert!((told_j / booked_j - 1.0).abs() < 1e-4, "{told_j} J and {booked_j} J");
}

#[tokio::test]
async fn an_object_that_is_not_there_and_one_of_too_many_voxels_are_refused_by_name() {
    let mut harness = Harness::with(|config| config.view.max_interior_voxels = 10).await;
    let session = harness.create_of(BLOCK.into()).await.unwrap();
    let violation = |status: Status| {
        assert_eq!(status.code(), Code::InvalidArgument);
        let violations = status.get_details_bad_request().unwrap().field_violations;
        (violations[0].field.clone(), status.message().to_owned())
    };
    let (field, words) = violation(interior(&harness, &session, 1).await.unwrap_err());
    assert_eq!((field.as_str(), words.as_str()), ("object", "object = 1: the scene has 1, counted from 0"));
    let (field, words) = violation(interior(&harness, &session, 0).await.unwrap_err());
    assert_eq!(field, "object");
    assert!(words.ends_with("the inside of 10 at most is told (view.max_interior_voxels)"), "{words}");
    let unknown = interior(&harness, "7", 0).await.unwrap_err();
    assert_eq!(unknown.code(), Code::NotFound);
}
