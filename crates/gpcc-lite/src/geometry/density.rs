//! How densely the surroundings of a node are filled: the context of its children.
//!
//! Every known cell around a node adds a weight to the density at each of the node's eight
//! children. The weight falls with the fourth power of the distance between cell and child. If a
//! neighbour is coded, its children are known: the distance is measured from each child's centre.
//! If not, it is measured from the neighbour's centre. Where the density is high, a child is
//! likely. A density is one number where a pattern of cells would be many contexts, so it learns
//! from few points.

use std::hint::select_unpredictable;
use std::sync::LazyLock;

/// A density per child.
pub(super) type Densities = [u16; 8];

/// Weight of a cell at a distance of one child's side.
const UNIT: u32 = 4096;
/// How many cells a neighbour counts for that is not coded yet: it has two children or more as
/// often as not.
const UNKNOWN: u32 = 2;
/// What neighbours add, by their bit in a window.
pub(super) struct Kernel {
    /// Of a coded neighbour, by the mask of its children. One without children has a single leaf,
    /// and counts for one cell at its centre.
    coded: Box<[[Densities; 256]; 43]>,
    /// Of a neighbour that is not coded yet.
    unknown: [Densities; 43],
}

/// Computed once: 176 KiB, of which the entries of 26 neighbours are used.
pub(super) static KERNEL: LazyLock<Kernel> = LazyLock::new(Kernel::new);

impl Kernel {
    fn new() -> Self {
        let zero = vec![[[0u16; 8]; 256]; 43].into_boxed_slice();
        let Ok(coded) = zero.try_into() else { unreachable!("the slice has 43 elements") };
        let mut kernel = Self { coded, unknown: [[0; 8]; 43] };
        for place in 0..43 {
            let d = [place / 16, place / 4 % 4, place % 4].map(|x| x as i32 - 1);
            if d == [0; 3] || d.contains(&2) {
                continue;
            }
            let of_child: [Densities; 8] = std::array::from_fn(|q| {
                std::array::from_fn(|k| {
                    let v = [2, 1, 0].map(|b| 2 * d[2 - b] + bit(q, b) - bit(k, b));
                    weight(UNIT, v)
                })
            });
            // Distances from the centre are in halves of a child's side.
            let centre = |mass: u32| -> Densities {
                std::array::from_fn(|k| {
                    let v = [2, 1, 0].map(|b| 4 * d[2 - b] + 1 - 2 * bit(k, b));
                    weight(16 * UNIT * mass, v)
                })
            };
            kernel.unknown[place] = centre(UNKNOWN);
            for mask in 1..256usize {
                let (rest, q) = (mask & (mask - 1), mask.trailing_zeros() as usize);
                let sum = kernel.coded[place][rest];
                kernel.coded[place][mask] = std::array::from_fn(|k| sum[k] + of_child[q][k]);
            }
            kernel.coded[place][0] = centre(1);
        }
        kernel
    }

    /// Adds a neighbour. Whether it is coded cannot be predicted, so there is no branch.
    #[inline]
    pub(super) fn add(&self, sum: &mut Densities, place: u32, is_coded: bool, mask: u8) {
        let place = (place as usize).min(42);
        let coded = &self.coded[place][usize::from(mask)];
        add(sum, select_unpredictable(is_coded, coded, &self.unknown[place]));
    }
}

#[inline]
fn bit(v: usize, b: usize) -> i32 {
    (v >> b & 1) as i32
}

fn weight(unit: u32, v: [i32; 3]) -> u16 {
    let square: i32 = v.iter().map(|x| x * x).sum();
    (unit / (square * square) as u32) as u16
}

#[inline]
fn add(sum: &mut Densities, more: &Densities) {
    for (a, b) in sum.iter_mut().zip(more) {
        *a += b;
    }
}

/// Binary logarithm in sixteenths, linear between powers of two; 0 for 0. It is read from the bits
/// of a float, which is exact below 2^24.
#[inline]
pub(super) fn sixteenths(v: u32) -> usize {
    ((v as f32).to_bits() >> 19).saturating_sub(127 << 4) as usize
}

/// Classes of the densities at a node's children.
#[derive(Clone, Copy, Debug)]
pub(super) struct Classes {
    /// For each child, its share of the sum of all eight, in thirds of an octave: 0 to 19.
    pub(super) share: [u16; 8],
    /// The sum of all eight, in two thirds of an octave: 0 to 15.
    pub(super) total: usize,
}

impl Classes {
    #[inline]
    pub(super) fn new(densities: &Densities) -> Self {
        let sum: u32 = densities.iter().map(|&v| u32::from(v)).sum();
        if sum == 0 {
            return Self { share: [0; 8], total: 0 };
        }
        let sum = sixteenths(sum) as i32;
        let logs = densities.map(|v| (f32::from(v).to_bits() >> 19) as i32 - (127 << 4));
        Self {
            share: logs.map(|l| (1 + (((l - sum + 96) * 3) >> 4).clamp(0, 18)) as u16),
            total: 1 + ((sum - 128).max(0) * 3 / 32).min(14) as usize,
        }
    }
}

/// Cells of a window at the low and at the high side of each axis.
const SIDES: [[u64; 2]; 3] = [
    [0x0000_0000_0000_0777, 0x0000_0777_0000_0000],
    [0x0000_0007_0007_0007, 0x0000_0700_0700_0700],
    [0x0000_0111_0111_0111, 0x0000_0444_0444_0444],
];

/// How many more neighbours there are at the high side of an axis than at the low one, -9 to 9.
#[inline]
pub(super) fn lean(window: u64, axis: usize) -> i32 {
    let [low, high] = SIDES[axis].map(|s| (window & s).count_ones() as i32);
    high - low
}

#[cfg(test)]
mod tests {
    use super::*;

    /// No neighbourhood overflows a density: not even one in which every neighbour adds the most it
    /// can.
    #[test]
    fn the_greatest_density_fits() {
        for child in 0..8 {
            let greatest = |place: usize| {
                let coded = KERNEL.coded[place].iter().map(|d| d[child]).max().unwrap_or(0);
                u32::from(coded.max(KERNEL.unknown[place][child]))
            };
            let sum: u32 = (0..43).map(greatest).sum();
            assert!(sum > 1 << 14 && sum < 1 << 16, "{sum}");
        }
    }
}
