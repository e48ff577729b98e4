//! Pipes, terminals that are gone, odd names and Ctrl-C.

use super::*;
use crate::process::begin;

#[test]
fn readers_that_are_gone() {
    let place = place();
    for args in [&["inspect", "good.ply"][..], &["inspect", "--json", "good.ply"], &["render", "--help"]] {
        let mut child = begin(&mut place.program(args));
        drop(child.stdout.take());
        let output = wait(child, "a closed pipe");
        let said = said(&output);
        assert!(output.status.success() && !said.contains("panicked"), "{args:?}: {said}");
    }
    // The picture is what was asked for; the line about it is not.
    let mut child = begin(&mut place.program(render("good.ply", &[])));
    drop((child.stdout.take(), child.stderr.take()));
    assert!(wait(child, "closed pipes").status.success());
    assert!(place.path("a.png").is_file());
}

#[test]
fn reports_are_json() {
    let place = place();
    let report = place.inspected("good.ply");
    assert_eq!((&report["health"]["splats"], &report["scene"]), (&60.into(), &"good.ply".into()));
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_told() {
    let place = place();
    for args in [&["inspect", "good.ply"][..], &["inspect", "--json", "good.ply"]] {
        let full = fs::File::options().write(true).open("/dev/full").unwrap();
        let child = place.program(args).stdout(full).stderr(Stdio::piped()).spawn().unwrap();
        let output = wait(child, "a full disk");
        let said = said(&output);
        assert_eq!(output.status.code(), Some(1), "{args:?}");
        assert!(said.starts_with("error: cannot print: ") && said.lines().count() == 1, "{args:?}: {said}");
    }
}

#[cfg(unix)]
#[test]
fn names_of_any_bytes() {
    use std::os::unix::ffi::OsStrExt;
    let place = place();
    let name = OsStr::from_bytes(b"b\xffd\n.ply");
    if fs::write(place.path(name), Ply::sound().bytes()).is_err() {
        eprintln!("skipped: this file system has names in UTF-8 only");
        return;
    }
    assert!(place.outcome([OsStr::new("inspect"), name]).status.success());
    let out = OsStr::from_bytes(b"p\xff.png");
    let usual = USUAL[..3].iter().flat_map(|(a, b)| [OsStr::new(a), OsStr::new(b)]);
    let words: Vec<&OsStr> =
        [OsStr::new("render"), name, OsStr::new("--out"), out].into_iter().chain(usual).collect();
    assert!(place.outcome(words).status.success());
    assert!(place.path(out).is_file());
    // What the page writes into links and commands is text.
    #[cfg(feature = "viewer")]
    place.refuses(
        [OsStr::new("view"), name, OsStr::new("--panorama"), out],
        &["p\u{fffd}.png: its path is not text in UTF-8; rename it"],
    );
    fs::write(place.path(name), "ply\n").unwrap();
    place.refuses([OsStr::new("inspect"), name], &["b\u{fffd}d\\n.ply: cut off in the header"]);
}

#[cfg(unix)]
mod pipes {
    use super::*;
    use crate::process::{listing, signal};
    use std::io::Write;
    use std::thread;

    /// A pipe with a name, and a thread that writes `content` into it for one reader.
    fn pipe(place: &Workshop, name: &str, content: Vec<u8>) -> thread::JoinHandle<()> {
        let path = place.path(name);
        assert!(Command::new("mkfifo").arg(&path).status().unwrap().success());
        thread::spawn(move || {
            let mut pipe = fs::File::options().write(true).open(&path).unwrap();
            // The reader may have seen enough.
            let _ = pipe.write_all(&content);
        })
    }

    #[test]
    fn scenes_come_through_pipes() {
        let place = place();
        let huge = Ply { count: "1000000000000".into(), ..Ply::sound() };
        let sound = Ply::sound().bytes();
        let writers =
            [pipe(&place, "a", sound.clone()), pipe(&place, "b", sound), pipe(&place, "c", huge.bytes())];
        place.rendered("a", &[]);
        assert!(place.outcome(["inspect", "b"]).status.success());
        place.render_refused("c", &[], &["c: cut off: the header promises 1000000000000 splats"]);
        writers.into_iter().for_each(|writer| writer.join().unwrap());
    }

    #[test]
    fn scenes_come_through_standard_input() {
        let place = place();
        if !Path::new("/dev/stdin").exists() {
            eprintln!("skipped: there is no /dev/stdin");
            return;
        }
        let file = fs::File::open(place.path("good.ply")).unwrap();
        assert!(finish(place.program(["inspect", "/dev/stdin"]).stdin(file)).status.success());
        let mut child = begin(place.program(["inspect", "/dev/stdin"]).stdin(Stdio::piped()));
        child.stdin.take().unwrap().write_all(&Ply::sound().bytes()).unwrap();
        assert!(wait(child, "standard input").status.success());
        place.refuses(["inspect", "/dev/stdin"], &["/dev/stdin: the file is empty"]);
    }

    #[test]
    fn what_waits_can_be_ended() {
        let place = place();
        let path = place.path("pipe");
        assert!(Command::new("mkfifo").arg(&path).status().unwrap().success());
        let before = listing(&place.path(""));
        let child = begin(&mut place.program(render("pipe", &[])));
        // Opens when the program does; it then waits for bytes that do not come.
        let held = fs::File::options().write(true).open(&path).unwrap();
        assert!(signal(&child, "-INT"));
        let output = wait(child, "a pipe that stays open, after Ctrl-C");
        drop(held);
        assert_eq!(output.status.code(), Some(130));
        assert_eq!(listing(&place.path("")), before);
    }

    #[cfg(feature = "h264")]
    #[test]
    fn a_video_that_is_ended_leaves_nothing() {
        use crate::process::MAX_RUN_TIME;
        use std::time::{Duration, Instant};
        let place = place();
        let before = listing(&place.path(""));
        for (signals, status) in
            [(&["-INT"][..], 130), (&["-INT", "-INT"], 130), (&["-TERM"], 143), (&["-HUP"], 129)]
        {
            let more = ["--out", "a.mp4", "--seconds", "30000"];
            let child = begin(&mut place.program(render("good.ply", &more)));
            let started = Instant::now();
            let writes = || {
                listing(&place.path("")).iter().any(|(path, content)| {
                    path.extension().is_some_and(|e| e == "part") && !content.is_empty()
                })
            };
            while !writes() {
                assert!(started.elapsed() < MAX_RUN_TIME, "no video begins");
                thread::sleep(Duration::from_millis(5));
            }
            assert!(signals.iter().all(|name| signal(&child, name)));
            let output = wait(child, "a video, after a signal");
            assert_eq!(output.status.code(), Some(status), "{}", said(&output));
            assert_eq!(listing(&place.path("")), before, "{signals:?}");
        }
    }
}
