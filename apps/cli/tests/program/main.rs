//! Tests that run the program and the examples as their users do, and tests of rendered pictures.
//!
//! One binary: forty would each be linked with everything. `cargo test --test program rain::` runs
//! the tests of one file.
//!
//! These cost most, of some six minutes on two cores:
//!
//! | tests | protect | seconds alone on two cores |
//! |---|---|---|
//! | `faults` | that what has its final name is whole, whatever fails or ends a command | 105 |
//! | `reconstruct` | that trainings end in the same bytes however they are run, and refusals | 53 |
//! | `viewer` | pictures, security, the page in a browser, and exported sites | 46 |
//! | `examples` | that the library's examples work as they stand | 36 |
//! | `flood` | mirrors against rays, and frames as functions of time | 30 |
//! | `cover_against_rays` | that snow lies where rays reach the sky, in all views | 20 |
//! | `relit_street` | the street's light changed against the street under another sky | 18 |
//! | `rain` | the laws by which drops dim, and their lengths, angles and speeds | 12 |
//! | `device` | that a GPU draws and trains as the CPU does | 11 |
//! | `evaluate`, `bad_input` | numbers against the truth; one line of error | 10 each |
//!
//! `faults` waits for most of its time; the others compute. Of other crates the dearest are
//! `each_instrument_finds_its_own_error_and_no_other` of wm-measure, which draws with 33 planted
//! errors, and `assets` and `reflectance` of weather-magician.

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
