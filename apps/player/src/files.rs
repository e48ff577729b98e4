//! The files of the site, fetched through the page into the store that the library reads from.

use js_sys::{Array, Function, Promise, Uint8Array};
use std::collections::BTreeSet;
use std::path::PathBuf;
use wasm_bindgen::{JsCast, JsValue};
use wasm_bindgen_futures::JsFuture;
use wm_base::files::fetched;
use wm_viewer::site::SiteFile;

/// Files that are fetched at once.
const AT_ONCE: usize = 8;

/// The page's function that fetches files below `place/`.
pub(crate) struct SiteFiles {
    fetch: Function,
    /// The names of prepared assets that the site has.
    prepared: BTreeSet<String>,
}

impl SiteFiles {
    pub(crate) fn new(fetch: Function) -> Self {
        Self { fetch, prepared: BTreeSet::new() }
    }

    /// Learns what the site has.
    pub(crate) fn of_site(self, site: &SiteFile) -> Self {
        Self { prepared: site.files.iter().map(|file| file.name.clone()).collect(), ..self }
    }

    /// Fetches a file.
    ///
    /// # Errors
    /// The file and the reason, in one line.
    pub(crate) async fn fetch(&self, name: &str) -> Result<Vec<u8>, String> {
        let promise = self.begin(name)?;
        let bytes = JsFuture::from(promise).await.map_err(|why| fault(name, &why))?;
        bytes_of(name, bytes)
    }

    fn begin(&self, name: &str) -> Result<Promise, String> {
        let promise = self.fetch.call1(&JsValue::NULL, &name.into()).map_err(|why| fault(name, &why))?;
        Ok(Promise::resolve(&promise))
    }

    /// Fetches files into the store, in order, several at once.
    ///
    /// # Errors
    /// The first file that cannot be fetched, in one line.
    pub(crate) async fn keep_all(&self, paths: &[PathBuf]) -> Result<(), String> {
        for paths in paths.chunks(AT_ONCE) {
            let names: Vec<String> = paths.iter().map(|path| path.to_string_lossy().into_owned()).collect();
            let promises = names.iter().map(|name| self.begin(name)).collect::<Result<Vec<_>, _>>()?;
            let all = Promise::all(&promises.into_iter().collect::<Array>());
            let all = JsFuture::from(all).await.map_err(|why| fault(&names.join(", "), &why))?;
            for ((name, path), bytes) in names.iter().zip(paths).zip(Array::from(&all)) {
                fetched::insert(path, bytes_of(name, bytes)?);
            }
        }
        Ok(())
    }

    /// Fetches those of these prepared assets into the store that the site has; one that cannot be
    /// fetched is made anew. Returns what is there.
    pub(crate) async fn keep_prepared(&self, names: &[String]) -> Vec<PathBuf> {
        let wanted: Vec<String> = names.iter().map(|name| format!("assets/{name}")).collect();
        let has_all = wanted.iter().all(|name| self.prepared.contains(name));
        // What is made is made of surfaces.
        let is_useful =
            |name: &String| wanted.contains(name) || !has_all && name.starts_with("assets/surfaces-");
        let mut kept = Vec::new();
        for path in self.prepared.iter().filter(|name| is_useful(name)).map(PathBuf::from) {
            if self.keep_all(std::slice::from_ref(&path)).await.is_ok() {
                kept.push(path);
            }
        }
        kept
    }
}

fn bytes_of(name: &str, bytes: JsValue) -> Result<Vec<u8>, String> {
    let bytes = bytes.dyn_into::<Uint8Array>().map_err(|_| format!("{name}: no bytes came"))?;
    Ok(bytes.to_vec())
}

fn fault(name: &str, why: &JsValue) -> String {
    let why = why.dyn_ref::<js_sys::Error>().map(|error| String::from(error.message()));
    format!("{name}: {}", why.unwrap_or_else(|| "cannot be fetched".to_owned()))
}
