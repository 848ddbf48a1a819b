//! The server over real gRPC on loopback: what clients do to it, and that it harms nobody else.

mod browser;
mod checkpoints;
mod control;
mod cut;
mod dial;
mod harness;
mod lifecycle;
mod view;
