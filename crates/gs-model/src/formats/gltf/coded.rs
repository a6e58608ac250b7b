//! Reads primitives that an extension compresses.

use std::path::Path;

use super::buffers::Buffers;
use super::json::{Primitive, Root, SplatExtension};
use super::spz;
use crate::codec::Codec;
use crate::error::Result;
use crate::report::ReadOptions;
use crate::scene::Scene;
use crate::spz as spz_file;

/// A compressed primitive.
pub(super) struct CompressedPrimitive<'a> {
    pub(super) decoder: Decoder,
    pub(super) data: &'a [u8],
    /// Gaussians that its accessors promise. SPZ says their number itself.
    pub(super) count: Option<usize>,
}

/// What decodes it.
#[derive(Clone, Copy)]
pub(super) enum Decoder {
    Spz,
    Codec(&'static Codec),
}

impl Decoder {
    fn named(name: &str, codec: Option<&'static Codec>) -> Option<Self> {
        match codec.filter(|codec| codec.extension == name) {
            Some(codec) => Some(Self::Codec(codec)),
            None => (name == spz::EXTENSION).then_some(Self::Spz),
        }
    }

    pub(super) fn extension(self) -> &'static str {
        match self {
            Self::Spz => spz::EXTENSION,
            Self::Codec(codec) => codec.extension,
        }
    }
}

impl<'a> CompressedPrimitive<'a> {
    /// The data of a primitive, if it is compressed; an error is what is wrong with it.
    pub(super) fn of(
        root: &Root,
        buffers: &'a Buffers<'_>,
        primitive: &Primitive,
        splats: &SplatExtension,
        codec: Option<&'static Codec>,
    ) -> Result<Option<Self>, String> {
        let Some(first) = splats.extensions.keys().next() else { return Ok(None) };
        let known = splats
            .extensions
            .iter()
            .find_map(|(name, extension)| Some((name, Decoder::named(name, codec)?, extension)));
        let Some((name, decoder, extension)) = known else {
            return Err(format!(
                "it is compressed ({first}), and there is no decoder for that here; decompress it first"
            ));
        };
        let view = extension["bufferView"].as_u64().and_then(|at| usize::try_from(at).ok());
        let view = view.ok_or_else(|| format!("{name} has no bufferView"))?;
        let view = root.buffer_views.get(view);
        let view = view.ok_or_else(|| format!("{name} names a bufferView that is not there"))?;
        let data = buffers.view(view).map_err(|why| format!("{name}: {why}"))?;
        let count = count(root, primitive)?;
        if count.is_none() && !matches!(decoder, Decoder::Spz) {
            return Err("it has no POSITION".into());
        }
        Ok(Some(Self { decoder, data, count }))
    }

    /// Its Gaussians, and what is to be said of them; an error is what is wrong with the data.
    pub(super) fn scene(&self, options: &ReadOptions) -> Result<(Scene, Vec<String>), String> {
        let (scene, notes) = match self.decoder {
            Decoder::Spz => {
                let read = spz_file::read(Path::new("its SPZ"), self.data, options);
                let (scene, report) = read.map_err(|e| crate::chain(&e))?;
                (scene, report.notes)
            }
            Decoder::Codec(codec) => {
                ((codec.decode)(self.data, self.count.unwrap_or_default())?, Vec::new())
            }
        };
        match self.count.is_none_or(|count| count == scene.len()) {
            true => Ok((scene, notes)),
            false => Err(differ(self.count.unwrap_or_default())),
        }
    }
}

/// The Gaussians that all accessors of a primitive promise; none where it has no attributes.
fn count(root: &Root, primitive: &Primitive) -> Result<Option<usize>, String> {
    let mut all = None;
    for at in primitive.attributes.values() {
        let accessor = root.accessors.get(*at).ok_or("it names an accessor that is not there")?;
        if *all.get_or_insert(accessor.count) != accessor.count {
            return Err("its attributes have different lengths".into());
        }
    }
    Ok(all)
}

fn differ(count: usize) -> String {
    format!("its accessors promise {count} Gaussians, its data hold another number")
}
