//! Embeddings of all picture sets: read, taken from the cache, or computed.

use super::cache::EmbeddingCache;
use super::layout::{PictureSet, PictureSource};
use super::network::{self, Embedder};
use crate::commands::evaluate::args::EvaluateArgs;
use crate::interrupt;
use crate::progress;
use anyhow::{Result, anyhow, bail};
use std::path::{Path, PathBuf};
use weather_magician::train::metrics::Embeddings;
use weather_magician::wm_image::photo::read_photo;
use wm_image::header::read_header;

/// A set of pictures with its embeddings.
pub(crate) struct CollectedSet {
    pub(crate) name: String,
    pub(crate) embeddings: Embeddings,
}

/// The picture sets to embed. All their faults are reported before the first picture is embedded.
pub(crate) struct Collector<'a> {
    args: &'a EvaluateArgs,
    parts: Vec<(PictureSet, EmbeddingSource)>,
}

/// Source of a set's embeddings.
enum EmbeddingSource {
    /// The embeddings are read from a file.
    Array(Embeddings),
    /// The embeddings are computed from these files, and kept in the folder if given.
    Files(Vec<PathBuf>, Option<PathBuf>),
}

impl<'a> Collector<'a> {
    pub(crate) fn new(args: &'a EvaluateArgs) -> Self {
        Self { args, parts: Vec::new() }
    }

    /// Returns an error for two sets of one name, which would share a file.
    pub(crate) fn forbid_one_name(&self, first: &Path, second: &Path) -> Result<()> {
        if self.args.realism.embeddings.is_none() {
            return Ok(());
        }
        bail!(
            "{} and {} have one name, and --embeddings keeps files of that name; rename one, or leave --embeddings out",
            first.display(),
            second.display()
        );
    }

    /// Adds a set, whose embeddings are kept at `place` in the folder of embeddings.
    pub(crate) fn add(&mut self, part: PictureSet, place: PathBuf) -> Result<()> {
        let wanted = match &part.source {
            PictureSource::Array => EmbeddingSource::Array(Embeddings::read(&part.path)?),
            PictureSource::Pictures(files) => {
                let mut sound = Vec::new();
                for file in files {
                    match read_header(file) {
                        Ok(_) => sound.push(file.clone()),
                        Err(error) => self.bad(&error.into())?,
                    }
                }
                let kept = self.args.realism.embeddings.as_ref().map(|folder| folder.join(place));
                EmbeddingSource::Files(sound, kept)
            }
        };
        let count = match &wanted {
            EmbeddingSource::Array(embeddings) => embeddings.count(),
            EmbeddingSource::Files(files, _) => files.len(),
        };
        check_picture_count(count, &part.path)?;
        self.parts.push((part, wanted));
        Ok(())
    }

    /// Reports a picture that cannot be used: an error, or a warning with --skip-bad.
    fn bad(&self, error: &anyhow::Error) -> Result<()> {
        if !self.args.photos.set.skip_bad {
            bail!("{error:#} (--skip-bad continues without it)");
        }
        eprintln!("warning: {error:#}; it is left out");
        Ok(())
    }

    /// Returns all embeddings, in the order in which sets were added.
    pub(crate) fn run(self) -> Result<Vec<CollectedSet>> {
        let is_made = |wanted: &EmbeddingSource| matches!(wanted, EmbeddingSource::Files(..));
        let embedder: Option<Box<Embedder>> = match self.parts.iter().find(|(_, wanted)| is_made(wanted)) {
            Some((part, _)) => Some(network::open(&self.args.realism.weights, &part.path)?),
            None => None,
        };
        self.check_widths(embedder.as_deref())?;
        let pictures = |(_, wanted): &(PictureSet, EmbeddingSource)| match wanted {
            EmbeddingSource::Array(_) => 0,
            EmbeddingSource::Files(files, _) => files.len() as u64,
        };
        let bar = progress::bar(self.parts.iter().map(pictures).sum(), "pictures");
        let mut collected = Vec::new();
        let Self { args, parts } = self;
        let this = Self { args, parts: Vec::new() };
        for (part, wanted) in parts {
            let embeddings = match (wanted, &embedder) {
                (EmbeddingSource::Array(embeddings), _) => embeddings,
                (EmbeddingSource::Files(files, kept), Some(embedder)) => {
                    this.embed(&part, &files, kept, embedder.as_ref(), &bar)?
                }
                (EmbeddingSource::Files(..), None) => unreachable!("one was opened for it"),
            };
            collected.push(CollectedSet { name: part.name, embeddings });
        }
        bar.finish_and_clear();
        Ok(collected)
    }

    /// Checks that all arrays are of the network that is used.
    fn check_widths(&self, embedder: Option<&Embedder>) -> Result<()> {
        let mut first = embedder.map(|embedder| (embedder.width(), "the network".to_owned()));
        for (part, wanted) in &self.parts {
            let EmbeddingSource::Array(embeddings) = wanted else { continue };
            let path = part.path.display();
            match &first {
                Some((width, whose)) if *width != embeddings.width() => bail!(
                    "{path}: its embeddings have {} numbers, those of {whose} {width}; take embeddings of one network",
                    embeddings.width()
                ),
                Some(_) => {}
                None => first = Some((embeddings.width(), path.to_string())),
            }
        }
        Ok(())
    }

    fn embed(
        &self,
        part: &PictureSet,
        files: &[PathBuf],
        kept: Option<PathBuf>,
        embedder: &Embedder,
        bar: &indicatif::ProgressBar,
    ) -> Result<Embeddings> {
        let mut cache = EmbeddingCache::open(kept, embedder.identity(), embedder.width())?;
        let mut count = 0;
        for (index, file) in files.iter().enumerate() {
            if interrupt::asked() {
                return Err(stopped(part, index, files.len(), cache.keep()?));
            }
            let added = cache.add(file, || {
                let photo = read_photo(file, &|_, _| Ok(()))?;
                embedder
                    .embed(&photo.rgb, photo.width as usize)
                    .map_err(|error| anyhow!("{}: {error}", file.display()))
            });
            match added {
                Ok(()) => count += 1,
                Err(error) => {
                    cache.keep()?;
                    self.bad(&error)?;
                }
            }
            bar.inc(1);
        }
        check_picture_count(count, &part.path)?;
        Embeddings::new(cache.finish()?, embedder.width())
            .map_err(|fault| anyhow!("{}: {fault}", part.path.display()))
    }
}

/// Returns the error of stopped work, with the path of finished embeddings.
fn stopped(part: &PictureSet, done: usize, of: usize, kept: Option<PathBuf>) -> anyhow::Error {
    interrupt::stopped(match kept {
        Some(path) => format!(
            "the embeddings of {done} of {of} pictures of {} are kept in {}; run it again to continue from there",
            part.path.display(),
            path.display()
        ),
        None => "nothing is kept; with --embeddings FOLDER stopped work can be continued".into(),
    })
}

/// Returns an error for a collection of one picture.
fn check_picture_count(count: usize, path: &Path) -> Result<()> {
    if count < 2 {
        bail!(
            "{}: has {count} picture{}, and CMMD compares collections; give at least two, better hundreds",
            path.display(),
            if count == 1 { "" } else { "s" }
        );
    }
    Ok(())
}
