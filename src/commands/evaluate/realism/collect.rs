//! Embeddings of all parts that are compared: read, taken from the cache, or made.

use super::cache::EmbeddingCache;
use super::layout::{PictureSet, PictureSource};
use super::network::{self, Embedder};
use super::{RealismArgs, RealismOptions};
use crate::interrupt::{self, Interrupted};
use crate::progress;
use anyhow::{Result, anyhow, bail};
use std::path::{Path, PathBuf};
use wm_scene::capture::header::read_header;
use wm_train::metrics::Embeddings;
use wm_train::photos::read_picture;

/// A set of pictures with its embeddings.
pub struct CollectedSet {
    pub name: String,
    pub embeddings: Embeddings,
}

/// The parts that are to be embedded. All that can be wrong with them is reported before the first picture is.
pub struct Collector<'a> {
    args: &'a RealismArgs,
    work: &'a RealismOptions<'a>,
    parts: Vec<(PictureSet, Wanted)>,
}

/// The treatment of a part.
enum Wanted {
    /// The embeddings are read from a file.
    Read(Embeddings),
    /// The embeddings are computed from these files, and kept in the folder if given.
    Made(Vec<PathBuf>, Option<PathBuf>),
}

impl<'a> Collector<'a> {
    pub fn new(args: &'a RealismArgs, work: &'a RealismOptions<'a>) -> Self {
        Self { args, work, parts: Vec::new() }
    }

    /// Two collections of one name would be kept in one file.
    pub fn forbid_one_name(&self, first: &Path, second: &Path) -> Result<()> {
        if self.args.embeddings.is_none() {
            return Ok(());
        }
        bail!(
            "{} and {} have one name, and --embeddings keeps files of that name; rename one, or leave --embeddings out",
            first.display(),
            second.display()
        );
    }

    /// Adds a part, which is kept in `place` of the folder of embeddings.
    pub fn add(&mut self, part: PictureSet, place: PathBuf) -> Result<()> {
        let wanted = match &part.source {
            PictureSource::Array => Wanted::Read(Embeddings::read(&part.path)?),
            PictureSource::Pictures(files) => {
                let mut sound = Vec::new();
                for file in files {
                    match read_header(file) {
                        Ok(_) => sound.push(file.clone()),
                        Err(error) => self.bad(&error.into())?,
                    }
                }
                let kept = self.args.embeddings.as_ref().map(|folder| folder.join(place));
                Wanted::Made(sound, kept)
            }
        };
        let count = match &wanted {
            Wanted::Read(embeddings) => embeddings.count(),
            Wanted::Made(files, _) => files.len(),
        };
        several(count, &part.path)?;
        self.parts.push((part, wanted));
        Ok(())
    }

    /// A picture that cannot be used.
    fn bad(&self, error: &anyhow::Error) -> Result<()> {
        if !self.work.skip_bad {
            bail!("{error:#} (--skip-bad continues without it)");
        }
        eprintln!("warning: {error:#}; it is left out");
        Ok(())
    }

    /// All embeddings, in the order in which parts were added.
    pub fn run(self) -> Result<Vec<CollectedSet>> {
        let is_made = |wanted: &Wanted| matches!(wanted, Wanted::Made(..));
        let embedder: Option<Box<Embedder>> = match self.parts.iter().find(|(_, wanted)| is_made(wanted)) {
            Some((part, _)) => Some(network::open(&self.args.weights, &part.path)?),
            None => None,
        };
        self.check_widths(embedder.as_deref())?;
        let pictures = |(_, wanted): &(PictureSet, Wanted)| match wanted {
            Wanted::Read(_) => 0,
            Wanted::Made(files, _) => files.len() as u64,
        };
        let bar = progress::bar(self.parts.iter().map(pictures).sum(), "pictures");
        let mut collected = Vec::new();
        let Self { args, work, parts } = self;
        let this = Self { args, work, parts: Vec::new() };
        for (part, wanted) in parts {
            let embeddings = match (wanted, &embedder) {
                (Wanted::Read(embeddings), _) => embeddings,
                (Wanted::Made(files, kept), Some(embedder)) => {
                    this.embed(&part, &files, kept, embedder.as_ref(), &bar)?
                }
                (Wanted::Made(..), None) => unreachable!("one was opened for it"),
            };
            collected.push(CollectedSet { name: part.name, embeddings });
        }
        bar.finish_and_clear();
        Ok(collected)
    }

    /// All arrays are of one network, and of that which is used.
    fn check_widths(&self, embedder: Option<&Embedder>) -> Result<()> {
        let mut first = embedder.map(|embedder| (embedder.width(), "the network".to_owned()));
        for (part, wanted) in &self.parts {
            let Wanted::Read(embeddings) = wanted else { continue };
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
                return Err(stopped(part, index, files.len(), cache.keep()?).into());
            }
            let added = cache.add(file, || {
                let (width, _, rgb) = read_picture(file, &|_, _| Ok(()))?;
                embedder.embed(&rgb, width as usize).map_err(|error| anyhow!("{}: {error}", file.display()))
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
        several(count, &part.path)?;
        Embeddings::new(cache.finish()?, embedder.width())
            .map_err(|fault| anyhow!("{}: {fault}", part.path.display()))
    }
}

/// Work that Ctrl-C ended, and where its part is.
fn stopped(part: &PictureSet, done: usize, of: usize, kept: Option<PathBuf>) -> Interrupted {
    Interrupted(match kept {
        Some(path) => format!(
            "the embeddings of {done} of {of} pictures of {} are kept in {}; run it again to continue from there",
            part.path.display(),
            path.display()
        ),
        None => "nothing is kept; with --embeddings FOLDER stopped work can be continued".into(),
    })
}

/// Refuses collections of one.
fn several(count: usize, path: &Path) -> Result<()> {
    if count < 2 {
        bail!(
            "{}: has {count} picture{}, and CMMD compares collections; give at least two, better hundreds",
            path.display(),
            if count == 1 { "" } else { "s" }
        );
    }
    Ok(())
}
