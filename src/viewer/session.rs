//! A page: what it wants comes in, pictures and words go out.
//!
//! | from the page | |
//! |---|---|
//! | `{"type": "view", "seq": N, "moving": BOOL, "state": {...}}` | what it wants to see; fields of the state that are left out stay |
//! | `{"type": "seen", "seq": N}` | it shows picture N: only then more than three follow |
//! | `{"type": "pick", "x": 0-1, "y": 0-1}` | which point of the scene is there? |
//! | `{"type": "thumbnails"}` | it wants pictures of the presets |
//!
//! Pictures are binary: the length of a JSON head (32 bits, little-endian), the head, a JPEG. Words are JSON with a `type`:
//! `loading`, `ready`, `failed`, `status`, `error`, `state`, `picked`, `thumbnail`.

use super::Room;
use super::desk::{Order, Outbox, Wish};
use super::state::View;
use axum::extract::ws::{Message, WebSocket};
use serde::Deserialize;
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::Duration;
use tokio::time::{interval, timeout};
use wm_weather::presets::PRESETS;

/// How long a page may take to accept a message.
const STALL: Duration = Duration::from_secs(30);
/// How often a page is asked whether it is there.
const PING: Duration = Duration::from_secs(20);

#[derive(Deserialize)]
#[serde(tag = "type", rename_all = "lowercase", deny_unknown_fields)]
enum Said {
    View { seq: u64, moving: bool, state: Value },
    Seen { seq: u64 },
    Pick { x: f64, y: f64 },
    Thumbnails {},
}

/// Serves a page until it goes.
pub async fn run(mut socket: WebSocket, room: Arc<Room>) {
    let outbox = Arc::new(Outbox::default());
    let Some(id) = room.desk.join(Arc::clone(&outbox)) else { return };
    outbox.note(room.greeting());
    let mut view: Option<Arc<View>> = None;
    let mut pings = interval(PING);
    loop {
        tokio::select! {
            message = socket.recv() => match message {
                Some(Ok(Message::Text(text))) => {
                    if let Err(error) = hear(text.as_str(), &room, id, &outbox, &mut view) {
                        outbox.note(json!({ "type": "error", "text": error }).to_string());
                    }
                }
                // Only words are understood.
                Some(Ok(Message::Ping(_) | Message::Pong(_))) => {}
                _ => break,
            },
            () = outbox.bell.notified() => {
                let (notes, picture) = outbox.take();
                let messages = notes.into_iter().map(|note| Message::Text(note.into())).chain(picture.map(Message::Binary));
                let mut is_there = true;
                for message in messages {
                    is_there &= matches!(timeout(STALL, socket.send(message)).await, Ok(Ok(())));
                    if !is_there {
                        break;
                    }
                }
                if !is_there {
                    break;
                }
            }
            _ = pings.tick() => {
                if !matches!(timeout(STALL, socket.send(Message::Ping(Default::default()))).await, Ok(Ok(()))) {
                    break;
                }
            }
        }
    }
    room.desk.leave(id);
}

fn hear(
    text: &str,
    room: &Room,
    id: u64,
    outbox: &Arc<Outbox>,
    view: &mut Option<Arc<View>>,
) -> Result<(), String> {
    let said: Said = serde_json::from_str(text).map_err(|error| format!("message: {error}"))?;
    if !room.is_loaded() {
        return Ok(());
    }
    match said {
        Said::View { seq, moving, state } => {
            let before = view.as_ref().map_or_else(|| room.start(), |view| view.state.clone());
            let new = View::new(before.patched(state)?, room.catalog(), view.as_deref())?;
            let new = Arc::new(new);
            *view = Some(Arc::clone(&new));
            room.set_state(&new.state);
            room.desk.wish(id, Wish { view: new, seq, is_moving: moving });
        }
        Said::Seen { seq } => room.desk.seen(id, seq),
        Said::Pick { x, y } => {
            let (Some(view), true) = (view, (0.0..=1.0).contains(&x) && (0.0..=1.0).contains(&y)) else {
                return Err("pick: x and y must be 0 to 1, after a view".into());
            };
            let order = Order::Pick { view: Arc::clone(view), at: [x, y], outbox: Arc::clone(outbox) };
            room.desk.order(order).map_err(|_| "too much is asked for at once".to_owned())?;
        }
        Said::Thumbnails {} => {
            let missing = PRESETS
                .iter()
                .map(|(name, _)| (*name).to_owned())
                .filter(|name| room.thumbnail(name).is_none());
            room.desk.thumbnails(missing);
            for name in room.thumbnail_names() {
                outbox.note(json!({ "type": "thumbnail", "name": name }).to_string());
            }
        }
    }
    Ok(())
}
