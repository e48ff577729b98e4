//! Published weights from the network, into a folder where they are found again.
//!
//! A download is kept in `NAME.part` until it is whole: as long as the server said, with the
//! expected checksum if there is one, and a file of weights by its header. Only then it gets its
//! name. A download that broke off goes on where it ended, if the server still has the same file
//! (its `ETag`, kept in `NAME.part.etag`).
//!
//! Nothing here asks. Who calls it has told the user what is fetched from where, and under which
//! licence it stands.

#[cfg(test)]
mod tests;

use super::WeightsFault;
use sha2::{Digest, Sha256};
use std::fmt;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;
use std::time::Duration;
use thiserror::Error;
use ureq::Agent;
use ureq::http::header::{CONTENT_LENGTH, CONTENT_RANGE, ETAG, HeaderName, IF_RANGE, RANGE};
use ureq::tls::{RootCerts, TlsConfig};

/// Longest file that is fetched, bytes: more than ten times the largest published one.
const MAX_FILE_BYTES: u64 = 1 << 34;
/// Longest `ETag` that is kept.
const MAX_ETAG_BYTES: u64 = 1 << 10;
/// Bytes that are read at a time.
const BLOCK_BYTES: usize = 1 << 18;
/// The longest silence of a server.
const TIMEOUT: Duration = Duration::from_secs(60);

/// A published file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DownloadSource {
    /// The address, `https://` or `http://`.
    pub url: String,
    /// The name of the file in the folder.
    pub file_name: String,
    /// The expected checksum, if it is known.
    pub checksum: Option<Checksum>,
}

/// A file's SHA-256, as 64 hexadecimal digits in text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Checksum(pub [u8; 32]);

/// A text that is no [`Checksum`].
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{0:?} is no SHA-256; give its 64 hexadecimal digits, as sha256sum prints them")]
pub struct NoChecksum(String);

impl FromStr for Checksum {
    type Err = NoChecksum;

    fn from_str(text: &str) -> Result<Self, NoChecksum> {
        let digits: Option<Vec<u8>> =
            text.chars().map(|c| c.to_digit(16).and_then(|digit| u8::try_from(digit).ok())).collect();
        let digits = digits.filter(|digits| digits.len() == 64).ok_or_else(|| NoChecksum(text.into()))?;
        Ok(Self(std::array::from_fn(|i| digits[2 * i] << 4 | digits[2 * i + 1])))
    }
}

impl fmt::Display for Checksum {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

/// The progress of a download.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FetchProgress {
    /// Bytes that are there, those of an earlier run too.
    pub done: u64,
    /// Bytes of the whole file, if the server says.
    pub total: Option<u64>,
}

/// A file that could not be fetched.
#[derive(Debug, Error)]
#[error("{url}: {why}")]
pub struct FetchError {
    /// The address.
    pub url: String,
    /// The fault.
    pub why: FetchFault,
}

/// The advice where fetching does not help.
const INSTEAD: &str = "or get the file in another way and give its path";

/// A fault of a download.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum FetchFault {
    /// There is no way to the server.
    #[error("cannot be reached ({0}); try again with a connection, {INSTEAD}")]
    Unreachable(String),
    /// The server refuses.
    #[error("the server answers {0}; try again later, {INSTEAD}")]
    Refused(String),
    /// The server gives another part than was asked for, or no end of it.
    #[error("the server answers with {0}; try again later, {INSTEAD}")]
    Odd(String),
    /// The connection ended.
    #[error("broke off after {done} bytes ({what}); run it again to go on from there, {INSTEAD}")]
    BrokeOff {
        /// Bytes that are kept.
        done: u64,
        /// The reason of the server or the connection.
        what: String,
    },
    /// It is another file.
    #[error("has SHA-256 {found}, not {expected}; nothing is kept; check the expected one, {INSTEAD}")]
    Checksum {
        /// The checksum of what arrived.
        found: Checksum,
        /// The checksum that was expected.
        expected: Checksum,
    },
    /// A file of this name was there and is another one.
    #[error("{} was there already and has SHA-256 {found}, not {expected}; delete it, {INSTEAD}", path.display())]
    Other {
        /// The file.
        path: PathBuf,
        /// The checksum of the file.
        found: Checksum,
        /// The checksum that was expected.
        expected: Checksum,
    },
    /// It is something else, say a page that asks to log in.
    #[error("what arrived holds no weights ({0}); nothing is kept; try again later, {INSTEAD}")]
    NoWeights(WeightsFault),
    /// Somebody else fetches it.
    #[error("{} is being written by another program; wait for it", .0.display())]
    Busy(PathBuf),
    /// The file cannot be written.
    #[error("{}: cannot be written: {error}; give another folder, {INSTEAD}", path.display())]
    Disk {
        /// The file or folder.
        path: PathBuf,
        /// The error of the system.
        error: io::Error,
    },
}

/// The user's folder for what can be had again: `XDG_CACHE_HOME` or the platform's, and this
/// program's name; `None` where the system knows no home.
#[must_use]
pub fn cache_folder() -> Option<PathBuf> {
    let of = |variable: &str| std::env::var_os(variable).map(PathBuf::from).filter(|path| path.is_absolute());
    let home = || std::env::home_dir().filter(|path| path.is_absolute());
    let folder = of("XDG_CACHE_HOME").or_else(|| {
        if cfg!(windows) {
            of("LOCALAPPDATA")
        } else if cfg!(target_os = "macos") {
            home().map(|home| home.join("Library/Caches"))
        } else {
            home().map(|home| home.join(".cache"))
        }
    });
    folder.map(|folder| folder.join("weather-magician"))
}

/// The path of a file in `folder`, which is fetched if it is not there; the folder is made. Proxies
/// are those of the environment. `progress` is called at the start and after each block.
///
/// # Errors
/// [`FetchError`] if it cannot be fetched or written, or is not what was expected. There is no file
/// of its name then, but for one that was there.
pub fn fetch(
    source: &DownloadSource,
    folder: &Path,
    progress: &mut dyn FnMut(FetchProgress),
) -> Result<PathBuf, FetchError> {
    let tls = TlsConfig::builder()
        .root_certs(RootCerts::PlatformVerifier)
        .unversioned_rustls_crypto_provider(Arc::new(rustls::crypto::ring::default_provider()));
    let config = Agent::config_builder()
        .tls_config(tls.build())
        // A safe start leads nowhere unsafe.
        .https_only(source.url.starts_with("https://"))
        .build();
    fetch_by(&config.into(), source, folder, progress)
}

/// [`fetch`] by a way of one's own.
fn fetch_by(
    agent: &Agent,
    source: &DownloadSource,
    folder: &Path,
    progress: &mut dyn FnMut(FetchProgress),
) -> Result<PathBuf, FetchError> {
    let part = |end: &str| folder.join(format!("{}.part{end}", source.file_name));
    let download =
        Download { source, target: folder.join(&source.file_name), part: part(""), etag: part(".etag") };
    let there = download.there().and_then(|there| match there {
        true => Ok(()),
        false => download.run(agent, folder, progress),
    });
    there.map_err(|why| FetchError { url: source.url.clone(), why })?;
    Ok(download.target)
}

struct Download<'a> {
    source: &'a DownloadSource,
    target: PathBuf,
    part: PathBuf,
    /// The server's name for what the part is of.
    etag: PathBuf,
}

/// The part of a file that a server sends.
struct Answer {
    response: ureq::http::Response<ureq::Body>,
    /// The first byte that it sends.
    from: u64,
    total: Option<u64>,
}

impl Download<'_> {
    /// Returns true if the file exists already.
    fn there(&self) -> Result<bool, FetchFault> {
        let path = &self.target;
        if !path.is_file() {
            return Ok(false);
        }
        if let Some(expected) = self.source.checksum {
            let found = File::open(path).and_then(|mut file| checksum(&mut file)).map_err(disk(path))?;
            if found != expected {
                return Err(FetchFault::Other { path: path.clone(), found, expected });
            }
        }
        Ok(true)
    }

    fn run(
        &self,
        agent: &Agent,
        folder: &Path,
        progress: &mut dyn FnMut(FetchProgress),
    ) -> Result<(), FetchFault> {
        fs::create_dir_all(folder).map_err(disk(folder))?;
        let options = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&self.part);
        let mut file = options.map_err(disk(&self.part))?;
        match file.try_lock() {
            Err(TryLockError::WouldBlock) => return Err(FetchFault::Busy(self.part.clone())),
            // Some network drives know no locks.
            Err(TryLockError::Error(_)) | Ok(()) => {}
        }
        // Another program may have been faster.
        if self.there()? {
            self.forget();
            return Ok(());
        }
        if let Err(why) = self.receive(agent, &mut file, progress) {
            if file.metadata().is_ok_and(|data| data.len() == 0) {
                drop(file);
                self.forget();
            }
            return Err(why);
        }
        if let Err(why) = self.check(&mut file) {
            drop(file);
            self.forget();
            return Err(why);
        }
        file.sync_all().map_err(disk(&self.part))?;
        drop(file);
        fs::rename(&self.part, &self.target).map_err(disk(&self.target))?;
        self.forget();
        Ok(())
    }

    /// Deletes what is left of it.
    fn forget(&self) {
        for path in [&self.part, &self.etag] {
            let _ = fs::remove_file(path);
        }
    }

    /// Fetches what is missing of the part.
    fn receive(
        &self,
        agent: &Agent,
        file: &mut File,
        progress: &mut dyn FnMut(FetchProgress),
    ) -> Result<(), FetchFault> {
        let disk = || disk(&self.part);
        let kept = file.metadata().map_err(disk())?.len();
        let Answer { mut response, from, total } = self.ask(agent, kept)?;
        file.set_len(from).and_then(|()| file.seek(SeekFrom::Start(from))).map_err(disk())?;
        let mut done = from;
        let mut reader = response.body_mut().as_reader();
        let mut block = vec![0; BLOCK_BYTES];
        loop {
            progress(FetchProgress { done, total });
            let broke_off = |what: String| FetchFault::BrokeOff { done, what };
            let count = match reader.read(&mut block) {
                Ok(0) if total.is_some_and(|total| done < total) => {
                    return Err(broke_off("the connection ended".into()));
                }
                Ok(0) => return Ok(()),
                Ok(count) => count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(broke_off(error.to_string())),
            };
            done += count as u64;
            if done > total.unwrap_or(MAX_FILE_BYTES) {
                return Err(FetchFault::Odd("more than the file's length".into()));
            }
            file.write_all(&block[..count]).map_err(disk())?;
        }
    }

    /// Asks for a file from a byte on, or all of it where the part is of another file or none.
    fn ask(&self, agent: &Agent, kept: u64) -> Result<Answer, FetchFault> {
        let etag = match kept {
            0 => None,
            _ => self.kept_etag(),
        };
        let mut request = agent
            .get(&self.source.url)
            .config()
            .http_status_as_error(false)
            .user_agent(concat!("weather-magician/", env!("CARGO_PKG_VERSION")))
            .timeout_connect(Some(TIMEOUT))
            .timeout_recv_response(Some(TIMEOUT))
            .timeout_per_read(Some(TIMEOUT))
            .build();
        if let Some(etag) = &etag {
            request = request.header(RANGE, format!("bytes={kept}-")).header(IF_RANGE, etag);
        }
        let response = request.call().map_err(|error| FetchFault::Unreachable(error.to_string()))?;
        let header = |name: HeaderName| response.headers().get(name).and_then(|value| value.to_str().ok());
        let (from, total) = match response.status().as_u16() {
            200 => (0, header(CONTENT_LENGTH).and_then(|length| length.parse().ok())),
            206 if etag.is_some() => match header(CONTENT_RANGE).and_then(range) {
                Some((from, total)) if from == kept => (from, Some(total)),
                _ => return Err(FetchFault::Odd("another part than was asked for".into())),
            },
            // What is kept is no part of it.
            416 if etag.is_some() => return self.ask(agent, 0),
            _ => return Err(FetchFault::Refused(response.status().to_string())),
        };
        if total.is_some_and(|total| total > MAX_FILE_BYTES) {
            return Err(FetchFault::Odd(format!("a file of more than {MAX_FILE_BYTES} bytes")));
        }
        if from == 0 {
            // A weak one does not say that the bytes are the same.
            let strong = header(ETAG).filter(|etag| etag.starts_with('"'));
            match strong {
                Some(etag) => fs::write(&self.etag, etag).map_err(disk(&self.etag))?,
                None => drop(fs::remove_file(&self.etag)),
            }
        }
        Ok(Answer { response, from, total })
    }

    fn kept_etag(&self) -> Option<String> {
        let mut etag = String::new();
        File::open(&self.etag).ok()?.take(MAX_ETAG_BYTES).read_to_string(&mut etag).ok()?;
        // What can stand in a header.
        etag.bytes().all(|byte| (b' '..=b'~').contains(&byte)).then_some(etag).filter(|etag| !etag.is_empty())
    }

    /// Checks the file that arrived.
    fn check(&self, file: &mut File) -> Result<(), FetchFault> {
        if let Some(expected) = self.source.checksum {
            let found = checksum(file).map_err(disk(&self.part))?;
            if found != expected {
                return Err(FetchFault::Checksum { found, expected });
            }
        }
        file.seek(SeekFrom::Start(0)).map_err(disk(&self.part))?;
        super::entries(file, &self.part).map(drop).map_err(FetchFault::NoWeights)
    }
}

fn disk(path: &Path) -> impl FnOnce(io::Error) -> FetchFault {
    let path = path.to_owned();
    |error| FetchFault::Disk { path, error }
}

/// The first byte and the length of `bytes FIRST-LAST/LENGTH`.
fn range(text: &str) -> Option<(u64, u64)> {
    let (bytes, total) = text.strip_prefix("bytes ")?.split_once('/')?;
    let (first, last) = bytes.split_once('-')?;
    let (first, last, total) = (first.parse().ok()?, last.parse::<u64>().ok()?, total.parse().ok()?);
    (first <= last && last.checked_add(1)? == total).then_some((first, total))
}

/// The SHA-256 of a file.
///
/// # Errors
/// The error of the system, if it cannot be read.
pub fn checksum_of(path: &Path) -> io::Result<Checksum> {
    checksum(&mut File::open(path)?)
}

/// The checksum of a whole file.
fn checksum(file: &mut File) -> io::Result<Checksum> {
    file.seek(SeekFrom::Start(0))?;
    let (mut hash, mut block) = (Sha256::new(), vec![0; BLOCK_BYTES]);
    loop {
        match file.read(&mut block)? {
            0 => return Ok(Checksum(hash.finalize().into())),
            count => hash.update(&block[..count]),
        }
    }
}
