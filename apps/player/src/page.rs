//! Messages of the player to its page.

use js_sys::{Error, Function};
use serde_json::json;
use std::fmt::Display;
use wasm_bindgen::JsValue;

/// The page's function that takes messages of the viewer.
#[derive(Clone)]
pub(crate) struct Page {
    say: Function,
}

impl Page {
    pub(crate) fn new(say: Function) -> Self {
        Self { say }
    }

    /// Says what is being done; nothing is an empty text.
    pub(crate) fn status(&self, text: &str) {
        self.message("status", text);
    }

    /// Says something that the user may want to know.
    pub(crate) fn note(&self, text: &str) {
        self.message("note", text);
    }

    fn message(&self, kind: &str, text: &str) {
        let message = json!({ "type": kind, "text": text }).to_string();
        // A page that cannot listen misses nothing that it needs.
        let _ = self.say.call1(&JsValue::NULL, &message.into());
    }

    /// Sends the words of a panic, which ends the module, to the page.
    pub(crate) fn report_panics(&self) {
        // The module has one thread, and so has the function.
        thread_local! {
            static PAGE: std::cell::RefCell<Option<Page>> = const { std::cell::RefCell::new(None) };
        }
        PAGE.with_borrow_mut(|page| *page = Some(self.clone()));
        std::panic::set_hook(Box::new(|panic| {
            PAGE.with_borrow(|page| {
                if let Some(page) = page {
                    page.message("failed", &one_line(&format!("the player has failed: {panic}")));
                }
            });
        }));
    }
}

/// An error for JavaScript, of one line.
pub(crate) fn failure(error: impl Display) -> JsValue {
    Error::new(&one_line(&error.to_string())).into()
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
