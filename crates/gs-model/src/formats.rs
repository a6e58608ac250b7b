//! The table of the formats of models.

use std::path::Path;

use crate::format::Format;
use crate::ply;

/// The table. Which formats it has depends on the features of the crate.
static ALL: &[&Format] = &[
    &ply::FORMAT,
    #[cfg(feature = "formats")]
    &ply::compressed::FORMAT,
    #[cfg(feature = "formats")]
    &crate::gltf::FORMAT,
    #[cfg(feature = "formats")]
    &crate::spz::FORMAT,
    #[cfg(feature = "sog")]
    &crate::sog::FORMAT,
    #[cfg(feature = "formats")]
    &crate::splat::FORMAT,
    #[cfg(feature = "formats")]
    &crate::ksplat::FORMAT,
];

impl Format {
    /// All formats that this build reads.
    #[must_use]
    pub fn all() -> &'static [&'static Self] {
        ALL
    }

    /// The format of a [`Format::name`].
    #[must_use]
    pub fn named(name: &str) -> Option<&'static Self> {
        ALL.iter().copied().find(|f| f.name == name)
    }

    /// The format that the extension of a file names.
    #[must_use]
    pub fn of_name(path: impl AsRef<Path>) -> Option<&'static Self> {
        let name = path.as_ref().file_name()?.to_string_lossy().to_ascii_lowercase();
        let has = |e: &&str| name.strip_suffix(e).is_some_and(|front| front.ends_with('.'));
        // The longest: a .compressed.ply is a .ply too.
        let length = |f: &Self| f.extensions.iter().copied().filter(has).map(str::len).max();
        ALL.iter().copied().filter(|f| length(f).is_some()).max_by_key(|f| length(f))
    }

    /// The format of a file of that name that starts with these bytes. The bytes decide; the name does where no format
    /// has them as its [`Format::magic`].
    #[must_use]
    pub fn of(path: impl AsRef<Path>, bytes: &[u8]) -> Option<&'static Self> {
        #[cfg(feature = "formats")]
        if crate::ksplat::is(bytes) {
            return Some(&crate::ksplat::FORMAT);
        }
        let marked = ALL.iter().copied().find(|f| f.magic.iter().any(|m| bytes.starts_with(m)));
        marked.or_else(|| Self::of_name(path))
    }
}
