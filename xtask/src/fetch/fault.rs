//! Why bytes of an archive did not come, and when a request is repeated.

use std::fmt;
use std::time::Duration;

/// Why bytes did not come.
#[derive(Debug)]
pub(crate) struct Fault {
    pub(crate) kind: Kind,
    /// One line that names the address.
    pub(crate) what: String,
}

/// Kinds of [`Fault`], by what helps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// No connection.
    Unreachable,
    /// There is a server or a disk, but not with these bytes.
    Unusable,
    /// The connection broke, or the server is busy: the same request may succeed later.
    Interrupted,
    /// The archive is not a whole ZIP, lacks an entry, or an entry is not what its directory says.
    Damaged,
    /// The bytes came, but cannot be written here.
    Local,
}

impl Fault {
    pub(crate) fn new(kind: Kind, what: impl fmt::Display) -> Self {
        Self { kind, what: what.to_string().replace(char::is_control, " ") }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.what)
    }
}

impl std::error::Error for Fault {}

/// How often a request is repeated.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Retry {
    /// Tries in a row that bring no byte, before giving up.
    pub(crate) tries: u32,
    /// Pause after the first; it doubles.
    pub(crate) pause: Duration,
}

impl Retry {
    /// The result of `work`, which is repeated while its fault may pass. `work` says whether it
    /// brought any byte; if so, the tries are counted anew.
    pub(crate) fn run<T>(
        self,
        mut work: impl FnMut() -> (bool, Result<T, Fault>),
    ) -> Result<T, Fault> {
        let mut tried = 0;
        loop {
            let (progress, done) = work();
            tried = if progress { 1 } else { tried + 1 };
            match done {
                Err(f) if f.kind == Kind::Interrupted && tried < self.tries => {
                    std::thread::sleep(self.pause * (1 << (tried - 1).min(5)));
                }
                done => return done,
            }
        }
    }
}
