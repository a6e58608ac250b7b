//! Answers to the requests of the viewer page: the page, and ranges of the files.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};
use tiny_http::{Header, Method, Request, Response, ResponseBox};

/// The viewer page, compressed by gzip; made by `cargo xtask web --page`.
const PAGE: &[u8] = include_bytes!("../../view/index.html.gz");

/// The path under which a file is served. Its name is kept: the page shows it.
pub(crate) fn place(number: usize, file: &Path) -> String {
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

/// Answers one request. A reader that goes away is no error.
pub(crate) fn answer(request: Request, host: &str, files: &[PathBuf]) {
    let response = response(&request, host, files);
    let _ = request.respond(response);
}

fn response(request: &Request, host: &str, files: &[PathBuf]) -> ResponseBox {
    let value = |name: &'static str| {
        let found = request.headers().iter().find(|h| h.field.equiv(name));
        found.map(|h| h.value.as_str())
    };
    // Another site that points its name at this machine reads nothing.
    if value("Host") != Some(host) {
        return refused(403, "open the address that gsvx view printed");
    }
    if !matches!(request.method(), Method::Get | Method::Head) {
        return refused(405, "GET or HEAD");
    }
    let path = request.url().split('?').next().unwrap_or_default();
    if path == "/" {
        return page();
    }
    let found = files.iter().enumerate().find(|(i, file)| place(*i, file) == path);
    match found {
        Some((_, file)) => part(file, value("Range")).unwrap_or_else(|error| {
            refused(500, &format!("{}: cannot be read: {error}", file.display()))
        }),
        None => refused(404, "not here"),
    }
}

fn with(mut response: ResponseBox, headers: &[(&str, &str)]) -> ResponseBox {
    let headers = headers.iter().filter_map(|&(name, value)| Header::from_bytes(name, value).ok());
    headers.for_each(|header| response.add_header(header));
    response
}

/// A body that is never sent by chunks: the page shows how much is still to come.
fn sized(status: u16, body: impl Read + Send + 'static, length: usize) -> ResponseBox {
    Response::new(status.into(), Vec::new(), body, Some(length), None)
        .with_chunked_threshold(usize::MAX)
        .boxed()
}

fn refused(status: u16, text: &str) -> ResponseBox {
    Response::from_string(text).with_status_code(status).boxed()
}

fn page() -> ResponseBox {
    let headers = [
        ("Content-Type", "text/html; charset=utf-8"),
        ("Content-Encoding", "gzip"),
        ("Cache-Control", "no-store"),
    ];
    with(sized(200, PAGE, PAGE.len()), &headers)
}

/// A file, or the range of it that is asked for.
fn part(path: &Path, range: Option<&str>) -> std::io::Result<ResponseBox> {
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    let wanted = range.and_then(|text| parsed(text, length));
    let Range { start, end } = wanted.clone().unwrap_or(0..length);
    if wanted.is_some() && start >= end {
        let range = format!("bytes */{length}");
        return Ok(with(refused(416, "no such range"), &[("Content-Range", &range)]));
    }
    file.seek(SeekFrom::Start(start))?;
    let status = if wanted.is_some() { 206 } else { 200 };
    let range = format!("bytes {start}-{}/{length}", end.saturating_sub(1));
    let headers = [
        ("Content-Type", "model/vnd.gsvx"),
        ("Accept-Ranges", "bytes"),
        ("Cache-Control", "no-store"),
        ("Content-Range", &range),
    ];
    // The last is of ranges only.
    let headers = if wanted.is_some() { &headers[..] } else { &headers[..3] };
    Ok(with(sized(status, file.take(end - start), (end - start) as usize), headers))
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
