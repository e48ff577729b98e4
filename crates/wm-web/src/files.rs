//! The files of the site, fetched through the page.

use js_sys::{Function, Promise, Uint8Array};
use wasm_bindgen::{JsCast, JsValue};
use wasm_bindgen_futures::JsFuture;

/// The page's function that fetches files below `place/`.
pub struct SiteFiles {
    fetch: Function,
}

impl SiteFiles {
    pub fn new(fetch: Function) -> Self {
        Self { fetch }
    }

    /// Fetches a file.
    ///
    /// # Errors
    /// The file and the reason, in one line.
    pub async fn fetch(&self, name: &str) -> Result<Vec<u8>, String> {
        let fault = |why: JsValue| {
            let why = why.dyn_ref::<js_sys::Error>().map(|error| String::from(error.message()));
            format!("{name}: {}", why.unwrap_or_else(|| "cannot be fetched".to_owned()))
        };
        let promise = self.fetch.call1(&JsValue::NULL, &name.into()).map_err(fault)?;
        let bytes = JsFuture::from(Promise::resolve(&promise)).await.map_err(fault)?;
        let bytes = bytes.dyn_into::<Uint8Array>().map_err(|_| format!("{name}: no bytes came"))?;
        Ok(bytes.to_vec())
    }
}
