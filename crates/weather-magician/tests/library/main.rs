//! Tests of the library as its users see it.

mod align;
mod assets;
mod guide;
mod reflectance;
