//! The schemas of a recording's messages: each with the files that it needs, and those without their comments.

use std::collections::BTreeSet;

use kerf_proto::FILE_DESCRIPTOR_SET;
use prost::Message;
use prost_types::{FileDescriptorProto, FileDescriptorSet};

/// All that the server's messages are made of.
pub struct Schemas(Vec<FileDescriptorProto>);

impl Schemas {
    /// Those that are compiled in.
    pub fn new() -> Self {
        let mut files = FileDescriptorSet::decode(FILE_DESCRIPTOR_SET).expect("compiled in").file;
        for file in &mut files {
            file.source_code_info = None;
            file.service.clear();
        }
        Self(files)
    }

    /// A message's file and those that it imports, as an encoded set; empty for an unknown message.
    pub fn of(&self, message: &str) -> Vec<u8> {
        let is_in = |file: &&FileDescriptorProto| {
            let inner = message.strip_prefix(file.package()).and_then(|name| name.strip_prefix('.'));
            file.message_type.iter().any(|descriptor| Some(descriptor.name()) == inner)
        };
        let mut names = BTreeSet::new();
        let mut open: Vec<&FileDescriptorProto> = self.0.iter().find(is_in).into_iter().collect();
        while let Some(file) = open.pop() {
            if names.insert(file.name()) {
                open.extend(self.0.iter().filter(|other| file.dependency.iter().any(|name| name == other.name())));
            }
        }
        let file = self.0.iter().filter(|file| names.contains(file.name())).cloned().collect();
        FileDescriptorSet { file }.encode_to_vec()
    }
}
