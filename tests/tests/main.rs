//! The system over real gRPC, and the quick part of what docs/ reports.

mod dicing;
mod experiment;
mod extremes;
mod fuzz;
mod grpc;
mod pages;
mod paper_models;
mod releases;
mod strokes;
mod surface_hash;
mod verification;
