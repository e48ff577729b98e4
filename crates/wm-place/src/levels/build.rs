//! Builds the levels of a scene of any size: blocks of splats in, files out.

use super::judge::LeafJudge;
use super::leaves::leaves;
use super::merge::halved;
use super::worth::seen_worth;
use crate::{Error, Progress, Result};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use wm_render::{CpuConfig, CpuRenderer, RenderError};
use wm_scene::levels::{LevelFileJob, LevelWriteOptions, LevelWriter, MAX_LEVELS, NewLeaf};
use wm_scene::{Group, Metadata, Rasterization, Splats};

/// Leaves that are built at a time, a thread: the memory that they take is bounded, and a slow one
/// delays the others little.
const LEAVES_AT_ONCE: usize = 8;

/// Options of [`LevelBuilder`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelOptions {
    /// Most splats of a leaf at the finest level, at least 1.
    pub leaf_splats: usize,
    /// Longest side of a leaf, scene units; leaves that it bounds have fewer splats.
    pub leaf_side: f64,
    /// Number of levels, 1 to [`MAX_LEVELS`]; without it, as many as it takes to come down to
    /// `coarsest`.
    pub levels: Option<u32>,
    /// Splats of a leaf at or below which no coarser level is made.
    pub coarsest: usize,
    /// The rasterisation of the scene.
    pub rasterization: Option<Rasterization>,
    /// Number of threads; without it, one a core.
    pub threads: Option<usize>,
}

impl LevelOptions {
    /// The options for a scene of so many splats. Few, large leaves are made of a large one, since
    /// each is a set of splats of its own when it is drawn; small ones fit better what cameras see.
    #[must_use]
    pub fn for_splats(count: u64) -> Self {
        let leaf_splats = (count / 4096).next_power_of_two().clamp(512, 1 << 14) as usize;
        Self { leaf_splats, coarsest: (leaf_splats / 512).max(16), ..Self::default() }
    }
}

impl Default for LevelOptions {
    fn default() -> Self {
        Self {
            leaf_splats: 512,
            leaf_side: f64::INFINITY,
            levels: None,
            coarsest: 16,
            rasterization: None,
            threads: None,
        }
    }
}

/// The size of what was built.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LevelSummary {
    /// Number of leaves.
    pub leaves: usize,
    /// Splats of each level, the finest first, without the environment.
    pub splats: Vec<u64>,
    /// Splats of the environment.
    pub environment: usize,
}

/// Builds a scene in levels, block by block. Memory is bounded by the largest block and its levels.
///
/// Splats of the sky ([`Group::Sky`]) become the environment, which is always drawn. The same
/// blocks give the same bytes on any number of threads.
///
/// ```
/// use wm_place::{Metadata, levels::{LevelBuilder, LevelOptions}};
///
/// # let folder = tempfile::tempdir()?;
/// # let block = |_| wm_street::Street::builtin().sampling(0.06).scene(&|_| true).unwrap().splats;
/// let mut builder = LevelBuilder::create(&folder.path().join("lod-meta.json"), LevelOptions::default())?;
/// for number in 0..2 {
///     builder.add(&block(number), &mut ())?;
/// }
/// let summary = builder.finish(&Metadata::default(), &mut ())?;
/// assert!(summary.splats.is_sorted_by(|finer, coarser| finer > coarser));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct LevelBuilder {
    writer: LevelWriter,
    options: LevelOptions,
    judges: Vec<LeafJudge>,
    /// The one that looks at blocks, on all threads.
    renderer: CpuRenderer,
    environment: Splats,
    summary: LevelSummary,
}

impl LevelBuilder {
    /// Starts the scene whose index is `main`, a path that ends in `lod-meta.json`. What was there
    /// is removed.
    ///
    /// # Errors
    /// [`Error::Format`] if it cannot be written there, [`Error::Render`] if threads cannot be
    /// started.
    pub fn create(main: &Path, options: LevelOptions) -> Result<Self> {
        let own = LevelWriteOptions { rasterization: options.rasterization, ..LevelWriteOptions::default() };
        let writer = LevelWriter::create(main, own)?;
        let cores = || std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let judge = |_| {
            let renderer = CpuRenderer::new(CpuConfig { threads: Some(1), ..CpuConfig::default() })?;
            Ok::<_, RenderError>(LeafJudge::new(renderer, options.rasterization.unwrap_or_default()))
        };
        let judges =
            (0..options.threads.unwrap_or_else(cores).max(1)).map(judge).collect::<Result<_, _>>()?;
        let renderer = CpuRenderer::new(CpuConfig { threads: options.threads, ..CpuConfig::default() })?;
        Ok(Self {
            writer,
            options,
            judges,
            renderer,
            environment: Splats::default(),
            summary: LevelSummary::default(),
        })
    }

    /// Adds a block: splats of a part of space, as many as fit memory three times.
    ///
    /// # Errors
    /// [`Error::Format`] if a splat has a number that is not finite or a file cannot be written;
    /// [`Error::Stopped`] if `progress` asks to stop.
    pub fn add(&mut self, splats: &Splats, progress: &mut dyn Progress) -> Result<()> {
        let (sky, rest): (Vec<u32>, Vec<u32>) =
            (0..splats.len() as u32).partition(|index| splats.groups[*index as usize] == Group::Sky);
        let environment = std::mem::take(&mut self.environment);
        self.environment = Splats::joined(environment, select(splats, &sky));
        progress.begin("building levels", Some(rest.len() as u64));
        if rest.is_empty() {
            progress.end();
            return Ok(());
        }
        let rasterization = self.options.rasterization.unwrap_or_default();
        let worth = seen_worth(splats, rasterization, &mut self.renderer, progress)?;
        let leaves = leaves(splats, rest, self.options.leaf_splats, self.options.leaf_side);
        for some in leaves.chunks(LEAVES_AT_ONCE * self.judges.len()) {
            if progress.is_stopped() {
                return Err(Error::Stopped);
            }
            let built = self.built(splats, &worth, some)?;
            let mut jobs = Vec::new();
            for leaf in built {
                self.count(&leaf);
                jobs.extend(self.writer.add(leaf)?);
            }
            write(jobs, self.judges.len())?;
            progress.advance(some.iter().map(|leaf| leaf.len() as u64).sum());
        }
        progress.end();
        Ok(())
    }

    /// Writes the last files and the index.
    ///
    /// # Errors
    /// [`Error::Format`] if there is no splat beside the sky, or a file cannot be written.
    pub fn finish(mut self, metadata: &Metadata, progress: &mut dyn Progress) -> Result<LevelSummary> {
        progress.begin("writing levels", None);
        self.summary.environment = self.environment.len();
        let environment = std::mem::take(&mut self.environment);
        let writer = self.writer;
        let mut end = writer.finish(Some(environment), metadata)?;
        write(std::mem::take(&mut end.jobs), self.judges.len())?;
        end.write_index()?;
        progress.end();
        Ok(self.summary)
    }

    fn count(&mut self, leaf: &NewLeaf) {
        let LevelSummary { leaves, splats, .. } = &mut self.summary;
        *leaves += 1;
        splats.resize(splats.len().max(leaf.levels.len()), 0);
        leaf.levels.iter().zip(splats).for_each(|(level, sum)| *sum += level.len() as u64);
    }

    /// Builds leaves over the threads.
    fn built(&mut self, splats: &Splats, worth: &[f64], leaves: &[Vec<u32>]) -> Result<Vec<NewLeaf>> {
        let options = self.options;
        let work = |judge: &mut LeafJudge, leaf: usize| {
            let own = leaves[leaf].iter().map(|index| worth[*index as usize]).collect();
            let levels = levels_of(select(splats, &leaves[leaf]), own, &options);
            let errors = judge.errors(&levels)?;
            Ok(NewLeaf { levels, errors })
        };
        over_threads(&mut self.judges, leaves.len(), work)
    }
}

/// Runs jobs over threads.
fn write(jobs: Vec<LevelFileJob>, threads: usize) -> Result<()> {
    let jobs: Vec<Mutex<Option<LevelFileJob>>> = jobs.into_iter().map(|job| Mutex::new(Some(job))).collect();
    let work = |_: &mut (), number: usize| {
        let job = jobs[number].lock().ok().and_then(|mut job| job.take());
        Ok(job.map_or(Ok(()), LevelFileJob::write)?)
    };
    over_threads(&mut vec![(); threads], jobs.len(), work).map(|_| ())
}

/// Does `count` pieces of work over a thread for each worker; what they give is in their order.
///
/// These are threads of their own: a renderer's wait would let a thread of a pool begin a second
/// piece within the first.
fn over_threads<W: Send, T: Send>(
    workers: &mut [W],
    count: usize,
    work: impl Fn(&mut W, usize) -> Result<T> + Sync,
) -> Result<Vec<T>> {
    let next = AtomicUsize::new(0);
    let done = Mutex::new(Vec::with_capacity(count));
    std::thread::scope(|scope| {
        for worker in workers {
            scope.spawn(|| {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    if number >= count {
                        break;
                    }
                    let result = work(worker, number);
                    if let Ok(mut done) = done.lock() {
                        done.push((number, result));
                    }
                }
            });
        }
    });
    let mut done = done.into_inner().unwrap_or_default();
    done.sort_by_key(|(number, _)| *number);
    done.into_iter().map(|(_, result)| result).collect()
}

/// The levels of a leaf, the finest first; `worth` are the importances of its splats.
fn levels_of(finest: Splats, worth: Vec<f64>, options: &LevelOptions) -> Vec<Splats> {
    let most = options.levels.unwrap_or(MAX_LEVELS).clamp(1, MAX_LEVELS) as usize;
    let least = if options.levels.is_some() { 1 } else { options.coarsest.max(1) };
    let mut levels = vec![finest];
    let mut importance = worth;
    while levels.len() < most {
        let finer = &levels[levels.len() - 1];
        if finer.len() <= least {
            break;
        }
        let (coarser, of_coarser) = halved(finer, &importance, finer.len() / 2);
        if coarser.len() >= finer.len() {
            break;
        }
        importance = of_coarser;
        levels.push(coarser);
    }
    levels
}

fn select(splats: &Splats, indices: &[u32]) -> Splats {
    let indices: Vec<usize> = indices.iter().map(|index| *index as usize).collect();
    splats.select(&indices)
}
