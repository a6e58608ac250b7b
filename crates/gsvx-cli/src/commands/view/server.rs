//! A small server for the page: one answer to each connection, and no bodies of requests.
//!
//! What a client can cost is bounded: the bytes and the time of a request's head, and the number of connections. A client
//! that does not read keeps its own connection only.

use super::answer::Answer;
use super::request::Request;
use httparse::{EMPTY_HEADER, Status};
use std::io::{self, Read};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Longest head of a request, and its most fields.
const HEAD: usize = 1 << 14;
const FIELDS: usize = 64;
/// Longest time for a head to arrive.
const ARRIVES: Duration = Duration::from_secs(10);
/// Longest time in which a client reads nothing.
const READS: Duration = Duration::from_secs(300);
/// What a client may still send after the answer, for it to hear the answer.
const REST: u64 = 1 << 16;
/// Connections at a time: browsers open six.
const CONNECTIONS: usize = 64;

/// Answers requests until the process ends.
pub(super) fn serve(
    listener: &TcpListener,
    answer: impl Fn(&Request<'_>) -> Answer + Send + Sync + 'static,
) {
    let answer = Arc::new(answer);
    for client in listener.incoming() {
        // The client has gone, or the process has too many files open for now.
        let Ok(client) = client else {
            std::thread::sleep(Duration::from_millis(10));
            continue;
        };
        if Arc::strong_count(&answer) > CONNECTIONS {
            continue;
        }
        let answer = Arc::clone(&answer);
        // Without another thread this client is not served. One that goes away is no error.
        let _ = std::thread::Builder::new().spawn(move || converse(client, &*answer));
    }
}

/// Reads a request and answers it.
fn converse(mut client: TcpStream, answer: &dyn Fn(&Request<'_>) -> Answer) -> io::Result<()> {
    client.set_write_timeout(Some(READS))?;
    let (mut head, until) = (Vec::new(), Instant::now() + ARRIVES);
    let (answer, is_head) = loop {
        if !receive(&mut client, &mut head, until)? {
            return Ok(());
        }
        let mut fields = [EMPTY_HEADER; FIELDS];
        let mut parsed = httparse::Request::new(&mut fields);
        match parsed.parse(&head) {
            Ok(Status::Partial) if head.len() < HEAD => {}
            Ok(Status::Partial) | Err(httparse::Error::TooManyHeaders) => {
                break (Answer::refused(431, "the head of the request is too long"), false);
            }
            Err(_) => break (Answer::refused(400, "no HTTP request"), false),
            Ok(Status::Complete(_)) => {
                let (method, target) = (parsed.method, parsed.path);
                let (method, target) = (method.unwrap_or_default(), target.unwrap_or_default());
                let request = Request { method, target, fields: parsed.headers };
                let answer = match request.has_body() {
                    true => Answer::refused(413, "a request has no body here"),
                    false => answer(&request),
                };
                break (answer, method == "HEAD");
            }
        }
    };
    answer.send(&mut client, is_head)?;
    client.shutdown(Shutdown::Write)?;
    client.set_read_timeout(Some(Duration::from_secs(1)))?;
    io::copy(&mut client.take(REST), &mut io::sink()).map(drop)
}

/// Appends what arrives to a head. False if the client has ended before.
fn receive(client: &mut TcpStream, head: &mut Vec<u8>, until: Instant) -> io::Result<bool> {
    let left = until.saturating_duration_since(Instant::now());
    // Zero would be no limit.
    client.set_read_timeout(Some(left.max(Duration::from_millis(1))))?;
    let mut piece = [0; 2048];
    let n = client.read(&mut piece)?;
    head.extend_from_slice(&piece[..n]);
    Ok(n > 0)
}
