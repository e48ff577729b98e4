//! Requests that the viewer must refuse: each gets one line of error, and the viewer keeps running.

use crate::viewer::client::Viewer;
use crate::viewer::socket::{Socket, SocketEvent, ask, connect, parts};
use crate::viewer::{yard_scene, yard_viewer};
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
    let (_workshop, viewer) = yard_viewer();
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
    assert_eq!(viewer.socket(&[("Origin", "http://evil.example")]).err(), Some(403));
    assert!(viewer.socket(&[("Origin", &own)]).is_ok());
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
fn every_request_for_the_scene_needs_the_token() {
    let (_workshop, viewer) = yard_viewer();
    let ask = |method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]| {
        ask(&viewer.address, method, path, headers, body)
    };
    let get = |path: &str, headers: &[(&str, &str)]| ask("GET", path, headers, b"").0;
    for path in
        ["/state", "/frame", "/parameters", "/ws", "/thumbnails/fog", "/videos/1/file", "/no-such-page"]
    {
        assert_eq!(get(path, &[]), 401, "{path}");
        let query = format!("{path}?token={}", viewer.token);
        assert_eq!(get(&query, &[]), 401, "{path}: by its query");
        assert_eq!(get(path, &[("Authorization", "Bearer 0123456789abcdef0123456789abcdef")]), 401, "{path}");
    }
    for (method, path, body) in [
        ("PUT", "/state", "{}"),
        ("POST", "/facts", r#"{"action": "clouds"}"#),
        ("POST", "/files/picture", "{}"),
        ("POST", "/surface", "{}"),
        ("POST", "/link", "{}"),
        ("POST", "/videos", "{}"),
        ("DELETE", "/videos/1", ""),
    ] {
        assert_eq!(ask(method, path, &[], body.as_bytes()).0, 401, "{method} {path}");
    }
    assert_eq!(Socket::open(&viewer.address, &[]).err(), Some(401));
    // The files of the page have nothing of the scene.
    assert_eq!((get("/", &[]), get("/main.js", &[])), (200, 200));
    assert_eq!(ask("GET", "/login", &[], b"").2, b"false");

    assert_eq!(ask("POST", "/login", &[], b"0123456789abcdef0123456789abcdef").0, 403);
    assert_eq!(ask("POST", "/login", &[], &[0xff; 32]).0, 403);
    assert_eq!(ask("POST", "/login", &[], &[b'a'; 1000]).0, 413);
    let token = viewer.token.as_bytes();
    assert_eq!(ask("POST", "/login", &[("Origin", "http://evil.example")], token).0, 403);
    let (status, head, _) = ask("POST", "/login", &[], token);
    assert!(status == 204 && head.contains("HttpOnly; SameSite=Strict"), "{head}");
    let cookie = head.split("set-cookie: ").nth(1).unwrap().split(';').next().unwrap();
    assert_eq!(get("/state", &[("Cookie", cookie)]), 200);
    assert_eq!(ask("GET", "/login", &[("Cookie", cookie)], b"").2, b"true");
    assert!(Socket::open(&viewer.address, &[("Cookie", cookie)]).is_ok());
    // The browser's cookie does not help a foreign page.
    assert_eq!(get("/state", &[("Cookie", cookie), ("Origin", "http://evil.example")]), 403);
    is_well(&viewer);
}

#[test]
fn one_bad_request_is_told_to_its_client_and_hurts_nobody_else() {
    let (_workshop, viewer) = yard_viewer();
    let mut page = viewer.socket(&[]).unwrap();
    let night = json!({ "name": "night", "light": { "model": "night" }, "rain": { "rate": 5 } });
    page.view(1, false, &json!({ "weather": night, "size": [32, 24] }));
    let (_, before) = page.whole();
    let lidar = |at: serde_json::Value| json!({ "lidar": { "model": "vlp-16", "at": at } });
    let facts = |change: serde_json::Value| ("/facts", change);
    let camera = |eye: f64| json!({ "camera": { "eye": [0, eye, 0], "rotation": [1, 0, 0, 0], "fov": 50 } });
    for (path, body) in [
        facts(json!({ "action": "lamp", "point": [1e300, 0, 0] })),
        facts(json!({ "action": "lamp", "point": [0, -1e20, 0] })),
        facts(json!({ "action": "window", "points": [[0, 0, 0], [1e300, 0, 1e300]], "eye": [0, -5, 0] })),
        facts(json!({ "action": "window", "points": [[0, 0, 0], [1, 0, 1]], "eye": [0, -1e300, 0] })),
        facts(json!({ "action": "ground", "points": [[1e300, 0, 0], [0, 1e300, 0], [0, 0, 1e300]] })),
        facts(json!({ "action": "scale", "points": [[0, 0, 0], [1, 0, 0]], "metres": 1e300 })),
        facts(json!({ "action": "scale", "points": [[0, 0, 0], [1, 0, 0]], "metres": 1e-300 })),
        facts(json!({ "action": "sun", "points": [[1e300, 0, 1e300], [0, 0, 0]] })),
        ("/files/points", lidar(json!({ "eye": [1e20, 0, 0], "target": [0, 0, 0] }))),
        ("/files/points", lidar(json!({ "eye": [0, 0, 1], "target": [1e300, 0, 0] }))),
        ("/files/picture", camera(1e20)),
        ("/files/picture", camera(-1e300)),
        (
            "/files/picture",
            json!({ "camera": { "eye": [0, 0, 0], "rotation": [1e308, 1e308, 0, 0], "fov": 50 } }),
        ),
    ] {
        let said = viewer.refuses("POST", path, &body.to_string(), "");
        assert!(said.len() < 400, "{path} {body}: {said}");
    }
    for query in ["camera=nan,0,0:0,0,1", "camera=1e20,0,0:0,0,1", "fov=nan", "time=inf", "divider=nan"] {
        assert_eq!(viewer.get(&format!("/frame?{query}")).0, 400, "{query}");
    }
    page.view(2, false, &json!({}));
    assert!(page.whole().1 == before, "the other page has another picture");
}

/// `apps/cli/examples/fuzz_viewer` says what must hold.
#[test]
fn requests_from_the_edges_hurt_no_other_page() {
    let (_workshop, viewer) = yard_viewer();
    let program = std::path::Path::new(env!("CARGO_BIN_EXE_weather-magician"))
        .with_file_name("examples/fuzz_viewer")
        .with_extension(std::env::consts::EXE_EXTENSION);
    assert!(program.exists(), "{} is not built: run `cargo test --workspace`", program.display());
    let address = format!("http://{}/#token={}", viewer.address, viewer.token);
    let output = std::process::Command::new(program)
        .args([&address, "500", &viewer.id().to_string()])
        .output()
        .expect("the example starts");
    let said = [output.stdout, output.stderr].concat();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&said));
}

#[test]
#[cfg(unix)]
fn facts_that_were_not_saved_outlast_the_program() {
    let (workshop, scene) = yard_scene();
    let facts = |viewer: &Viewer| viewer.json("GET", "/parameters", &json!({}))["scene"].clone();
    let change = |viewer: &Viewer, body: serde_json::Value| viewer.json("POST", "/facts", &body);
    let journal = workshop.path("yard.ply.unsaved.wm.toml");
    let show = || Viewer::of(&scene, &["--port=0", "--camera=0.5,-12,3:0,4,1"]).loaded();
    let viewer = show();
    change(&viewer, json!({ "action": "scale", "points": [[0, 0, 0], [0, 2, 0]], "metres": 1 }));
    change(&viewer, json!({ "action": "lamp", "point": [0.0, -3.0, 0.0] }));
    let night = json!({ "weather": { "name": "night", "light": { "model": "night" } }, "time": 1 });
    let lit = viewer.file("picture", &night);
    // Killed, as the test does it.
    drop(viewer);
    assert!(journal.exists());
    let viewer = show();
    let found = facts(&viewer);
    assert!(found["metres_per_unit"] == 0.5 && found["unsaved"] == true, "{found}");
    assert!(viewer.file("picture", &night) == lit, "the lamp is another one");
    let undone = change(&viewer, json!({ "action": "undo" }));
    assert!(undone["facts"]["metres_per_unit"] == 1.0 && !journal.exists(), "{undone}");
    change(&viewer, json!({ "action": "flip" }));
    assert!(journal.exists());
    change(&viewer, json!({ "action": "save" }));
    assert!(!journal.exists());
    // What is older than the scene's own facts, or damaged, is left alone.
    std::fs::write(&journal, "metres_per_unit = 3.0\n").unwrap();
    let old = std::time::SystemTime::now() - Duration::from_secs(3600);
    std::fs::File::options().write(true).open(&journal).unwrap().set_modified(old).unwrap();
    drop(viewer);
    let viewer = show();
    assert_eq!(facts(&viewer)["unsaved"], false);
    drop(viewer);
    std::fs::write(&journal, "metres_per_unit = nonsense").unwrap();
    let viewer = show();
    assert_eq!(facts(&viewer)["unsaved"], false);
}

#[test]
#[cfg(target_os = "linux")]
fn the_command_names_files_that_are_not_utf_8() {
    use std::os::unix::ffi::OsStrExt;
    let (workshop, scene) = yard_scene();
    let named = workshop.path("").join(std::ffi::OsStr::from_bytes(b"Stra\xdfe.ply"));
    std::fs::rename(&scene, &named).unwrap();
    let viewer = Viewer::of(&named, &["--port=0"]).loaded();
    let command = String::from_utf8(viewer.file("command", &json!({}))).unwrap();
    assert!(command.contains("/Stra\\337e.ply' "), "{command}");
}

#[test]
fn no_name_reaches_the_file_system() {
    let (workshop, scene) = yard_scene();
    workshop.put("cam.json", "{}");
    let viewer = Viewer::of(&scene, &["--port=0"]).loaded();
    let paths = "/../Cargo.toml /..%2fCargo.toml /thumbnails/..%2f..%2fetc%2fpasswd /files/..%2fsecret \
                 /videos/1/file /%00";
    for path in paths.split_whitespace() {
        assert!(matches!(viewer.get(path).0, 400 | 404 | 405), "{path}");
    }
    let cam = workshop.path("cam.json").display().to_string();
    for query in [
        format!("camera={cam}"),
        "set=sky.panorama=/etc/passwd".into(),
        format!("weather={}", workshop.path("x.toml").display()),
    ] {
        let said = viewer.refuses("GET", &format!("/frame?{query}"), "", "");
        assert!(!said.contains("root:"), "{query}: {said}");
    }
    let sky = r#"{"weather": {"sky": {"panorama": "/etc/passwd"}}}"#;
    viewer.refuses("PUT", "/state", sky, "--panorama");
    is_well(&viewer);
}

#[test]
fn huge_and_malformed_requests_are_refused_in_a_line() {
    let (_workshop, viewer) = yard_viewer();
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
        viewer.refuses("PUT", "/state", body, "");
    }
    let queries = "time=x size=3 size=99999x99999 output=heat set= set=fog.mor what=1 fov=400 camera=1 time=% \
                   weather=fgo";
    for query in queries.split_whitespace() {
        viewer.refuses("GET", &format!("/frame?{query}"), "", "");
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
    let (_workshop, viewer) = yard_viewer();
    let mut socket = viewer.socket(&[]).unwrap();
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
        let said = socket.word("error")["text"].as_str().unwrap().to_owned();
        assert!(!said.contains('\n') && said.len() < 600, "{text}: {said}");
    }
    // The same page goes on.
    socket.view(1, false, &json!({}));
    assert_eq!(socket.whole().0["seq"], 1);
    // What is no words ends it: bytes, no UTF-8, more than may be, a length that is a lie.
    for (opcode, payload) in
        [(2, vec![0; 10]), (1, vec![0xff; 10]), (1, vec![b' '; 1 << 20]), (7, vec![]), (9, vec![0; 200])]
    {
        let mut socket = viewer.socket(&[]).unwrap();
        let _ = socket.send(opcode, &payload);
        while !matches!(socket.next(), SocketEvent::Closed) {}
    }
    let mut socket = viewer.socket(&[]).unwrap();
    let lie = [0x81, 0xff, 0x7f, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0];
    socket.stream.write_all(&lie).unwrap();
    while !matches!(socket.next(), SocketEvent::Closed) {}
    is_well(&viewer);
}

#[test]
fn a_thousand_connections_keep_nobody_out() {
    let (_workshop, viewer) = yard_viewer();
    let mut page = viewer.socket(&[]).unwrap();
    let mut held: Vec<_> = (0..1000)
        .map(|number| {
            let mut stream = connect(&viewer.address);
            // Some say nothing, some half of something.
            if number % 2 == 0 {
                stream.write_all(b"GET /state HTTP/1.1\r\nHost: ").unwrap();
            }
            if number % 100 == 0 {
                assert_eq!(viewer.get("/state").0, 200);
            }
            stream
        })
        .collect();
    is_well(&viewer);
    page.view(1, false, &json!({ "size": [32, 24] }));
    assert_eq!(page.whole().0["seq"], 1);
    // The oldest had to leave.
    let is_closed = |stream: &mut std::net::TcpStream| {
        stream.set_read_timeout(Some(Duration::from_millis(30))).unwrap();
        match stream.read(&mut [0; 16]) {
            Ok(length) => length == 0,
            Err(error) => error.kind() == std::io::ErrorKind::ConnectionReset,
        }
    };
    assert!(held[..900].iter_mut().all(is_closed));
    assert!(held.iter_mut().rev().filter_map(|stream| (!is_closed(stream)).then_some(())).count() <= 16);
    drop(held);
    // Pages are fewer still.
    let pages: Vec<_> = (0..20).map(|_| viewer.socket(&[])).collect();
    assert_eq!(pages.iter().filter(|page| page.is_ok()).count(), 15);
    assert!(pages.iter().flat_map(|page| page.as_ref().err()).all(|status| *status == 503));
    drop(pages);
    is_well(&viewer);
}

#[test]
#[cfg(target_os = "linux")]
fn who_does_not_read_costs_nothing() {
    let (_workshop, viewer) = yard_viewer();
    is_well(&viewer);
    let before = viewer.memory();
    let mut deaf: Vec<Socket> = (0..8).map(|_| viewer.socket(&[]).unwrap()).collect();
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
    let mut page = viewer.socket(&[]).unwrap();
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
        (vec![scene, "--token=0123456789abcdef"], "could read it in the list of processes"),
        (vec![scene, "--token-file=none.txt"], "--token-file none.txt: cannot be read"),
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
