//! Writing files so that an interrupted run, a full disk or an existing file loses nothing.
//!
//! An [`Output`] is opened before the work, so that a folder that cannot be written fails at once.
//! The bytes go to a temporary file beside the final name, which is renamed when it is complete.
//! A symbolic link is followed: the file that it names is replaced, the link stays. Devices and
//! pipes cannot be renamed onto; they are written directly.

use crate::exit::usage;
use crate::ledger::ledger;
use crate::positional::At;
use anyhow::{Context, Result, anyhow, bail};
use std::fmt::Display;
use std::fs::File;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::path::{Path, PathBuf};
use tempfile::{NamedTempFile, TempDir};

/// Names of temporary files.
const PREFIX: &str = ".gsvx-";
const SUFFIX: &str = ".part";

/// Removes what killed runs left in `dir`. Best effort: what cannot be removed stays.
///
/// A running command holds a lock on its temporary file or folder; one that can be locked has no owner.
fn sweep(dir: &Path) {
    for entry in std::fs::read_dir(dir).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let Some(name) = name.to_str() else { continue };
        if !(name.starts_with(PREFIX) && name.ends_with(SUFFIX)) {
            continue;
        }
        let Ok(file) = File::open(entry.path()) else { continue };
        if file.try_lock().is_ok() {
            // The lock is held until the file is gone: see `temporary`.
            let _ = match entry.file_type().is_ok_and(|t| t.is_dir()) {
                true => std::fs::remove_dir_all(entry.path()),
                false => std::fs::remove_file(entry.path()),
            };
        }
    }
}

/// A new temporary file in `dir`, locked.
fn temporary(dir: &Path) -> std::io::Result<NamedTempFile> {
    loop {
        let mut builder = tempfile::Builder::new();
        builder.prefix(PREFIX).suffix(SUFFIX);
        // The mode of any new file: the umask takes away what the user does not want.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let file = builder.tempfile_in(dir)?;
        // On a file system without locks nothing is swept, so the lock may fail.
        let _ = file.as_file().lock();
        // Another run may have swept the file before it was locked.
        if file.path().exists() {
            return Ok(file);
        }
    }
}

/// A file that will appear whole or not at all, a device, or standard output.
pub(crate) struct Output {
    /// As given.
    path: PathBuf,
    target: Target,
}

enum Target {
    Stdout,
    Device(File),
    File(Replacement),
}

/// A temporary file and what it becomes.
struct Replacement {
    /// The final name, symbolic links followed.
    path: PathBuf,
    file: NamedTempFile,
    force: bool,
}

impl Output {
    /// Opens `path`, or standard output for `-`. Refuses to replace one of the `inputs`.
    pub(crate) fn open<P: AsRef<Path>>(path: &Path, force: bool, inputs: &[P]) -> Result<Self> {
        if is_stdout(path) {
            if std::io::stdout().is_terminal() {
                return Err(usage(
                    "standard output is a terminal; redirect it, or name a file with -o",
                ));
            }
            return Ok(Self { path: path.into(), target: Target::Stdout });
        }
        let name = path.display();
        if let Some(device) = device(path)? {
            return Ok(Self { path: path.into(), target: Target::Device(device) });
        }
        let file = check(path, force, inputs)?;
        let dir = folder_of(&file)?;
        sweep(dir);
        let temporary =
            temporary(dir).with_context(|| format!("{}: cannot write here", dir.display()))?;
        ledger().pending.push(temporary.path().into());
        if file.file_name().is_none() {
            bail!("{name}: names no file");
        }
        let target = Target::File(Replacement { path: file, file: temporary, force });
        Ok(Self { path: path.into(), target })
    }

    /// True if the bytes go to standard output.
    pub(crate) fn is_stdout(&self) -> bool {
        matches!(self.target, Target::Stdout)
    }

    /// True if the bytes may be written in any order: see [`Output::write_at`].
    pub(crate) fn is_file(&self) -> bool {
        matches!(self.target, Target::File(_))
    }

    /// The name as given.
    pub(crate) fn name(&self) -> String {
        if self.is_stdout() { "standard output".into() } else { self.path.display().to_string() }
    }

    /// Writes everything and gives the file its name.
    pub(crate) fn write(
        self,
        fill: impl FnOnce(&mut (dyn Write + Send)) -> Result<()>,
    ) -> Result<Written> {
        let (name, stdout) = (self.name(), self.is_stdout());
        let bytes = match self.target {
            Target::Stdout => at_once(&mut io::stdout(), &name, fill)?,
            Target::Device(mut file) => at_once(&mut file, &name, fill)?,
            Target::File(mut to) => {
                let bytes = WatchedFile::fill(to.file.as_file_mut(), &name, fill)?;
                to.put_in_place(&name, true)?;
                bytes
            }
        };
        Ok(Written { name, bytes, stdout })
    }

    /// As [`Output::write`], at any position and from any thread, for files. The result can be made
    /// again: the disk is waited for only where a file is replaced, which a power cut must not cost.
    pub(crate) fn write_at(
        self,
        fill: impl FnOnce(&(dyn Fn(&[u8], u64) -> Result<()> + Sync)) -> Result<()>,
    ) -> Result<Written> {
        let name = self.name();
        let Target::File(to) = self.target else {
            bail!("{name}: can only be written from its start");
        };
        let file = to.file.as_file();
        fill(&|bytes, at| At(file, at).write_all(bytes).map_err(|e| not_written(&name, e)))?;
        let bytes = file.metadata().map_err(|e| not_written(&name, e))?.len();
        let replaces = to.path.exists();
        to.put_in_place(&name, replaces)?;
        Ok(Written { name, bytes, stdout: false })
    }
}

/// Writes what cannot be taken back.
fn at_once(
    out: &mut (dyn Write + Send),
    name: &str,
    fill: impl FnOnce(&mut (dyn Write + Send)) -> Result<()>,
) -> Result<u64> {
    ledger().begun = Some(name.into());
    let bytes = WatchedFile::fill(out, name, fill)?;
    let mut ledger = ledger();
    ledger.begun = None;
    ledger.completed(name);
    Ok(bytes)
}

/// What was written.
pub(crate) struct Written {
    /// As given.
    pub(crate) name: String,
    pub(crate) bytes: u64,
    /// It is on standard output.
    pub(crate) stdout: bool,
}

/// A writer that counts what goes through, and keeps the first failure: what is above it words it
/// otherwise, or not at all.
struct WatchedFile<'a> {
    out: &'a mut (dyn Write + Send),
    bytes: u64,
    failed: Option<io::Error>,
}

impl<'a> WatchedFile<'a> {
    /// Calls `fill` with a buffer before `out`, which is called `name`. Returns the bytes written.
    fn fill(
        out: &'a mut (dyn Write + Send),
        name: &str,
        fill: impl FnOnce(&mut (dyn Write + Send)) -> Result<()>,
    ) -> Result<u64> {
        let mut watched = Self { out, bytes: 0, failed: None };
        let mut buffer = io::BufWriter::with_capacity(1 << 20, &mut watched);
        let outcome = fill(&mut buffer).and_then(|()| Ok(buffer.flush()?));
        drop(buffer);
        match watched.failed {
            Some(failure) => Err(not_written(name, failure)),
            None => outcome.map(|()| watched.bytes),
        }
    }

    fn keep<T>(&mut self, outcome: io::Result<T>) -> io::Result<T> {
        if let Err(e) = &outcome
            && e.kind() != ErrorKind::Interrupted
        {
            self.failed.get_or_insert_with(|| io::Error::new(e.kind(), e.to_string()));
        }
        outcome
    }
}

impl Write for WatchedFile<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let outcome = self.out.write(bytes);
        let n = self.keep(outcome)?;
        self.bytes += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        let outcome = self.out.flush();
        self.keep(outcome)
    }
}

impl Replacement {
    /// Gives the file its name, once the disk has it if `on_disk`.
    fn put_in_place(self, name: &str, on_disk: bool) -> Result<()> {
        let failed = |e| not_written(name, e);
        if on_disk {
            self.file.as_file().sync_all().map_err(failed)?;
        }
        // A replaced file keeps its mode.
        #[cfg(unix)]
        if let Ok(old) = std::fs::metadata(&self.path) {
            self.file.as_file().set_permissions(old.permissions()).map_err(failed)?;
        }
        let temporary = self.file.path().to_path_buf();
        // An interruption finds the output in place and in the ledger, or neither.
        let mut ledger = ledger();
        if self.force {
            self.file.persist(&self.path).map_err(|e| failed(e.error))?;
        } else {
            self.file.persist_noclobber(&self.path).map_err(|e| match e.error.kind() {
                ErrorKind::AlreadyExists => {
                    anyhow!("{name}: was made meanwhile; pass --force to replace it")
                }
                _ => failed(e.error),
            })?;
        }
        ledger.pending.retain(|p| *p != temporary);
        ledger.completed(name);
        Ok(())
    }
}

/// A folder of files that belong together: all of them appear in it, or none.
pub(crate) struct OutputFolder {
    path: PathBuf,
    /// Where the files wait, in the folder.
    waiting: TempDir,
    _lock: Option<File>,
    /// Where each file is, and where it goes, in the order in which they appear.
    files: Vec<(PathBuf, PathBuf)>,
}

impl OutputFolder {
    /// Makes the folder, unless it is there. One that holds something already needs `force`.
    pub(crate) fn open(path: &Path, force: bool) -> Result<Self> {
        // An interruption finds no folder that is not in the ledger.
        let mut ledger = ledger();
        let made = !path.exists();
        empty_folder(path, force)?;
        sweep(path);
        let waiting = tempfile::Builder::new().prefix(PREFIX).suffix(SUFFIX).tempdir_in(path);
        let waiting = waiting.with_context(|| format!("{}: cannot write here", path.display()))?;
        let lock = File::open(waiting.path()).ok().filter(|dir| dir.try_lock().is_ok());
        ledger.pending.push(waiting.path().into());
        ledger.made.extend(made.then(|| path.into()));
        Ok(Self { path: path.into(), waiting, _lock: lock, files: Vec::new() })
    }

    /// Writes a file of this name, in a folder of its own if that has a `/`; it must not be one of the `inputs`. Returns
    /// its length.
    pub(crate) fn write<P: AsRef<Path>>(
        &mut self,
        name: &str,
        inputs: &[P],
        fill: impl FnOnce(&mut (dyn Write + Send)) -> Result<()>,
    ) -> Result<u64> {
        let (path, waits) = (self.path.join(name), self.waiting.path().join(name));
        let target = check(&path, true, inputs)?;
        let name = path.display().to_string();
        let failed = |e| not_written(&name, e);
        // The ledger is locked, so that no file is added while an interruption empties the folder.
        let created = {
            let _ledger = ledger();
            std::fs::create_dir_all(parent(&waits)).and_then(|()| File::create(&waits))
        };
        let mut file = created.map_err(failed)?;
        self.files.push((waits, target));
        WatchedFile::fill(&mut file, &name, fill)
    }

    /// Files that are written.
    pub(crate) fn len(&self) -> usize {
        self.files.len()
    }

    /// Gives all files their names.
    pub(crate) fn put_in_place(mut self) -> Result<()> {
        let failed = |to: &Path, e| not_written(&to.display().to_string(), e);
        // All at the end: the first one takes most of the others to the disk.
        for (from, to) in &self.files {
            let file = File::options().write(true).open(from);
            file.and_then(|file| file.sync_all()).map_err(|e| failed(to, e))?;
        }
        let mut ledger = ledger();
        for (from, to) in self.files.drain(..) {
            let renamed =
                std::fs::create_dir_all(parent(&to)).and_then(|()| std::fs::rename(from, &to));
            renamed.map_err(|e| failed(&to, e))?;
        }
        ledger.completed(&self.path.display().to_string());
        Ok(())
    }
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        let waiting = self.waiting.path();
        let _ = std::fs::remove_dir_all(waiting);
        let mut ledger = ledger();
        ledger.pending.retain(|p| p != waiting);
        if ledger.made.contains(&self.path) {
            // Only an empty folder is removed.
            let _ = std::fs::remove_dir(&self.path);
        }
    }
}

/// Opens what is there but is no regular file: a device or a pipe.
fn device(path: &Path) -> Result<Option<File>> {
    let Ok(there) = std::fs::metadata(path) else { return Ok(None) };
    if there.is_file() {
        return Ok(None);
    }
    let name = path.display();
    if there.is_dir() {
        bail!("{name}: is a directory; give a file name");
    }
    let file = File::options().write(true).open(path);
    Ok(Some(file.with_context(|| format!("{name}: cannot be written"))?))
}

/// Checks that a file may be made at `path`, or replaced with --force. Returns the name of the file
/// that `path` leads to.
pub(crate) fn check<P: AsRef<Path>>(path: &Path, force: bool, inputs: &[P]) -> Result<PathBuf> {
    let name = path.display();
    let file = follow_links(path)?;
    let Ok(there) = std::fs::metadata(&file) else { return Ok(file) };
    if inputs.iter().any(|input| is_same(&file, input.as_ref())) {
        bail!("{name}: is the input itself, which would be lost; give another name");
    }
    if !force {
        bail!("{name}: already exists; pass --force to replace it");
    }
    if there.permissions().readonly() {
        bail!("{name}: is read-only; make it writable or give another name");
    }
    Ok(file)
}

/// The folder of a file that is to be made.
pub(crate) fn folder_of(file: &Path) -> Result<&Path> {
    let dir = parent(file);
    if !dir.is_dir() {
        bail!("{}: no such directory; create it first", dir.display());
    }
    Ok(dir)
}

/// The name that the symbolic links at `path` lead to; there need be nothing.
fn follow_links(path: &Path) -> Result<PathBuf> {
    const MOST: usize = 40;
    let mut path = path.to_path_buf();
    for _ in 0..MOST {
        let is_link = std::fs::symlink_metadata(&path).is_ok_and(|m| m.is_symlink());
        if !is_link {
            return Ok(path);
        }
        let to = std::fs::read_link(&path)
            .with_context(|| format!("{}: the link cannot be read", path.display()))?;
        path = parent(&path).join(to);
    }
    bail!("{}: the symbolic links go round in a circle", path.display())
}

/// True if two names lead to one file, through links of either kind too.
fn is_same(path: &Path, input: &Path) -> bool {
    use same_file::Handle;
    let input = if is_stdio(input) { Handle::stdin() } else { Handle::from_path(input) };
    matches!((Handle::from_path(path), input), (Ok(a), Ok(b)) if a == b)
}

/// Makes a folder, unless it is there; one that holds something already needs `force`.
pub(crate) fn empty_folder(path: &Path, force: bool) -> Result<()> {
    let name = path.display();
    if path.is_file() {
        bail!("{name}: is a file; name a folder");
    }
    make_folder(path)?;
    let mut list = std::fs::read_dir(path).with_context(|| format!("{name}: cannot be read"))?;
    if !force && list.next().is_some() {
        bail!("{name}: is not empty; pass --force to write into it");
    }
    Ok(())
}

/// Makes a folder, unless it is there.
pub(crate) fn make_folder(path: &Path) -> Result<()> {
    std::fs::create_dir_all(path)
        .with_context(|| format!("{}: the folder cannot be made", path.display()))
}

/// The folder of a path.
pub(crate) fn parent(path: &Path) -> &Path {
    match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    }
}

/// The error of an output that cannot be written.
fn not_written(name: &str, error: io::Error) -> anyhow::Error {
    let known = match error.kind() {
        ErrorKind::StorageFull => Some("the disk is full"),
        ErrorKind::QuotaExceeded => Some("your quota on this disk is used up"),
        ErrorKind::FileTooLarge => Some("the file is larger than the system allows"),
        _ => None,
    };
    let cause = match known {
        Some(text) => io::Error::new(error.kind(), text),
        None => error,
    };
    anyhow::Error::new(cause).context(format!("{name}: could not be written"))
}

/// True for `-`, which stands for standard input or output.
pub(crate) fn is_stdio(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// True for standard output. Its name on Unix may lead to a file, which a shell has open already
/// and which must not be replaced.
fn is_stdout(path: &Path) -> bool {
    is_stdio(path) || (cfg!(unix) && path == Path::new("/dev/stdout"))
}

/// A number of things: "1 Gaussian", "2 Gaussians".
pub(crate) fn counted(n: impl Display, thing: &str) -> String {
    let n = n.to_string();
    format!("{n} {thing}{}", if n == "1" { "" } else { "s" })
}
