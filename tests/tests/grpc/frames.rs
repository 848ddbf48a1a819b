//! HTTP/2 by hand, for what no client's library sends.

use std::net::SocketAddr;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

use super::harness::soon;

const DATA: u8 = 0;
const HEADERS: u8 = 1;
const RST_STREAM: u8 = 3;
const SETTINGS: u8 = 4;
const PING: u8 = 6;
const GOAWAY: u8 = 7;
const END_STREAM: u8 = 1;
const END_HEADERS: u8 = 4;
const ACK: u8 = 1;
const CANCEL: [u8; 4] = 8_u32.to_be_bytes();

/// A frame that came.
#[derive(Debug)]
pub struct Frame {
    pub kind: u8,
    flags: u8,
    pub stream: u32,
}

/// A connection whose frames are sent one by one.
pub struct Frames {
    socket: TcpStream,
    /// What is sent next, all at once.
    pub batch: Vec<u8>,
}

impl Frames {
    /// A connection that both sides have agreed on.
    pub async fn open(address: SocketAddr) -> Self {
        let socket = TcpStream::connect(address).await.expect("a connection");
        let mut frames = Self { socket, batch: b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n".to_vec() };
        frames.push(SETTINGS, 0, 0, &[]);
        frames.push(SETTINGS, ACK, 0, &[]);
        assert!(frames.is_answered().await);
        frames
    }

    fn push(&mut self, kind: u8, flags: u8, stream: u32, payload: &[u8]) {
        self.batch.extend(&(payload.len() as u32).to_be_bytes()[1..]);
        self.batch.extend([kind, flags]);
        self.batch.extend(stream.to_be_bytes());
        self.batch.extend(payload);
    }

    /// Begins a call of `path`.
    pub fn call(&mut self, stream: u32, path: &str) {
        // POST and http, as HPACK has them; the others by the numbers of their names.
        let mut head = vec![0x83, 0x86];
        let fields: [(&[u8], &str); 3] = [(&[0x04], path), (&[0x01], "localhost"), (&[0x0f, 0x10], "application/grpc")];
        for (name, value) in fields {
            head.extend(name);
            head.push(value.len() as u8);
            head.extend(value.as_bytes());
        }
        self.push(HEADERS, END_HEADERS, stream, &head);
    }

    /// Sends bytes of a call's message, which may be the last.
    pub fn data(&mut self, stream: u32, bytes: &[u8], is_last: bool) {
        self.push(DATA, if is_last { END_STREAM } else { 0 }, stream, bytes);
    }

    /// Cancels a call.
    pub fn cancel(&mut self, stream: u32) {
        self.push(RST_STREAM, 0, stream, &CANCEL);
    }

    /// Sends what has come together.
    pub async fn send(&mut self) {
        self.socket.write_all(&std::mem::take(&mut self.batch)).await.expect("a connection");
    }

    /// Sends it, and says whether the server goes on with the connection afterwards.
    pub async fn is_answered(&mut self) -> bool {
        self.push(PING, 0, 0, &[7; 8]);
        self.send().await;
        let last = self.next(|frame| frame.kind == GOAWAY || (frame.kind, frame.flags) == (PING, ACK)).await;
        last.kind == PING
    }

    /// What a call is answered with first: the head of an answer, or its only one.
    pub async fn answer(&mut self, stream: u32) -> Frame {
        self.next(|frame| frame.stream == stream && [HEADERS, RST_STREAM].contains(&frame.kind)).await
    }

    async fn next(&mut self, is_meant: impl Fn(&Frame) -> bool) -> Frame {
        soon("a frame", async {
            loop {
                let mut head = [0; 9];
                self.socket.read_exact(&mut head).await.expect("a frame");
                let [a, b, c, kind, flags, stream @ ..] = head;
                let mut payload = vec![0; u32::from_be_bytes([0, a, b, c]) as usize];
                self.socket.read_exact(&mut payload).await.expect("a whole frame");
                let frame = Frame { kind, flags, stream: u32::from_be_bytes(stream) };
                if is_meant(&frame) {
                    break frame;
                }
            }
        })
        .await
    }
}

impl Frame {
    /// Whether it begins an answer that goes on.
    pub fn begins_an_answer(&self) -> bool {
        self.kind == HEADERS && self.flags & END_STREAM == 0
    }
}
