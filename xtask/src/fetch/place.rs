//! Where an archive may be: mirrors, a copy put beside the scenes by hand, the public server.

use std::path::{Path, PathBuf};
use std::time::Duration;

use super::catalogue::Archive;
use super::error::{Error, Result};
use super::http::Http;
use super::ranged::Patience;
use super::source::{LocalFile, Source};

/// An address of an archive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Place {
    /// `http://` or `https://`.
    Server(String),
    /// A file.
    Disk(PathBuf),
}

impl Place {
    /// Opens the archive there.
    pub(crate) fn open(&self, timeout: Duration, patience: Patience) -> Result<Box<dyn Source>> {
        Ok(match self {
            Self::Server(url) => Box::new(patience.run(false, || Http::connect(url, timeout))?),
            Self::Disk(path) => Box::new(LocalFile::at(path)?),
        })
    }
}

/// The addresses that `mirrors` give for `archive`, to be tried in turn; `None` if they are all
/// about other archives.
///
/// A mirror is an `http(s)://` or `file://` address or a path. One that ends in `.zip` is an
/// archive: that of the same file name, or, with another name, one that holds everything. Any
/// other is a folder, with the archives in it or in Inria's subfolders.
pub(crate) fn mirrored(archive: &Archive, mirrors: &[String]) -> Result<Option<Vec<Place>>> {
    let mut all = None;
    for mirror in mirrors {
        let place = parse(mirror)?;
        match zip_name(&place) {
            Some(name) if name == archive.file => return Ok(Some(vec![place])),
            Some(name) if ["models.zip", "tandt_db.zip"].contains(&name.as_str()) => {}
            Some(_) => all = all.or(Some(vec![place])),
            None => {
                let [flat, below] =
                    [archive.file.to_owned(), format!("{}/{}", archive.folder, archive.file)];
                all = all.or(Some(vec![join(&place, &flat), join(&place, &below)]));
            }
        }
    }
    Ok(all)
}

/// The file name, if it is that of an archive.
fn zip_name(place: &Place) -> Option<String> {
    let name = match place {
        Place::Server(url) => {
            let path = url.split(['?', '#']).next().unwrap_or(url);
            path.rsplit('/').next()?.to_owned()
        }
        Place::Disk(path) => path.file_name()?.to_str()?.to_owned(),
    };
    name.to_lowercase().ends_with(".zip").then_some(name)
}

fn join(place: &Place, name: &str) -> Place {
    match place {
        Place::Server(url) => Place::Server(format!("{}/{name}", url.trim_end_matches('/'))),
        Place::Disk(dir) => Place::Disk(dir.join(name)),
    }
}

fn parse(mirror: &str) -> Result<Place> {
    let bad = |why: &str| Error::Address { url: mirror.to_owned(), why: why.to_owned() };
    match mirror.split_once("://") {
        Some(("http" | "https", rest)) if !rest.is_empty() => Ok(Place::Server(mirror.to_owned())),
        Some(("file", rest)) => {
            let path = rest.strip_prefix("localhost").unwrap_or(rest);
            if !path.starts_with('/') {
                return Err(bad(
                    "file:// takes a path from the root, as in file:///data/models.zip",
                ));
            }
            let path = percent_encoding::percent_decode_str(path).decode_utf8();
            Ok(Place::Disk(PathBuf::from(&*path.map_err(|_| bad("not UTF-8"))?)))
        }
        Some(_) => Err(bad("only http://, https://, file:// and paths")),
        None if mirror.is_empty() => Err(bad("empty")),
        None => Ok(Place::Disk(Path::new(mirror).to_path_buf())),
    }
}

#[cfg(test)]
mod tests {
    use super::super::catalogue::SCENES;
    use super::*;

    fn of(mirrors: &[&str]) -> Vec<Option<Vec<String>>> {
        let mirrors: Vec<String> = mirrors.iter().map(|s| (*s).to_owned()).collect();
        let text = |place: Place| match place {
            Place::Server(url) => url,
            Place::Disk(path) => path.display().to_string(),
        };
        SCENES[0]
            .archives()
            .iter()
            .map(|(archive, _)| mirrored(archive, &mirrors).unwrap())
            .map(|places| places.map(|p| p.into_iter().map(text).collect()))
            .collect()
    }

    #[test]
    fn a_folder_holds_both_archives_flat_or_as_inria_has_them() {
        let want = |base: &str| {
            vec![
                Some(vec![format!("{base}/tandt_db.zip"), format!("{base}/input/tandt_db.zip")]),
                Some(vec![format!("{base}/models.zip"), format!("{base}/pretrained/models.zip")]),
            ]
        };
        assert_eq!(of(&["http://h:1/x/"]), want("http://h:1/x"));
        assert_eq!(of(&["file:///a%20b"]), want("/a b"));
        assert_eq!(of(&["rel/dir"]), want("rel/dir"));
    }

    #[test]
    fn an_archive_is_the_one_of_its_name_or_all() {
        let one = |s: &str| Some(vec![s.to_owned()]);
        assert_eq!(of(&["https://h/models.zip?k=1"]), [None, one("https://h/models.zip?k=1")]);
        assert_eq!(of(&["/a/both.zip"]), [one("/a/both.zip"), one("/a/both.zip")]);
        let two = of(&["file:///a/models.zip", "file://localhost/b/tandt_db.zip"]);
        assert_eq!(two, [one("/b/tandt_db.zip"), one("/a/models.zip")]);
        assert_eq!(of(&[]), [None, None]);
    }

    #[test]
    fn other_addresses_are_refused() {
        for bad in ["ftp://h/models.zip", "file://a/models.zip", "", "http://"] {
            assert!(matches!(parse(bad), Err(Error::Address { .. })), "{bad}");
        }
    }
}
