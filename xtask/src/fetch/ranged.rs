//! A file on an HTTP server, read by range requests.

use std::io::{self, Read, Seek, SeekFrom};
use std::thread::sleep;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use ureq::Agent;
use ureq::http::{StatusCode, header};

/// Bytes of a request.
const BLOCK: u64 = 8 << 20;
/// Requests for the same bytes before giving up. The pause between them doubles, from a quarter of a second.
const TRIES: u32 = 6;
/// The longest silence of a server.
const SILENCE: Duration = Duration::from_secs(60);

/// See the module.
pub(super) struct RangeReader {
    agent: Agent,
    url: String,
    size: u64,
    at: u64,
    /// The block that was read last, and its place.
    block: Vec<u8>,
    start: u64,
}

impl RangeReader {
    /// Asks for one byte, to learn the size and whether ranges are served.
    pub(super) fn open(url: &str) -> Result<Self> {
        let mut config = Agent::config_builder()
            .user_agent(concat!("gsvx-xtask/", env!("CARGO_PKG_VERSION")))
            .timeout_connect(Some(SILENCE))
            .timeout_recv_response(Some(SILENCE))
            .timeout_per_read(Some(SILENCE));
        if url.starts_with("http://127.0.0.1") {
            // To a proxy, this address is the proxy's own machine.
            config = config.proxy(None);
        }
        let (agent, url) = (config.build().into(), url.to_owned());
        let mut this = Self { agent, url, size: 0, at: 0, block: Vec::new(), start: 0 };
        this.size = this.again(0, 1)?.1;
        Ok(this)
    }

    /// The bytes `from..to` and the size of the file. Requests that fail are repeated.
    fn again(&self, from: u64, to: u64) -> Result<(Vec<u8>, u64)> {
        let mut pause = Duration::from_millis(250);
        for _ in 1..TRIES {
            match self.request(from, to) {
                Err(error) if error.downcast_ref::<ureq::Error>().is_some() => sleep(pause),
                done => return done,
            }
            pause *= 2;
        }
        self.request(from, to)
    }

    fn request(&self, from: u64, to: u64) -> Result<(Vec<u8>, u64)> {
        let range = format!("bytes={from}-{}", to - 1);
        let response = self.agent.get(&self.url).header(header::RANGE, range).call()?;
        let sent = response.headers().get(header::CONTENT_RANGE).and_then(|v| v.to_str().ok());
        let size = sent.filter(|v| v.starts_with(&format!("bytes {from}-")));
        let size = size.and_then(|v| v.rsplit('/').next()?.parse().ok());
        let partial = response.status() == StatusCode::PARTIAL_CONTENT;
        let size = size.filter(|_| partial).context("the server does not serve byte ranges")?;
        let bytes = response.into_body().with_config().limit(to - from + 1).read_to_vec()?;
        ensure!(bytes.len() as u64 == to - from, "the server sent other bytes than asked for");
        Ok((bytes, size))
    }
}

impl Read for RangeReader {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        if self.at >= self.size {
            return Ok(0);
        }
        if !(self.start..self.start + self.block.len() as u64).contains(&self.at) {
            self.start = self.at / BLOCK * BLOCK;
            let end = (self.start + BLOCK).min(self.size);
            self.block = self.again(self.start, end).map_err(io::Error::other)?.0;
        }
        let n = (&self.block[(self.at - self.start) as usize..]).read(buf)?;
        self.at += n as u64;
        Ok(n)
    }
}

impl Seek for RangeReader {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let (base, by) = match to {
            SeekFrom::Start(at) => (at, 0),
            SeekFrom::End(by) => (self.size, by),
            SeekFrom::Current(by) => (self.at, by),
        };
        self.at = base.checked_add_signed(by).ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.at)
    }
}
