//! The player of exported web pages.
#![cfg(target_arch = "wasm32")]

use js_sys::Error;
use wasm_bindgen::prelude::*;
use weather_magician::{FrameOptions, Picture, PlaceOptions, PreparedPlace, Renderer};
use wm_scene::Camera;
use wm_weather::Weather;

#[wasm_bindgen]
pub struct Probe { renderer: Renderer, place: PreparedPlace, picture: Picture }

fn js(e: impl std::fmt::Display) -> JsValue { Error::new(&e.to_string()).into() }

#[wasm_bindgen]
impl Probe {
    pub async fn open(bytes: Vec<u8>, gpu: bool) -> Result<Probe, JsValue> {
        std::panic::set_hook(Box::new(|info| js_sys::eval(&format!("console.error({:?})", info.to_string())).map(|_| ()).unwrap_or(())));
        let mut renderer = if gpu { Renderer::in_browser(|e| { js_sys::eval(&format!("console.error({:?})", e.to_string())).ok(); }).await.map_err(js)? } else { Renderer::cpu().map_err(js)? };
        let scene = wm_scene::formats::read_scene_from("scene.sog".as_ref(), &bytes[..], Some(bytes.len() as u64)).map_err(js)?;
        let place = renderer.load_with(scene, &PlaceOptions::default()).map_err(js)?;
        Ok(Probe { renderer, place, picture: Picture::default() })
    }
    pub fn device(&self) -> String { self.renderer.describe() }
    pub async fn render(&mut self, weather: String, time: f64, w: u32, h: u32, eye: Vec<f64>, target: Vec<f64>) -> Result<Vec<u8>, JsValue> {
        let weather = match Weather::preset(&weather) { Ok(w) => w, Err(e) => return Err(js(e)) };
        let v = |a: &[f64]| glam::DVec3::new(a[0], a[1], a[2]);
        let camera = Camera::looking((w, h), 50.0, v(&eye), v(&target), glam::DVec3::Z).map_err(js)?;
        let options = FrameOptions::new(time, weather_magician::MovingCamera::from(camera));
        self.renderer.render_async(&mut self.place, &weather, &options, &mut self.picture, &mut ()).await.map_err(js)?;
        let rgb = wm_media::color::quantize_rgb8(&self.picture.frame.rgb, wm_media::PictureSize::new(w, h), wm_media::color::Dither::Off);
        Ok(rgb.chunks_exact(3).flat_map(|c| [c[0], c[1], c[2], 255]).collect())
    }
}
