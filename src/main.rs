//! Weather on real places.

#[allow(dead_code, reason = "no command uses the cameras yet")]
mod view;

fn main() {}
