//! The server over real gRPC on loopback: what clients do to it, and that it harms nobody else.

mod anew;
mod browser;
mod bystander;
mod checkpoint_files;
mod checkpoints;
mod control;
mod cut;
mod deadband;
mod dial;
mod frames;
mod given_up;
mod harness;
mod hostile;
mod interior;
mod lifecycle;
mod lock_step;
mod own_scenes;
mod recorded;
mod secured;
mod stale;
mod station;
mod unfinished;
mod vectors;
mod vertices;
mod view;
