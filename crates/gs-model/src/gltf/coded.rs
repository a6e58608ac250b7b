//! Reads primitives that an extension compresses.

use super::accessor::view_bytes;
use super::json::{Primitive, Root, SplatExtension};
use crate::codec::Codec;
use crate::scene::Scene;

/// A compressed primitive.
pub(super) struct Coded<'a> {
    pub(super) codec: &'static Codec,
    pub(super) data: &'a [u8],
    /// Gaussians that its accessors promise.
    pub(super) count: usize,
}

impl<'a> Coded<'a> {
    /// The data of a primitive, if it is compressed; an error is what is wrong with it.
    pub(super) fn of(
        root: &Root,
        data: &'a [u8],
        primitive: &Primitive,
        splats: &SplatExtension,
        codec: Option<&'static Codec>,
    ) -> Result<Option<Self>, String> {
        let Some(name) = splats.extensions.keys().next() else { return Ok(None) };
        let known = codec.and_then(|codec| Some((codec, splats.extensions.get(codec.extension)?)));
        let Some((codec, extension)) = known else {
            return Err(format!(
                "it is compressed ({name}), and there is no decoder for that here; decompress it first"
            ));
        };
        let view = extension["bufferView"].as_u64().and_then(|at| usize::try_from(at).ok());
        let view = view.ok_or_else(|| format!("{name} has no bufferView"))?;
        let view = root.buffer_views.get(view);
        let view = view.ok_or_else(|| format!("{name} names a bufferView that is not there"))?;
        let data = view_bytes(root, data, view).map_err(|why| format!("{name}: {why}"))?;
        Ok(Some(Self { codec, data, count: count(root, primitive)? }))
    }

    /// Its Gaussians; an error is what is wrong with the data.
    pub(super) fn scene(&self) -> Result<Scene, String> {
        let scene = (self.codec.decode)(self.data, self.count)?;
        match scene.len() == self.count {
            true => Ok(scene),
            false => Err(differ(self.count)),
        }
    }
}

/// The Gaussians that all accessors of a primitive promise.
fn count(root: &Root, primitive: &Primitive) -> Result<usize, String> {
    let count = |at: &usize| {
        let accessor = root.accessors.get(*at).ok_or("it names an accessor that is not there")?;
        Ok::<_, String>(accessor.count)
    };
    let position = primitive.attributes.get("POSITION").ok_or("it has no POSITION")?;
    let all = count(position)?;
    for at in primitive.attributes.values() {
        if count(at)? != all {
            return Err("its attributes have different lengths".into());
        }
    }
    Ok(all)
}

fn differ(count: usize) -> String {
    format!("its accessors promise {count} Gaussians, its data hold another number")
}
