//! Renders a video along a street in rain that begins and grows:
//! `cargo run --release -p weather-magician --example rain_video -- rain.mp4 4`

use weather_magician::video::{FrameRate, VideoSettings};
use weather_magician::view::{ViewOptions, moves};
use weather_magician::{Camera, CameraMotion, Renderer, VideoFile, Weather};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let out = args.next().unwrap_or_else(|| "rain.mp4".into());
    let seconds: f64 = args.next().map_or(Ok(4.0), |text| text.parse())?;
    let scene = wm_street::Street::builtin().sampling(0.2).scene(&|_| true).expect("nobody stops it");

    // From nothing to 30 mm/h over the video, in a wind of 4 m/s.
    let weather = Weather::clear().set("rain.rate", format!("0:0,{seconds}:30"))?.set("wind.speed", 4.0)?;
    let mut renderer = Renderer::auto()?;
    let mut place = renderer.load(scene)?;
    let start = Camera::look_at([0.0, 0.0, 1.6], [0.0, 30.0, 2.0]).size(320, 192);
    let start = start.camera(place.survey().up.value, 0.1)?;
    let options = ViewOptions { size: Some((320, 192)), ..ViewOptions::default() };
    let path = moves::dolly(&mut renderer.view_search(&place, options), &start, Some(8.0), seconds)?;
    let motion = CameraMotion::Along { path, size: (320, 192) };

    let settings = VideoSettings::new(weather_magician::PictureSize::new(320, 192), FrameRate::default());
    let video = VideoFile { path: out.as_ref(), seconds, settings };
    let report = renderer.render_video(&mut place, &weather, &motion, video, &mut ())?;
    println!("{out}: {} frames, {} bytes", report.frames, report.bytes);
    Ok(())
}
