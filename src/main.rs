//! Weather on real places.
fn main() {}
