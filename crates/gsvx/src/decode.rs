//! The decoder. Needs nothing but the stream.

mod values;

use crate::attributes::group::coding;
use crate::error::{Error, Result};
use crate::stream::{Container, Header, SectionKind};
use crate::{ordered, outliers, slices};
use gpcc_lite::Leaf;
use gs_model::Scene;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};
use values::{BLOCK, Values};

/// Gaussians per stream byte that a decoder accepts by default. Coded scenes have fewer than
/// one per byte; a solid block of equal Gaussians could have more, and then the caller says so.
pub const DEFAULT_GAUSSIANS_PER_BYTE: u64 = 64;

/// Options of [`decode`].
#[derive(Clone, Debug, PartialEq)]
pub struct DecodeOptions {
    /// Highest SH degree to decode.
    pub max_sh_degree: u8,
    /// Merge Gaussians to at most one per octree cell of this depth; `None` keeps all.
    pub lod: Option<u8>,
    /// Decode what a truncated stream still holds instead of failing. Geometry, importance,
    /// opacity and DC must be whole.
    pub allow_truncated: bool,
    /// Greatest number of Gaussians accepted; `None` derives it from the stream's length.
    pub max_gaussians: Option<u64>,
}

impl Default for DecodeOptions {
    fn default() -> Self {
        Self { max_sh_degree: 3, lod: None, allow_truncated: false, max_gaussians: None }
    }
}

/// A decoded scene.
#[derive(Clone, Debug)]
pub struct Decoded {
    /// The scene; Gaussians in Morton order (of a lossless stream: of the means, unless it keeps
    /// the order of the input), then those that were coded exactly.
    pub scene: Scene,
    /// The octree leaves, one per Gaussian that was not coded exactly; none of a lossless stream.
    pub leaves: Vec<Leaf>,
    /// The stream's header.
    pub header: Header,
    /// What was not decoded, and why; one line each.
    pub skipped: Vec<String>,
}

/// Decodes a stream.
///
/// # Errors
/// Any damage to the stream is reported as an [`Error`]; see [`DecodeOptions`] for truncation.
pub fn decode(bytes: &[u8], options: &DecodeOptions) -> Result<Decoded> {
    let decoder = Decoder::new(bytes, options)?;
    let mut scene = Scene::default();
    let mut leaves = Vec::new();
    decoder.parts(
        |part| part,
        |part| -> Result<()> {
            if scene.is_empty() {
                (scene, leaves) = (part.scene, part.leaves);
                reserve(&mut scene, &mut leaves, &decoder);
            } else {
                scene.append(&part.scene);
                leaves.extend(part.leaves);
            }
            Ok(())
        },
    )?;
    scene.sh_degree = decoder.sh_degree;
    let Decoder { header, skipped, .. } = decoder;
    let decoded = Decoded { scene, leaves, header, skipped };
    match options.lod {
        Some(depth) => crate::lod::reduce(decoded, depth),
        None => Ok(decoded),
    }
}

/// Makes room for what follows the first part.
fn reserve(scene: &mut Scene, leaves: &mut Vec<Leaf>, decoder: &Decoder<'_>) {
    let more = decoder.len() - scene.len();
    if more > 0 {
        scene.means.reserve_exact(more);
        scene.rotations.reserve_exact(more);
        scene.log_scales.reserve_exact(more);
        scene.opacity_logits.reserve_exact(more);
        scene.sh.reserve_exact(more * scene.sh_len());
        leaves.reserve_exact(decoder.header.count as usize - leaves.len());
    }
}

/// Some of a scene's Gaussians.
#[derive(Clone, Debug)]
pub struct Part {
    /// The Gaussians.
    pub scene: Scene,
    /// Their leaves; none of Gaussians that were coded exactly.
    pub leaves: Vec<Leaf>,
}

/// A stream about to be decoded part by part, for readers that need not hold the whole scene.
#[derive(Debug)]
pub struct Decoder<'a> {
    header: Header,
    sh_degree: u8,
    skipped: Vec<String>,
    slices: Vec<Slice<'a>>,
    /// The attributes to decode, in the order of their payloads in [`Slice::attributes`].
    kinds: Vec<SectionKind>,
    outliers: Option<Scene>,
    lossless: Option<&'a [u8]>,
}

/// The payloads of one slice.
#[derive(Debug, Default)]
struct Slice<'a> {
    /// Its first leaf, and the number of leaves it claims.
    first: u64,
    len: u64,
    geometry: &'a [u8],
    importance: Option<&'a [u8]>,
    attributes: Vec<&'a [u8]>,
}

impl<'a> Decoder<'a> {
    /// Reads the header, verifies the checksums of all sections that are wanted, and finds the
    /// slices. The level of detail in `options` is for [`decode`] only.
    ///
    /// # Errors
    /// As [`decode`], as far as damage shows before the decoding.
    pub fn new(bytes: &'a [u8], options: &DecodeOptions) -> Result<Self> {
        let container = Container::parse(bytes)?;
        let header = container.header.clone();
        let limit =
            options.max_gaussians.unwrap_or(DEFAULT_GAUSSIANS_PER_BYTE * bytes.len() as u64 + 1024);
        if header.count > limit {
            return Err(Error::Limit { points: header.count, limit });
        }
        let mut this = Self {
            sh_degree: header.sh_degree,
            header,
            skipped: Vec::new(),
            slices: Vec::new(),
            kinds: Vec::new(),
            outliers: None,
            lossless: container.section(SectionKind::Lossless)?,
        };
        if this.lossless.is_none() {
            this.find_sections(&container, options, limit)?;
        }
        Ok(this)
    }

    /// The stream's header.
    #[must_use]
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Gaussians of all parts together.
    #[must_use]
    pub fn len(&self) -> usize {
        self.header.count as usize + self.outliers.as_ref().map_or(0, Scene::len)
    }

    /// True if there is no Gaussian.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// SH degree of all parts: the stream's, or less if less is wanted or there.
    #[must_use]
    pub fn sh_degree(&self) -> u8 {
        self.sh_degree
    }

    /// What is not decoded, and why; one line each.
    #[must_use]
    pub fn skipped(&self) -> &[String] {
        &self.skipped
    }

    fn find_sections(
        &mut self,
        container: &Container<'a>,
        options: &DecodeOptions,
        limit: u64,
    ) -> Result<()> {
        let slices = self.header.slices as usize;
        let split = |kind| match container.section(kind)? {
            Some(payload) => slices::split(payload, slices),
            None => Err(Error::MissingSection { kind }),
        };
        let mut first = 0u64;
        for geometry in split(SectionKind::Geometry)? {
            let len = gpcc_lite::geometry::points(geometry).map_err(coding("geometry"))?;
            if slices > 1 && len < slices::LEAST {
                return Err(Error::Corrupt { what: "leaves of a slice", value: len });
            }
            self.slices.push(Slice { first, len, geometry, ..Slice::default() });
            first = first.saturating_add(len);
        }
        if first != self.header.count {
            return Err(Error::Corrupt { what: "leaf count", value: first });
        }
        match split(SectionKind::Importance) {
            Ok(parts) => {
                for (slice, part) in self.slices.iter_mut().zip(parts) {
                    slice.importance = Some(part);
                }
            }
            Err(Error::MissingSection { .. }) => {}
            Err(e) => return Err(e),
        }
        match container.section(SectionKind::Outliers) {
            Ok(None) => {}
            Ok(Some(payload)) => {
                let points = self.header.count.saturating_add(container.outliers());
                if points > limit {
                    return Err(Error::Limit { points, limit });
                }
                self.outliers = Some(outliers::decode(payload, self.header.sh_degree)?);
            }
            Err(e @ Error::Truncated { .. }) if options.allow_truncated => {
                self.skipped.push(format!("{}: {e}", SectionKind::Outliers));
            }
            Err(e) => return Err(e),
        }
        let wanted = self.header.sh_degree.min(options.max_sh_degree);
        for degree in wanted + 1..=self.header.sh_degree {
            self.skipped.push(format!("{}: not asked for", SectionKind::of_sh_degree(degree)));
        }
        for entry in &container.toc {
            if let SectionKind::Unknown(code) = entry.kind {
                self.skipped
                    .push(format!("section of unknown kind {code}: written by a newer version"));
            }
        }
        let mut kinds = vec![SectionKind::Opacity, SectionKind::Dc, SectionKind::Covariance];
        kinds.extend((1..=wanted).map(SectionKind::of_sh_degree));
        let mut broken = false;
        self.sh_degree = 0;
        for kind in kinds {
            let is_sh =
                !matches!(kind, SectionKind::Opacity | SectionKind::Dc | SectionKind::Covariance);
            match split(kind) {
                // A later degree is of no use when an earlier one is missing.
                Ok(_) if is_sh && broken => {
                    self.skipped.push(format!("{kind}: a lower degree is missing"));
                }
                Ok(parts) => {
                    self.kinds.push(kind);
                    for (slice, part) in self.slices.iter_mut().zip(parts) {
                        slice.attributes.push(part);
                    }
                    self.sh_degree += u8::from(is_sh);
                }
                Err(e @ Error::Truncated { .. })
                    if options.allow_truncated
                        && !matches!(kind, SectionKind::Opacity | SectionKind::Dc) =>
                {
                    self.skipped.push(format!("{kind}: {e}"));
                    broken = true;
                }
                Err(e) => return Err(e),
            }
        }
        Ok(())
    }

    /// Decodes the parts on all threads: `convert` gets each where it was decoded, `take` gets what
    /// came of it, in order, one at a time. Few more parts than threads are in memory at once. All
    /// parts have the same SH degree.
    ///
    /// # Errors
    /// Damage, as [`decode`]; what `take` returns.
    pub fn parts<T: Send, E: From<Error> + Send>(
        &self,
        convert: impl Fn(Part) -> T + Sync,
        mut take: impl FnMut(T) -> std::result::Result<(), E> + Send,
    ) -> std::result::Result<(), E> {
        if let Some(payload) = self.lossless {
            let Header { count, sh_degree, .. } = self.header;
            let scene = crate::lossless::decode_payload(payload, count, sh_degree)?;
            return take(convert(Part { scene, leaves: Vec::new() }));
        }
        self.in_order::<_, E>(
            |slice, alone| {
                let mut values = Values::default();
                values.decode(slice, &self.kinds, &self.header, alone)?;
                let scene = values.scene(&self.header, self.sh_degree, alone)?;
                let ends = values.ends();
                Ok((ends, convert(Part { scene, leaves: values.leaves })))
            },
            &mut take,
        )?;
        match self.outliers_at_degree() {
            Some(scene) => take(convert(Part { scene, leaves: Vec::new() })),
            None => Ok(()),
        }
    }

    /// Decodes the scene on all threads in blocks of a few hundred Gaussians, for readers that can
    /// put each where it belongs: `visit` gets them in any order, several at a time, with the
    /// number of the first Gaussian in the scene and with a `T` that is visited by one at a time,
    /// for buffers. Less is in memory than with [`Decoder::parts`], and less is copied.
    ///
    /// # Errors
    /// Damage, as [`decode`], when some blocks may have been visited; what `visit` returns.
    pub fn blocks<T: Default + Send, E: From<Error> + Send>(
        &self,
        visit: impl Fn(&mut T, usize, &Scene) -> std::result::Result<(), E> + Sync,
    ) -> std::result::Result<(), E> {
        let empty = || Scene { sh_degree: self.sh_degree, ..Scene::default() };
        // Visits Gaussians that are there already.
        let copied = |scene: &Scene, first: usize| {
            let (mut buffer, mut block) = (T::default(), empty());
            for at in (0..scene.len()).step_by(BLOCK) {
                block.clear();
                block.append_range(scene, at..scene.len().min(at + BLOCK));
                visit(&mut buffer, first + at, &block)?;
            }
            Ok(())
        };
        if let Some(payload) = self.lossless {
            let Header { count, sh_degree, .. } = self.header;
            return copied(&crate::lossless::decode_payload(payload, count, sh_degree)?, 0);
        }
        let free: Mutex<Vec<(Values, T, Scene)>> = Mutex::default();
        let lock = || free.lock().unwrap_or_else(PoisonError::into_inner);
        self.in_order::<_, E>(
            |slice, alone| {
                let space = lock().pop();
                let mut space = space.unwrap_or_else(|| (Values::default(), T::default(), empty()));
                let (values, buffer, block) = &mut space;
                values.decode(slice, &self.kinds, &self.header, alone)?;
                let n = values.leaves.len();
                let one =
                    |buffer: &mut T, block: &mut Scene, at: usize| -> std::result::Result<(), E> {
                        values.block(&self.header, at..n.min(at + BLOCK), block)?;
                        visit(buffer, slice.first as usize + at, block)
                    };
                if alone {
                    (0..n).step_by(BLOCK).try_for_each(|at| one(buffer, block, at))?;
                } else {
                    (0..n.div_ceil(BLOCK)).into_par_iter().with_min_len(16).try_for_each_init(
                        || (T::default(), empty()),
                        |(buffer, block), i| one(buffer, block, i * BLOCK),
                    )?;
                }
                let ends = values.ends();
                lock().push(space);
                Ok((ends, ()))
            },
            |()| Ok(()),
        )?;
        match self.outliers_at_degree() {
            Some(scene) => copied(&scene, self.header.count as usize),
            None => Ok(()),
        }
    }

    /// Makes something of every slice on all threads and takes it in order; `make` also gets
    /// whether its slice is to be decoded on its own thread only, and returns the first and the
    /// last leaf too.
    fn in_order<T: Send, E: From<Error> + Send>(
        &self,
        make: impl Fn(&Slice<'_>, bool) -> std::result::Result<(Option<(Leaf, Leaf)>, T), E> + Sync,
        mut take: impl FnMut(T) -> std::result::Result<(), E> + Send,
    ) -> std::result::Result<(), E> {
        let threads = rayon::current_num_threads();
        let mut end = 0;
        ordered::in_order(
            self.slices.len(),
            threads + 1,
            // Where no slices are left for them, sections keep the other threads busy.
            |i| make(&self.slices[i], i + threads < self.slices.len()),
            |(ends, made)| {
                if let Some((first, last)) = ends {
                    if first.morton < end {
                        let what = "slice out of order";
                        return Err(Error::Corrupt { what, value: first.morton }.into());
                    }
                    end = last.morton + (1 << (3 * (self.header.j_high - last.depth)));
                }
                take(made)
            },
        )
    }

    /// The Gaussians that were coded exactly, at the SH degree of all parts.
    fn outliers_at_degree(&self) -> Option<Scene> {
        self.outliers.as_ref().map(|outliers| {
            let mut scene = Scene { sh_degree: self.sh_degree, ..Scene::default() };
            scene.append(outliers);
            scene
        })
    }
}

/// Centres of the leaves, the first of which is number `first`. A cube that reaches beyond what an
/// f32 holds is damage: an encoder refuses such scenes.
pub(crate) fn centres(leaves: &[Leaf], header: &Header, first: u64) -> Result<Vec<[f32; 3]>> {
    let mut means = vec![[0.0; 3]; leaves.len()];
    centres_into(leaves, header, first, &mut means)?;
    Ok(means)
}

/// As [`centres`], into as many means.
fn centres_into(
    leaves: &[Leaf],
    header: &Header,
    first: u64,
    means: &mut [[f32; 3]],
) -> Result<()> {
    for (mean, &leaf) in means.iter_mut().zip(leaves) {
        *mean = header.cube.leaf_centre(leaf, header.j_high);
    }
    match means.iter().position(|m| m.iter().any(|v| !v.is_finite())) {
        Some(index) => {
            Err(Error::Corrupt { what: "Gaussian beyond f32", value: first + index as u64 })
        }
        None => Ok(()),
    }
}

/// Log-scales where covariances are missing: a ball that fills its voxel.
fn ball(leaf: Leaf, header: &Header) -> [f32; 3] {
    let cell = header.cube.side / (1u64 << leaf.depth) as f64;
    [libm::log((0.5 * cell).max(f64::MIN_POSITIVE)) as f32; 3]
}
