//! An archive on an HTTP server, by range requests.

use std::io::{self, Read};
use std::time::Duration;

use ureq::http::{Response, StatusCode, header};
use ureq::{Agent, Body, Timeout};

use super::error::{Error, Result, one_line};
use super::source::Source;

/// An archive on a server that serves ranges.
pub(crate) struct Http {
    agent: Agent,
    url: String,
    timeout: Duration,
    size: u64,
    /// Strong validator of the bytes, where the server gives one.
    etag: Option<String>,
}

/// What a range response says.
struct Part {
    response: Response<Body>,
    from: u64,
    size: u64,
    etag: Option<String>,
}

impl Http {
    /// Asks for one byte, to learn the size and whether ranges are served: not every server
    /// answers HEAD, and few signed addresses do. `timeout` is the longest silence.
    pub(crate) fn connect(url: &str, timeout: Duration) -> Result<Self> {
        let mut config = Agent::config_builder()
            .user_agent(concat!("gsvx-xtask/", env!("CARGO_PKG_VERSION")))
            .http_status_as_error(false)
            .timeout_resolve(Some(timeout))
            .timeout_connect(Some(timeout))
            .timeout_recv_response(Some(timeout))
            .timeout_per_read(Some(timeout));
        if is_loopback(url) {
            // A proxy's own loopback is another machine.
            config = config.proxy(None);
        }
        let mut http = Self {
            agent: config.build().into(),
            url: url.to_owned(),
            timeout,
            size: 0,
            etag: None,
        };
        let part = http.request(0, 1)?;
        (http.size, http.etag) = (part.size, part.etag);
        // Read it to the end, so that the connection can be used again.
        io::copy(&mut part.response.into_body().into_reader().take(2), &mut io::sink())
            .map_err(|e| http.failure(0, ureq::Error::from(e)))?;
        Ok(http)
    }

    fn request(&self, from: u64, to: u64) -> Result<Part> {
        let url = || self.url.clone();
        let response = self
            .agent
            .get(&self.url)
            .header(header::RANGE, format!("bytes={from}-{}", to - 1))
            .call()
            .map_err(|e| self.failure(from, e))?;
        match response.status() {
            StatusCode::PARTIAL_CONTENT => {}
            // The range is ignored, or there are no bytes at all.
            StatusCode::OK | StatusCode::RANGE_NOT_SATISFIABLE if self.size == 0 => {
                return Err(Error::NoRanges { url: url() });
            }
            StatusCode::OK | StatusCode::RANGE_NOT_SATISFIABLE => {
                let why = format!("bytes from {from} are no longer served");
                return Err(Error::Moved { url: url(), why });
            }
            status => return Err(Error::Status { url: url(), status: status.as_u16() }),
        }
        let text = |name| response.headers().get(name).and_then(|v| v.to_str().ok());
        let range = text(header::CONTENT_RANGE).and_then(content_range);
        let Some((start, size)) = range.filter(|(start, size)| *start == from && size > start)
        else {
            return Err(Error::NoRanges { url: url() });
        };
        let etag = text(header::ETAG).filter(|e| !e.starts_with("W/")).map(str::to_owned);
        Ok(Part { from: start, size, etag, response })
    }

    fn failure(&self, at: u64, error: ureq::Error) -> Error {
        let url = self.url.clone();
        let seconds = self.timeout.as_secs_f64();
        let why = one_line(&error);
        match error {
            ureq::Error::Timeout(Timeout::Resolve | Timeout::Connect) => {
                Error::Unreachable { url, why: format!("no connection within {seconds} s") }
            }
            ureq::Error::Timeout(_) => Error::Stalled { url, seconds },
            ureq::Error::Io(e) if e.kind() == io::ErrorKind::TimedOut => {
                Error::Stalled { url, seconds }
            }
            ureq::Error::Io(e) if !ends_early(e.kind()) => {
                Error::Unreachable { url, why: one_line(e) }
            }
            ureq::Error::Io(_) | ureq::Error::Protocol(_) => Error::Broken { url, at, why },
            ureq::Error::HostNotFound
            | ureq::Error::ConnectionFailed
            | ureq::Error::ConnectProxyFailed(_)
            | ureq::Error::Tls(_)
            | ureq::Error::Rustls(_) => Error::Unreachable { url, why },
            _ => Error::Address { url, why },
        }
    }
}

impl Source for Http {
    fn url(&self) -> &str {
        &self.url
    }

    fn size(&self) -> u64 {
        self.size
    }

    fn open(&mut self, from: u64, to: u64) -> Result<Box<dyn Read>> {
        let part = self.request(from, to)?;
        let moved = |why| Err(Error::Moved { url: self.url.clone(), why });
        if part.size != self.size {
            return moved(format!("{} bytes were {}", part.size, self.size));
        }
        if let (Some(old), Some(new)) = (&self.etag, &part.etag)
            && old != new
        {
            return moved(format!("its tag was {old}, is {}", one_line(new)));
        }
        let body = part.response.into_body().into_reader().take(to - part.from);
        let (url, seconds) = (self.url.clone(), self.timeout.as_secs_f64());
        Ok(Box::new(BodyRead { body, url, seconds }))
    }
}

/// A body whose errors are ours.
struct BodyRead<R> {
    body: R,
    url: String,
    seconds: f64,
}

impl<R: Read> Read for BodyRead<R> {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        self.body.read(buf).map_err(|e| {
            let url = self.url.clone();
            match ureq::Error::from(e) {
                ureq::Error::Timeout(_) => Error::Stalled { url, seconds: self.seconds }.into(),
                // The reader knows the position, and says it.
                ureq::Error::Io(e) => e,
                e => io::Error::other(one_line(e)),
            }
        })
    }
}

/// True if a connection was there and went away. All else means that none came about; a name
/// that cannot be looked up has no kind of its own.
fn ends_early(kind: io::ErrorKind) -> bool {
    use io::ErrorKind as K;
    matches!(kind, K::ConnectionReset | K::ConnectionAborted | K::BrokenPipe | K::UnexpectedEof)
}

fn is_loopback(url: &str) -> bool {
    let host = url.split_once("://").map_or(url, |(_, rest)| rest);
    ["127.0.0.1", "localhost", "[::1]"].iter().any(|name| {
        host.strip_prefix(name).is_some_and(|r| r.is_empty() || r.starts_with([':', '/']))
    })
}

/// First byte and whole size out of `bytes 0-99/1234`.
fn content_range(text: &str) -> Option<(u64, u64)> {
    let (range, size) = text.trim().strip_prefix("bytes")?.trim().split_once('/')?;
    let (from, _) = range.split_once('-')?;
    Some((from.trim().parse().ok()?, size.trim().parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn content_ranges() {
        assert_eq!(content_range("bytes 0-99/1234"), Some((0, 1234)));
        assert_eq!(
            content_range("bytes 5000000000-5000000001/6000000000").unwrap().1,
            6_000_000_000
        );
        for bad in ["bytes */1234", "bytes 0-99/*", "0-99/1234", "bytes 0-99", ""] {
            assert_eq!(content_range(bad), None, "{bad}");
        }
    }

    #[test]
    fn a_name_that_is_not_found_means_no_network() {
        let agent = Agent::new_with_defaults();
        let (url, timeout) = ("http://x/".to_owned(), Duration::from_secs(1));
        let http = Http { agent, url, timeout, size: 0, etag: None };
        let failure = |e| http.failure(0, ureq::Error::Io(e));
        // As Linux reports it, without a kind.
        let lookup = io::Error::other("failed to lookup address information");
        assert!(matches!(failure(lookup), Error::Unreachable { .. }));
        let refused = io::ErrorKind::ConnectionRefused.into();
        assert!(matches!(failure(refused), Error::Unreachable { .. }));
        let reset = io::ErrorKind::ConnectionReset.into();
        assert!(matches!(failure(reset), Error::Broken { .. }));
        assert!(matches!(http.failure(0, ureq::Error::HostNotFound), Error::Unreachable { .. }));
    }

    #[test]
    fn loopback_addresses() {
        assert!(is_loopback("http://127.0.0.1:80/x") && is_loopback("http://localhost"));
        assert!(!is_loopback("http://127.0.0.1.example.org/") && !is_loopback("https://inria.fr"));
    }
}
