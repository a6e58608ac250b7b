//! Which property of `vertex` holds which number of a Gaussian.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::header::Element;
use super::variants::Variants;
use crate::error::{Error, Result};
use crate::rows::{SH, row_len};
use crate::scene::sh_len;

/// Names of the first [`SH`] numbers of a row in scene order.
const NAMES: [&str; SH] =
    ["x", "y", "z", "rot_0", "rot_1", "rot_2", "rot_3", "scale_0", "scale_1", "scale_2", "opacity"];

/// `f_rest` counts of SH degrees 0 to 3.
const REST_COUNTS: [usize; 4] = [0, 9, 24, 45];

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
    all.extend((0..3 * (sh_len(sh_degree) - 1)).map(|i| format!("f_rest_{i}")));
    all.extend(fixed(&["opacity", "scale_0", "scale_1", "scale_2"]));
    all.extend(fixed(&["rot_0", "rot_1", "rot_2", "rot_3"]));
    all
}

/// The properties of `vertex`: those that make a Gaussian, and those that the scene does not keep.
#[derive(Debug)]
pub(super) struct Columns {
    pub(super) sh_degree: u8,
    /// Property index of each number, in scene order; [`row_len`] entries. Where the model is one of
    /// [`Variants`], some are stand-ins.
    pub(super) properties: Vec<usize>,
    pub(super) variants: Variants,
    /// Property indices of `nx`, `ny` and `nz`, as far as they exist, in file order.
    pub(super) normals: Vec<usize>,
    /// Names of the properties that are not part of the Inria layout, in file order.
    pub(super) unknown: Vec<String>,
    /// Rows read so far whose normal is not zero. Tasks add to it in any order; the sum is the same.
    pub(super) rows_with_normal: AtomicUsize,
}

/// True for a number that is lost when the writer puts +0 in its place. This includes -0.
fn is_not_zero(v: f32) -> bool {
    v.to_bits() != 0
}

impl Columns {
    /// Finds the columns of a `vertex` element.
    pub(super) fn of(file: &Path, vertex: &Element) -> Result<Self> {
        let index: BTreeMap<&str, usize> =
            vertex.properties.iter().enumerate().map(|(i, p)| (p.name.as_str(), i)).collect();

        if index.contains_key("packed_position") && !index.contains_key("x") {
            return Err(Error::PlyCompressed { file: file.into() });
        }
        let rest = index.keys().filter(|n| is_rest(n)).count();
        let missing = |names: Vec<String>| {
            let properties = names.join(", ");
            Error::PlyMissingProperty { file: file.into(), properties }
        };
        let variants = Variants::of(vertex, &index);
        let absent: Vec<String> = inria_names(0)
            .into_iter()
            .filter(|n| !is_normal(n) && !index.contains_key(variants.stand_in(n)))
            .collect();
        if !absent.is_empty() {
            return Err(missing(absent));
        }
        let Some(sh_degree) = (0..4u8).find(|&d| REST_COUNTS[usize::from(d)] == rest) else {
            return Err(Error::PlyRestCount { file: file.into(), count: rest });
        };

        let mut properties = Vec::with_capacity(row_len(sh_degree));
        for i in 0..row_len(sh_degree) {
            let name = name(i, sh_degree);
            let Some(&at) = index.get(variants.stand_in(&name)) else {
                return Err(missing(vec![name]));
            };
            if vertex.properties[at].list.is_some() {
                return Err(Error::PlyListProperty { file: file.into(), property: name });
            }
            properties.push(at);
        }
        let mut known = vec![false; vertex.properties.len()];
        for &p in properties.iter().chain(&variants.filter_3d) {
            known[p] = true;
        }
        let (mut normals, mut unknown) = (Vec::new(), Vec::new());
        for (at, property) in vertex.properties.iter().enumerate().filter(|&(at, _)| !known[at]) {
            if is_normal(&property.name) && property.list.is_none() {
                normals.push(at);
            } else {
                unknown.push(property.name.clone());
            }
        }
        let rows_with_normal = AtomicUsize::new(0);
        Ok(Self { sh_degree, properties, variants, normals, unknown, rows_with_normal })
    }

    /// Number `c` in scene order of a row; `property` gives the numbers of its properties.
    #[inline]
    pub(super) fn number(&self, c: usize, property: impl Fn(usize) -> f32) -> f32 {
        if self.variants.any() {
            self.variants.number(c, |c| property(self.properties[c]), &property)
        } else {
            property(self.properties[c])
        }
    }

    /// Counts those of `rows` rows whose normal is not zero. `number(row, property)` is a number
    /// of the file.
    pub(super) fn count_normals(&self, rows: usize, number: impl Fn(usize, usize) -> f32) {
        if self.normals.is_empty() {
            return;
        }
        let has_normal = |&row: &usize| self.normals.iter().any(|&p| is_not_zero(number(row, p)));
        let count = (0..rows).filter(has_normal).count();
        self.rows_with_normal.fetch_add(count, Ordering::Relaxed);
    }
}

fn is_normal(name: &str) -> bool {
    matches!(name, "nx" | "ny" | "nz")
}

fn is_rest(name: &str) -> bool {
    name.strip_prefix("f_rest_")
        .is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()))
}
