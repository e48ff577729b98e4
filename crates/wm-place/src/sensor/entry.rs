//! The table of a sensor in a rig file.

use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::path::Path;

/// A fault of a sensor's table: what is wrong, and where, if it is at one value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EntryFault {
    /// The byte of the file; `None` is the table itself.
    pub at: Option<usize>,
    /// The fault in words.
    pub says: String,
}

impl From<String> for EntryFault {
    fn from(says: String) -> Self {
        Self { at: None, says }
    }
}

impl From<&str> for EntryFault {
    fn from(says: &str) -> Self {
        says.to_owned().into()
    }
}

/// The keys and values of a sensor.
#[derive(Debug)]
pub struct SensorEntry<'a> {
    values: &'a BTreeMap<String, toml::Spanned<toml::Value>>,
    /// The folder of the rig file, where files that it names are found.
    pub folder: &'a Path,
}

impl<'a> SensorEntry<'a> {
    pub(crate) fn new(values: &'a BTreeMap<String, toml::Spanned<toml::Value>>, folder: &'a Path) -> Self {
        Self { values, folder }
    }

    /// The keys that are given, and where.
    pub(crate) fn keys(&self) -> impl Iterator<Item = (&str, usize)> {
        self.values.iter().map(|(key, value)| (key.as_str(), value.span().start))
    }

    /// The value of a key; `None` if it is not given.
    ///
    /// # Errors
    /// [`EntryFault`] if it is of another type.
    pub fn get<T: DeserializeOwned>(&self, key: &str) -> Result<Option<T>, EntryFault> {
        let Some(value) = self.values.get(key) else { return Ok(None) };
        let read = value.get_ref().clone().try_into().map_err(|error: toml::de::Error| EntryFault {
            at: Some(value.span().start),
            says: format!("{key}: {}", error.message().split_whitespace().collect::<Vec<_>>().join(" ")),
        });
        read.map(Some)
    }

    /// The name of the model of a kind, or its file: those are beside the rig's.
    ///
    /// # Errors
    /// [`EntryFault`] if there is none.
    pub fn model(&self, kind: &str) -> Result<String, EntryFault> {
        let Some(name) = self.get::<String>("model")? else {
            return Err(format!("model is missing: the name of a {kind}, or a TOML file").into());
        };
        let is_file = name.to_lowercase().ends_with(".toml");
        Ok(if is_file { self.folder.join(name).to_string_lossy().into_owned() } else { name })
    }
}
