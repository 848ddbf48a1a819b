//! Compiles the `.proto` files with protox: no protoc has to be installed.

use std::path::PathBuf;

use prost::Message;

const FILES: [&str; 6] = [
    "kerf/v1/types.proto",
    "kerf/v1/session.proto",
    "kerf/v1/control.proto",
    "kerf/v1/view.proto",
    "kerf/v1/recording.proto",
    "foxglove/scene.proto",
];

/// What the sidecar of a pod and the allocator speak. Apart, because a server offers no service of it.
const FILES_OF_AGONES: [&str; 3] =
    ["agones/dev/sdk/sdk.proto", "agones/dev/sdk/beta/beta.proto", "agones/allocation/allocation.proto"];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo::rerun-if-changed=kerf");
    println!("cargo::rerun-if-changed=foxglove");
    println!("cargo::rerun-if-changed=agones");
    let descriptors = protox::compile(FILES, ["."])?;
    let out_dir = PathBuf::from(std::env::var("OUT_DIR")?);
    std::fs::write(out_dir.join("kerf_descriptor.bin"), descriptors.encode_to_vec())?;
    tonic_prost_build::configure()
        .codec_path("crate::codec::StrictCodec")
        // Encoded once, and shared by all viewers that get them.
        .bytes(".kerf.v1.BodyState")
        .compile_fds(descriptors)?;
    tonic_prost_build::compile_fds(protox::compile(FILES_OF_AGONES, ["."])?)?;
    Ok(())
}
