//! Videos: frames in, one MP4 out.
