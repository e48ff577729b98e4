//! Bodies of responses that are read while they are sent: a client that does not read them costs no
//! memory.

use axum::body::{Body, Bytes};
use axum::http::header;
use axum::response::{IntoResponse, Response};
use hyper::body::{Frame, SizeHint};
use std::any::Any;
use std::fs::File;
use std::io::{self, Cursor, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::pin::Pin;
use std::task::{Context, Poll};

/// Bytes that are read at once.
const PART_BYTES: usize = 1 << 16;
/// Size up to which a content stays in memory, bytes.
const MAX_BYTES_IN_MEMORY: usize = 1 << 17;

/// A content to send.
pub(crate) struct Download {
    reader: Box<dyn Read + Send>,
    left: u64,
    /// The owner of the file, which is dropped after it.
    _owner: Option<Box<dyn Any + Send>>,
}

impl Download {
    /// Returns the content of a file; `owner`, which removes the file, is kept until it is sent.
    ///
    /// # Errors
    /// Errors of the system.
    pub(crate) fn open(path: &Path, owner: impl Any + Send) -> io::Result<Self> {
        let file = File::open(path)?;
        let left = file.metadata()?.len();
        Ok(Self { reader: Box::new(file), left, _owner: Some(Box::new(owner)) })
    }

    /// Returns a content that was made in memory; a large one is put into a file without a name in
    /// `folder`.
    ///
    /// # Errors
    /// Errors of the system.
    pub(crate) fn of_bytes(bytes: Vec<u8>, folder: &Path) -> io::Result<Self> {
        let left = bytes.len() as u64;
        let reader: Box<dyn Read + Send> = if bytes.len() <= MAX_BYTES_IN_MEMORY {
            Box::new(Cursor::new(bytes))
        } else {
            let mut file = tempfile::tempfile_in(folder)?;
            file.write_all(&bytes)?;
            file.seek(SeekFrom::Start(0))?;
            Box::new(file)
        };
        Ok(Self { reader, left, _owner: None })
    }

    /// Returns the response of a content type.
    pub(crate) fn response(self, kind: &'static str) -> Response {
        ([(header::CONTENT_TYPE, kind)], Body::new(self)).into_response()
    }
}

impl hyper::body::Body for Download {
    type Data = Bytes;
    type Error = io::Error;

    // The file was just written, so that reading a part of it does not wait for a disk.
    fn poll_frame(
        mut self: Pin<&mut Self>,
        _: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, io::Error>>> {
        if self.left == 0 {
            return Poll::Ready(None);
        }
        let mut part = vec![0; usize::try_from(self.left).map_or(PART_BYTES, |left| left.min(PART_BYTES))];
        Poll::Ready(Some(self.reader.read_exact(&mut part).map(|()| {
            self.left -= part.len() as u64;
            Frame::data(part.into())
        })))
    }

    fn is_end_stream(&self) -> bool {
        self.left == 0
    }

    fn size_hint(&self) -> SizeHint {
        SizeHint::with_exact(self.left)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyper::body::Body;

    fn sent(mut download: Download) -> Vec<u8> {
        let mut context = Context::from_waker(std::task::Waker::noop());
        let mut whole = Vec::new();
        while let Poll::Ready(Some(part)) = Pin::new(&mut download).poll_frame(&mut context) {
            let part = part.unwrap().into_data().unwrap();
            assert!(part.len() <= PART_BYTES);
            whole.extend(part);
        }
        assert!(download.is_end_stream());
        whole
    }

    #[test]
    fn all_bytes_are_sent_in_parts() {
        let folder = tempfile::tempdir().unwrap();
        for length in [0, 1, PART_BYTES, MAX_BYTES_IN_MEMORY, MAX_BYTES_IN_MEMORY + 1, 3 * PART_BYTES + 7] {
            let bytes: Vec<u8> = (0..length).map(|at| (at % 251) as u8).collect();
            let download = Download::of_bytes(bytes.clone(), folder.path()).unwrap();
            assert_eq!(download.size_hint().exact(), Some(length as u64));
            assert!(sent(download) == bytes, "{length} in memory or in a file");
            let own = tempfile::tempdir_in(folder.path()).unwrap();
            let path = own.path().join("content");
            std::fs::write(&path, &bytes).unwrap();
            assert!(sent(Download::open(&path, own).unwrap()) == bytes, "{length} in a file");
            assert!(!path.exists(), "the owner is dropped with the content");
        }
    }
}
