//! Which property of `vertex` holds which number of a Gaussian.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use super::header::{PlyElement, PlyHeader, Property, Scalar};
use super::origin;
use super::variants::Variants;
use crate::error::{Error, Result, list};
use crate::formats::foreign;
use crate::report::DEGREE_4;
use crate::rows::{SH, row_len};
use crate::scene::sh_len;

/// Names of the first [`SH`] numbers of a row in scene order.
const NAMES: [&str; SH] =
    ["x", "y", "z", "rot_0", "rot_1", "rot_2", "rot_3", "scale_0", "scale_1", "scale_2", "opacity"];

/// Property name of number `i` of a row in scene order.
pub(super) fn name(i: usize, sh_degree: u8) -> String {
    if i < SH {
        return NAMES[i].to_owned();
    }
    let (k, channel) = ((i - SH) / 3, (i - SH) % 3);
    if k == 0 {
        format!("f_dc_{channel}")
    } else {
        // f_rest is channel-major: all of red, then green, then blue.
        format!("f_rest_{}", channel * (sh_len(sh_degree) - 1) + k - 1)
    }
}

/// Property names of the Inria layout, in file order.
pub(super) fn inria_names(sh_degree: u8) -> Vec<String> {
    let fixed = |names: &[&str]| names.iter().map(|&n| n.to_owned()).collect::<Vec<_>>();
    let mut all = fixed(&["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]);
    all.extend(rest_names(3 * (sh_len(sh_degree) - 1)));
    all.extend(fixed(&["opacity", "scale_0", "scale_1", "scale_2"]));
    all.extend(fixed(&["rot_0", "rot_1", "rot_2", "rot_3"]));
    all
}

/// Names of the first `count` higher SH coefficients.
pub(super) fn rest_names(count: usize) -> Vec<String> {
    (0..count).map(|i| format!("f_rest_{i}")).collect()
}

/// The properties of `vertex`: those that make a Gaussian, and those that the scene does not keep.
#[derive(Debug)]
pub(super) struct Columns {
    pub(super) sh_degree: u8,
    /// Property index of each number, in scene order; [`row_len`] entries. Where the model is one of
    /// [`Variants`], some are stand-ins.
    pub(super) properties: Vec<usize>,
    pub(super) variants: Variants,
    /// What is subtracted from the positions.
    pub(super) origin: [f64; 3],
    /// What a scene may not keep.
    lost: Vec<Lost>,
}

/// A property that may hold something that a scene does not keep.
#[derive(Debug)]
struct Lost {
    property: usize,
    name: String,
    kind: LostKind,
    /// Set by any task.
    found: AtomicBool,
}

/// What of a property is lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum LostKind {
    /// Numbers that no float holds, of a property that is part of a Gaussian.
    Precision,
    /// SH coefficients of degree 4: lost where they are not zero.
    Degree4,
    /// The whole property: lost where it is not zero.
    All,
}

impl Lost {
    fn is_in(&self, number: f64) -> bool {
        match self.kind {
            LostKind::Precision => !number.is_nan() && f64::from(number as f32) != number,
            LostKind::Degree4 | LostKind::All => number != 0.0,
        }
    }
}

impl Columns {
    /// Finds the columns of a `vertex` element.
    pub(super) fn of(file: &Path, vertex: &PlyElement) -> Result<Self> {
        let index: BTreeMap<&str, usize> =
            vertex.properties.iter().enumerate().map(|(i, p)| (p.name.as_str(), i)).collect();
        let rest = index.keys().filter(|n| is_rest(n)).count();
        let missing = |names: Vec<String>| {
            let reason =
                format!("no property {}: not a 3DGS model in the Inria layout", names.join(", "));
            Error::malformed(file, PLACE, reason)
        };
        if let Some(list) = vertex.properties.iter().find(|p| p.list.is_some()) {
            let reason = format!("property {:?} is a list; a 3DGS model has numbers", list.name);
            return Err(Error::malformed(file, PLACE, reason));
        }
        let variants = Variants::of(vertex, &index);
        let absent: Vec<String> = inria_names(0)
            .into_iter()
            .filter(|n| !is_normal(n) && !index.contains_key(variants.stand_in(n)))
            .collect();
        if !absent.is_empty() {
            if !["opacity", "scale_0", "rot_0"].iter().any(|n| index.contains_key(n))
                && index.contains_key("x")
            {
                return Err(foreign::is(file, PLAIN_POINTS));
            }
            return Err(missing(absent));
        }
        let file_degree = rest_degree(rest).ok_or_else(|| rest_count(file, "vertex", rest))?;
        let sh_degree = file_degree.min(3);
        let mut properties = Vec::with_capacity(row_len(sh_degree));
        for i in 0..row_len(sh_degree) {
            let name = name(i, file_degree);
            let Some(&at) = index.get(variants.stand_in(&name)) else {
                return Err(missing(vec![name]));
            };
            properties.push(at);
        }
        let mut known = vec![false; vertex.properties.len()];
        for &p in properties.iter().chain(&variants.filter_3d) {
            known[p] = true;
        }
        let mut lost = Vec::new();
        for (property, Property { name, scalar, .. }) in vertex.properties.iter().enumerate() {
            let kind = match known[property] {
                true if *scalar == Scalar::F32 => continue,
                true => LostKind::Precision,
                false if is_rest(name) => LostKind::Degree4,
                false => LostKind::All,
            };
            lost.push(Lost { property, name: name.clone(), kind, found: AtomicBool::new(false) });
        }
        Ok(Self { sh_degree, properties, variants, origin: [0.0; 3], lost })
    }

    /// Chooses the origin by the first rows, at most [`origin::SAMPLE`]. `number(row, property)` is a number of the
    /// file.
    pub(super) fn choose_origin(
        &mut self,
        vertex: &PlyElement,
        rows: usize,
        number: impl Fn(usize, usize) -> f64,
    ) {
        let is_double = |&p: &usize| vertex.properties[p].scalar == Scalar::F64;
        if !self.properties[..3].iter().any(is_double) {
            return;
        }
        let row = |row: usize| {
            let of = |c: usize| number(row, self.properties[c]);
            ([0, 1, 2].map(of), [7, 8, 9].map(of).into_iter().fold(f64::NEG_INFINITY, f64::max))
        };
        self.origin = origin::choose(&(0..rows.min(origin::SAMPLE)).map(row).collect::<Vec<_>>());
    }

    /// Where the origin of the scene's means lies.
    pub(super) fn scene_origin(&self, header: &PlyHeader) -> [f64; 3] {
        let named = origin::of_file(&header.comments);
        std::array::from_fn(|k| named[k] + self.origin[k])
    }

    /// Number `c` in scene order of a row; `property` gives the numbers of its properties.
    #[inline]
    pub(super) fn number(&self, c: usize, property: impl Fn(usize) -> f64) -> f32 {
        let raw = |c: usize| property(self.properties[c]);
        match c {
            0..3 => (raw(c) - self.origin[c]) as f32,
            _ if self.variants.any() => {
                self.variants.number(c, |c| raw(c) as f32, |p| property(p) as f32)
            }
            _ => raw(c) as f32,
        }
    }

    /// Looks at `rows` rows for what a scene does not keep. `number(row, property)` is a number of the file.
    pub(super) fn look(&self, rows: usize, number: impl Fn(usize, usize) -> f64) {
        let number = |row: usize, property: usize| {
            let axis = self.properties[..3].iter().position(|&p| p == property);
            number(row, property) - axis.map_or(0.0, |k| self.origin[k])
        };
        for lost in self.lost.iter().filter(|lost| !lost.found.load(Ordering::Relaxed)) {
            if (0..rows).any(|row| lost.is_in(number(row, lost.property))) {
                lost.found.store(true, Ordering::Relaxed);
            }
        }
    }

    /// What a scene does not keep, a sentence for each kind.
    pub(super) fn notes(&self) -> Vec<String> {
        let names = |kind: LostKind| {
            let found = self.lost.iter().filter(|lost| lost.found.load(Ordering::Relaxed));
            list(found.filter(|lost| lost.kind == kind).map(|lost| lost.name.clone()))
        };
        let all = names(LostKind::All).map(|names| {
            format!("properties that are not part of a 3DGS model are not kept: {names}")
        });
        let degree_4 = names(LostKind::Degree4).map(|_| DEGREE_4.into());
        let precision = names(LostKind::Precision)
            .map(|names| format!("numbers that no float holds are rounded: {names}"));
        [all, degree_4, precision].into_iter().flatten().collect()
    }
}

/// The SH degree of a number of `f_rest` properties.
pub(super) fn rest_degree(count: usize) -> Option<u8> {
    (0..=4).find(|&d| 3 * (sh_len(d) - 1) == count)
}

const PLAIN_POINTS: &str = "a plain point cloud, such as training starts from: its points have no opacity, scales and \
                            rotation; the trained model is point_cloud/iteration_N/point_cloud.ply or alike";

/// Where the columns are.
const PLACE: &str = "element \"vertex\"";

/// The error of a number of `f_rest` properties that no SH degree has.
pub(super) fn rest_count(file: &Path, element: &str, count: usize) -> Error {
    let reason =
        format!("{count} f_rest properties; SH degrees 0, 1, 2, 3, 4 have 0, 9, 24, 45, 72");
    Error::malformed(file, &format!("element {element:?}"), reason)
}

fn is_normal(name: &str) -> bool {
    matches!(name, "nx" | "ny" | "nz")
}

fn is_rest(name: &str) -> bool {
    name.strip_prefix("f_rest_")
        .is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()))
}
