//! Scenes of a folder of the server's, and scenes that a client sends with the files they refer to.

use kerf_proto::v1::{self, create_session_request::Scene};
use tonic::{Code, Status};

use super::harness::{BLOCK, Harness};

const BOX_OBJ: &str = "v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1\n\
    f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 3 4 8 7\nf 2 3 7 6\nf 4 1 5 8\n";

/// The block, its shape the mesh of a box.
fn meshed() -> String {
    let shape = BLOCK.lines().find(|line| line.starts_with("shape = { box")).unwrap();
    BLOCK.replace(shape, "shape = { mesh = { file = \"meshes/box.obj\", scale_m_per_unit = 0.01 } }")
}

async fn create(harness: &mut Harness, scene: Scene, files: Vec<v1::SceneFile>) -> Result<v1::ObjectSummary, Status> {
    let request = v1::CreateSessionRequest { scene: Some(scene), files, ..Default::default() };
    let session = harness.sessions.create_session(request).await?.into_inner().session.unwrap();
    Ok(session.scene.unwrap().objects[0].clone())
}

#[tokio::test]
async fn scenes_of_the_servers_folder_are_listed_and_created_with_their_meshes() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("meshes")).unwrap();
    std::fs::write(folder.path().join("meshes/box.obj"), BOX_OBJ).unwrap();
    std::fs::write(folder.path().join("mine.toml"), meshed()).unwrap();
    let mut harness = Harness::with(|config| config.scene_dir = Some(folder.path().into())).await;
    let listed = harness.sessions.list_scenes(v1::ListScenesRequest {}).await.unwrap().into_inner().scenes;
    assert!(["liver", "mine"].iter().all(|name| listed.iter().any(|scene| scene.name == *name)));
    let object = create(&mut harness, Scene::SceneName("mine".into()), Vec::new()).await.unwrap();
    assert_eq!(object.voxels, 6 * 6 * 6);
    let outside = create(&mut harness, Scene::SceneName("../mine".into()), Vec::new()).await.unwrap_err();
    assert_eq!(outside.code(), Code::NotFound);
}

#[tokio::test]
async fn colours_of_a_scene_reach_its_viewers() {
    let mut harness = Harness::start().await;
    let scene = Scene::SceneToml(BLOCK.replacen("material = { ", "material = { color = \"#204080\", ", 1));
    let object = create(&mut harness, scene, Vec::new()).await.unwrap();
    assert_eq!((object.material_names, object.material_colors), (vec!["block".into()], vec!["#204080".into()]));
}

#[tokio::test]
async fn a_mesh_is_sent_with_the_scene_that_refers_to_it() {
    let mut harness = Harness::with(|config| config.transport.max_upload_bytes = 100_000).await;
    let file = |data: Vec<u8>| vec![v1::SceneFile { name: "meshes/box.obj".into(), data }];
    let mut sent = async |files| create(&mut harness, Scene::SceneToml(meshed()), files).await;
    let object = sent(file(BOX_OBJ.into())).await.unwrap();
    assert_eq!((object.voxels, object.material_colors), (6 * 6 * 6, vec![String::new()]));
    let absent = sent(Vec::new()).await.unwrap_err();
    assert_eq!((absent.code(), absent.message().contains("meshes/box.obj")), (Code::InvalidArgument, true));
    let broken = sent(file(b"v 0 0 x".to_vec())).await.unwrap_err();
    assert_eq!((broken.code(), broken.message().contains("meshes/box.obj")), (Code::InvalidArgument, true), "{broken}");
    let open = sent(file(BOX_OBJ.replace("f 4 1 5 8\n", "").into())).await.unwrap_err();
    assert_eq!(open.code(), Code::InvalidArgument, "{open}");
    let large = sent(file(vec![b'#'; 200_000])).await.unwrap_err();
    let names_limit = large.message().contains("100000 bytes (max_upload_bytes)");
    assert_eq!((large.code(), names_limit), (Code::ResourceExhausted, true), "{large}");
}
