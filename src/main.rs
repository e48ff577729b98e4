//! Weather on real places.

#[allow(dead_code, reason = "the commands that write pictures and videos are not here yet")]
mod media;

fn main() {}
