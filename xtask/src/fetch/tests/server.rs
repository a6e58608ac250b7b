//! A small HTTP server on loopback that can fail in the ways of real ones.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::SeqCst};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

/// How the server behaves; all off is a good server.
#[derive(Clone, Debug, Default)]
pub(super) struct Behaviour {
    /// Ranges are ignored: the whole file, status 200.
    pub(super) no_ranges: bool,
    /// Every answer is this status.
    pub(super) status: Option<u16>,
    /// The first so many answers are status 503.
    pub(super) unavailable: u64,
    /// Every response body is cut after so many bytes.
    pub(super) cut_each: Option<u64>,
    /// Nothing more is sent once this many body bytes have been.
    pub(super) cut_all: Option<u64>,
    /// Requests are read and not answered.
    pub(super) silent: bool,
}

#[derive(Default)]
struct State {
    files: BTreeMap<String, PathBuf>,
    behaviour: Mutex<Behaviour>,
    requests: AtomicU64,
    body_bytes: AtomicU64,
    stopped: AtomicBool,
}

/// The server; it ends when dropped.
pub(super) struct Server {
    address: SocketAddr,
    state: Arc<State>,
}

impl Server {
    /// Serves files at paths such as `/a/b.zip`.
    pub(super) fn start(files: &[(&str, &Path)], behaviour: Behaviour) -> Self {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let address = listener.local_addr().unwrap();
        let files = files.iter().map(|(url, path)| ((*url).to_owned(), path.to_path_buf()));
        let (files, behaviour) = (files.collect(), Mutex::new(behaviour));
        let state = Arc::new(State { files, behaviour, ..State::default() });
        let shared = Arc::clone(&state);
        thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                if shared.stopped.load(SeqCst) {
                    return;
                }
                let state = Arc::clone(&shared);
                // A client that closes the connection is no error of the server.
                thread::spawn(move || converse(&stream, &state).unwrap_or_default());
            }
        });
        Self { address, state }
    }

    pub(super) fn url(&self, path: &str) -> String {
        format!("http://{}{path}", self.address)
    }

    pub(super) fn behave(&self, behaviour: Behaviour) {
        *self.state.behaviour.lock().unwrap() = behaviour;
    }

    /// Requests and body bytes since the last call.
    pub(super) fn take_counts(&self) -> (u64, u64) {
        let State { requests, body_bytes, .. } = &*self.state;
        (requests.swap(0, SeqCst), body_bytes.swap(0, SeqCst))
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.state.stopped.store(true, SeqCst);
        // Wakes the thread that accepts connections.
        let _ = TcpStream::connect(self.address);
    }
}

/// Answers requests on one connection until it is closed.
fn converse(stream: &TcpStream, state: &State) -> io::Result<()> {
    stream.set_nodelay(true)?;
    let mut lines = BufReader::new(stream.try_clone()?).lines();
    loop {
        let (mut path, mut range) = (String::new(), None);
        loop {
            let Some(line) = lines.next().transpose()? else { return Ok(()) };
            if let Some(rest) = line.strip_prefix("GET ") {
                path = rest.split([' ', '?']).next().unwrap_or_default().to_owned();
            } else if let Some(value) = line.to_lowercase().strip_prefix("range: bytes=") {
                let (from, to) = value.trim().split_once('-').unwrap();
                range = Some((from.parse::<u64>().unwrap(), to.parse::<u64>().unwrap()));
            } else if line.is_empty() {
                break;
            }
        }
        if !answer(stream, state, &path, range)? {
            return Ok(());
        }
    }
}

/// Answers one request. False if the connection is to be closed.
fn answer(
    mut stream: &TcpStream,
    state: &State,
    path: &str,
    range: Option<(u64, u64)>,
) -> io::Result<bool> {
    let number = state.requests.fetch_add(1, SeqCst);
    let behaviour = state.behaviour.lock().unwrap().clone();
    if behaviour.silent {
        thread::sleep(Duration::from_secs(3));
        return Ok(false);
    }
    let busy = (number < behaviour.unavailable).then_some(503).or(behaviour.status);
    let file = state.files.get(path).filter(|_| busy.is_none());
    let Some(file) = file else {
        let status = busy.unwrap_or(404);
        write!(stream, "HTTP/1.1 {status} X\r\nContent-Length: 0\r\n\r\n")?;
        return Ok(true);
    };
    let mut file = File::open(file)?;
    let size = file.metadata()?.len();
    let range = range.filter(|_| !behaviour.no_ranges);
    let (from, to) = range.map_or((0, size), |(from, last)| (from, (last + 1).min(size)));
    match range {
        Some(_) => {
            write!(stream, "HTTP/1.1 206 X\r\nContent-Range: bytes {from}-{}/{size}\r\n", to - 1)?
        }
        None => write!(stream, "HTTP/1.1 200 X\r\n")?,
    }
    write!(stream, "Content-Length: {}\r\n\r\n", to - from)?;

    file.seek(SeekFrom::Start(from))?;
    let (mut left, mut allowed) = (to - from, behaviour.cut_each.unwrap_or(u64::MAX));
    let mut buffer = vec![0; 16 << 10];
    while left > 0 {
        let sent = state.body_bytes.load(SeqCst);
        let budget = behaviour.cut_all.map_or(u64::MAX, |all| all.saturating_sub(sent));
        let n = left.min(allowed).min(budget).min(buffer.len() as u64);
        if n == 0 {
            return Ok(false);
        }
        let bytes = &mut buffer[..n as usize];
        file.read_exact(bytes)?;
        stream.write_all(bytes)?;
        state.body_bytes.fetch_add(n, SeqCst);
        (left, allowed) = (left - n, allowed - n);
    }
    Ok(true)
}
