//! Damages small files of every kind that the program reads, and reads them: each gives a result or
//! one line of error.
//!
//! `cargo run --release --example fuzz_readers -- [--runs N | --seconds S] [--only NAME] [--corpus FOLDER]`
//!
//! Each target has seeds: small valid inputs, written by the code of `targets.rs` or kept in
//! `seeds/`. A run takes one file of one seed, damages it (`damage.rs`) and reads the seed. Run K
//! of a target is the same every time. A run fails if the reader panics, overflows (build with
//! overflow checks), prints an error of several lines, takes more than 2 s of processor time, or
//! takes the process above 512 MiB. Targets whose names begin with `use-` work with what was read:
//! they draw and scan at 64x48 px, and may take 5 s and 1 GiB, and 20 s to make
//! assets for a weather. Targets run in processes of their
//! own, so that an abort or an endless loop ends one target alone. A damaged seed that fails is
//! kept in `target/fuzz-failures/`.

mod damage;
mod edges;
mod outcome;
mod targets;
mod uses;

use clap::Parser;
use std::{
    fs, io,
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
    process::{Command, ExitCode},
    sync::{
        Arc, Mutex,
        atomic::{AtomicU64, Ordering},
    },
    thread,
    time::{Duration, Instant},
};
use targets::{TARGETS, Target};

/// A run that has not ended after so much processor time is an endless loop.
const MAX_PROCESSOR_TIME: Duration = Duration::from_secs(60);
/// A run that has not ended after so much time on the clock is an endless loop, even if other
/// programs take the processor.
const MAX_CLOCK_TIME: Duration = Duration::from_secs(1200);
/// Longest time of making assets, as a multiple of a target's budget.
const MAX_PREPARING_RATIO: f64 = 4.0;
/// Runs between two looks at the memory.
const MEMORY_INTERVAL: u64 = 64;
/// Failures that a target reports before it stops.
const MAX_FAILURES: u64 = 10;

#[derive(Parser, Clone)]
#[command(about = "Damages small files of every kind that the program reads, and reads them")]
struct Args {
    /// Runs of each target; scene formats get ten times as many
    #[arg(long, default_value_t = 1000, conflicts_with = "seconds")]
    runs: u64,
    /// Seconds for all targets together, in place of a number of runs
    #[arg(long)]
    seconds: Option<f64>,
    /// Only targets whose name contains this text
    #[arg(long)]
    only: Option<String>,
    /// The first run, to repeat one: `--start K --runs 1 --only NAME`
    #[arg(long, default_value_t = 0)]
    start: u64,
    /// More seeds: FOLDER/TARGET/SEED is a file or a folder; if it is a folder, its first file in
    /// order of names is read
    #[arg(long)]
    corpus: Option<PathBuf>,
    /// Targets at the same time
    #[arg(long, default_value_t = 2)]
    jobs: usize,
    /// Factor on the processor time that a run may take: a sanitizer slows everything
    #[arg(long, default_value_t = 1.0)]
    slowness: f64,
    /// Runs one target in this process
    #[arg(long, hide = true)]
    child: bool,
}

fn main() -> ExitCode {
    let args = Args::parse();
    let only = args.only.as_deref().unwrap_or_default();
    let chosen: Vec<&Target> = TARGETS
        .iter()
        .filter(|target| if args.child { target.name == only } else { target.name.contains(only) })
        .collect();
    if chosen.is_empty() {
        let names: Vec<&str> = TARGETS.iter().map(|target| target.name).collect();
        eprintln!("error: no target has \"{only}\" in its name; the targets are {}", names.join(", "));
        return ExitCode::FAILURE;
    }
    let failed = if args.child { !run_target(chosen[0], &args) } else { run_all(&chosen, &args) > 0 };
    if failed { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}

/// Runs each target in a process of its own; returns the number of targets that failed.
fn run_all(chosen: &[&Target], args: &Args) -> usize {
    let queue = Mutex::new(chosen.iter());
    let share = args.seconds.map(|seconds| seconds * args.jobs as f64 / chosen.len() as f64);
    let failed = AtomicU64::new(0);
    let work = || {
        while let Some(target) = { queue.lock().unwrap().next() } {
            let mut command = Command::new(std::env::current_exe().unwrap());
            command.args(["--child", "--only", target.name, "--start", &args.start.to_string()]);
            command.arg("--slowness").arg(args.slowness.to_string());
            match share {
                Some(share) => command.arg("--seconds").arg(share.to_string()),
                None => command.arg("--runs").arg(args.runs.to_string()),
            };
            if let Some(corpus) = &args.corpus {
                command.arg("--corpus").arg(corpus);
            }
            let output = command.output().unwrap();
            print!("{}", String::from_utf8_lossy(&output.stdout));
            if !output.status.success() {
                failed.fetch_add(1, Ordering::Relaxed);
                let errors = String::from_utf8_lossy(&output.stderr);
                println!("{}: FAILED, {}; {}", target.name, output.status, errors.trim_end());
            }
        }
    };
    thread::scope(|scope| {
        for _ in 0..args.jobs.max(1) {
            scope.spawn(work);
        }
    });
    let failed = failed.into_inner() as usize;
    println!("{} targets, {failed} failed", chosen.len());
    failed
}

/// A seed: a folder of its own, and the path in it that is read.
pub struct Seed {
    /// The path that the reader is given.
    pub main: PathBuf,
    files: Vec<SeedFile>,
}

struct SeedFile {
    path: PathBuf,
    bytes: Vec<u8>,
}

/// The run that goes on, for the thread that looks for endless loops.
#[derive(Default)]
struct CurrentRun {
    /// One more than the number of the run; 0 between runs.
    number: AtomicU64,
    /// Milliseconds from the start of the process to that of the run.
    began: AtomicU64,
    /// Milliseconds of processor time until the run began.
    spent: AtomicU64,
}

/// Runs a target in this process; returns true if nothing failed.
fn run_target(target: &'static Target, args: &Args) -> bool {
    // Deleted at the end; an abort leaves it in the system's folder of temporary files.
    let folder = fast_temporary_folder().unwrap();
    let seeds = seeds_of(target, folder.path(), args.corpus.as_deref()).unwrap();
    for seed in &seeds {
        if let Err(message) = (target.read)(&seed.main) {
            eprintln!("seed {} cannot be read: {message}", seed.main.display());
            return false;
        }
    }
    let panic_text = Arc::new(Mutex::new(String::new()));
    let hook_text = panic_text.clone();
    std::panic::set_hook(Box::new(move |info| *hook_text.lock().unwrap() = info.to_string()));
    let start = Instant::now();
    let current = Arc::new(CurrentRun::default());
    watch_for_endless_loops(target.name, current.clone(), start);
    let last = match args.seconds {
        Some(_) => u64::MAX,
        None => args.start + args.runs * target.share,
    };
    let (mut read, mut failures, mut slowest, mut run) = (0u64, 0u64, 0.0f64, args.start);
    let baseline = peak_resident_kib();
    while run < last && args.seconds.is_none_or(|seconds| start.elapsed().as_secs_f64() < seconds) {
        let seed = &seeds[(run % seeds.len() as u64) as usize];
        let damaged = seed.damaged(run);
        fs::write(&damaged.path, &damaged.bytes).unwrap();
        current.began.store(start.elapsed().as_millis() as u64, Ordering::Relaxed);
        let before = processor_seconds();
        current.spent.store((before * 1e3) as u64, Ordering::Relaxed);
        current.number.store(run + 1, Ordering::Release);
        let outcome = catch_unwind(AssertUnwindSafe(|| (target.read)(&seed.main)));
        let preparing = uses::take_preparing_seconds();
        let seconds = processor_seconds() - before - preparing;
        current.number.store(0, Ordering::Release);
        slowest = slowest.max(seconds);
        let fault = match outcome {
            Err(_) => Some(format!("panic: {}", panic_text.lock().unwrap().replace('\n', " "))),
            Ok(Err(message)) if message.contains(['\n', '\r']) => {
                Some(format!("more than one line: {message:?}"))
            }
            Ok(result) => {
                read += u64::from(result.is_ok());
                let budget = args.slowness * target.budget.seconds;
                let is_slow = seconds > budget || preparing > MAX_PREPARING_RATIO * budget;
                is_slow.then(|| format!("slow: {seconds:.1} s, and {preparing:.1} s for assets"))
            }
        };
        if let Some(fault) = fault {
            failures += 1;
            println!("{}: run {run}: {fault}; {}", target.name, keep(target, seed, &damaged, run));
        }
        let original = seed.files.iter().find(|file| file.path == damaged.path).unwrap();
        fs::write(&original.path, &original.bytes).unwrap();
        if run.is_multiple_of(MEMORY_INTERVAL)
            && peak_resident_kib() > (target.budget.mebibytes << 10).max(baseline)
        {
            let (first, most) = (run.saturating_sub(MEMORY_INTERVAL), target.budget.mebibytes);
            println!("{}: runs {first} to {run}: above {most} MiB", target.name);
            failures += 1;
        }
        if failures >= MAX_FAILURES {
            println!("{}: stopped after {failures} failures", target.name);
            break;
        }
        run += 1;
    }
    let runs = run - args.start;
    println!(
        "{:14} {} seeds, {runs} runs in {:.0} s, {read} still read, slowest {slowest:.3} s, memory {} MiB, {failures} failures",
        target.name,
        seeds.len(),
        start.elapsed().as_secs_f64(),
        peak_resident_kib() >> 10,
    );
    failures == 0
}

impl Seed {
    /// Returns one of the files with something wrong in it; the same for the same run.
    fn damaged(&self, run: u64) -> SeedFile {
        let mut draw = damage::Draws::new(run);
        let chosen = draw.below(self.files.len());
        let file = &self.files[chosen];
        let donor = &self.files[draw.below(self.files.len())].bytes;
        SeedFile { path: file.path.clone(), bytes: damage::damage(&file.bytes, donor, &mut draw) }
    }
}

/// Writes the seeds of a target, each into a folder of its own, and those of the corpus.
fn seeds_of(target: &Target, folder: &Path, corpus: Option<&Path>) -> io::Result<Vec<Seed>> {
    let mut mains = Vec::new();
    for (index, write) in target.seeds.iter().enumerate() {
        let own = folder.join(index.to_string());
        fs::create_dir_all(&own)?;
        mains.push((own.clone(), write(&own).map_err(io::Error::other)?));
    }
    if let Some(given) = corpus.map(|corpus| corpus.join(target.name)).filter(|given| given.is_dir()) {
        for path in entries(&given)? {
            let own = folder.join("corpus").join(path.file_name().unwrap_or_default());
            fs::create_dir_all(&own)?;
            let files = if path.is_dir() { entries(&path)? } else { vec![path] };
            for file in files.iter().filter(|file| file.is_file()) {
                fs::copy(file, own.join(file.file_name().unwrap_or_default()))?;
            }
            let main = entries(&own)?.into_iter().next();
            mains.extend(main.map(|main| (own, main)));
        }
    }
    mains
        .into_iter()
        .map(|(own, main)| {
            let mut paths = Vec::new();
            all_files(&own, &mut paths)?;
            let file = |path: PathBuf| Ok(SeedFile { bytes: fs::read(&path)?, path });
            Ok(Seed { main, files: paths.into_iter().map(file).collect::<io::Result<_>>()? })
        })
        .collect()
}

/// Returns what is in a folder, in order of names.
fn entries(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut paths: Vec<PathBuf> =
        fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<io::Result<_>>()?;
    paths.sort();
    Ok(paths)
}

fn all_files(folder: &Path, files: &mut Vec<PathBuf>) -> io::Result<()> {
    for path in entries(folder)? {
        if path.is_dir() { all_files(&path, files)? } else { files.push(path) }
    }
    Ok(())
}

/// Keeps the damaged file of a run that failed; returns its path and how to repeat the run.
fn keep(target: &Target, seed: &Seed, damaged: &SeedFile, run: u64) -> String {
    let folder = Path::new("target/fuzz-failures").join(format!("{}-{run}", target.name));
    let name = damaged.path.file_name().unwrap_or_default();
    let kept = fs::create_dir_all(&folder).and_then(|()| fs::write(folder.join(name), &damaged.bytes));
    let place = match kept {
        Ok(()) => format!("the damaged file is {}", folder.join(name).display()),
        Err(error) => format!("the damaged file could not be kept: {error}"),
    };
    format!(
        "{place}, of seed {}; repeat with --only {} --start {run} --runs 1",
        seed.main.display(),
        target.name
    )
}

/// Ends the process if a run does not end.
fn watch_for_endless_loops(name: &'static str, current: Arc<CurrentRun>, start: Instant) {
    thread::spawn(move || {
        loop {
            thread::sleep(Duration::from_millis(500));
            let number = current.number.load(Ordering::Acquire);
            let began = Duration::from_millis(current.began.load(Ordering::Relaxed));
            let took = start.elapsed().saturating_sub(began);
            let spent = processor_seconds() * 1e3 - current.spent.load(Ordering::Relaxed) as f64;
            if number > 0 && (spent > MAX_PROCESSOR_TIME.as_secs_f64() * 1e3 || took > MAX_CLOCK_TIME) {
                eprintln!("{name}: run {} has not ended after {:.0} s", number - 1, took.as_secs_f64());
                std::process::exit(2);
            }
        }
    });
}

/// Makes a folder for temporary files, in memory where the system has such a place.
fn fast_temporary_folder() -> io::Result<tempfile::TempDir> {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir())
}

/// Processor time of the process, seconds.
fn processor_seconds() -> f64 {
    #[cfg(unix)]
    {
        use rustix::time::{ClockId, clock_gettime};
        let time = clock_gettime(ClockId::ProcessCPUTime);
        time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
    }
    #[cfg(not(unix))]
    0.0
}

/// Peak of resident memory, KiB; 0 where the system does not say it.
fn peak_resident_kib() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|text| text.trim().trim_end_matches(" kB").parse().ok()).unwrap_or(0)
}
