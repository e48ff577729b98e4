//! Pictures through lenses that are no pinholes, put together from pinhole pictures.
//!
//! A fisheye or a panorama is sampled from up to six pinhole pictures, the sides of a cube about
//! the eye, and a distorted perspective from one. So all weather is drawn in them as in any
//! picture: air, particles, lying snow and water. Neighbouring sides overlap, and one goes over
//! into the other: the two differ a little where splats are large, since each is flattened along
//! its own view. Each side has as many pixels an angle in its middle as the lens has, and more
//! towards its edges; they are sampled by cubic convolution.
//!
//! Rays through splats (`wm_render::stages::rays`) would draw the splats of a fisheye exactly, but
//! air, particles, snow and water would need a second body each.

mod spec;
mod view;

pub use spec::LensSpec;
pub use view::LensView;
pub(crate) use view::PictureRect;
