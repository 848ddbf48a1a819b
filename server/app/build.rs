//! The viewer's files and the book are part of the program: it is built anew when they change.

fn main() {
    println!("cargo::rerun-if-changed=../../client/web/dist");
    println!("cargo::rerun-if-changed=../../docs/book");
}
