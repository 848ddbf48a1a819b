//! Messages and services of Kerf, generated from `kerf/v1/*.proto` and `foxglove/*.proto`, and those of Agones's sidecar.
//!
//! Deliberately absent: logic. Conversions live with the server, checks of what comes in with
//! whoever receives it.

pub mod codec;
pub mod integers;

/// The package `kerf.v1`.
// Generated code: its style is not ours, and private glue in it carries no docs.
#[allow(clippy::all, missing_docs, unused_qualifications)]
pub mod v1 {
    tonic::include_proto!("kerf.v1");
}

/// As much of Foxglove's schemas as recordings use.
// Generated code, as above.
#[allow(clippy::all, missing_docs, unused_qualifications)]
pub mod foxglove {
    tonic::include_proto!("foxglove");
}

/// As much of Agones's SDK as a server uses.
// Generated code, as above.
#[allow(clippy::all, missing_docs, unused_qualifications)]
pub mod agones {
    tonic::include_proto!("agones.dev.sdk");

    /// Counters.
    pub mod beta {
        tonic::include_proto!("agones.dev.sdk.beta");
    }

    /// The allocator, which is asked for a server of a fleet.
    pub mod allocation {
        tonic::include_proto!("allocation");
    }
}

/// The version that both ends of a stream name in their first message.
pub const PROTOCOL_VERSION: u32 = 3;

/// Where a session has moved, as an address: metadata of the status that a stream of it ends in, and that whoever asks for it
/// gets.
pub const MOVED_TO: &str = "kerf-moved-to";

/// Largest message that either side accepts: a keyframe takes 40 bytes per surface vertex, so this
/// carries a surface of 1.6 million vertices, a hundred times the liver's.
pub const MAX_MESSAGE_BYTES: usize = 64 << 20;

/// The compiled `.proto` files, for reflection and for the schemas of recordings.
pub const FILE_DESCRIPTOR_SET: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/kerf_descriptor.bin"));

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_files_and_the_document_name_the_version_that_is_spoken() {
        let files = [include_str!("../kerf/v1/control.proto"), include_str!("../kerf/v1/view.proto")];
        let named: Vec<_> = files.iter().flat_map(|file| file.split(" speaks: ").skip(1)).collect();
        assert_eq!(named.len(), 4);
        let version = PROTOCOL_VERSION.to_string();
        assert!(named.iter().all(|named| named.split('.').next() == Some(&version)), "{named:?}");
        let document = include_str!("../../docs/reference/protocol.md");
        assert!(document.contains(&format!("states the version it speaks, {version}:")));
    }
}
