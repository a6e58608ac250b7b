//! Answers to the requests of the viewer page: the page, ranges of the files, and streams that it asks for.

use super::request::Request;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The viewer page, compressed by gzip; made by `cargo xtask web --page`.
const PAGE: &[u8] = include_bytes!("../../../view/index.html.gz");

/// The path under which a file is served. Its name is kept: the page shows it.
pub(super) fn place(number: usize, file: &Path) -> String {
    let name = file.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    format!("/file/{number}/{}", escaped(&name))
}

/// A name as part of an address.
fn escaped(name: &str) -> String {
    let plain = |b: u8| b.is_ascii_alphanumeric() || b"-_.".contains(&b);
    name.bytes()
        .map(|b| if plain(b) { char::from(b).to_string() } else { format!("%{b:02X}") })
        .collect()
}

/// What a client gets.
pub(super) struct Answer {
    status: u16,
    fields: Vec<(&'static str, String)>,
    body: Box<dyn Read>,
    length: u64,
}

impl Answer {
    fn new(status: u16, length: u64, body: impl Read + 'static) -> Self {
        let fields = vec![("Cache-Control", "no-store".into()), ("Connection", "close".into())];
        Self { status, fields, body: Box::new(body), length }
    }

    fn with(mut self, name: &'static str, value: impl Into<String>) -> Self {
        self.fields.push((name, value.into()));
        self
    }

    /// These bytes.
    pub(super) fn of(bytes: Vec<u8>, kind: &str) -> Self {
        Self::new(200, bytes.len() as u64, io::Cursor::new(bytes)).with("Content-Type", kind)
    }

    /// A status that is no success, and why.
    pub(super) fn refused(status: u16, why: &str) -> Self {
        let (length, body) = (why.len() as u64, io::Cursor::new(why.as_bytes().to_vec()));
        Self::new(status, length, body).with("Content-Type", "text/plain; charset=utf-8")
    }

    /// Sends it; to a HEAD request without its body.
    pub(super) fn send(mut self, out: &mut impl Write, is_head: bool) -> io::Result<()> {
        let Self { status, fields, length, .. } = &self;
        let mut head = format!("HTTP/1.1 {status} {}\r\n", reason(*status));
        for (name, value) in fields {
            head += &format!("{name}: {value}\r\n");
        }
        head += &format!("Content-Length: {length}\r\n\r\n");
        out.write_all(head.as_bytes())?;
        if !is_head {
            io::copy(&mut self.body, out)?;
        }
        Ok(())
    }
}

fn reason(status: u16) -> &'static str {
    match status {
        200 => "OK",
        206 => "Partial Content",
        403 => "Forbidden",
        404 => "Not Found",
        405 => "Method Not Allowed",
        409 => "Conflict",
        413 => "Content Too Large",
        416 => "Range Not Satisfiable",
        431 => "Request Header Fields Too Large",
        500 => "Internal Server Error",
        _ => "Bad Request",
    }
}

/// Answers what the page alone may ask for, by the path and the query of its address.
pub(super) type AnswerPost<'a> = &'a dyn Fn(&str, &str) -> Answer;

/// Answers one request.
pub(super) fn answer(
    request: &Request<'_>,
    host: &str,
    files: &[PathBuf],
    post: Option<AnswerPost<'_>>,
) -> Answer {
    // Another site that points its name at this machine reads nothing.
    if request.field("Host") != Some(host) {
        return Answer::refused(403, "open the address that gsvx view printed");
    }
    let (path, query) = request.target.split_once('?').unwrap_or((request.target, ""));
    if let (Some(post), "POST") = (post, request.method) {
        // Another site that a browser shows starts no work and writes no file here.
        if request.field("Origin") != Some(&format!("http://{host}")) {
            return Answer::refused(403, "only the page of gsvx view asks for this");
        }
        return post(path, query);
    }
    if !matches!(request.method, "GET" | "HEAD") {
        return Answer::refused(405, "GET or HEAD").with("Allow", "GET, HEAD");
    }
    if path == "/" {
        return Answer::new(200, PAGE.len() as u64, PAGE)
            .with("Content-Type", "text/html; charset=utf-8")
            .with("Content-Encoding", "gzip");
    }
    let found = files.iter().enumerate().find(|(i, file)| place(*i, file) == path);
    match found {
        Some((_, file)) => part(file, request.field("Range")).unwrap_or_else(|error| {
            Answer::refused(500, &format!("{}: cannot be read: {error}", file.display()))
        }),
        None => Answer::refused(404, "not here"),
    }
}

/// A file, or the range of it that is asked for.
fn part(path: &Path, range: Option<&str>) -> io::Result<Answer> {
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    let Some(Range { start, end }) = range.and_then(|text| parsed(text, length)) else {
        return Ok(whole(200, length, file));
    };
    if start >= end {
        let range = format!("bytes */{length}");
        return Ok(Answer::refused(416, "no such range").with("Content-Range", range));
    }
    file.seek(SeekFrom::Start(start))?;
    let range = format!("bytes {start}-{}/{length}", end - 1);
    Ok(whole(206, end - start, file).with("Content-Range", range))
}

fn whole(status: u16, length: u64, file: File) -> Answer {
    Answer::new(status, length, file.take(length))
        .with("Content-Type", "model/vnd.gsvx")
        .with("Accept-Ranges", "bytes")
}

/// A single range of bytes, cut to the file; an empty one if it is beyond it. Others are none.
fn parsed(text: &str, length: u64) -> Option<Range<u64>> {
    let (start, end) = text.strip_prefix("bytes=")?.split_once('-')?;
    if start.is_empty() {
        let last: u64 = end.parse().ok()?;
        return Some(length.saturating_sub(last)..length);
    }
    let start: u64 = start.parse().ok()?;
    let end = match end {
        "" => length,
        end => end.parse::<u64>().ok()?.saturating_add(1).min(length),
    };
    Some(start..end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_cut_to_the_file() {
        assert_eq!(parsed("bytes=0-9", 100), Some(0..10));
        assert_eq!(parsed("bytes=90-", 100), Some(90..100));
        assert_eq!(parsed("bytes=90-900", 100), Some(90..100));
        assert_eq!(parsed("bytes=-5", 100), Some(95..100));
        assert_eq!(parsed("bytes=-500", 100), Some(0..100));
        assert!(parsed("bytes=100-", 100).is_some_and(|r| r.is_empty()));
        for other in ["bytes=0-1,5-6", "items=0-1", "bytes=x-", "bytes=-", ""] {
            assert_eq!(parsed(other, 100), None, "{other}");
        }
    }

    #[test]
    fn names_become_parts_of_addresses() {
        assert_eq!(place(1, Path::new("a/my scene+ü.ply")), "/file/1/my%20scene%2B%C3%BC.ply");
    }
}
