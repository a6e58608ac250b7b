//! `Read + Seek` over a [`Source`]: few and long requests, the end of the archive in memory,
//! the entry at work on disk, and patience with a bad line.

use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;
use std::time::Duration;

use super::error::{Error, Result, one_line};
use super::meter::Meter;
use super::source::Source;
use super::spool::Spool;

/// Bytes from the end that are kept in memory: the central directory of an archive of about
/// 2500 entries.
pub(crate) const TAIL: u64 = 256 << 10;

/// A gap of at most this many bytes is read over; a longer one is worth a new request.
const SKIP: u64 = 128 << 10;

/// Length of a request that no [`Ranged::expect`] covers.
const PEEK: u64 = 64 << 10;

/// Bytes that go to disk at once.
const CHUNK: usize = 64 << 10;

/// How to deal with a line that breaks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Patience {
    /// Tries in a row that bring no byte, before giving up.
    pub(crate) tries: u32,
    /// Pause after the first; it doubles.
    pub(crate) pause: Duration,
}

impl Patience {
    /// The result of `work`, tried again while its error may pass.
    pub(crate) fn run<T>(&self, connected: bool, mut work: impl FnMut() -> Result<T>) -> Result<T> {
        let mut tried = 1;
        loop {
            match work() {
                Err(e) if e.passing(connected) && tried < self.tries => {
                    std::thread::sleep(self.pause * (1 << (tried - 1).min(5)));
                    tried += 1;
                }
                done => return done,
            }
        }
    }
}

/// A response being read.
struct Stream {
    at: u64,
    end: u64,
    body: Box<dyn Read>,
}

/// The archive as a file.
pub(crate) struct Ranged {
    source: Box<dyn Source>,
    patience: Patience,
    pos: u64,
    stream: Option<Stream>,
    /// End of what will be read without a gap.
    horizon: u64,
    tail_start: u64,
    tail: Vec<u8>,
    spool: Option<Spool>,
    /// Bytes up to here have been counted.
    counted: u64,
    meter: Meter,
    /// What the last failed read ran into: archive code turns errors into text.
    failure: Option<Error>,
}

impl Ranged {
    /// Over `source`, with its last `tail` bytes read at once.
    pub(crate) fn new(source: Box<dyn Source>, patience: Patience, tail: u64) -> Result<Self> {
        let size = source.size();
        let mut ranged = Self {
            source,
            patience,
            pos: 0,
            stream: None,
            horizon: size,
            tail_start: size,
            tail: Vec::new(),
            spool: None,
            counted: 0,
            meter: Meter::hidden(),
            failure: None,
        };
        let start = size.saturating_sub(tail);
        let mut bytes = vec![0; usize::try_from(size - start).unwrap_or(0)];
        let mut have = 0;
        while have < bytes.len() {
            have += ranged.network(start + have as u64, &mut bytes[have..])?;
        }
        (ranged.tail_start, ranged.tail, ranged.stream) = (start, bytes, None);
        // The central directory is looked for in small steps: no long request for each.
        ranged.horizon = 0;
        Ok(ranged)
    }

    /// Where the archive is.
    pub(crate) fn url(&self) -> &str {
        self.source.url()
    }

    /// Size of the archive.
    pub(crate) fn size(&self) -> u64 {
        self.source.size()
    }

    /// Counts bytes of entries on `meter` from now on.
    pub(crate) fn count_on(&mut self, meter: Meter) {
        self.meter = meter;
    }

    /// Takes what the last failed read ran into.
    pub(crate) fn failure(&mut self) -> Option<Error> {
        self.failure.take()
    }

    /// Announces that the bytes from here to `end` are wanted.
    pub(crate) fn expect(&mut self, end: u64) {
        self.horizon = end;
    }

    /// Keeps what arrives of `start..end` in the file at `path`. Returns how much of it was
    /// there already.
    pub(crate) fn keep(&mut self, path: &Path, start: u64, end: u64) -> Result<u64> {
        let spool = Spool::open(path, start, end)?;
        let held = spool.reach() - start;
        self.spool = Some(spool);
        self.counted = start;
        Ok(held)
    }

    /// Ends what [`Ranged::keep`] began.
    pub(crate) fn release(&mut self) {
        self.spool = None;
    }

    /// Reads at least one byte from `at`, with patience.
    fn network(&mut self, at: u64, buf: &mut [u8]) -> Result<usize> {
        let patience = self.patience;
        patience
            .run(true, || {
                let read = self.try_network(at, buf);
                if read.is_err() {
                    self.stream = None;
                }
                read
            })
            .map_err(|e| match e {
                // It was reached before: an outage under way, to be waited for.
                Error::Unreachable { url, why } => Error::Broken { url, at, why },
                e => e,
            })
    }

    fn try_network(&mut self, at: u64, buf: &mut [u8]) -> Result<usize> {
        let near = |s: &Stream| s.at <= at && at < s.end && at - s.at <= SKIP;
        let mut stream = match self.stream.take().filter(near) {
            Some(stream) => stream,
            None => {
                let end = if at < self.horizon { self.horizon } else { at + PEEK };
                // What is in memory is not asked for again.
                let end = end.min(if at < self.tail_start { self.tail_start } else { end });
                let end = end.min(self.size());
                Stream { at, end, body: self.source.open(at, end)? }
            }
        };
        let url = self.source.url();
        let read = |stream: &mut Stream, buf: &mut [u8]| {
            let room = usize::try_from(stream.end - stream.at).unwrap_or(usize::MAX);
            let room = buf.len().min(room);
            let broken = |why| Error::Broken { url: url.to_owned(), at: stream.at, why };
            let n = match stream.body.read(&mut buf[..room]) {
                Ok(0) => return Err(broken("it ended early".to_owned())),
                Ok(n) => n,
                Err(e) => {
                    // Ours, from the source, or one of the system's.
                    let ours = e.downcast::<Error>();
                    return Err(ours.unwrap_or_else(|e| broken(one_line(e))));
                }
            };
            stream.at += n as u64;
            Ok(n)
        };
        let mut over = [0; 4096];
        while stream.at < at {
            let gap = usize::try_from(at - stream.at).unwrap_or(over.len()).min(over.len());
            read(&mut stream, &mut over[..gap])?;
        }
        let n = read(&mut stream, buf)?;
        if stream.at < stream.end {
            self.stream = Some(stream);
        }
        Ok(n)
    }

    /// Reads within the spool, which is filled up to there first.
    fn spooled(&mut self, spool: &mut Spool, buf: &mut [u8]) -> Result<usize> {
        while spool.reach() <= self.pos {
            // Not beyond the entry: the stream is to go on with the next one.
            let room = usize::try_from(spool.room()).unwrap_or(CHUNK).min(CHUNK);
            let mut chunk = vec![0; room];
            let n = self.network(spool.reach(), &mut chunk)?;
            spool.append(&chunk[..n])?;
        }
        spool.read(self.pos, buf)
    }

    fn fill(&mut self, buf: &mut [u8]) -> Result<usize> {
        if self.pos >= self.size() || buf.is_empty() {
            return Ok(0);
        }
        if let Some(held) = self.pos.checked_sub(self.tail_start) {
            let held = &self.tail[usize::try_from(held).unwrap_or(self.tail.len())..];
            let n = held.len().min(buf.len());
            buf[..n].copy_from_slice(&held[..n]);
            return Ok(n);
        }
        match self.spool.take_if(|s| s.covers(self.pos)) {
            Some(mut spool) => {
                let read = self.spooled(&mut spool, buf);
                self.spool = Some(spool);
                read
            }
            None => self.network(self.pos, buf),
        }
    }
}

impl Read for Ranged {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        let n = self.fill(buf).map_err(|e| {
            let text = e.to_string();
            self.failure = Some(e);
            io::Error::other(text)
        })?;
        self.pos += n as u64;
        if self.spool.is_some() && self.pos > self.counted {
            self.meter.advance(self.pos - self.counted);
            self.counted = self.pos;
        }
        Ok(n)
    }
}

impl Seek for Ranged {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let (base, by) = match to {
            SeekFrom::Start(pos) => (pos, 0),
            SeekFrom::End(by) => (self.size(), by),
            SeekFrom::Current(by) => (self.pos, by),
        };
        let pos = base.checked_add_signed(by).ok_or(io::ErrorKind::InvalidInput)?;
        self.pos = pos;
        Ok(pos)
    }
}
