//! The WebSocket of a page: receives requests, sends frames and text messages.
//!
//! | message from the page | meaning |
//! |---|---|
//! | `{"type": "view", "seq": N, "moving": BOOL, "state": {...}}` | requests a frame; fields of the state that are left out keep their value |
//! | `{"type": "seen", "seq": N}` | acknowledges frame N: at most three frames are unacknowledged |
//! | `{"type": "pick", "x": 0-1, "y": 0-1}` | asks for the point of the scene at a point of the picture |
//! | `{"type": "thumbnails"}` | requests thumbnails of the presets |
//!
//! Frames are binary: the length of a JSON header (32 bits, little-endian), the header, a JPEG.
//! Text messages are JSON with a `type`: `loading`, `ready`, `failed`, `status`, `error`, `state`,
//! `facts`, `picked`, `thumbnail`.

use super::client_queue::ClientQueue;
use super::context::ViewerContext;
use super::request_queue::{ViewRequest, ViewerCommand};
use axum::extract::ws::{Message, WebSocket};
use serde::Deserialize;
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::Duration;
use tokio::time::{interval, timeout};
use wm_viewer::View;
use wm_weather::presets::PRESETS;

/// Longest time for a page to accept a message.
const MAX_SEND_TIME: Duration = Duration::from_secs(30);
const PING_INTERVAL: Duration = Duration::from_secs(20);

#[derive(Deserialize)]
#[serde(tag = "type", rename_all = "lowercase", deny_unknown_fields)]
enum ClientMessage {
    View { seq: u64, moving: bool, state: Value },
    Seen { seq: u64 },
    Pick { x: f64, y: f64 },
    Thumbnails {},
}

/// Serves a page until it disconnects.
pub(crate) async fn run(mut socket: WebSocket, context: Arc<ViewerContext>) {
    let client_queue = Arc::new(ClientQueue::default());
    let Some(id) = context.queue.add_client(Arc::clone(&client_queue)) else { return };
    let _place = ClientPlace { context: Arc::clone(&context), id };
    client_queue.push_message(context.greeting());
    let mut view: Option<Arc<View>> = None;
    let mut pings = interval(PING_INTERVAL);
    loop {
        tokio::select! {
            message = socket.recv() => match message {
                Some(Ok(Message::Text(text))) => {
                    if let Err(error) = handle_message(text.as_str(), &context, id, &client_queue, &mut view) {
                        client_queue.push_error(&error);
                    }
                }
                // Clients send text only.
                Some(Ok(Message::Ping(_) | Message::Pong(_))) => {}
                _ => break,
            },
            () = client_queue.changed.notified() => {
                let (texts, picture) = client_queue.take_all();
                let messages = texts.into_iter().map(|text| Message::Text(text.into())).chain(picture.map(Message::Binary));
                let mut is_connected = true;
                for message in messages {
                    is_connected &= matches!(timeout(MAX_SEND_TIME, socket.send(message)).await, Ok(Ok(())));
                    if !is_connected {
                        break;
                    }
                }
                if !is_connected {
                    break;
                }
            }
            _ = pings.tick() => {
                if !matches!(timeout(MAX_SEND_TIME, socket.send(Message::Ping(Default::default()))).await, Ok(Ok(()))) {
                    break;
                }
            }
        }
    }
}

/// The place of a client in the queue, which is free again when the session ends, also by a panic.
struct ClientPlace {
    context: Arc<ViewerContext>,
    id: u64,
}

impl Drop for ClientPlace {
    fn drop(&mut self) {
        self.context.queue.remove_client(self.id);
    }
}

fn handle_message(
    text: &str,
    context: &ViewerContext,
    id: u64,
    client_queue: &Arc<ClientQueue>,
    view: &mut Option<Arc<View>>,
) -> Result<(), String> {
    let message: ClientMessage = serde_json::from_str(text).map_err(|error| format!("message: {error}"))?;
    if !context.is_loaded() {
        return Ok(());
    }
    match message {
        ClientMessage::View { seq, moving, state } => {
            let before = view.as_ref().map_or_else(|| context.initial_state(), |view| view.state.clone());
            let new = View::new(before.patched(state)?, &context.catalog(), view.as_deref())?;
            let new = Arc::new(new);
            *view = Some(Arc::clone(&new));
            context.set_state(&new.state);
            context.queue.set_request(id, ViewRequest { view: new, seq, is_moving: moving });
        }
        ClientMessage::Seen { seq } => context.queue.acknowledge_frame(id, seq),
        ClientMessage::Pick { x, y } => {
            let (Some(view), true) = (view, (0.0..=1.0).contains(&x) && (0.0..=1.0).contains(&y)) else {
                return Err("pick: x and y must be 0 to 1, after a view".into());
            };
            let command = ViewerCommand::Pick {
                view: Arc::clone(view),
                at: [x, y],
                client_queue: Arc::clone(client_queue),
            };
            context.queue.push_command(command).map_err(|_| "too many requests at once".to_owned())?;
        }
        ClientMessage::Thumbnails {} => {
            let missing = PRESETS
                .iter()
                .map(|(name, _)| (*name).to_owned())
                .filter(|name| context.thumbnail(name).is_none());
            context.queue.request_thumbnails(missing);
            for name in context.thumbnail_names() {
                client_queue.push_message(json!({ "type": "thumbnail", "name": name }).to_string());
            }
        }
    }
    Ok(())
}
