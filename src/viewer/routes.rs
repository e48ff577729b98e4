//! The HTTP interface, described in docs/guide/viewer.md.

use super::Room;
use super::desk::{Form, MOST_CLIENTS, Order};
use super::server::{MOST_BYTES, assets, refusal};
use super::session;
use super::state::{Follow, Output, Pose, View, ViewState, weather_of_json, weather_to_json};
use super::videos::MOST_FRAMES;
use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{Path, RawQuery, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use serde::Deserialize;
use serde_json::{Value, json};
use std::sync::Arc;
use tokio::sync::oneshot;
use weather_magician::view::Options;
use weather_magician::view::spec::{CameraSpec, parse_size};
use wm_media::video::FrameRate;
use wm_scene::SceneView as Photo;
use wm_weather::Weather;

type Shared = State<Arc<Room>>;
type Answer = Result<Response, Fault>;

/// Why a request is not answered.
pub struct Fault(StatusCode, String);

impl From<String> for Fault {
    fn from(why: String) -> Self {
        Self(StatusCode::BAD_REQUEST, why)
    }
}

impl IntoResponse for Fault {
    fn into_response(self) -> Response {
        refusal(self.0, self.1)
    }
}

/// All routes.
pub fn routes(room: Arc<Room>) -> Router {
    let router = assets! {
        Router::new(),
        "/" => "index.html", "text/html; charset=utf-8";
        "/style.css" => "style.css", "text/css";
        "/icon.svg" => "icon.svg", "image/svg+xml";
        "/main.js" => "main.js", "text/javascript";
        "/camera.js" => "camera.js", "text/javascript";
        "/controls.js" => "controls.js", "text/javascript";
        "/connection.js" => "connection.js", "text/javascript";
        "/dom.js" => "dom.js", "text/javascript";
        "/files.js" => "files.js", "text/javascript";
        "/panels.js" => "panels.js", "text/javascript";
        "/store.js" => "store.js", "text/javascript";
        "/timeline.js" => "timeline.js", "text/javascript";
        "/tracks.js" => "tracks.js", "text/javascript";
    };
    router
        .route("/ws", get(socket))
        .route("/parameters", get(parameters))
        .route("/state", get(state).put(put_state))
        .route("/frame", get(frame))
        .route("/weather", post(read_weather))
        .route("/thumbnails/{name}", get(thumbnail))
        .route("/files/{kind}", post(file))
        .route("/videos", post(begin_video))
        .route("/videos/{id}", get(video).delete(stop_video))
        .route("/videos/{id}/file", get(video_file))
        .with_state(room)
}

/// The room, once the scene is there.
fn loaded(room: &Room) -> Result<(), Fault> {
    if room.is_loaded() { Ok(()) } else { Err(Fault(StatusCode::SERVICE_UNAVAILABLE, room.loading())) }
}

async fn socket(State(room): Shared, upgrade: WebSocketUpgrade) -> Response {
    if room.desk.clients() >= MOST_CLIENTS {
        return refusal(StatusCode::SERVICE_UNAVAILABLE, format!("{MOST_CLIENTS} pages are open; close one"));
    }
    let upgrade = upgrade.max_message_size(MOST_BYTES).max_frame_size(MOST_BYTES);
    upgrade.on_upgrade(move |socket| session::run(socket, room))
}

async fn parameters(State(room): Shared) -> Answer {
    loaded(&room)?;
    Ok(json_answer(&room.catalog().json(&room.start())))
}

async fn state(State(room): Shared) -> Answer {
    loaded(&room)?;
    Ok(json_answer(&room.state()))
}

async fn put_state(State(room): Shared, body: Bytes) -> Answer {
    loaded(&room)?;
    let state = room.state().patched(parsed(&body)?)?;
    let view = View::new(state, room.catalog(), None)?;
    room.set_state(&view.state);
    room.desk.tell_all(&json!({ "type": "state", "state": view.state }).to_string());
    Ok(json_answer(&view.state))
}

/// A picture of the state with what the query changes of it.
async fn frame(State(room): Shared, RawQuery(query): RawQuery) -> Answer {
    loaded(&room)?;
    let (mut state, mut form) = (room.state(), Form::Jpeg);
    for pair in query.as_deref().unwrap_or_default().split('&').filter(|pair| !pair.is_empty()) {
        let (key, value) = pair.split_once('=').unwrap_or((pair, ""));
        change(&mut state, &mut form, key, &unescaped(value)?, &room)?;
    }
    let view = View::new(state, room.catalog(), None)?;
    picture(&room, view, form).await
}

fn change(state: &mut ViewState, form: &mut Form, key: &str, value: &str, room: &Room) -> Result<(), String> {
    let number = || value.parse::<f64>().map_err(|_| format!("{key}: `{value}` is no number"));
    match key {
        "format" => {
            *form = match value {
                "png" => Form::Png,
                "jpeg" | "jpg" => Form::Jpeg,
                _ => return Err(format!("format: `{value}` is neither png nor jpeg")),
            };
        }
        "time" => state.time = number()?,
        "fov" => state.camera.fov = number()?,
        "quality" => {
            state.quality = value.parse().map_err(|_| format!("quality: `{value}` is not 1 to 100"))?;
        }
        "divider" => state.divider = if value == "off" { None } else { Some(number()?) },
        "size" => {
            let (width, height) = parse_size(value).map_err(|error| error.to_string())?;
            state.size = [width, height];
        }
        "output" => {
            let known = Output::ALL.iter().find(|(_, name)| *name == value);
            state.output =
                known.ok_or_else(|| format!("output: `{value}` is not rgb, depth, normal or alpha"))?.0;
        }
        "camera" => {
            let spec: CameraSpec = value.parse().map_err(|error| format!("{error}"))?;
            if matches!(spec, CameraSpec::File(_)) {
                return Err("camera: give EYE:TARGET or a photo; files are not read for pages".into());
            }
            let catalog = room.catalog();
            let photo = |(name, camera): &(String, _)| Photo { name: name.clone(), camera: *camera };
            let photos: Vec<Photo> = catalog.views.iter().map(photo).collect();
            let options = Options { size: Some((state.size[0], state.size[1])), ..Options::default() };
            let camera =
                spec.camera(&photos, &catalog.survey, &options).map_err(|error| error.to_string())?;
            (state.camera, state.follow) = (Pose::of(&camera), Follow::Camera);
        }
        "weather" => {
            let weather = Weather::preset(value).map_err(|error| format!("weather: {error}"))?;
            state.weather = weather_to_json(&weather);
        }
        "set" => {
            let mut weather = weather_of_json(&state.weather)?;
            weather.set_text(value).map_err(|error| error.to_string())?;
            state.weather = weather_to_json(&weather);
        }
        _ => {
            return Err(format!(
                "there is no `{key}`; there are format, time, fov, quality, divider, size, output, camera, weather and set"
            ));
        }
    }
    Ok(())
}

/// A text of a query: `%` and two digits for a byte, `+` for a space.
fn unescaped(text: &str) -> Result<String, String> {
    let (mut bytes, mut rest) = (Vec::new(), text.bytes());
    while let Some(byte) = rest.next() {
        bytes.push(match byte {
            b'+' => b' ',
            b'%' => {
                let digit = |byte: Option<u8>| char::from(byte?).to_digit(16);
                let (high, low) = (digit(rest.next()), digit(rest.next()));
                let both =
                    high.zip(low).ok_or_else(|| format!("`{text}`: % must be followed by two hex digits"))?;
                (both.0 * 16 + both.1) as u8
            }
            byte => byte,
        });
    }
    String::from_utf8(bytes).map_err(|_| "the query is no text in UTF-8".into())
}

async fn picture(room: &Room, view: View, form: Form) -> Answer {
    let (reply, answer) = oneshot::channel();
    let busy = || Fault(StatusCode::SERVICE_UNAVAILABLE, "too many pictures are asked for at once".into());
    room.desk.order(Order::Picture { view: Arc::new(view), form, reply }).map_err(|_| busy())?;
    let gone = |_| Fault(StatusCode::SERVICE_UNAVAILABLE, "the program is ending".into());
    let bytes =
        answer.await.map_err(gone)?.map_err(|error| Fault(StatusCode::INTERNAL_SERVER_ERROR, error))?;
    let kind = if form == Form::Png { "image/png" } else { "image/jpeg" };
    Ok(([(header::CONTENT_TYPE, kind)], bytes).into_response())
}

/// The text of a weather file as the weather of a state.
async fn read_weather(State(room): Shared, body: Bytes) -> Answer {
    loaded(&room)?;
    let text = std::str::from_utf8(&body).map_err(|_| "the file is no text in UTF-8".to_owned())?;
    let mut weather = Weather::parse(text, "weather.toml").map_err(|error| error.to_string())?;
    if weather.name.is_empty() {
        weather.name = "mine".into();
    }
    room.catalog().load(&mut weather)?;
    Ok(json_answer(&weather_to_json(&weather)))
}

async fn thumbnail(State(room): Shared, Path(name): Path<String>) -> Answer {
    let bytes = room.thumbnail(&name);
    let bytes =
        bytes.ok_or_else(|| Fault(StatusCode::NOT_FOUND, "there is no such picture, or not yet".into()))?;
    Ok(([(header::CONTENT_TYPE, "image/jpeg")], bytes).into_response())
}

/// What is saved of a state, which is the body.
async fn file(State(room): Shared, Path(kind): Path<String>, body: Bytes) -> Answer {
    loaded(&room)?;
    let state = room.state().patched(parsed(&body)?)?;
    let view = View::new(state, room.catalog(), None)?;
    let names = Names::of(&room, &view);
    let (name, kind, text) = match &kind[..] {
        "picture" => {
            let mut response = picture(&room, view, Form::Png).await?;
            name_file(&mut response, &names.picture)?;
            return Ok(response);
        }
        "weather" => (names.weather.clone(), "application/toml", view.weather.to_toml()),
        "camera" => (names.camera.clone(), "application/json", view.camera_file.clone()),
        "command" => ("command.txt".into(), "text/plain; charset=utf-8", names.command(&room, &view, None)),
        _ => {
            return Err(Fault(
                StatusCode::NOT_FOUND,
                "there are picture, weather, camera and command".into(),
            ));
        }
    };
    let mut response = ([(header::CONTENT_TYPE, kind)], text).into_response();
    name_file(&mut response, &name)?;
    Ok(response)
}

fn name_file(response: &mut Response, name: &str) -> Result<(), String> {
    // Names are made of letters and digits, see below.
    let value = format!("attachment; filename=\"{name}\"").parse().map_err(|_| "no such name".to_owned())?;
    response.headers_mut().insert(header::CONTENT_DISPOSITION, value);
    Ok(())
}

/// What the files of a state are called.
struct Names {
    weather: String,
    camera: String,
    picture: String,
    video: String,
}

impl Names {
    fn of(room: &Room, view: &View) -> Self {
        let plain = |text: &str| -> String {
            let keep = |c: char| if c.is_ascii_alphanumeric() || "-_".contains(c) { c } else { '-' };
            text.chars().take(60).map(keep).collect()
        };
        let base = format!("{}-{}", plain(&room.catalog().stem), plain(&view.weather.name));
        Self {
            weather: format!("{base}.toml"),
            camera: format!("{base}.camera.json"),
            picture: format!("{base}.png"),
            video: format!("{base}.mp4"),
        }
    }

    /// The command that renders the same; `video` is frames a second and seconds.
    fn command(&self, room: &Room, view: &View, video: Option<(FrameRate, f64)>) -> String {
        let catalog = room.catalog();
        let mut words = vec!["weather-magician".to_owned(), "render".into()];
        words.extend(catalog.words.iter().cloned());
        let state = &view.state;
        let [width, height] = state.size;
        let camera = if state.follow == Follow::Path { "path" } else { "camera" };
        let mut add = |option: &str, value: String| words.push(format!("--{option}={value}"));
        add("weather", self.weather.clone());
        add(camera, self.camera.clone());
        add("size", format!("{width}x{height}"));
        match video {
            Some((rate, seconds)) => {
                add("fps", rate.to_string());
                add("seconds", seconds.to_string());
                add("out", self.video.clone());
            }
            None => {
                add("time", state.time.to_string());
                if state.output != Output::Rgb {
                    add("also", state.output.name().into());
                }
                add("out", self.picture.clone());
            }
        }
        words.extend(catalog.run_words.iter().cloned());
        words.iter().map(|word| shell_word(word)).collect::<Vec<_>>().join(" ") + "\n"
    }
}

/// A word as a POSIX shell takes it for one.
fn shell_word(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_./:=,+@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.into()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct AskedVideo {
    state: Value,
    fps: f64,
    seconds: f64,
}

async fn begin_video(State(room): Shared, body: Bytes) -> Answer {
    loaded(&room)?;
    let AskedVideo { state, fps, seconds } =
        serde_json::from_slice(&body).map_err(|error| format!("video: {error}"))?;
    let rate = FrameRate::from_hz(fps).ok_or_else(|| format!("fps {fps}: must be 0.001 to 1000"))?;
    if !(seconds.is_finite() && seconds > 0.0) {
        return Err(format!("seconds {seconds}: must be above 0").into());
    }
    let frames = rate.frames_within(seconds);
    if frames > MOST_FRAMES {
        return Err(
            format!("{frames} frames are too many here: the most is {MOST_FRAMES}; use `render`").into()
        );
    }
    let mut state = room.state().patched(state)?;
    (state.time, state.output, state.divider) = (0.0, Output::Rgb, None);
    let view = Arc::new(View::new(state, room.catalog(), None)?);
    let names = Names::of(&room, &view);
    let busy = |error| Fault(StatusCode::CONFLICT, error);
    let video = room.videos.begin(names.video.clone(), rate, frames).map_err(busy)?;
    let order = Order::Video { view: Arc::clone(&view), job: Arc::clone(&video) };
    if room.desk.order(order).is_err() {
        video.end(Err("too much is asked for at once".into()));
    }
    let mut answer = video.json();
    answer["command"] = names.command(&room, &view, Some((rate, seconds))).trim().into();
    Ok(json_answer(&answer))
}

fn video_of(room: &Room, id: u32) -> Result<Arc<super::videos::Video>, Fault> {
    room.videos.get(id).ok_or_else(|| Fault(StatusCode::NOT_FOUND, "there is no such video".into()))
}

async fn video(State(room): Shared, Path(id): Path<u32>) -> Answer {
    Ok(json_answer(&video_of(&room, id)?.json()))
}

async fn stop_video(State(room): Shared, Path(id): Path<u32>) -> Answer {
    let video = video_of(&room, id)?;
    video.stop();
    Ok(json_answer(&video.json()))
}

async fn video_file(State(room): Shared, Path(id): Path<u32>) -> Answer {
    let video = video_of(&room, id)?;
    if !video.is_done() {
        return Err(Fault(StatusCode::CONFLICT, "the video is not done".into()));
    }
    let file = std::fs::read(video.path())
        .map_err(|error| Fault(StatusCode::INTERNAL_SERVER_ERROR, error.to_string()))?;
    let mut response = ([(header::CONTENT_TYPE, "video/mp4")], Body::from(file)).into_response();
    name_file(&mut response, &video.name)?;
    Ok(response)
}

fn parsed(body: &[u8]) -> Result<Value, String> {
    serde_json::from_slice(body).map_err(|error| format!("the body is no JSON: {error}"))
}

fn json_answer(value: &impl serde::Serialize) -> Response {
    let text = serde_json::to_string(value).unwrap_or_default();
    ([(header::CONTENT_TYPE, "application/json")], text).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn queries_are_unescaped() {
        assert_eq!(unescaped("fog.mor%3D0%3A1%2C+5").unwrap(), "fog.mor=0:1, 5");
        assert_eq!(unescaped("%C3%A4").unwrap(), "ä");
        for bad in ["%", "%1", "%zz", "%ff", "%+1"] {
            assert!(unescaped(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn words_survive_a_shell() {
        assert_eq!(shell_word("--camera=a-b.camera.json"), "--camera=a-b.camera.json");
        assert_eq!(shell_word("my place.ply"), "'my place.ply'");
        assert_eq!(shell_word("it's; $(rm)"), r"'it'\''s; $(rm)'");
        assert_eq!(shell_word(""), "''");
    }
}
