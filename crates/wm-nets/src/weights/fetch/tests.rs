use super::*;
use crate::testing::{Files, noise, safetensors};
use std::io::{BufRead, BufReader};
use std::net::{SocketAddr, TcpListener};
use std::sync::mpsc::{Receiver, channel};
use std::thread;

/// Answers one request after the other, and tells what was asked, in lower case.
fn serve(answers: Vec<Vec<u8>>) -> (SocketAddr, Receiver<String>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let (tell, asked) = channel();
    thread::spawn(move || {
        for answer in answers {
            let (mut stream, _) = listener.accept().unwrap();
            let mut request = String::new();
            let mut reader = BufReader::new(stream.try_clone().unwrap());
            while !request.ends_with("\r\n\r\n") && reader.read_line(&mut request).unwrap_or(0) > 0 {}
            // Who has heard enough hangs up, and who has asked enough does not listen.
            let _ = stream.write_all(&answer);
            let _ = tell.send(request.to_lowercase());
        }
    });
    (address, asked)
}

fn answer(status: &str, headers: &str, body: &[u8]) -> Vec<u8> {
    [format!("HTTP/1.1 {status}\r\nconnection: close\r\n{headers}\r\n").as_bytes(), body].concat()
}

/// A whole file.
fn whole(body: &[u8]) -> Vec<u8> {
    answer("200 OK", &format!("content-length: {}\r\netag: \"one\"\r\n", body.len()), body)
}

/// 40 kB of weights.
fn weights() -> Vec<u8> {
    safetensors(&[("a".into(), vec![10_000], (0..10_000).map(|i| noise(1, i) as f32).collect())])
}

fn source(address: SocketAddr, checksum: Option<Checksum>) -> DownloadSource {
    DownloadSource { url: format!("http://{address}/file"), file_name: "x.safetensors".into(), checksum }
}

/// Without the proxies of whoever runs the tests.
fn direct(source: &DownloadSource, folder: &Path) -> Result<PathBuf, FetchError> {
    let agent = Agent::config_builder().proxy(None).build().into();
    fetch_by(&agent, source, folder, &mut |_| {})
}

fn said<T>(result: Result<T, FetchError>) -> String {
    let line = result.err().expect("refused").to_string();
    assert!(!line.contains('\n') && line.starts_with("http://127.0.0.1:"), "{line}");
    line
}

fn names(folder: &Path) -> Vec<String> {
    let names = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

fn checksum_of(bytes: &[u8]) -> Checksum {
    Checksum(Sha256::digest(bytes).into())
}

#[test]
fn a_file_is_fetched_once() {
    let (files, body) = (Files::new(), weights());
    let folder = files.path().join("new/folder");
    let (address, asked) = serve(vec![whole(&body)]);
    let source = source(address, Some(checksum_of(&body)));
    let agent = Agent::config_builder().proxy(None).build().into();
    let mut seen = Vec::new();
    let path = fetch_by(&agent, &source, &folder, &mut |progress| seen.push(progress)).unwrap();
    assert_eq!(fs::read(&path).unwrap(), body);
    assert_eq!(names(&folder), ["x.safetensors"]);
    let total = Some(body.len() as u64);
    assert_eq!(seen.first(), Some(&FetchProgress { done: 0, total }));
    assert_eq!(seen.last(), Some(&FetchProgress { done: body.len() as u64, total }));
    assert!(!asked.recv().unwrap().contains("range:"));
    // There is no second answer.
    assert_eq!(direct(&source, &folder).unwrap(), path);
    let other = DownloadSource { checksum: Some(checksum_of(b"")), ..source };
    let line = said(direct(&other, &folder));
    assert!(line.contains("was there already and has SHA-256 "), "{line}");
    assert_eq!(fs::read(&path).unwrap(), body);
}

#[test]
fn what_broke_off_goes_on() {
    let (files, body) = (Files::new(), weights());
    let length = body.len();
    let cut = |end: usize| {
        let headers = format!("content-length: {length}\r\netag: \"one\"\r\n");
        answer("200 OK", &headers, &body[..end])
    };
    let rest = |from: usize| {
        let headers = format!(
            "content-length: {}\r\ncontent-range: bytes {from}-{}/{length}\r\netag: \"one\"\r\n",
            length - from,
            length - 1
        );
        answer("206 Partial Content", &headers, &body[from..])
    };
    let (address, asked) = serve(vec![
        cut(10_000),
        answer("302 Found", "location: /elsewhere\r\ncontent-length: 0\r\n", b""),
        rest(10_000),
    ]);
    let source = source(address, None);
    let line = said(direct(&source, files.path()));
    assert!(line.contains("broke off after 10000 bytes"), "{line}");
    assert_eq!(names(files.path()), ["x.safetensors.part", "x.safetensors.part.etag"]);
    let path = direct(&source, files.path()).unwrap();
    assert_eq!(fs::read(path).unwrap(), body);
    assert_eq!(names(files.path()), ["x.safetensors"]);
    assert!(!asked.recv().unwrap().contains("range:"));
    let second = asked.recv().unwrap();
    assert!(
        second.contains("range: bytes=10000-\r\n") && second.contains("if-range: \"one\"\r\n"),
        "{second}"
    );
}

/// The server has another file by now, or no parts, or nothing behind what is kept.
#[test]
fn what_cannot_go_on_starts_again() {
    let body = weights();
    let cut = |etag: &str| {
        let headers = format!("content-length: {}\r\n{etag}", body.len());
        answer("200 OK", &headers, &[b'x'; 3000])
    };
    let beyond = || answer("416 Range Not Satisfiable", "content-length: 0\r\n", b"");
    for (answers, asks_for_a_part) in [
        (vec![cut("etag: \"old\"\r\n"), whole(&body)], true),
        (vec![cut("etag: \"old\"\r\n"), beyond(), whole(&body)], true),
        (vec![cut("etag: W/\"old\"\r\n"), whole(&body)], false),
        (vec![cut(""), whole(&body)], false),
    ] {
        let files = Files::new();
        let (address, asked) = serve(answers);
        let source = source(address, None);
        said(direct(&source, files.path()));
        assert_eq!(fs::read(direct(&source, files.path()).unwrap()).unwrap(), body);
        asked.recv().unwrap();
        assert_eq!(asked.recv().unwrap().contains("range: bytes=3000-"), asks_for_a_part);
    }
    let files = Files::new();
    let odd = answer("206 Partial Content", "content-range: bytes 5-9/10\r\ncontent-length: 5\r\n", &[0; 5]);
    let (address, _asked) = serve(vec![cut("etag: \"old\"\r\n"), odd]);
    let source = source(address, None);
    said(direct(&source, files.path()));
    let line = said(direct(&source, files.path()));
    assert!(line.contains("another part than was asked for"), "{line}");
}

#[test]
fn what_is_no_such_file_is_not_kept() {
    let (files, body) = (Files::new(), weights());
    let page = b"<html>log in</html>";
    let (address, _asked) = serve(vec![whole(&body), whole(page), whole(&[])]);
    let wrong = source(address, Some(checksum_of(page)));
    let line = said(direct(&wrong, files.path()));
    assert!(
        line.contains(&format!("has SHA-256 {}, not {}", checksum_of(&body), checksum_of(page))),
        "{line}"
    );
    let source = source(address, None);
    let line = said(direct(&source, files.path()));
    assert!(line.contains("holds no weights (neither a safetensors file"), "{line}");
    let line = said(direct(&source, files.path()));
    assert!(line.contains("holds no weights (the file is empty"), "{line}");
    assert!(names(files.path()).is_empty());
}

#[test]
fn servers_that_refuse_or_are_not_there() {
    let files = Files::new();
    let huge = format!("content-length: {}\r\n", MAX_FILE_BYTES + 1);
    let (address, _asked) = serve(vec![
        answer("404 Not Found", "content-length: 4\r\n", b"none"),
        answer("200 OK", &huge, b""),
        answer("302 Found", &format!("location: http://{}/\r\ncontent-length: 0\r\n", closed()), b""),
    ]);
    let source = source(address, None);
    let line = said(direct(&source, files.path()));
    assert!(
        line.contains("/file: the server answers 404 Not Found; ") && line.ends_with("give its path"),
        "{line}"
    );
    assert!(said(direct(&source, files.path())).contains("a file of more than 17179869184 bytes"));
    assert!(said(direct(&source, files.path())).contains("cannot be reached ("));
    let nobody = DownloadSource { url: format!("http://{}/file", closed()), ..source };
    let line = said(direct(&nobody, files.path()));
    assert!(line.contains("cannot be reached (") && line.ends_with("give its path"), "{line}");
    assert!(names(files.path()).is_empty());
    let blocked = files.put("blocked", b"");
    assert!(said(direct(&nobody, &blocked)).contains("cannot be written"));
}

/// An address where no server listens.
fn closed() -> SocketAddr {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
}

#[test]
fn two_at_a_time_do_not_mix() {
    let files = Files::new();
    let held = File::create(files.path().join("x.safetensors.part")).unwrap();
    held.lock().unwrap();
    let line = said(direct(&source(closed(), None), files.path()));
    assert!(line.contains("x.safetensors.part is being written by another program"), "{line}");
}

#[test]
fn checksums_in_text() {
    let empty = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
    assert_eq!(checksum_of(b"").to_string(), empty);
    assert_eq!(empty.to_uppercase().parse(), Ok(checksum_of(b"")));
    for text in ["", "e3", &empty[1..], &empty.replace('e', "g"), &format!("{empty}00")] {
        assert!(text.parse::<Checksum>().is_err(), "{text}");
    }
}
