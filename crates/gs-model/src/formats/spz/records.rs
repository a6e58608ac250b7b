//! Extension records: a type, a length, so many bytes. Some change what the numbers mean.

use std::path::Path;

use crate::axes::Placement;
use crate::bytes::word;
use crate::error::{Error, Result};

/// Bytes before a record's contents.
const HEAD: usize = 8;
/// The flag of the header that says that there are records.
const RECORDS: u8 = 2;
/// `SPZ_ADOBE_coordinate_system`: a number from 1 to 16.
const AXES: u32 = 0xadbe_0003;
/// Types that have a name.
const NAMES: [(u32, &str); 1] = [(0xadbe_0002, " (SPZ_ADOBE_safe_orbit_camera)")];

/// What the records of a file say.
#[derive(Debug, Default)]
pub(super) struct Records {
    /// The axes of the numbers; `None` for those of the specification.
    pub(super) axes: Option<SpzAxes>,
    /// What is not used, a sentence each.
    pub(super) notes: Vec<String>,
}

impl Records {
    /// Those in the bytes where records are, if the flags of the header say that there are any.
    pub(super) fn of(file: &Path, flags: u8, mut bytes: &[u8]) -> Result<Self> {
        let mut records = Self::default();
        if flags & RECORDS == 0 {
            return Ok(records);
        }
        while !bytes.is_empty() {
            let record = bytes.split_at_checked(HEAD).and_then(|(head, rest)| {
                let (contents, rest) = rest.split_at_checked(word(head, 4) as usize)?;
                Some((word(head, 0), contents, rest))
            });
            let (kind, contents, rest) = record.ok_or_else(|| {
                Error::malformed(
                    file,
                    "SPZ, extension records",
                    "they are not whole; get the file again",
                )
            })?;
            bytes = rest;
            match (kind, contents.len()) {
                (AXES, 4) => records.axes = Some(SpzAxes(word(contents, 0))),
                (AXES, _) => {
                    let reason = "its coordinate system is not a number of 4 bytes";
                    return Err(Error::malformed(file, "SPZ, extension records", reason));
                }
                (_, len) => {
                    let name = NAMES.iter().find(|n| n.0 == kind).map_or("", |n| n.1);
                    records.notes.push(format!(
                        "the extension record {kind:#010x}{name} of {len} bytes is not used"
                    ));
                }
            }
        }
        Ok(records)
    }
}

/// A coordinate system of `SPZ_ADOBE_coordinate_system`. The names of 1 to 8 are where x, y and z point: LDB, RDB,
/// LUB, RUB, LDF, RDF, LUF, RUF (left or right, up or down, forward or back). In those of 9 to 16 y and z have
/// changed places: LFD, RFD, LFU, RFU, LBD, RBD, LBU, RBU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SpzAxes(u32);

impl SpzAxes {
    /// Not said; the specification's, RUB.
    const UNSPECIFIED: u32 = 0;
    /// Right, up, back: those of the specification.
    const RUB: u32 = 4;

    /// True where the numbers have the axes of the specification.
    pub(super) fn is_usual(self) -> bool {
        matches!(self.0, Self::UNSPECIFIED | Self::RUB)
    }

    /// What turns the numbers to the axes of PLY files, which are right, down, forward.
    pub(super) fn to_ply(self, file: &Path) -> Result<Placement> {
        let system = if self.0 == Self::UNSPECIFIED { Self::RUB } else { self.0 };
        if system > 16 {
            let reason = format!(
                "its SPZ_ADOBE_coordinate_system is {system}; 1 to 16 are known. With axes \"keep\" the numbers are \
                 read as they are"
            );
            return Err(Error::malformed(file, "SPZ, extension records", reason));
        }
        let (bits, swapped) = ((system - 1) % 8, system > 8);
        let sign = |is_positive: bool| if is_positive { 1.0 } else { -1.0 };
        let right = sign(bits & 1 != 0);
        let down = sign(bits & 2 == 0);
        let forward = sign((bits & 4 != 0) != swapped);
        let (y, z) = if swapped { (2, 1) } else { (1, 2) };
        let mut matrix = [[0.0; 3]; 3];
        (matrix[0][0], matrix[1][y], matrix[2][z]) = (right, down, forward);
        Ok(Placement { matrix, shift: [0.0; 3] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where a point lies that is 1 to the right, 2 up and 3 forward, in the axes that a name says.
    fn numbers(name: &str) -> [f64; 3] {
        let along = |letter| match letter {
            'R' => 1.0,
            'L' => -1.0,
            'U' => 2.0,
            'D' => -2.0,
            'F' => 3.0,
            _ => -3.0,
        };
        let all: Vec<f64> = name.chars().map(along).collect();
        [all[0], all[1], all[2]]
    }

    #[test]
    fn every_system_points_where_its_name_says() {
        let names = "LDB RDB LUB RUB LDF RDF LUF RUF LFD RFD LFU RFU LBD RBD LBU RBU";
        for (system, name) in (1..).zip(names.split(' ')) {
            let placement = SpzAxes(system).to_ply(Path::new("a.spz")).unwrap();
            let p = numbers(name);
            let turned = placement.matrix.map(|row| (0..3).map(|k| row[k] * p[k]).sum::<f64>());
            assert_eq!(turned, [1.0, -2.0, 3.0], "{name}");
        }
        assert!(SpzAxes(0).is_usual() && SpzAxes(4).is_usual() && !SpzAxes(6).is_usual());
        let error = SpzAxes(17).to_ply(Path::new("a.spz")).unwrap_err().to_string();
        assert!(error.starts_with("a.spz: ") && error.contains("is 17"), "{error}");
    }
}
