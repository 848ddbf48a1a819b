//! The viewer's files are part of the program: it is built anew when they change.

fn main() {
    println!("cargo::rerun-if-changed=../../client/web/dist");
}
