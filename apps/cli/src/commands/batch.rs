//! `batch`: makes a data set by a plan: scenes in many weathers, in the layouts that training code
//! reads.

use crate::interrupt::stopped;
use crate::progress::Reporter;
use crate::scene::{RunArgs, count_of};
use anyhow::{Context, Result, bail};
use clap::Args;
use std::fmt::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Instant;
use weather_magician::assets::AssetCache;
use weather_magician::batch::{
    BatchPlan, BatchRun, BatchStore, FRAMES_LAYOUT, LAYOUTS, PAGE, merge, missing_blocks, runs_of,
};
use weather_magician::{Error, Progress};

/// Rows of `--list` if no frames are chosen.
const DEFAULT_LIST_ROWS: u64 = 40;

/// Options of `batch`.
#[derive(Args, Debug)]
#[command(after_long_help = layouts_help())]
pub(crate) struct BatchArgs {
    /// The plan (TOML): scenes, weathers, paths, sensors, layouts
    plan: PathBuf,
    /// Folder of the set [default: named after the plan, in this folder]
    #[arg(short, long, value_name = "FOLDER", help_heading = "Output")]
    out: Option<PathBuf>,
    /// Make part I of N alone, counted from 0: 0/8 to 7/8, on as many machines or one after the
    /// other; --merge ends the set
    #[arg(long, value_name = "I/N", help_heading = "Output")]
    shard: Option<Shard>,
    /// Check that all blocks are there, and write the tables of the layouts, the manifest and the
    /// summary
    #[arg(long, conflicts_with_all = ["shard", "list", "frames"], help_heading = "Output")]
    merge: bool,
    /// With --merge: compare the hashes of all files too
    #[arg(long, requires = "merge", help_heading = "Output")]
    verify: bool,
    /// Print clips and frames, and how much is done; make nothing
    #[arg(long, conflicts_with = "shard", help_heading = "Output")]
    list: bool,
    /// Make only these frames, as 300..420 or 300..=420, without marking anything as done; with
    /// --list, print these
    #[arg(long, value_name = "RANGE", conflicts_with = "shard", help_heading = "Output")]
    frames: Option<FrameSpan>,
    #[command(flatten)]
    run: RunArgs,
}

/// A part of the work.
#[derive(Clone, Copy, Debug)]
struct Shard {
    index: u64,
    count: u64,
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = || format!("`{text}`: write I/N, as in 0/8 for the first of eight");
        let (index, count) = text.split_once('/').ok_or_else(form)?;
        let (index, count) =
            (index.trim().parse().map_err(|_| form())?, count.trim().parse().map_err(|_| form())?);
        if index >= count {
            return Err(format!("`{text}`: the parts of {count} are 0 to {}", u64::saturating_sub(count, 1)));
        }
        Ok(Self { index, count })
    }
}

/// A run of frames.
#[derive(Clone, Debug)]
struct FrameSpan(Range<u64>);

impl FromStr for FrameSpan {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = || format!("`{text}`: write 300..420, 300..=420 or 300");
        let number = |text: &str| text.trim().parse::<u64>().map_err(|_| form());
        let range = match text.split_once("..") {
            None => number(text)?..number(text)?.saturating_add(1),
            Some((from, to)) => match to.strip_prefix('=') {
                Some(last) => number(from)?..number(last)?.saturating_add(1),
                None => number(from)?..number(to)?,
            },
        };
        if range.is_empty() { Err(format!("`{text}`: holds no frame")) } else { Ok(Self(range)) }
    }
}

/// The layouts, for the long help.
fn layouts_help() -> String {
    let mut text = format!(
        "Layouts (`layouts = [...]` of the plan):\n  {FRAMES_LAYOUT:18} this program's own files (default)\n"
    );
    for layout in LAYOUTS {
        let _ = writeln!(text, "  {:18} {}", layout.name, layout.about);
    }
    text
}

/// Runs the command.
pub(crate) fn run(args: &BatchArgs) -> Result<()> {
    let plan = BatchPlan::read(&args.plan)?;
    let folder = args.out.clone().unwrap_or_else(|| PathBuf::from(&plan.name));
    if folder.exists() && !folder.is_dir() {
        bail!("--out {}: is not a folder", folder.display());
    }
    let mut run =
        BatchRun::new(plan, args.run.renderer()?, |scene: &Path| Some(AssetCache::folder_of(scene)))?;
    let all = run.clips.frames();
    if let Some(FrameSpan(range)) = &args.frames
        && range.end > all
    {
        bail!("--frames: the set has {all} frames, 0 to {}", all.saturating_sub(1));
    }
    if args.list {
        return list(&run, &folder, args.frames.as_ref().map(|span| span.0.clone()));
    }
    let store = BatchStore::new(&folder)?;
    if let Some(FrameSpan(range)) = &args.frames {
        return frames(&mut run, &store, range);
    }
    if !args.merge {
        let shard = args.shard.unwrap_or(Shard { index: 0, count: 1 });
        make(&mut run, &store, shard)?;
        if args.shard.is_some() {
            return Ok(());
        }
    }
    let merged = merge(&run, &store, args.verify, &mut Reporter::default())?;
    for warning in &merged.warnings {
        eprintln!("warning: {warning}");
    }
    let [clips, frames, readings] = merged.counts;
    println!(
        "{}: {}, {}, {}, {:.1} MB, {}",
        folder.display(),
        count_of(clips as usize, "clip"),
        count_of(frames as usize, "frame"),
        count_of(readings as usize, "reading"),
        merged.bytes as f64 / 1e6,
        folder.join(PAGE).display()
    );
    Ok(())
}

/// Makes the blocks of a shard that are not done.
fn make(run: &mut BatchRun, store: &BatchStore, shard: Shard) -> Result<()> {
    let own = run.clips.shard(shard.index, shard.count);
    let mut missing = Vec::new();
    for number in own.clone() {
        let marker = store.marker(number, &run.plan.digest)?;
        if let Some(file) = marker.as_ref().and_then(|marker| store.lost_file(marker)) {
            eprintln!("note: block {number} is made again: {file} is gone or has another length");
            missing.push(number);
        } else if marker.is_none() {
            missing.push(number);
        }
    }
    let kept = (own.end - own.start) as usize - missing.len();
    let blocks: Vec<_> = missing.iter().map(|number| run.clips.block(*number)).collect();
    let frames: u64 = blocks.iter().map(|block| block.frames.end - block.frames.start).sum();
    let started = Instant::now();
    let mut progress = Reporter::default();
    progress.begin("frames", Some(frames));
    for block in &blocks {
        let made = run.make(store, block, &mut progress);
        for warning in run.take_warnings() {
            progress.say(&format!("note: {warning}"));
        }
        match made {
            Err(Error::Stopped) => {
                progress.end();
                let says = "the same command continues with the blocks that are not done";
                return Err(stopped(format!("{}: {says}", store.folder().display())));
            }
            made => made.with_context(|| format!("block {}", block.number))?,
        }
    }
    progress.end();
    let (seconds, written) = (started.elapsed().as_secs_f64(), run.written);
    if frames > 0 {
        println!(
            "{}: {} of {} made, {kept} kept, {frames} frames, {:.1} s, {:.2} frames/s, writing {:.0} % of the time on a thread of its own, \
             {:.2} MB a frame ({})",
            store.folder().display(),
            blocks.len(),
            count_of((own.end - own.start) as usize, "block"),
            seconds,
            frames as f64 / seconds,
            100.0 * written.writing.as_secs_f64() / written.all.as_secs_f64().max(1e-9),
            written.bytes as f64 / 1e6 / frames as f64,
            run.renderer().describe()
        );
    } else {
        println!("{}: {} done already", store.folder().display(), count_of(kept, "block"));
    }
    Ok(())
}

/// Makes single frames.
fn frames(run: &mut BatchRun, store: &BatchStore, range: &Range<u64>) -> Result<()> {
    let mut progress = Reporter::default();
    progress.begin("frames", Some(range.end - range.start));
    let mut at = range.start;
    while at < range.end {
        // Frames of one scene at a time.
        let scene_end =
            (at..range.end).find(|frame| run.clips.scene_of_frame(*frame) != run.clips.scene_of_frame(at));
        let end = scene_end.unwrap_or(range.end);
        run.make_frames(store, &(at..end), &mut progress)?;
        at = end;
    }
    progress.end();
    println!("{}: {} made", store.folder().display(), count_of((range.end - range.start) as usize, "frame"));
    Ok(())
}

/// Prints the clips of a run of frames.
fn list(run: &BatchRun, folder: &Path, range: Option<Range<u64>>) -> Result<()> {
    let (plan, clips) = (&run.plan, &run.clips);
    println!(
        "{}: {}, {}, {} of {} frames",
        plan.name,
        count_of(clips.clips() as usize, "clip"),
        count_of(clips.frames() as usize, "frame"),
        count_of(clips.blocks() as usize, "block"),
        plan.block
    );
    let frames = u64::from(plan.frames);
    let of = range.map_or(0..clips.clips().min(DEFAULT_LIST_ROWS), |range| {
        range.start / frames..(range.end - 1) / frames + 1
    });
    for number in of.clone() {
        let clip = clips.clip(plan, number)?;
        let values: Vec<String> =
            clip.weather.variables.iter().map(|(name, value)| format!("{name} {value:.4}")).collect();
        let first = number * frames;
        let at = if clip.weather.at == 0.0 { String::new() } else { format!(" from {} s", clip.weather.at) };
        println!("{first}..{}  {}{at}  {}  {}", first + frames, clip.name, clip.split, values.join(", "));
    }
    if of.end < clips.clips() {
        println!("...");
    }
    if folder.is_dir() {
        let store = BatchStore::new(folder)?;
        let missing = missing_blocks(run, &store)?;
        let done = clips.blocks() - missing.len() as u64;
        let rest =
            if missing.is_empty() { String::new() } else { format!("; missing: {}", runs_of(&missing)) };
        println!("{}: {done} of {} done{rest}", folder.display(), count_of(clips.blocks() as usize, "block"));
    }
    Ok(())
}
