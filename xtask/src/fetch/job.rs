//! One scene, from its archives to its folder.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result, anyhow, ensure};
use eval::progress::Bar;

use super::catalogue::{Archive, PUBLIC, Scene};
use super::directory::{Item, items};
use super::fault::{Fault, Kind, Retry};
use super::record::{Fetched, Record, digests};
use super::source::Source;

/// Entries this close to each other are fetched by one request.
const GAP: u64 = 64 << 10;

/// How to fetch.
pub(crate) struct Options {
    /// Replacements of the public archives: addresses of folders or of single archives.
    pub(crate) mirrors: Vec<String>,
    /// Folder of the public archives.
    pub(crate) public: String,
    /// The longest silence of a server.
    pub(crate) timeout: Duration,
    /// What to do about a connection that breaks.
    pub(crate) retry: Retry,
}

impl Options {
    pub(crate) fn new(mirrors: &[String], timeout: Duration) -> Self {
        let retry = Retry { tries: 5, pause: Duration::from_secs(1) };
        let public = PUBLIC.to_owned();
        Self { mirrors: mirrors.to_vec(), public, timeout, retry }
    }
}

/// What a fetch did.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Summary {
    /// Files fetched now.
    pub(crate) fetched: usize,
    /// Files that were there, and are as recorded or as in the archive.
    pub(crate) kept: usize,
}

/// Fetches what is missing of `scene` into `dir`. Files that are there are checked.
pub(crate) fn fetch(scene: Scene, dir: &Path, options: &Options) -> Result<Summary> {
    let work = dir.join(".fetch");
    fs::create_dir_all(&work).with_context(|| format!("create {}", work.display()))?;
    let mut record = Record::load(dir)?;
    let mut summary = Summary::default();
    if record.verify(dir)? && record.complete {
        summary.kept = record.files.len();
        return Ok(summary);
    }
    for (archive, folder) in scene.archives() {
        let place = Place::of(archive, dir, options);
        fetch_from(&place, archive, &folder, dir, options, &mut record, &mut summary)
            .map_err(|e| place.with_remedy(e))?;
    }
    record.complete = true;
    record.store(dir)?;
    // Only pieces are in it, and all are used up.
    let _ = fs::remove_dir_all(&work);
    Ok(summary)
}

fn fetch_from(
    place: &Place,
    archive: &Archive,
    folder: &str,
    dir: &Path,
    options: &Options,
    record: &mut Record,
    summary: &mut Summary,
) -> Result<()> {
    let source = Source::open(&place.address, options.timeout, options.retry)?;
    let mut missing = Vec::new();
    let wanted = items(&source, archive, folder).map_err(|e| match kind_of(&e) {
        Some(_) => e,
        None => Fault::new(Kind::Damaged, format!("{e:#}")).into(),
    })?;
    for item in wanted {
        if is_there(&item, dir, &place.address, record)? {
            summary.kept += 1;
        } else {
            missing.push(item);
        }
    }
    let total = missing.iter().map(|i| i.end - i.start).sum();
    let label = format!("{} files from {}", missing.len(), place.address);
    let bar = Bar::bytes(&label, total);
    for run in missing.chunk_by(|a, b| b.start.saturating_sub(a.end) <= GAP) {
        fetch_run(&source, archive, run, dir, &bar, record)?;
        summary.fetched += run.len();
    }
    bar.done();
    Ok(())
}

/// Fetches entries that lie side by side by one request, into a file that a fetch which is cut goes
/// on with, and unpacks them.
fn fetch_run(
    source: &Source,
    archive: &Archive,
    run: &[Item],
    dir: &Path,
    bar: &Bar,
    record: &mut Record,
) -> Result<()> {
    let (Some(first), Some(last)) = (run.first(), run.last()) else { return Ok(()) };
    let name = format!("{}-{}-{}.part", archive.file, first.start, last.end);
    let part = dir.join(".fetch").join(name);
    loop {
        let shown = || format!("write {}", part.display());
        let open = OpenOptions::new().create(true).append(true).open(&part);
        let mut file = open.with_context(shown)?;
        let held = file.metadata().with_context(shown)?.len();
        bar.step(held);
        source.copy(first.start + held, last.end, |bytes| {
            bar.step(bytes.len() as u64);
            file.write_all(bytes)
        })?;
        let done = run.iter().try_for_each(|item| {
            let sha256 = unpack(&part, first.start, item, dir)?;
            note(record, &source.address(), item, sha256);
            record.store(dir)
        });
        let damaged = done.as_ref().is_err_and(|e| kind_of(e) == Some(Kind::Damaged));
        if done.is_ok() || damaged {
            fs::remove_file(&part).with_context(|| format!("remove {}", part.display()))?;
        }
        // A power cut can damage what an earlier run wrote. Then the archive may be sound.
        if !(damaged && held > 0) {
            return done;
        }
    }
}

/// Unpacks an entry out of `part`, which holds the archive's bytes from `base` on. The file gets its
/// name only when it is whole and its CRC-32 is the archive's. Returns its SHA-256.
fn unpack(part: &Path, base: u64, item: &Item, dir: &Path) -> Result<String> {
    let damaged = |why: &dyn std::fmt::Display| {
        Fault::new(Kind::Damaged, format!("entry {} is damaged: {why}", item.name))
    };
    let mut file = File::open(part).with_context(|| format!("read {}", part.display()))?;
    let mut header = [0; 30];
    file.seek(SeekFrom::Start(item.start - base))?;
    file.read_exact(&mut header)?;
    ensure!(header.starts_with(b"PK\x03\x04"), damaged(&"no local header"));
    let names = [26, 28].map(|i| i64::from(u16::from_le_bytes([header[i], header[i + 1]])));
    file.seek(SeekFrom::Current(names[0] + names[1]))?;
    let packed = file.take(item.packed);
    let mut bytes: Box<dyn Read> = if item.deflated {
        Box::new(flate2::read::DeflateDecoder::new(packed))
    } else {
        Box::new(packed)
    };
    let whole = part.with_extension("unpacked");
    let mut out = File::create(&whole).with_context(|| format!("create {}", whole.display()))?;
    // One byte more than there should be, to notice a longer entry.
    let mut limited = bytes.by_ref().take(item.size + 1);
    let size = io::copy(&mut limited, &mut out).map_err(|e| match e.kind() {
        // What the decoder of deflate and a file that is cut give.
        io::ErrorKind::InvalidInput | io::ErrorKind::InvalidData | io::ErrorKind::UnexpectedEof => {
            anyhow!(damaged(&e))
        }
        _ => anyhow!(e).context(format!("write {}", whole.display())),
    })?;
    ensure!(size == item.size, damaged(&format!("{size} bytes or more, not {}", item.size)));
    out.sync_all().with_context(|| format!("write {}", whole.display()))?;
    let (sha256, crc32) = digests(&whole)?;
    ensure!(crc32 == item.crc32, damaged(&"its CRC-32 is not the archive's"));
    let path = dir.join(&item.path);
    let folder = path.parent().unwrap_or(dir);
    fs::create_dir_all(folder).with_context(|| format!("create {}", folder.display()))?;
    fs::rename(&whole, &path).with_context(|| format!("write {}", path.display()))?;
    Ok(sha256)
}

fn note(record: &mut Record, archive: &str, item: &Item, sha256: String) {
    let (archive, entry) = (archive.to_owned(), item.name.clone());
    let fetched = Fetched { archive, entry, bytes: item.size, sha256 };
    record.files.insert(item.path.clone(), fetched);
}

/// True if the file is there. One that is not recorded must be the archive's, and is then recorded.
fn is_there(item: &Item, dir: &Path, address: &str, record: &mut Record) -> Result<bool> {
    let path = dir.join(&item.path);
    if !path.exists() {
        return Ok(false);
    }
    if !record.files.contains_key(&item.path) {
        let (sha256, crc32) = digests(&path)?;
        let own = crc32 == item.crc32 && fs::metadata(&path).is_ok_and(|m| m.len() == item.size);
        ensure!(own, "{} is not the file in {address}; move it away", path.display());
        note(record, address, item, sha256);
    }
    Ok(true)
}

fn kind_of(error: &anyhow::Error) -> Option<Kind> {
    error.downcast_ref::<Fault>().map(|f| f.kind)
}

/// Where an archive is read from, and what a person can do if that fails.
struct Place {
    address: String,
    mirrored: bool,
    public: String,
    size: &'static str,
    /// Folder where a copy that was downloaded by hand is looked for.
    put: PathBuf,
}

impl Place {
    /// A mirror if one has the archive, else a copy beside the scenes, else the public server. A
    /// mirror that ends in `.zip` has the archive of that file name; any other has both.
    fn of(archive: &Archive, dir: &Path, options: &Options) -> Self {
        let file_of =
            |m: &str| m.split('?').next().and_then(|m| m.rsplit('/').next()).map(str::to_owned);
        let mirror = options.mirrors.iter().find_map(|m| match file_of(m) {
            Some(file) if file.ends_with(".zip") => (file == archive.file).then(|| m.clone()),
            _ => Some(format!("{}/{}", m.trim_end_matches('/'), archive.file)),
        });
        let put = dir.parent().unwrap_or(dir).to_path_buf();
        let public = format!("{}/{}/{}", options.public, archive.folder, archive.file);
        let by_hand = put.join(archive.file);
        let mirrored = mirror.is_some();
        let address = mirror.unwrap_or_else(|| {
            if by_hand.is_file() { by_hand.display().to_string() } else { public.clone() }
        });
        Self { address, mirrored, public, size: archive.size, put }
    }

    /// The error with what to do about it.
    fn with_remedy(&self, error: anyhow::Error) -> anyhow::Error {
        let remedy = match kind_of(&error) {
            Some(Kind::Interrupted) => "what has arrived is kept: run this again".to_owned(),
            None | Some(Kind::Local) => "put that right and run this again".to_owned(),
            Some(Kind::Damaged) => {
                format!("run this again; if it stays so, use another copy of {}", self.public)
            }
            Some(_) if self.mirrored => {
                format!("check --mirror; without it, {} is used", self.public)
            }
            Some(_) => format!(
                "download {} ({}) by hand into {} and run this again, or name another place by \
                 --mirror",
                self.public,
                self.size,
                self.put.display()
            ),
        };
        anyhow!("{error:#}; {remedy}")
    }
}
