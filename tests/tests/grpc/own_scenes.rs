//! Scenes of a folder of the server's, and scenes that a client sends with the files they refer to.

use kerf_proto::v1::{self, create_session_request::Scene};
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Code, Status};
use tonic_types::StatusExt;

use super::harness::{BLOCK, Harness, soon};

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
    let mut harness = Harness::with(|config| config.transport.max_request_bytes = 100_000).await;
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
    let names_limit = large.message().contains("100000 bytes (transport.max_request_bytes)");
    assert_eq!((large.code(), names_limit), (Code::ResourceExhausted, true), "{large}");
}

/// The parts of a scene, its mesh in so many bytes each.
fn parts(toml: &str, file: &[u8], bytes: usize) -> Vec<v1::UploadSceneRequest> {
    let scene = Some(Scene::SceneToml(toml.into()));
    let request = Some(v1::CreateSessionRequest { scene, start_paused: true, ..Default::default() });
    let begin = [
        v1::UploadSceneRequest { request, ..Default::default() },
        v1::UploadSceneRequest { file_name: "meshes/box.obj".into(), ..Default::default() },
    ];
    let part = |data: &[u8]| v1::UploadSceneRequest { data: data.to_vec(), ..Default::default() };
    begin.into_iter().chain(file.chunks(bytes).map(part)).collect()
}

async fn upload(harness: &mut Harness, parts: Vec<v1::UploadSceneRequest>) -> Result<v1::ObjectSummary, Status> {
    let answer = soon("an answer", harness.sessions.upload_scene(tokio_stream::iter(parts))).await?;
    Ok(answer.into_inner().session.unwrap().scene.unwrap().objects[0].clone())
}

fn assert_limit(refused: &Status, limit: &str) {
    assert_eq!(refused.code(), Code::ResourceExhausted, "{refused}");
    assert_eq!(refused.get_details_quota_failure().unwrap().violations[0].subject, limit, "{refused}");
}

#[tokio::test]
async fn a_mesh_that_is_sent_in_parts_is_the_mesh_whatever_their_size() {
    let mut harness = Harness::with(|config| config.transport.max_request_bytes = 10_000).await;
    // Longer than a message may be.
    let long = format!("{BOX_OBJ}{}", "# a remark\n".repeat(2000));
    for bytes in [7, 1000, 9000] {
        let object = upload(&mut harness, parts(&meshed(), long.as_bytes(), bytes)).await.unwrap();
        assert_eq!(object.voxels, 6 * 6 * 6);
    }
    let refused = create(
        &mut harness,
        Scene::SceneToml(meshed()),
        vec![v1::SceneFile { name: "meshes/box.obj".into(), data: long.into() }],
    );
    assert_limit(&refused.await.unwrap_err(), "max_request_bytes");
}

#[tokio::test]
async fn an_upload_that_makes_no_sense_is_refused_by_its_field_and_one_that_is_too_large_by_the_limit() {
    let mut harness = Harness::with(|config| config.transport.max_upload_bytes = 20_000).await;
    let refused = async |harness: &mut Harness, parts| upload(harness, parts).await.unwrap_err();
    let none = refused(&mut harness, Vec::new()).await;
    assert_eq!((none.code(), none.message()), (Code::InvalidArgument, "request: is required"));
    let mut headless = parts(&meshed(), BOX_OBJ.as_bytes(), 100);
    headless.remove(0);
    assert_eq!(refused(&mut harness, headless).await.message(), "request: is required");
    let mut nameless = parts(&meshed(), BOX_OBJ.as_bytes(), 100);
    nameless.remove(1);
    assert_eq!(refused(&mut harness, nameless).await.message(), "file_name: is required");
    let cut = refused(&mut harness, parts(&meshed(), &BOX_OBJ.as_bytes()[..80], 100)).await;
    assert!(cut.code() == Code::InvalidArgument && cut.message().contains("meshes/box.obj"), "{cut}");
    let mut many = parts(&meshed(), BOX_OBJ.as_bytes(), 100);
    many.extend((0..1000).map(|i| v1::UploadSceneRequest { file_name: i.to_string(), ..Default::default() }));
    let many = refused(&mut harness, many).await;
    assert!(many.code() == Code::InvalidArgument && many.message().starts_with("file_name: "), "{many}");
    let large = refused(&mut harness, parts(&meshed(), &[b'#'; 20_000], 4000)).await;
    assert_limit(&large, "max_upload_bytes");
    assert!(large.message().contains("more than 20000 bytes"), "{large}");
    let sessions = harness.sessions.list_sessions(v1::ListSessionsRequest {}).await.unwrap().into_inner().sessions;
    assert!(sessions.is_empty(), "nothing was created");
}

async fn send(
    harness: &mut Harness,
    upload_id: &str,
    file_name: &str,
    data: &[u8],
) -> Result<v1::SendSceneFileResponse, Status> {
    let (upload_id, file_name, data) = (upload_id.into(), file_name.into(), data.to_vec());
    Ok(harness.sessions.send_scene_file(v1::SendSceneFileRequest { upload_id, file_name, data }).await?.into_inner())
}

async fn create_of_upload(harness: &mut Harness, upload_id: &str) -> Result<v1::ObjectSummary, Status> {
    let scene = Some(Scene::SceneToml(meshed()));
    let request = v1::CreateSessionRequest { scene, upload_id: upload_id.into(), ..Default::default() };
    Ok(harness.sessions.create_session(request).await?.into_inner().session.unwrap().scene.unwrap().objects[0].clone())
}

#[tokio::test(flavor = "multi_thread")]
async fn files_that_came_in_a_call_a_part_are_used_once_and_what_is_not_used_is_forgotten() {
    let mut harness = Harness::with(|config| {
        config.transport.max_uploads = 1;
        config.transport.max_upload_bytes = 20_000;
    })
    .await;
    let (begin, rest) = BOX_OBJ.as_bytes().split_at(50);
    let first = send(&mut harness, "", "meshes/box.obj", begin).await.unwrap();
    assert_eq!(first.received_bytes, 50);
    let id = first.upload_id;
    assert_eq!(send(&mut harness, &id, "", rest).await.unwrap().received_bytes, BOX_OBJ.len() as u64);
    assert_eq!(create_of_upload(&mut harness, &id).await.unwrap().voxels, 6 * 6 * 6);
    let gone =
        |refused: Status| assert!(refused.code() == Code::NotFound && refused.message().starts_with("upload_id: "));
    gone(create_of_upload(&mut harness, &id).await.unwrap_err());
    gone(send(&mut harness, &id, "", rest).await.unwrap_err());
    let nameless = send(&mut harness, "", "", rest).await.unwrap_err();
    assert_eq!(nameless.message(), "file_name: is required");
    // One that is left alone gives way to the next.
    let left = send(&mut harness, "", "meshes/box.obj", begin).await.unwrap().upload_id;
    let id = send(&mut harness, "", "meshes/box.obj", BOX_OBJ.as_bytes()).await.unwrap().upload_id;
    soon("the end of the first", async { while send(&mut harness, &left, "", &[]).await.is_ok() {} }).await;
    assert_eq!(create_of_upload(&mut harness, &id).await.unwrap().voxels, 6 * 6 * 6);
    let id = send(&mut harness, "", "meshes/box.obj", &[b'#'; 15_000]).await.unwrap().upload_id;
    assert_limit(&send(&mut harness, &id, "", &[b'#'; 15_000]).await.unwrap_err(), "max_upload_bytes");
    gone(create_of_upload(&mut harness, &id).await.unwrap_err());
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_that_never_ends_gives_way_to_those_who_come_later() {
    let mut harness = Harness::with(|config| config.transport.max_uploads = 1).await;
    let (sender, trickle) = mpsc::channel(8);
    for part in parts(&meshed(), &BOX_OBJ.as_bytes()[..100], 100) {
        sender.send(part).await.unwrap();
    }
    let mut client = harness.sessions.clone();
    let call = tokio::spawn(async move { client.upload_scene(ReceiverStream::new(trickle)).await });
    // Held open.
    tokio::time::sleep(std::time::Duration::from_millis(200)).await;
    let object = upload(&mut harness, parts(&meshed(), BOX_OBJ.as_bytes(), 100)).await.unwrap();
    assert_eq!(object.voxels, 6 * 6 * 6);
    let refused = soon("the refusal of the first", call).await.unwrap().unwrap_err();
    assert_limit(&refused, "max_uploads");
    drop(sender);
    let sessions = harness.sessions.list_sessions(v1::ListSessionsRequest {}).await.unwrap().into_inner().sessions;
    assert_eq!(sessions.len(), 1);
}
