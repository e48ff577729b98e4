//! The least of an HTTP and a WebSocket client.

#![allow(dead_code)] // Each program uses its part.

use serde_json::{Value, json};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// Longest that anything may take.
pub const MAX_ANSWER_TIME: Duration = Duration::from_secs(60);

/// Status, head and body of a request over a connection of its own. `Host` is the address unless it
/// is among the headers.
pub fn ask(
    address: &str,
    method: &str,
    path: &str,
    headers: &[(&str, &str)],
    body: &[u8],
) -> (u16, String, Vec<u8>) {
    let mut stream = connect(address);
    let mut head =
        format!("{method} {path} HTTP/1.1\r\nConnection: close\r\nContent-Length: {}\r\n", body.len());
    if !headers.iter().any(|(name, _)| *name == "Host") {
        head += &format!("Host: {address}\r\n");
    }
    headers.iter().for_each(|(name, value)| head += &format!("{name}: {value}\r\n"));
    stream.write_all((head + "\r\n").as_bytes()).unwrap();
    // A server that has had enough closes before it has read all.
    let _ = stream.write_all(body);
    // Not until the end of the connection, which some servers leave open.
    let (mut answer, mut part) = (Vec::new(), [0; 1 << 16]);
    while !is_whole(&answer) {
        match stream.read(&mut part) {
            Ok(length @ 1..) => answer.extend(&part[..length]),
            _ => break,
        }
    }
    parts(&answer)
}

/// Returns true if an answer has all the bytes that its header promises.
fn is_whole(answer: &[u8]) -> bool {
    let Some(end) = answer.windows(4).position(|four| four == b"\r\n\r\n") else { return false };
    let head = String::from_utf8_lossy(&answer[..end]).to_ascii_lowercase();
    let length =
        head.lines().find_map(|line| line.strip_prefix("content-length:")?.trim().parse::<usize>().ok());
    length.is_some_and(|length| answer.len() >= end + 4 + length) || answer.ends_with(b"\r\n0\r\n\r\n")
}

/// An answer in its parts; status 0 for none.
pub fn parts(answer: &[u8]) -> (u16, String, Vec<u8>) {
    let Some(end) = answer.windows(4).position(|four| four == b"\r\n\r\n") else {
        return (0, String::new(), Vec::new());
    };
    let head = String::from_utf8_lossy(&answer[..end]).into_owned();
    let status = head.split(' ').nth(1).and_then(|code| code.parse().ok()).unwrap_or(0);
    let body = answer[end + 4..].to_vec();
    let is_chunked = head.to_ascii_lowercase().contains("transfer-encoding: chunked");
    (status, head, if is_chunked { dechunked(&body) } else { body })
}

fn dechunked(mut rest: &[u8]) -> Vec<u8> {
    let mut whole = Vec::new();
    while let Some(end) = rest.windows(2).position(|two| two == b"\r\n") {
        let size = usize::from_str_radix(std::str::from_utf8(&rest[..end]).unwrap().trim(), 16).unwrap();
        whole.extend(&rest[end + 2..][..size]);
        rest = &rest[end + 2 + size + 2..];
    }
    whole
}

pub fn connect(address: &str) -> TcpStream {
    let stream = TcpStream::connect(address).expect("the viewer listens");
    stream.set_read_timeout(Some(MAX_ANSWER_TIME)).unwrap();
    stream.set_write_timeout(Some(MAX_ANSWER_TIME)).unwrap();
    stream
}

/// A WebSocket.
pub struct Socket {
    pub stream: TcpStream,
}

/// A message received over the socket.
#[derive(Debug)]
pub enum SocketEvent {
    Word(Value),
    /// Head and JPEG.
    Picture(Value, Vec<u8>),
    Closed,
}

impl Socket {
    /// Opens one; the status that it was refused with otherwise.
    pub fn open(address: &str, headers: &[(&str, &str)]) -> Result<Self, u16> {
        let mut stream = connect(address);
        let mut head = format!(
            "GET /ws HTTP/1.1\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\
             Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nHost: {address}\r\n"
        );
        headers.iter().for_each(|(name, value)| head += &format!("{name}: {value}\r\n"));
        stream.write_all((head + "\r\n").as_bytes()).unwrap();
        let (mut answer, mut byte) = (Vec::new(), [0]);
        while !answer.ends_with(b"\r\n\r\n") && stream.read_exact(&mut byte).is_ok() {
            answer.push(byte[0]);
        }
        match parts(&answer).0 {
            101 => Ok(Self { stream }),
            status => Err(status),
        }
    }

    /// Sends a frame with an opcode; the mask is zeros, which masks nothing.
    pub fn send(&mut self, opcode: u8, payload: &[u8]) -> std::io::Result<()> {
        let mut frame = vec![0x80 | opcode];
        match payload.len() {
            length @ 0..126 => frame.push(0x80 | length as u8),
            length @ 126..65536 => frame.extend([&[0xfe][..], &(length as u16).to_be_bytes()].concat()),
            length => frame.extend([&[0xff][..], &(length as u64).to_be_bytes()].concat()),
        }
        frame.extend([0; 4]);
        frame.extend(payload);
        self.stream.write_all(&frame)
    }

    /// Says something.
    pub fn say(&mut self, word: &Value) {
        self.send(1, word.to_string().as_bytes()).expect("it is listened to");
    }

    /// Asks for a view.
    pub fn view(&mut self, seq: u64, moving: bool, state: &Value) {
        self.say(&json!({ "type": "view", "seq": seq, "moving": moving, "state": state }));
    }

    /// The next that comes; pings are left aside.
    pub fn next(&mut self) -> SocketEvent {
        loop {
            let mut head = [0; 2];
            if self.stream.read_exact(&mut head).is_err() {
                return SocketEvent::Closed;
            }
            let mut length = u64::from(head[1] & 0x7f);
            let mut more = |bytes: usize| {
                let mut buffer = [0; 8];
                self.stream.read_exact(&mut buffer[8 - bytes..]).unwrap();
                u64::from_be_bytes(buffer)
            };
            match length {
                126 => length = more(2),
                127 => length = more(8),
                _ => {}
            }
            let mut payload = vec![0; length as usize];
            if self.stream.read_exact(&mut payload).is_err() {
                return SocketEvent::Closed;
            }
            match head[0] & 0xf {
                1 => return SocketEvent::Word(serde_json::from_slice(&payload).unwrap()),
                2 => {
                    let length = u32::from_le_bytes(payload[..4].try_into().unwrap()) as usize;
                    let head = serde_json::from_slice(&payload[4..4 + length]).unwrap();
                    return SocketEvent::Picture(head, payload[4 + length..].to_vec());
                }
                8 => return SocketEvent::Closed,
                _ => {}
            }
        }
    }

    /// The next words of a type, with everything left aside that comes before.
    pub fn word(&mut self, kind: &str) -> Value {
        loop {
            match self.next() {
                SocketEvent::Word(word) if word["type"] == kind => return word,
                SocketEvent::Closed => panic!("closed before {kind} came"),
                _ => {}
            }
        }
    }

    /// The next picture, with those words left aside that come before.
    pub fn picture(&mut self) -> (Value, Vec<u8>) {
        loop {
            match self.next() {
                SocketEvent::Picture(head, jpeg) => return (head, jpeg),
                SocketEvent::Word(_) => {}
                SocketEvent::Closed => panic!("closed before a picture came"),
            }
        }
    }

    /// The next whole picture.
    pub fn whole(&mut self) -> (Value, Vec<u8>) {
        loop {
            let (head, jpeg) = self.picture();
            self.say(&json!({ "type": "seen", "seq": head["seq"] }));
            if head["whole"] == true {
                return (head, jpeg);
            }
        }
    }
}
