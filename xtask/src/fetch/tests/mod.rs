//! Whole fetches from a server on loopback and from disk.

mod archive;
mod disk;
mod server;
mod servers;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tempfile::TempDir;

use super::catalogue::SCENES;
use super::fault::Retry;
use super::job::{Options, Summary, fetch};
use archive::Entry;
use server::{Behaviour, Server};

/// Both archives on disk, and a folder to fetch playroom into.
struct Setup {
    temp: TempDir,
    expected: Vec<Entry>,
}

impl Setup {
    fn new() -> Self {
        Self::with(&archive::models(), &archive::photos(), 0)
    }

    fn with(models: &[Entry], photos: &[Entry], hole: u64) -> Self {
        let temp = tempfile::tempdir().unwrap();
        fs::create_dir(temp.path().join("archives")).unwrap();
        let setup = Self { temp, expected: archive::expected(models, photos) };
        archive::write_zip(&setup.models(), models, hole);
        archive::write_zip(&setup.photos(), photos, hole);
        setup
    }

    fn archives(&self) -> PathBuf {
        self.temp.path().join("archives")
    }

    fn models(&self) -> PathBuf {
        self.archives().join("models.zip")
    }

    fn photos(&self) -> PathBuf {
        self.archives().join("tandt_db.zip")
    }

    /// The scene's folder.
    fn dir(&self) -> PathBuf {
        self.temp.path().join("scenes/playroom")
    }

    /// A server with the archives in `/d`.
    fn serve(&self, behaviour: Behaviour) -> Server {
        let (models, photos) = (self.models(), self.photos());
        let files = [("/d/models.zip", models.as_path()), ("/d/tandt_db.zip", &photos)];
        Server::start(&files, behaviour)
    }

    fn fetch(&self, options: &Options) -> anyhow::Result<Summary> {
        fetch(SCENES[0], &self.dir(), options)
    }

    /// The error, which is one line.
    fn fails(&self, options: &Options) -> String {
        let line = format!("{:#}", self.fetch(options).unwrap_err());
        assert!(!line.contains('\n'), "one line: {line}");
        line
    }

    /// Every wanted file, and no other, is there with its bytes.
    fn assert_complete(&self) {
        let mut found = Vec::new();
        walk(&self.dir(), &self.dir(), &mut found);
        found.retain(|(name, _)| name != "fetch.toml");
        found.sort();
        let names = |list: &[Entry]| list.iter().map(|(n, _)| n.clone()).collect::<Vec<_>>();
        assert_eq!(names(&found), names(&self.expected));
        assert!(found == self.expected, "bytes differ");
    }

    /// Unfinished pieces.
    fn pieces(&self) -> Vec<PathBuf> {
        let dir = fs::read_dir(self.dir().join(".fetch")).unwrap();
        dir.map(|e| e.unwrap().path()).filter(|p| p.extension().unwrap() == "part").collect()
    }
}

fn walk(root: &Path, dir: &Path, found: &mut Vec<Entry>) {
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            walk(root, &path, found);
        } else {
            let name = path.strip_prefix(root).unwrap().to_str().unwrap().to_owned();
            found.push((name, fs::read(&path).unwrap()));
        }
    }
}

/// Options that do not wait.
fn options(mirrors: &[String]) -> Options {
    Options {
        // Nothing listens there: what is not mirrored is not fetched.
        public: "http://127.0.0.1:1/d".to_owned(),
        retry: Retry { tries: 3, pause: Duration::from_millis(1) },
        ..Options::new(mirrors, Duration::from_secs(20))
    }
}

fn from(server: &Server) -> Options {
    options(&[server.url("/d")])
}

/// The archives' folder as a mirror.
fn local(setup: &Setup) -> Options {
    options(&[setup.archives().display().to_string()])
}
