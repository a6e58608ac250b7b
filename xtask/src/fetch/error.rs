//! What can go wrong while fetching, and what to do about it.

use std::io;
use std::path::{Path, PathBuf};

use indicatif::DecimalBytes;

/// Result of this module.
pub(crate) type Result<T> = std::result::Result<T, Error>;

/// Why a fetch failed. Every message is one line.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub(crate) enum Error {
    #[error("{url}: cannot reach the server: {why}")]
    Unreachable { url: String, why: String },
    #[error("{url}: not a usable address: {why}")]
    Address { url: String, why: String },
    #[error("{url}: the server sent nothing for {seconds} s")]
    Stalled { url: String, seconds: f64 },
    #[error("{url}: the connection broke at byte {at}: {why}")]
    Broken { url: String, at: u64, why: String },
    #[error("{url}: the server answered with status {status}")]
    Status { url: String, status: u16 },
    #[error("{url}: the server does not serve byte ranges, so nothing less than all of it")]
    NoRanges { url: String },
    #[error("{url}: the archive changed while it was read: {why}")]
    Moved { url: String, why: String },
    #[error("{url}: not a usable ZIP archive: {why}")]
    Archive { url: String, why: String },
    #[error("{url}: there is no entry {name}")]
    NoEntry { url: String, name: String },
    #[error("{url}: entry {name:?} is refused: {why}")]
    Refused { url: String, name: String, why: &'static str },
    #[error("{url}: entry {name} is damaged: {why}")]
    Damaged { url: String, name: String, why: String },
    #[error("{url}: entry {name} is not what was fetched first: {what} was {recorded}, is {found}")]
    Replaced { url: String, name: String, what: &'static str, recorded: String, found: String },
    #[error("{}: changed since it was fetched: {what} was {recorded}, is {found}", path.display())]
    Changed { path: PathBuf, what: &'static str, recorded: String, found: String },
    #[error("{}: is there, but is not the file in {url}: {why}", path.display())]
    Foreign { path: PathBuf, url: String, why: String },
    #[error("{}: {} needed, {} free", dir.display(), DecimalBytes(*need), DecimalBytes(*free))]
    Space { dir: PathBuf, need: u64, free: u64 },
    #[error("{}: another fetch is at work there", dir.display())]
    Busy { dir: PathBuf },
    #[error("{}: not a record of fetched files: {why}", path.display())]
    Record { path: PathBuf, why: String },
    #[error("{verb} {}: {source}", path.display())]
    Io { path: PathBuf, verb: &'static str, source: io::Error },
}

/// What a person can do without this program.
#[derive(Clone, Debug)]
pub(crate) struct ByHand {
    /// The archive's public address.
    pub(crate) url: String,
    /// How large it is, in words.
    pub(crate) size: &'static str,
    /// Folder where this program looks for a copy of it.
    pub(crate) put: PathBuf,
    /// The other archives that are not at hand, as "address (size)".
    pub(crate) others: Vec<String>,
    /// True if the address came from `--mirror`.
    pub(crate) mirrored: bool,
}

impl Error {
    /// An operation on a local file that failed.
    pub(crate) fn io(path: &Path, verb: &'static str, source: io::Error) -> Self {
        Self::Io { path: path.to_path_buf(), verb, source }
    }

    /// True if the same request may succeed a little later. `connected`: the server has
    /// answered before, so that an unreachable one is an outage rather than no network.
    pub(crate) fn passing(&self, connected: bool) -> bool {
        match self {
            Self::Stalled { .. } | Self::Broken { .. } => true,
            Self::Status { status, .. } => matches!(status, 408 | 429 | 500..=599),
            Self::Unreachable { .. } => connected,
            _ => false,
        }
    }

    /// True if there is nothing at that address.
    pub(crate) fn absent(&self) -> bool {
        match self {
            Self::Status { status, .. } => matches!(status, 404 | 410),
            Self::Io { source, .. } => source.kind() == io::ErrorKind::NotFound,
            _ => false,
        }
    }

    /// What to do, as the end of the message.
    pub(crate) fn remedy(&self, hand: &ByHand) -> String {
        let download = |others: &[String]| {
            let all: Vec<String> = others.iter().map(|other| format!(" and {other}")).collect();
            let (put, all) = (hand.put.display(), all.concat());
            format!(
                "download {} ({}){all} by hand into {put} and run this again",
                hand.url, hand.size
            )
        };
        match self {
            Self::Unreachable { .. } if hand.mirrored => {
                "check --mirror and the network, then run this again".to_owned()
            }
            Self::Address { .. } | Self::Io { .. } | Self::Status { .. } if hand.mirrored => {
                format!("check --mirror; without it, {} is used", hand.url)
            }
            Self::Unreachable { .. } => {
                format!("{}, or name another place by --mirror", download(&hand.others))
            }
            Self::NoRanges { .. } | Self::Status { .. } | Self::Address { .. } => {
                format!("{}, or name another place by --mirror", download(&[]))
            }
            Self::Stalled { .. } | Self::Broken { .. } | Self::Moved { .. } => {
                "what has arrived is kept: run this again to go on".to_owned()
            }
            Self::Damaged { .. } => {
                "run this again; if it stays so, the archive is broken: use another by --mirror"
                    .to_owned()
            }
            Self::Archive { .. } | Self::NoEntry { .. } | Self::Refused { .. } => {
                format!("use the original, {}", hand.url)
            }
            _ => self.local_remedy(),
        }
    }

    /// As [`Error::remedy`], for what has nothing to do with an archive.
    pub(crate) fn local_remedy(&self) -> String {
        match self {
            Self::Replaced { .. } => {
                "if the new archive is the right one, delete the scene's folder and run this again"
                    .to_owned()
            }
            Self::Changed { .. } => "delete it and run this again".to_owned(),
            Self::Foreign { .. } => "move it away and run this again".to_owned(),
            Self::Space { .. } => "make room, or use another disk by --cache".to_owned(),
            Self::Busy { .. } => "wait for it to end".to_owned(),
            Self::Record { .. } => {
                "delete it and run this again: the files are checked against the archive".to_owned()
            }
            _ => "put that right and run this again".to_owned(),
        }
    }
}

/// An error on its way through `Read`.
impl From<Error> for io::Error {
    fn from(error: Error) -> Self {
        Self::other(error)
    }
}

/// One line out of any text.
pub(crate) fn one_line(text: impl ToString) -> String {
    text.to_string().replace(|c: char| c.is_control(), " ")
}
