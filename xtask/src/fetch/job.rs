//! One scene, from its archives to its folder.

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::Path;
use std::time::Duration;

use anyhow::anyhow;
use indicatif::DecimalBytes;

use super::catalogue::{Archive, PUBLIC, Scene};
use super::error::{ByHand, Error, Result};
use super::meter::Meter;
use super::place::{Place, mirrored};
use super::plan::{Item, items};
use super::ranged::{Patience, Ranged, TAIL};
use super::record::{Fetched, Record, digests, work_dir};
use super::unpack::{spool_path, unpack};

/// Room left on the disk beyond what is needed.
const SPARE: u64 = 64 << 20;

/// How to fetch.
pub(crate) struct Options {
    /// Replacements of the public archives.
    pub(crate) mirrors: Vec<String>,
    /// Folder of the public archives.
    pub(crate) public: String,
    /// The longest silence of a server.
    pub(crate) timeout: Duration,
    /// What to do about a line that breaks.
    pub(crate) patience: Patience,
    /// Bytes of an archive's end to read first.
    pub(crate) tail: u64,
    /// Bytes free on the disk of a folder.
    pub(crate) free: fn(&Path) -> io::Result<u64>,
    /// Says nothing.
    pub(crate) quiet: bool,
}

impl Options {
    /// The public archives, with that much silence allowed.
    pub(crate) fn new(mirrors: &[String], timeout: Duration) -> Self {
        Self {
            mirrors: mirrors.to_vec(),
            public: PUBLIC.to_owned(),
            timeout,
            patience: Patience { tries: 5, pause: Duration::from_secs(1) },
            tail: TAIL,
            free: |dir| fs4::available_space(dir),
            quiet: false,
        }
    }

    fn say(&self, text: String) {
        if !self.quiet {
            eprintln!("{text}");
        }
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

/// An archive with the entries still to fetch.
struct Task {
    reader: Ranged,
    hand: ByHand,
    items: Vec<Item>,
}

/// Fetches `scene` into `dir`: whatever is missing there. Files that are there are checked.
///
/// # Errors
/// One line, with what to do about it.
pub(crate) fn fetch(scene: Scene, dir: &Path, options: &Options) -> anyhow::Result<Summary> {
    let local = |e: Error| anyhow!("{e}; {}", e.local_remedy());
    let work = work_dir(dir);
    fs::create_dir_all(&work).map_err(|e| local(Error::io(&work, "create", e)))?;
    let _lock = lock(dir, &work).map_err(local)?;
    let mut record = Record::load(dir).map_err(local)?;
    let mut summary = Summary::default();
    let missing = record.verify(dir).map_err(local)?;
    summary.kept = record.files.len() - missing.len();
    if record.complete && missing.is_empty() {
        return Ok(summary);
    }

    let mut tasks = Vec::new();
    for (archive, folder) in scene.archives() {
        let hand = by_hand(scene, archive, dir, options);
        let explain = |e: Error| anyhow!("{e}; {}", e.remedy(&hand));
        let mut reader = open(archive, &hand, options).map_err(explain)?;
        options.say(format!("{}: from {}", scene.name, reader.url()));
        let wanted = items(&mut reader, archive, &folder).map_err(explain)?;
        let mut todo = Vec::new();
        for item in wanted {
            if settled(&item, dir, reader.url(), &mut record, &mut summary).map_err(explain)? {
                continue;
            }
            todo.push(item);
        }
        tasks.push(Task { reader, hand, items: todo });
    }
    record.store(dir).map_err(local)?;
    let total = check_space(dir, &tasks, options).map_err(local)?;

    let files: usize = tasks.iter().map(|t| t.items.len()).sum();
    options.say(format!("{}: {files} files, {} to fetch", scene.name, DecimalBytes(total)));
    let meter = if options.quiet { Meter::hidden() } else { Meter::new(scene.name, total) };
    for task in &mut tasks {
        task.reader.count_on(meter.clone());
        run(task, dir, &mut record, &mut summary)?;
    }
    meter.done();
    record.complete = true;
    record.store(dir).map_err(local)?;
    sweep(&work);
    Ok(summary)
}

/// Fetches the entries of one archive.
fn run(
    task: &mut Task,
    dir: &Path,
    record: &mut Record,
    summary: &mut Summary,
) -> anyhow::Result<()> {
    let Task { reader, hand, items } = task;
    for (i, item) in items.iter().enumerate() {
        // One request for entries that follow each other.
        let follows = |pair: &[Item]| pair[1].start.saturating_sub(pair[0].end) <= (64 << 10);
        let last = items[i..].windows(2).take_while(|pair| follows(pair)).count();
        reader.expect(items[i + last].end);
        let pin = record.files.get(&item.path).map(|f| f.sha256.clone());
        let sha256 = unpack(reader, item, dir, pin.as_deref())
            .map_err(|e| anyhow!("{e}; {}", e.remedy(hand)))?;
        note(record, reader.url(), item, sha256);
        record.store(dir).map_err(|e| anyhow!("{e}; {}", e.local_remedy()))?;
        summary.fetched += 1;
    }
    Ok(())
}

fn note(record: &mut Record, url: &str, item: &Item, sha256: String) {
    let (archive, entry) = (url.to_owned(), item.name.clone());
    let fetched = Fetched { archive, entry, bytes: item.size, sha256 };
    record.files.insert(item.path.clone(), fetched);
}

/// True if nothing is to be fetched for `item`: the file is there. One that is not recorded
/// (put there by hand, or the record was lost) must be the archive's, and is recorded.
fn settled(
    item: &Item,
    dir: &Path,
    url: &str,
    record: &mut Record,
    summary: &mut Summary,
) -> Result<bool> {
    let path = dir.join(&item.path);
    let recorded = record.files.get(&item.path);
    if let Some(old) = recorded.filter(|old| old.bytes != item.size) {
        let (url, name) = (url.to_owned(), item.name.clone());
        let (recorded, found) = (old.bytes.to_string(), item.size.to_string());
        return Err(Error::Replaced { url, name, what: "size", recorded, found });
    }
    let size = match fs::metadata(&path) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(false),
        Err(e) => return Err(Error::io(&path, "read", e)),
        // Checked already.
        Ok(_) if recorded.is_some() => return Ok(true),
        Ok(meta) => meta.len(),
    };
    let foreign = |why| Err(Error::Foreign { path: path.clone(), url: url.to_owned(), why });
    if size != item.size {
        return foreign(format!("{size} bytes, not {}", item.size));
    }
    let (sha256, crc32) = digests(&path)?;
    if crc32 != item.crc32 {
        return foreign(format!("CRC-32 {crc32:08x}, not {:08x}", item.crc32));
    }
    note(record, url, item, sha256);
    summary.kept += 1;
    Ok(true)
}

/// Refuses to begin what the disk cannot hold. Returns the bytes to fetch.
fn check_space(dir: &Path, tasks: &[Task], options: &Options) -> Result<u64> {
    let (mut unpacked, mut packed, mut largest, mut held) = (0_u64, 0_u64, 0, 0_u64);
    for task in tasks {
        for item in &task.items {
            unpacked = unpacked.saturating_add(item.size);
            packed = packed.saturating_add(item.packed);
            largest = item.packed.max(largest);
            let spool = spool_path(dir, task.reader.size(), item);
            held = held.saturating_add(fs::metadata(spool).map_or(0, |m| m.len()));
        }
    }
    // The largest is there twice, packed and unpacked, for a while.
    let need = unpacked.saturating_add(largest).saturating_sub(held);
    let free = (options.free)(dir).map_err(|e| Error::io(dir, "measure", e))?;
    if need > 0 && need.saturating_add(SPARE) > free {
        return Err(Error::Space { dir: dir.to_path_buf(), need, free });
    }
    Ok(packed)
}

/// Opens the archive where it is: at a mirror, beside the scenes, on the public server.
fn open(archive: &Archive, hand: &ByHand, options: &Options) -> Result<Ranged> {
    let places = match mirrored(archive, &options.mirrors)? {
        Some(places) => places,
        None if hand.put.join(archive.file).is_file() => {
            vec![Place::Disk(hand.put.join(archive.file))]
        }
        None => vec![Place::Server(hand.url.clone())],
    };
    let mut first_error = None;
    for place in places {
        match place.open(options.timeout, options.patience) {
            Ok(source) => return Ranged::new(source, options.patience, options.tail),
            Err(e) if e.absent() => first_error = first_error.or(Some(e)),
            Err(e) => return Err(e),
        }
    }
    Err(first_error.unwrap_or_else(|| {
        let (url, why) = (hand.url.clone(), "no address".to_owned());
        Error::Address { url, why }
    }))
}

fn by_hand(scene: Scene, archive: &Archive, dir: &Path, options: &Options) -> ByHand {
    let put = dir.parent().unwrap_or(dir).to_path_buf();
    let url = |archive: &Archive| format!("{}/{}/{}", options.public, archive.folder, archive.file);
    let is_mirrored =
        |archive: &Archive| mirrored(archive, &options.mirrors).is_ok_and(|m| m.is_some());
    let all = scene.archives();
    let others = all.iter().map(|(other, _)| *other).filter(|other| {
        other.file != archive.file && !is_mirrored(other) && !put.join(other.file).is_file()
    });
    ByHand {
        url: url(archive),
        size: archive.size,
        others: others.map(|other| format!("{} ({})", url(other), other.size)).collect(),
        mirrored: is_mirrored(archive),
        put,
    }
}

/// Two fetches into one folder would mix their pieces.
fn lock(dir: &Path, work: &Path) -> Result<File> {
    let path = work.join("lock");
    let file = File::create(&path).map_err(|e| Error::io(&path, "create", e))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(Error::Busy { dir: dir.to_path_buf() }),
        Err(TryLockError::Error(e)) => Err(Error::io(&path, "lock", e)),
    }
}

/// Removes pieces that nothing will go on from. What cannot be removed does no harm.
fn sweep(work: &Path) {
    let Ok(entries) = fs::read_dir(work) else { return };
    for entry in entries.flatten() {
        if entry.path().extension().is_some_and(|e| e == "part") {
            let _ = fs::remove_file(entry.path());
        }
    }
}
