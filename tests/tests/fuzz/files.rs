//! Files that users give.

use kerf_system_tests::readers::files::{EDGE, MSH, NIFTI, NRRD, OBJ, PLY, SCENE, SCRIPT, STL, VTP, VTU, with_file};
use kerf_system_tests::readers::{Reader, corpus};

use super::fuzz;

#[test]
fn scene() {
    fuzz(&SCENE);
}

fn shapes(reader: &Reader, extension: &str) {
    let name = format!("shape{extension}");
    corpus(extension).iter().for_each(|file| drop(with_file(&name, file).expect("the corpus is read")));
    fuzz(reader);
}

#[test]
fn stl() {
    shapes(&STL, ".stl");
}

#[test]
fn obj() {
    shapes(&OBJ, ".obj");
}

#[test]
fn ply() {
    shapes(&PLY, ".ply");
}

#[test]
fn vtu() {
    shapes(&VTU, ".vtu");
}

#[test]
fn vtp() {
    shapes(&VTP, ".vtp");
}

#[test]
fn msh() {
    shapes(&MSH, ".msh");
}

#[test]
fn nifti() {
    shapes(&NIFTI, ".nii");
}

#[test]
fn nrrd() {
    shapes(&NRRD, ".nrrd");
}

#[test]
fn edge() {
    fuzz(&EDGE);
}

#[test]
fn script() {
    fuzz(&SCRIPT);
}
