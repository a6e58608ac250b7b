//! The formats of models: each is a file or a folder here, with a [`Format`] in the table [`Format::all`].

pub(crate) mod foreign;
#[cfg(feature = "formats")]
pub mod gltf;
#[cfg(feature = "formats")]
mod ksplat;
pub mod ply;
#[cfg(feature = "sog")]
pub mod sog;
#[cfg(feature = "formats")]
mod splat;
#[cfg(feature = "formats")]
pub mod spz;

use std::fmt;
use std::io::Write;
use std::path::Path;

use crate::doubts;
use crate::error::{Error, Result};
use crate::fs;
use crate::report::{ReadOptions, Report};
use crate::scene::Scene;

/// Reads a model as it is from the bytes of the file of that name.
pub(crate) type ReadModel = fn(&Path, &[u8], &ReadOptions) -> Result<(Scene, Report)>;
/// Writes a scene; the name is for messages. The shape of the scene has been checked.
pub(crate) type WriteModel = fn(&Path, &mut dyn Write, &Scene) -> Result<()>;
pub(crate) type StepsOf = fn(&Scene) -> Vec<f64>;

/// A format of models. The table is [`Format::all`].
pub struct Format {
    /// What commands, Python and messages call it.
    pub name: &'static str,
    /// What it is, and which versions are read and written: a line for a person.
    pub about: &'static str,
    /// The extensions of its files. The first is that of files that are written.
    pub extensions: &'static [&'static str],
    /// What its files start with: one of these. Where there is none, the extension has to tell.
    pub magic: &'static [&'static [u8]],
    /// Highest SH degree that it holds.
    pub max_sh_degree: u8,
    /// Whether it says that a model is antialiased (see [`Scene::antialiased`]).
    pub says_antialiased: bool,
    /// Whether it says where a model lies (see [`Scene::origin`]).
    pub says_origin: bool,
    /// The steps in which it holds the positions of the Gaussians, in world units; none where these are floats.
    pub(crate) steps: Option<StepsOf>,
    pub(crate) read: ReadModel,
    pub(crate) write: Option<WriteModel>,
}

/// The table. Which formats it has depends on the features of the crate.
static ALL: &[&Format] = &[
    &ply::FORMAT,
    #[cfg(feature = "formats")]
    &ply::compressed::FORMAT,
    #[cfg(feature = "formats")]
    &gltf::FORMAT,
    #[cfg(feature = "formats")]
    &spz::FORMAT,
    #[cfg(feature = "sog")]
    &sog::FORMAT,
    #[cfg(feature = "formats")]
    &splat::FORMAT,
    #[cfg(feature = "formats")]
    &ksplat::FORMAT,
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
        if ksplat::is(bytes) {
            return Some(&ksplat::FORMAT);
        }
        let marked = ALL.iter().copied().find(|f| f.magic.iter().any(|m| bytes.starts_with(m)));
        marked.or_else(|| Self::of_name(path))
    }

    /// Reads a model from bytes. `name` is the file in errors; files that belong to it are looked for beside
    /// it.
    ///
    /// # Errors
    /// What [`Error`] says of files.
    pub fn read(
        &self,
        name: impl AsRef<Path>,
        bytes: &[u8],
        options: &ReadOptions,
    ) -> Result<(Scene, Report)> {
        let name = name.as_ref();
        if bytes.is_empty() && !self.magic.is_empty() {
            return Err(Error::other_format(name, self.name, bytes));
        }
        let (mut scene, mut report) = (self.read)(name, bytes, options)?;
        options.apply(name, &mut scene, &mut report)?;
        Ok((scene, report))
    }

    /// True if the format is written.
    #[must_use]
    pub fn is_written(&self) -> bool {
        self.write.is_some()
    }

    /// A sentence, without the name of the file, if the steps of positions are coarse beside the Gaussians of a valid
    /// scene.
    #[must_use]
    pub fn coarse_steps(&self, scene: &Scene) -> Option<String> {
        doubts::coarse_when_written(scene, &self.steps?(scene), self.extensions[0])
    }

    /// Writes a scene to a file, which appears whole or not at all.
    ///
    /// # Errors
    /// As [`Format::write_to`].
    pub fn write(&self, path: impl AsRef<Path>, scene: &Scene) -> Result<()> {
        let path = path.as_ref();
        fs::write_atomically(path, |out| self.write_to(path, out, scene))
    }

    /// Writes a scene to anything that takes bytes. `name` is the file in errors.
    ///
    /// # Errors
    /// [`Error::SceneShape`] or [`Error::SceneDegree`] if the arrays do not fit together, [`Error::Unwritable`]
    /// if the format is not written or cannot hold the scene, [`Error::Io`].
    pub fn write_to(
        &self,
        name: impl AsRef<Path>,
        mut out: impl Write,
        scene: &Scene,
    ) -> Result<()> {
        let file = name.as_ref();
        let Some(write) = self.write else {
            return Err(Error::unwritable(file, format!("{} is read only", self.name)));
        };
        scene.check_shape()?;
        write(file, &mut out, scene)
    }
}

impl PartialEq for Format {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Eq for Format {}

impl fmt::Debug for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}
