//! The HTTP interface, described in docs/guide/viewer.md.

use super::context::ViewerContext;
use super::download::Download;
use super::facts::FactError;
use super::request_queue::{MAX_CLIENTS, ResponseFormat, ViewerCommand};
use super::server::{MAX_BODY_BYTES, refusal};
use super::session;
use super::videos::MAX_FRAMES;
use axum::Router;
use axum::body::Bytes;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{Path, RawQuery, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use serde::Deserialize;
use serde_json::{Value, json};
use std::sync::Arc;
use tokio::sync::oneshot;
use weather_magician::Weather;
use weather_magician::video::FrameRate;
use weather_magician::view::ViewOptions;
use weather_magician::view::spec::{CameraSpec, parse_size};
use wm_base::files::text_of;
use wm_scene::SceneView as Photo;
use wm_viewer::state::{Follow, Pose, ViewOutput, weather_of_json, weather_to_json};
use wm_viewer::{FileNames, View, ViewState, link};

type Shared = State<Arc<ViewerContext>>;
type Answer = Result<Response, RequestError>;

/// Error of a request: a status and a message.
pub(crate) struct RequestError(StatusCode, String);

impl From<String> for RequestError {
    fn from(why: String) -> Self {
        Self(StatusCode::BAD_REQUEST, why)
    }
}

impl IntoResponse for RequestError {
    fn into_response(self) -> Response {
        refusal(self.0, self.1)
    }
}

/// Answer to a request if too many wait.
const BUSY: &str = "too many requests at once";

/// The program failed at a request.
fn failed(why: String) -> RequestError {
    RequestError(StatusCode::INTERNAL_SERVER_ERROR, why)
}

/// Returns all routes, which need the token.
pub(crate) fn routes(context: Arc<ViewerContext>) -> Router {
    Router::new()
        .route("/ws", get(socket))
        .route("/parameters", get(parameters))
        .route("/state", get(state).put(put_state))
        .route("/frame", get(frame))
        .route("/surface", post(surface))
        .route("/facts", post(change_facts))
        .route("/weather", post(read_weather))
        .route("/link", post(link_of))
        .route("/unlink", post(open_link))
        .route("/thumbnails/{name}", get(thumbnail))
        .route("/files/{kind}", post(file))
        .route("/videos", post(begin_video))
        .route("/videos/{id}", get(video).delete(stop_video))
        .route("/videos/{id}/file", get(video_file))
        .with_state(context)
}

/// Returns the view of the last state with other fields.
fn view_of(context: &ViewerContext, patch: Value) -> Result<View, String> {
    View::new(context.state().patched(patch)?, &context.catalog(), None)
}

/// Returns an error unless the scene is loaded.
fn check_loaded(context: &ViewerContext) -> Result<(), RequestError> {
    if context.is_loaded() {
        Ok(())
    } else {
        Err(RequestError(StatusCode::SERVICE_UNAVAILABLE, context.loading_text()))
    }
}

async fn socket(State(context): Shared, upgrade: WebSocketUpgrade) -> Response {
    if context.queue.client_count() >= MAX_CLIENTS {
        return refusal(
            StatusCode::SERVICE_UNAVAILABLE,
            format!("{MAX_CLIENTS} pages are open, which is the maximum; close one"),
        );
    }
    let upgrade = upgrade.max_message_size(MAX_BODY_BYTES).max_frame_size(MAX_BODY_BYTES);
    upgrade.on_upgrade(move |socket| session::run(socket, context))
}

async fn parameters(State(context): Shared) -> Answer {
    check_loaded(&context)?;
    Ok(json_answer(&context.catalog().json(&context.initial_state())))
}

async fn state(State(context): Shared) -> Answer {
    check_loaded(&context)?;
    Ok(json_answer(&context.state()))
}

async fn put_state(State(context): Shared, body: Bytes) -> Answer {
    check_loaded(&context)?;
    let view = view_of(&context, parsed(&body)?)?;
    context.set_state(&view.state);
    context.queue.broadcast(&json!({ "type": "state", "state": view.state }).to_string());
    Ok(json_answer(&view.state))
}

/// Renders a picture of the state, changed by the query.
async fn frame(State(context): Shared, RawQuery(query): RawQuery) -> Answer {
    check_loaded(&context)?;
    let (mut state, mut format) = (context.state(), ResponseFormat::Jpeg);
    for pair in query.as_deref().unwrap_or_default().split('&').filter(|pair| !pair.is_empty()) {
        let (key, value) = pair.split_once('=').unwrap_or((pair, ""));
        apply_query(&mut state, &mut format, key, &decode_query(value)?, &context)?;
    }
    let view = View::new(state, &context.catalog(), None)?;
    picture(&context, view, format).await
}

fn apply_query(
    state: &mut ViewState,
    format: &mut ResponseFormat,
    key: &str,
    value: &str,
    context: &ViewerContext,
) -> Result<(), String> {
    let number = || value.parse::<f64>().map_err(|_| format!("{key}: `{value}` is not a number"));
    match key {
        "format" => {
            *format = match value {
                "png" => ResponseFormat::Png,
                "jpeg" | "jpg" => ResponseFormat::Jpeg,
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
            let known = ViewOutput::ALL.iter().find(|(_, name)| *name == value);
            state.output =
                known.ok_or_else(|| format!("output: `{value}` is not rgb, depth, normal or alpha"))?.0;
        }
        "camera" => {
            let spec: CameraSpec = value.parse().map_err(|error| format!("{error}"))?;
            if matches!(spec, CameraSpec::File(_)) {
                return Err("camera: must be EYE:TARGET or a photo; pages cannot name files".into());
            }
            let catalog = context.catalog();
            let photo = |(name, camera): &(String, _)| Photo { name: name.clone(), camera: *camera };
            let photos: Vec<Photo> = catalog.views.iter().map(photo).collect();
            let options =
                ViewOptions { size: Some((state.size[0], state.size[1])), ..ViewOptions::default() };
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
                "unknown key `{key}`; the keys are format, time, fov, quality, divider, size, output, camera, weather and set"
            ));
        }
    }
    Ok(())
}

/// Decodes the text of a query: `%` and two hex digits for a byte, `+` for a space.
fn decode_query(text: &str) -> Result<String, String> {
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
    String::from_utf8(bytes).map_err(|_| "the query is not UTF-8".into())
}

async fn picture(context: &ViewerContext, view: View, format: ResponseFormat) -> Answer {
    let (view, busy) = (Arc::new(view), "too many pictures are requested at once");
    let picture = reply_of(context, busy, |reply| ViewerCommand::Picture { view, format, reply }).await?;
    let picture = picture.map_err(failed)?;
    let kind = if format == ResponseFormat::Png { "image/png" } else { "image/jpeg" };
    Ok(picture.response(kind))
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SurfaceParameters {
    state: Value,
    x: f64,
    y: f64,
}

/// Pushes a command and waits for its reply; `busy` is what is said if too many wait.
async fn reply_of<T>(
    context: &ViewerContext,
    busy: &str,
    command: impl FnOnce(oneshot::Sender<T>) -> ViewerCommand,
) -> Result<T, RequestError> {
    let (reply, answer) = oneshot::channel();
    let unavailable = |why: &str| RequestError(StatusCode::SERVICE_UNAVAILABLE, why.into());
    context.queue.push_command(command(reply)).map_err(|_| unavailable(busy))?;
    answer.await.map_err(|_| unavailable("the program is ending"))
}

/// Finds the point of the nearest surface at a point of a state's picture.
async fn surface(State(context): Shared, body: Bytes) -> Answer {
    check_loaded(&context)?;
    let SurfaceParameters { state, x, y } =
        serde_json::from_slice(&body).map_err(|error| format!("surface: {error}"))?;
    if !((0.0..=1.0).contains(&x) && (0.0..=1.0).contains(&y)) {
        return Err("surface: x and y must be 0 to 1".to_owned().into());
    }
    let view = Arc::new(view_of(&context, state)?);
    let found = reply_of(&context, BUSY, |reply| ViewerCommand::Surface { view, at: [x, y], reply }).await?;
    Ok(json_answer(&json!({ "point": found.map_err(failed)?.map(|point| point.to_array()) })))
}

/// Changes the facts of the scene.
async fn change_facts(State(context): Shared, body: Bytes) -> Answer {
    check_loaded(&context)?;
    let change = serde_json::from_slice(&body).map_err(|error| format!("facts: {error}"))?;
    let changed = reply_of(&context, BUSY, |reply| ViewerCommand::Facts { change, reply }).await?;
    let answer = changed.map_err(|error| match error {
        FactError::Refused(why) => RequestError(StatusCode::BAD_REQUEST, why),
        FactError::Busy(why) => RequestError(StatusCode::CONFLICT, why),
        FactError::Failed(why) => failed(why),
    })?;
    Ok(json_answer(&answer))
}

/// Converts the text of a weather file to the weather of a state.
async fn read_weather(State(context): Shared, body: Bytes) -> Answer {
    check_loaded(&context)?;
    let text = text_of(body.into()).map_err(|error| format!("the file is {error}"))?;
    Ok(json_answer(&context.catalog().read_weather(&text)?))
}

/// Returns the fragment of a link to the state in the body.
async fn link_of(State(context): Shared, body: Bytes) -> Answer {
    check_loaded(&context)?;
    let view = view_of(&context, parsed(&body)?)?;
    let text = link::encode(&view.state)?;
    Ok(([(header::CONTENT_TYPE, "text/plain; charset=utf-8")], text).into_response())
}

/// Returns the state of the fragment of a link; the size and the quality are those of the last
/// state.
async fn open_link(State(context): Shared, body: Bytes) -> Answer {
    check_loaded(&context)?;
    let fragment = std::str::from_utf8(&body).map_err(|_| "link: it is not UTF-8".to_owned())?;
    let view = link::open(fragment, &context.catalog(), &context.state())?;
    Ok(json_answer(&view.state))
}

async fn thumbnail(State(context): Shared, Path(name): Path<String>) -> Answer {
    let bytes = context.thumbnail(&name);
    let bytes = bytes.ok_or_else(|| {
        RequestError(StatusCode::NOT_FOUND, "there is no such thumbnail, or it is not rendered yet".into())
    })?;
    Ok(([(header::CONTENT_TYPE, "image/jpeg")], bytes).into_response())
}

/// Returns a file to save of the state in the body.
async fn file(State(context): Shared, Path(kind): Path<String>, body: Bytes) -> Answer {
    check_loaded(&context)?;
    let view = view_of(&context, parsed(&body)?)?;
    let catalog = context.catalog();
    let names = FileNames::of(&catalog, &view);
    let (mut response, name) = match &kind[..] {
        "picture" => (picture(&context, view, ResponseFormat::Png).await?, names.picture),
        "points" if view.lidar.is_none() => return Err("points: the state has no lidar".to_owned().into()),
        "points" => {
            let view = Arc::new(view);
            let points = reply_of(&context, BUSY, |reply| ViewerCommand::Points { view, reply }).await??;
            (points.response("application/octet-stream"), names.points)
        }
        kind => {
            let saved = names.text(kind, &catalog, &view)?.ok_or_else(|| {
                let why = "the files are picture, weather, camera, command, points and scan";
                RequestError(StatusCode::NOT_FOUND, why.into())
            })?;
            (([(header::CONTENT_TYPE, saved.kind)], saved.text).into_response(), saved.name)
        }
    };
    set_file_name(&mut response, &name)?;
    Ok(response)
}

fn set_file_name(response: &mut Response, name: &str) -> Result<(), String> {
    // File names are made of letters and digits.
    let value = format!("attachment; filename=\"{name}\"")
        .parse()
        .map_err(|_| "the file name is invalid".to_owned())?;
    response.headers_mut().insert(header::CONTENT_DISPOSITION, value);
    Ok(())
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct VideoParameters {
    state: Value,
    fps: f64,
    seconds: f64,
}

async fn begin_video(State(context): Shared, body: Bytes) -> Answer {
    check_loaded(&context)?;
    let VideoParameters { state, fps, seconds } =
        serde_json::from_slice(&body).map_err(|error| format!("video: {error}"))?;
    let rate = FrameRate::from_hz(fps).ok_or_else(|| format!("fps {fps}: must be 0.001 to 1000"))?;
    if !(seconds.is_finite() && seconds > 0.0) {
        return Err(format!("seconds {seconds}: must be above 0").into());
    }
    let frames = rate.frames_within(seconds);
    if frames > MAX_FRAMES {
        return Err(format!(
            "{frames} frames are too many for the viewer: the maximum is {MAX_FRAMES}; use `render`"
        )
        .into());
    }
    let mut state = context.state().patched(state)?;
    (state.time, state.output, state.divider) = (0.0, ViewOutput::Rgb, None);
    let view = Arc::new(View::new(state, &context.catalog(), None)?);
    let catalog = context.catalog();
    let names = FileNames::of(&catalog, &view);
    let busy = |error| RequestError(StatusCode::CONFLICT, error);
    let folder = context.workshop.subfolder().map_err(failed)?;
    let video = context.videos.add(names.video.clone(), rate, frames, folder).map_err(busy)?;
    let command = ViewerCommand::Video { view: Arc::clone(&view), job: Arc::clone(&video) };
    if context.queue.push_command(command).is_err() {
        video.end(Err(BUSY.into()));
    }
    let mut answer = video.json();
    answer["command"] = names.command(&catalog, &view, Some((rate, seconds))).trim().into();
    Ok(json_answer(&answer))
}

fn video_of(context: &ViewerContext, id: u32) -> Result<Arc<super::videos::ViewerVideo>, RequestError> {
    context.videos.get(id).ok_or_else(|| RequestError(StatusCode::NOT_FOUND, "there is no such video".into()))
}

async fn video(State(context): Shared, Path(id): Path<u32>) -> Answer {
    Ok(json_answer(&video_of(&context, id)?.json()))
}

async fn stop_video(State(context): Shared, Path(id): Path<u32>) -> Answer {
    let video = video_of(&context, id)?;
    video.stop();
    Ok(json_answer(&video.json()))
}

async fn video_file(State(context): Shared, Path(id): Path<u32>) -> Answer {
    let video = video_of(&context, id)?;
    if !video.is_done() {
        return Err(RequestError(StatusCode::CONFLICT, "the video is not finished".into()));
    }
    let file =
        Download::open(&video.path(), Arc::clone(&video)).map_err(|error| failed(error.to_string()))?;
    let mut response = file.response("video/mp4");
    set_file_name(&mut response, &video.name)?;
    Ok(response)
}

fn parsed(body: &[u8]) -> Result<Value, String> {
    serde_json::from_slice(body).map_err(|error| format!("the body is not JSON: {error}"))
}

fn json_answer(value: &impl serde::Serialize) -> Response {
    let text = serde_json::to_string(value).unwrap_or_default();
    ([(header::CONTENT_TYPE, "application/json")], text).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn queries_are_decode_query() {
        assert_eq!(decode_query("fog.mor%3D0%3A1%2C+5").unwrap(), "fog.mor=0:1, 5");
        assert_eq!(decode_query("%C3%A4").unwrap(), "ä");
        for bad in ["%", "%1", "%zz", "%ff", "%+1"] {
            assert!(decode_query(bad).is_err(), "{bad}");
        }
    }
}
