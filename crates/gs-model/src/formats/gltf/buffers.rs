//! The buffers of a file: the data of a `.glb`, data in a URI, and files beside it. They are read when they are
//! needed.

use std::borrow::Cow;
use std::cell::OnceCell;
use std::fs::File;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

use base64::Engine;
use base64::prelude::BASE64_STANDARD;

use super::json::{BufferView, Root};

pub(super) const SHORT: &str = "it promises more than the file holds";

pub(super) struct Buffers<'a> {
    root: &'a Root,
    /// Where files beside it are.
    folder: PathBuf,
    /// The data of a `.glb`.
    chunk: &'a [u8],
    loaded: Vec<OnceCell<Result<Cow<'a, [u8]>, String>>>,
}

impl<'a> Buffers<'a> {
    pub(super) fn new(file: &Path, root: &'a Root, chunk: &'a [u8]) -> Self {
        let folder = file.parent().unwrap_or(Path::new("")).to_owned();
        let loaded = root.buffers.iter().map(|_| OnceCell::new()).collect();
        Self { root, folder, chunk, loaded }
    }

    /// The bytes of the view at an index; an error is what is wrong with it.
    pub(super) fn view(&self, view: &BufferView) -> Result<&[u8], String> {
        let buffer = self.loaded.get(view.buffer).ok_or("it names a buffer that is not there")?;
        let loaded = buffer.get_or_init(|| self.load(view.buffer));
        let data = loaded.as_ref().map_err(Clone::clone)?;
        let end = view.byte_offset.checked_add(view.byte_length).ok_or(SHORT)?;
        Ok(data.get(view.byte_offset..end).ok_or(SHORT)?)
    }

    /// Bytes that were needed.
    pub(super) fn len(&self) -> u64 {
        self.sizes(|_| true)
    }

    /// Bytes that were read from files beside it.
    pub(super) fn beside(&self) -> u64 {
        self.sizes(|uri| uri.is_some_and(|uri| !uri.starts_with(DATA)))
    }

    fn sizes(&self, counts: impl Fn(Option<&str>) -> bool) -> u64 {
        let loaded = self.loaded.iter().zip(&self.root.buffers);
        let loaded = loaded.filter(|(_, buffer)| counts(buffer.uri.as_deref()));
        let size = |(cell, _): (&OnceCell<Result<Cow<'_, [u8]>, _>>, _)| match cell.get() {
            Some(Ok(data)) => data.len() as u64,
            _ => 0,
        };
        loaded.map(size).sum()
    }

    fn load(&self, at: usize) -> Result<Cow<'a, [u8]>, String> {
        let buffer = &self.root.buffers[at];
        let Some(uri) = &buffer.uri else {
            // Only the first one is in a .glb.
            return Ok(Cow::Borrowed(if at == 0 { self.chunk } else { &[] }));
        };
        if let Some(data) = uri.strip_prefix(DATA) {
            let (_, text) = data.split_once(";base64,").ok_or("its data: URI is not base64")?;
            let bytes = BASE64_STANDARD.decode(text.trim_ascii());
            return bytes.map(Cow::Owned).map_err(|_| "its data: URI is broken base64".into());
        }
        let path = self.folder.join(beside(uri)?);
        let read = || {
            let file = File::open(&path)?;
            let mut bytes = Vec::new();
            if file.metadata()?.is_file() {
                file.take(buffer.byte_length as u64).read_to_end(&mut bytes)?;
            }
            Ok::<_, std::io::Error>(bytes)
        };
        let bytes = read().map_err(|e| format!("its data are in {}: {e}", path.display()))?;
        Ok(Cow::Owned(bytes))
    }
}

const DATA: &str = "data:";

/// The path of a file beside the model, or in a folder there. Others could be any file of the machine.
fn beside(uri: &str) -> Result<PathBuf, String> {
    let name = unescaped(uri);
    let normal = |c: Component<'_>| matches!(c, Component::Normal(_) | Component::CurDir);
    let path = Path::new(&name);
    if name.contains(['\\', ':', '\0']) || !path.components().all(normal) || name.is_empty() {
        let name = crate::error::excerpt(uri.as_bytes());
        return Err(format!(
            "its data are in {name:?}, and files that do not lie beside the model are not read; put it there"
        ));
    }
    Ok(path.to_owned())
}

/// A URI with its `%20` and the like as the characters that they stand for.
fn unescaped(uri: &str) -> String {
    let mut out = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((&byte, after)) = rest.split_first() {
        let hex = after.get(..2).filter(|_| byte == b'%');
        let hex = hex.and_then(|h| u8::from_str_radix(std::str::from_utf8(h).ok()?, 16).ok());
        out.push(hex.unwrap_or(byte));
        rest = if hex.is_some() { &after[2..] } else { after };
    }
    String::from_utf8_lossy(&out).into_owned()
}
