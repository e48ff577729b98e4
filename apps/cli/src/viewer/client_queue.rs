//! Messages and frames on their way to one client.

use super::locked::locked;
use axum::body::Bytes;
use serde_json::json;
use std::collections::VecDeque;
use std::sync::Mutex;
use tokio::sync::Notify;

/// Maximum number of messages waiting for a client.
const MAX_MESSAGES: usize = 64;

/// Data to be sent to one client: text messages and the latest frame.
#[derive(Default)]
pub(crate) struct ClientQueue {
    content: Mutex<(VecDeque<String>, Option<Bytes>)>,
    /// Notified when something was added.
    pub(crate) changed: Notify,
}

impl ClientQueue {
    /// Appends a text message; drops the oldest one if there are too many.
    pub(crate) fn push_message(&self, text: String) {
        let mut content = locked(&self.content);
        if content.0.len() == MAX_MESSAGES {
            content.0.pop_front();
        }
        content.0.push_back(text);
        drop(content);
        self.changed.notify_one();
    }

    /// Appends the message that something failed.
    pub(crate) fn push_error(&self, why: &str) {
        self.push_message(json!({ "type": "error", "text": why }).to_string());
    }

    /// Sets the frame to send, in place of one that was not sent yet.
    pub(crate) fn set_picture(&self, bytes: Bytes) {
        locked(&self.content).1 = Some(bytes);
        self.changed.notify_one();
    }

    /// Removes and returns the messages and the frame.
    pub(crate) fn take_all(&self) -> (VecDeque<String>, Option<Bytes>) {
        std::mem::take(&mut *locked(&self.content))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_limited() {
        let client_queue = ClientQueue::default();
        (0..1000).for_each(|i| client_queue.push_message(i.to_string()));
        assert_eq!(client_queue.take_all().0.len(), MAX_MESSAGES);
    }
}
