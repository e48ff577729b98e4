//! Programs that are run to their end: what they say, and what they leave behind.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Longer than this no program may take; the machine may be busy.
pub const MAX_RUN_TIME: Duration = Duration::from_secs(60);

/// Starts a command with both outputs kept.
pub fn begin(command: &mut Command) -> Child {
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Runs to the end, within [`MAX_RUN_TIME`].
pub fn finish(command: &mut Command) -> Output {
    wait(begin(command), &format!("{command:?}"))
}

/// Runs a command that must succeed, to its end.
pub fn succeeds(command: &mut Command) -> Output {
    let output = finish(command);
    assert!(output.status.success(), "{command:?}: {}: {}", output.status, said(&output));
    output
}

/// Waits for the end of `child`, within [`MAX_RUN_TIME`]; `what` says in a panic what hangs.
pub fn wait(mut child: Child, what: &str) -> Output {
    let started = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if started.elapsed() > MAX_RUN_TIME {
            child.kill().unwrap();
            panic!("hangs: {what}");
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    child.wait_with_output().unwrap()
}

/// Sends a signal, such as `-INT`; returns false if the program has ended.
pub fn signal(child: &Child, name: &str) -> bool {
    Command::new("kill").args([name, &child.id().to_string()]).output().unwrap().status.success()
}

/// Returns the text of stderr.
pub fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Returns the text of stdout.
pub fn printed(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Runs a command that must fail with one line of error that holds each of `says`, print nothing,
/// and say nothing else but lines that begin with one of `others`. Returns the line.
pub fn fails(command: &mut Command, says: &[&str], others: &[&str]) -> String {
    let output = finish(command);
    let said = said(&output);
    let what = format!("{command:?}\n{:?}\n{said}", output.status);
    assert!(matches!(output.status.code(), Some(1 | 2)), "{what}");
    assert!(!said.contains("panicked"), "{what}");
    let (errors, rest): (Vec<&str>, Vec<&str>) = said.lines().partition(|line| line.starts_with("error: "));
    assert!(rest.iter().all(|line| others.iter().any(|other| line.starts_with(other))), "{what}");
    let [error] = errors[..] else { panic!("not one line of error: {what}") };
    for part in says {
        assert!(error.contains(part), "no {part:?} in: {what}");
    }
    assert!(output.stdout.is_empty(), "{what}");
    error.into()
}

/// [`fails`], and leaves everything below `folder` as it was.
pub fn refuses(command: &mut Command, folder: &Path, says: &[&str], others: &[&str]) -> String {
    let before = listing(folder);
    let line = fails(command, says, others);
    let after = listing(folder);
    let changed = |path: &&PathBuf| before.get(*path) != after.get(*path);
    let changed: Vec<&PathBuf> = before.keys().chain(after.keys()).filter(changed).collect();
    assert!(changed.is_empty(), "{command:?}: {line}: {changed:?}");
    line
}

/// Every file below a folder with its content, every folder and special file without.
pub fn listing(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        // A program that runs may have renamed it since.
        let Ok(about) = fs::symlink_metadata(&path) else { continue };
        if about.is_dir() {
            all.extend(listing(&path));
        }
        all.insert(
            path.clone(),
            if about.is_file() { fs::read(&path).unwrap_or_default() } else { Vec::new() },
        );
    }
    all
}
