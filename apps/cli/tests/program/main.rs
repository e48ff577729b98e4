//! Tests that run the program and the examples as their users do, and tests of rendered pictures.
//!
//! One binary: forty would each be linked with everything. `cargo test --test program rain::` runs the
//! tests of one file.

mod align;
mod bad_input;
mod batch;
mod bench;
mod common;
mod convert;
mod cover;
mod cover_against_rays;
mod demo;
#[cfg(feature = "gpu")]
mod device;
mod documents;
mod evaluate;
mod examples;
#[cfg(feature = "viewer")]
mod export_web;
#[cfg(unix)]
mod faults;
mod flood;
mod golden;
mod lens;
mod light;
mod measure;
mod names;
mod pairs;
mod pan;
mod paper;
mod priors;
mod process;
mod rain;
mod realism;
mod reconstruct;
mod relit_street;
mod silhouette;
mod splash;
mod time;
mod viewer;
mod visibility;
mod water;
mod weather_reports;
