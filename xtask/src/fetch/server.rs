//! An archive on an HTTP server, by range requests.

use std::io::{self, Read};
use std::time::Duration;

use ureq::http::{Response, StatusCode, header};
use ureq::{Agent, Body};

use super::fault::{Fault, Kind};

/// An archive on a server that serves byte ranges.
pub(crate) struct Server {
    agent: Agent,
    pub(crate) url: String,
    pub(crate) size: u64,
}

impl Server {
    /// Asks for one byte, to learn the size and whether ranges are served: not every server answers
    /// HEAD, and few signed addresses do. `timeout` is the longest silence.
    pub(crate) fn connect(url: &str, timeout: Duration) -> Result<Self, Fault> {
        let mut config = Agent::config_builder()
            .user_agent(concat!("gsvx-xtask/", env!("CARGO_PKG_VERSION")))
            .http_status_as_error(false)
            .timeout_resolve(Some(timeout))
            .timeout_connect(Some(timeout))
            .timeout_recv_response(Some(timeout))
            .timeout_per_read(Some(timeout));
        if url.starts_with("http://127.0.0.1") || url.starts_with("http://localhost") {
            // To a proxy, these addresses are the proxy's own machine.
            config = config.proxy(None);
        }
        let agent = config.build().into();
        let mut server = Self { agent, url: url.to_owned(), size: 0 };
        let (size, response) = server.request(0, 1)?;
        server.size = size;
        // Read to the end, so that the connection can be used again.
        io::copy(&mut response.into_body().into_reader().take(2), &mut io::sink())
            .map_err(|e| server.fault(ureq::Error::from(e), 0))?;
        Ok(server)
    }

    /// The bytes `from..to`.
    pub(crate) fn body(&self, from: u64, to: u64) -> Result<Box<dyn Read>, Fault> {
        let (size, response) = self.request(from, to)?;
        if size != self.size {
            let what = format!("{}: the archive was replaced while it was read", self.url);
            return Err(Fault::new(Kind::Damaged, what));
        }
        Ok(Box::new(response.into_body().into_reader().take(to - from)))
    }

    /// Size of the archive, and a response with bytes `from..to`.
    fn request(&self, from: u64, to: u64) -> Result<(u64, Response<Body>), Fault> {
        let request = self.agent.get(&self.url);
        let request = request.header(header::RANGE, format!("bytes={from}-{}", to - 1));
        let response = request.call().map_err(|e| self.fault(e, from))?;
        let fault = |kind, what: &str| Err(Fault::new(kind, format!("{}: {what}", self.url)));
        match response.status() {
            StatusCode::PARTIAL_CONTENT => {}
            StatusCode::OK | StatusCode::RANGE_NOT_SATISFIABLE => {
                return fault(Kind::Unusable, "the server does not serve byte ranges");
            }
            status => {
                let busy = matches!(status.as_u16(), 408 | 429 | 500..=599);
                let kind = if busy { Kind::Interrupted } else { Kind::Unusable };
                return fault(
                    kind,
                    &format!("the server answered with status {}", status.as_u16()),
                );
            }
        }
        let text = |name| response.headers().get(name).and_then(|v| v.to_str().ok());
        let range = text(header::CONTENT_RANGE).and_then(content_range);
        let Some((_, size)) = range.filter(|(start, size)| *start == from && size > start) else {
            return fault(Kind::Unusable, "the server does not serve byte ranges");
        };
        Ok((size, response))
    }

    fn fault(&self, error: ureq::Error, at: u64) -> Fault {
        use ureq::{Error, Timeout};
        let url = &self.url;
        let connected = match &error {
            Error::Timeout(Timeout::Resolve | Timeout::Connect) => false,
            Error::Timeout(_) | Error::Protocol(_) => true,
            _ => false,
        };
        if connected || self.size > 0 {
            return Fault::new(Kind::Interrupted, format!("{url}: broke at byte {at}: {error}"));
        }
        Fault::new(Kind::Unreachable, format!("{url}: cannot reach the server: {error}"))
    }
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
        let far = content_range("bytes 5000000000-5000000001/6000000000").unwrap();
        assert_eq!(far, (5_000_000_000, 6_000_000_000));
        for bad in ["bytes */1234", "bytes 0-99/*", "0-99/1234", "bytes 0-99", ""] {
            assert_eq!(content_range(bad), None, "{bad}");
        }
    }
}
