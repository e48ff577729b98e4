//! Weather on real places.

#[allow(dead_code, reason = "the commands that write pictures and videos are not here yet")]
mod media;
#[allow(dead_code, reason = "no command uses the cameras yet")]
mod view;

fn main() {}
