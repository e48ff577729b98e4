//! Requests that the viewer must refuse: each gets one line of error, and the viewer keeps running.

use crate::client::{Viewer, until};
use crate::socket::{Came, Socket, ask, connect, parts};
use crate::yard_scene;
use serde_json::json;
use std::io::{Read, Write};
use std::time::{Duration, Instant};

/// It still draws.
fn is_well(viewer: &Viewer) {
    let (status, jpeg) = viewer.get("/frame?size=32x24");
    assert_eq!(status, 200);
    assert!(jpeg.starts_with(&[0xff, 0xd8, 0xff]));
}

#[test]
fn foreign_pages_and_names_are_refused() {
    let (_workshop, scene) = yard_scene();
    let viewer = Viewer::of(&scene, &["--port=0"]).loaded();
    let own = format!("http://{}", viewer.address);
    for (headers, expected) in [
        (vec![("Origin", own.as_str())], 200),
        (vec![("Origin", "http://evil.example")], 403),
        (vec![("Origin", "null")], 403),
        (vec![("Host", "evil.example")], 403),
        (vec![("Host", "evil.example"), ("Origin", "http://evil.example")], 403),
        (vec![("Sec-Fetch-Site", "cross-site")], 403),
    ] {
        assert_eq!(viewer.ask("GET", "/state", &headers, b"").0, expected, "{headers:?}");
        assert_eq!(viewer.ask("PUT", "/state", &headers, b"{}").0, expected, "{headers:?}");
    }
    assert_eq!(Socket::open(&viewer.address, &[("Origin", "http://evil.example")]).err(), Some(403));
    assert!(Socket::open(&viewer.address, &[("Origin", &own)]).is_ok());
    // The page says what it may load, and nobody may frame it.
    let (_, head, _) = ask(&viewer.address, "GET", "/", &[], b"");
    for header in
        ["content-security-policy: default-src 'self'", "x-frame-options: DENY", "nosniff", "no-referrer"]
    {
        assert!(head.contains(header), "{header}: {head}");
    }
    is_well(&viewer);
}

#[test]
fn other_addresses_need_the_token() {
    let (_workshop, scene) = yard_scene();
    let mut viewer = Viewer::of(&scene, &["--port=0", "--host=0.0.0.0", "--token=0123456789abcdef"]);
    viewer.address = viewer.address.replace("0.0.0.0", "127.0.0.1");
    let bearer = [("Authorization", "Bearer 0123456789abcdef")];
    until("the scene is read", || viewer.ask("GET", "/state", &bearer, b"").0 == 200);
    for path in ["/", "/state", "/frame", "/main.js", "/?token=", "/?token=0123456789abcdeF", "/ws"] {
        assert_eq!(viewer.get(path).0, 401, "{path}");
    }
    assert_eq!(Socket::open(&viewer.address, &[]).err(), Some(401));
    let (status, head, _) = ask(&viewer.address, "GET", "/?token=0123456789abcdef", &[], b"");
    assert!(status == 303 && head.contains("location: /\r\n"), "{head}");
    let cookie = head.split("set-cookie: ").nth(1).unwrap().split(';').next().unwrap();
    assert_eq!(viewer.ask("GET", "/", &[("Cookie", cookie)], b"").0, 200);
    assert!(Socket::open(&viewer.address, &[("Cookie", cookie)]).is_ok());
}

#[test]
fn no_name_reaches_the_file_system() {
    let (workshop, scene) = yard_scene();
    std::fs::write(workshop.path("cam.json"), "{}").unwrap();
    let viewer = Viewer::of(&scene, &["--port=0"]).loaded();
    for path in [
        "/../Cargo.toml",
        "/..%2fCargo.toml",
        "/thumbnails/..%2f..%2fetc%2fpasswd",
        "/files/..%2fsecret",
        "/videos/1/file",
        "/%00",
    ] {
        assert!(matches!(viewer.get(path).0, 400 | 404 | 405), "{path}");
    }
    let cam = workshop.path("cam.json").display().to_string();
    for query in [
        format!("camera={cam}"),
        "set=sky.panorama=/etc/passwd".into(),
        format!("weather={}", workshop.path("x.toml").display()),
    ] {
        let (status, said) = viewer.get(&format!("/frame?{query}"));
        let said = String::from_utf8(said).unwrap();
        assert!(status == 400 && said.lines().count() == 1 && !said.contains("root:"), "{query}: {said}");
    }
    let (status, said) =
        viewer.ask("PUT", "/state", &[], br#"{"weather": {"sky": {"panorama": "/etc/passwd"}}}"#);
    assert!(
        status == 400 && String::from_utf8_lossy(&said).contains("--panorama"),
        "{}",
        String::from_utf8_lossy(&said)
    );
    is_well(&viewer);
}

#[test]
fn huge_and_malformed_requests_are_refused_in_a_line() {
    let (_workshop, scene) = yard_scene();
    let viewer = Viewer::of(&scene, &["--port=0"]).loaded();
    let huge = vec![b' '; 2 << 20];
    assert_eq!(viewer.ask("PUT", "/state", &[], &huge).0, 413);
    for body in [
        "",
        "{",
        "3",
        "null",
        r#"{"time": "now"}"#,
        r#"{"time": 1e999}"#,
        r#"{"tiem": 1}"#,
        r#"{"size": [0, 5]}"#,
        r#"{"size": [100000, 100000]}"#,
        r#"{"size": [4096, 4096]}"#,
        r#"{"quality": 0}"#,
        r#"{"divider": 2}"#,
        r#"{"camera": {"eye": [0, 0, 0], "rotation": [0, 0, 0, 0], "fov": 50}}"#,
        r#"{"camera": {"eye": [1e300, 0, 0], "rotation": [1, 0, 0, 0], "fov": 500}}"#,
        r#"{"follow": "path"}"#,
        r#"{"weather": {"rain": {"rate": -1}}}"#,
        r#"{"weather": []}"#,
        r#"{"weather": {"fog": {"mor": {"keys": []}}}}"#,
        &format!("{}1{}", "[".repeat(5000), "]".repeat(5000)),
    ] {
        let (status, said) = viewer.ask("PUT", "/state", &[], body.as_bytes());
        let said = String::from_utf8(said).unwrap();
        assert!(
            status == 400 && said.lines().count() == 1 && said.len() < 600,
            "{body:.80}: {status} {said}"
        );
    }
    for query in [
        "time=x",
        "size=3",
        "size=99999x99999",
        "output=heat",
        "set=",
        "set=fog.mor",
        "what=1",
        "fov=400",
        "camera=1",
        "time=%",
        "weather=fgo",
    ] {
        let (status, said) = viewer.get(&format!("/frame?{query}"));
        let said = String::from_utf8(said).unwrap();
        assert!(status == 400 && said.lines().count() == 1, "{query}: {status} {said}");
    }
    // Not HTTP at all.
    let mut stream = connect(&viewer.address);
    stream.write_all(&[0xff; 4096]).unwrap();
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    assert!(matches!(parts(&answer).0, 0 | 400), "{answer:?}");
    is_well(&viewer);
}

#[test]
fn huge_and_malformed_messages_are_refused_in_a_line() {
    let (_workshop, scene) = yard_scene();
    let viewer = Viewer::of(&scene, &["--port=0"]).loaded();
    let mut socket = Socket::open(&viewer.address, &[]).unwrap();
    for text in [
        "",
        "{",
        "[]",
        r#"{"type": "fly"}"#,
        r#"{"type": "view"}"#,
        r#"{"type": "pick", "x": 9, "y": 0}"#,
        r#"{"type": "view", "seq": 1, "moving": true, "state": {"size": [-1, 2]}}"#,
        r#"{"type": "view", "seq": -1, "moving": 1, "state": 0}"#,
    ] {
        socket.send(1, text.as_bytes()).unwrap();
        let said = loop {
            match socket.next() {
                Came::Word(word) if word["type"] == "error" => {
                    break word["text"].as_str().unwrap().to_owned();
                }
                Came::Word(_) => {}
                other => panic!("{text}: {other:?}"),
            }
        };
        assert!(!said.contains('\n') && said.len() < 600, "{text}: {said}");
    }
    // The same page goes on.
    socket.view(1, false, &json!({}));
    assert_eq!(socket.whole().0["seq"], 1);
    // What is no words ends it: bytes, no UTF-8, more than may be, a length that is a lie.
    for (opcode, payload) in
        [(2, vec![0; 10]), (1, vec![0xff; 10]), (1, vec![b' '; 1 << 20]), (7, vec![]), (9, vec![0; 200])]
    {
        let mut socket = Socket::open(&viewer.address, &[]).unwrap();
        let _ = socket.send(opcode, &payload);
        while !matches!(socket.next(), Came::Closed) {}
    }
    let mut socket = Socket::open(&viewer.address, &[]).unwrap();
    socket
        .stream
        .write_all(&[0x81, 0xff, 0x7f, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0])
        .unwrap();
    while !matches!(socket.next(), Came::Closed) {}
    is_well(&viewer);
}

#[test]
fn a_thousand_connections_are_served_or_refused() {
    let (_workshop, scene) = yard_scene();
    let viewer = Viewer::of(&scene, &["--port=0"]).loaded();
    let (mut held, mut refused) = (Vec::new(), 0);
    for _ in 0..1000 {
        let mut stream = connect(&viewer.address);
        stream.set_read_timeout(Some(Duration::from_millis(3))).unwrap();
        let mut answer = [0; 256];
        match stream.read(&mut answer) {
            Ok(0) => refused += 1,
            Ok(length) => {
                let said = String::from_utf8_lossy(&answer[..length]).into_owned();
                assert!(said.starts_with("HTTP/1.1 503 ") && said.contains("too many connections"), "{said}");
                refused += 1;
            }
            Err(_) => held.push(stream),
        }
    }
    assert!(refused > 500, "{refused} refused, {} held", held.len());
    drop(held);
    until("there is room again", || viewer.get("/state").0 == 200);
    // Pages are fewer still.
    let pages: Vec<_> = (0..20).map(|_| Socket::open(&viewer.address, &[])).collect();
    assert_eq!(pages.iter().filter(|page| page.is_ok()).count(), 16);
    assert!(pages.iter().flat_map(|page| page.as_ref().err()).all(|status| *status == 503));
    drop(pages);
    is_well(&viewer);
}

#[test]
#[cfg(target_os = "linux")]
fn who_does_not_read_costs_nothing() {
    let (_workshop, scene) = yard_scene();
    let viewer = Viewer::of(&scene, &["--port=0"]).loaded();
    is_well(&viewer);
    let before = viewer.memory();
    let mut deaf: Vec<Socket> = (0..8).map(|_| Socket::open(&viewer.address, &[]).unwrap()).collect();
    let mut seq = 0;
    let end = Instant::now() + Duration::from_secs(3);
    while Instant::now() < end {
        seq += 1;
        for socket in &mut deaf {
            socket.view(seq, true, &json!({ "size": [480, 320], "time": seq as f64 * 0.001 }));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    // Somebody who reads is served meanwhile.
    let mut page = Socket::open(&viewer.address, &[]).unwrap();
    page.view(7, false, &json!({ "size": [64, 48] }));
    assert_eq!(page.whole().0["seq"], 7);
    let grown = viewer.memory() - before;
    assert!(grown < 60.0, "{grown} MB for {seq} requests of 8 pages");
}

#[test]
fn bad_options_are_told_before_anything_is_served() {
    let (workshop, scene) = yard_scene();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = format!("--port={}", taken.local_addr().unwrap().port());
    let scene = scene.to_str().unwrap();
    let missing = workshop.path("missing.ply").display().to_string();
    for (words, expected) in [
        (vec![missing.as_str()], "no such file"),
        (vec![scene, port.as_str()], "give another --port or --host"),
        (vec![scene, "--token=short"], "--token: must be 16 to 256 letters"),
        (vec![scene, "--panorama=none.png"], "none.png"),
        (vec![scene, "--weather=fgo"], "did you mean `fog`"),
        (vec![scene, "--fov=200"], "--fov 200"),
    ] {
        let output = crate::common::binary().arg("view").args(&words).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{words:?}: {said}");
        assert!(said.starts_with("error: ") && said.lines().count() == 1, "{words:?}: {said}");
        assert!(said.contains(expected) && output.stdout.is_empty(), "{words:?}: {said}");
    }
}
