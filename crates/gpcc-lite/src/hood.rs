//! Neighbourhoods of the nodes of an octree level, derived from those of their parents without a
//! search.
//!
//! A *block* holds the 4x4x4 cells in and around a parent: its children (at 1 and 2 on each axis)
//! and the cells that touch them. Cell `(x, y, z)` is bit `16 x + 4 y + z` of a `u64`. The 3x3x3
//! cells around one child are a part of the block, a *window*: shifted down, they are numbered in
//! the same way with 0 to 2 on each axis, and the child itself is at `(1, 1, 1)`.
//!
//! Every cell of the block is a child of the parent or of one of the parent's 26 neighbours. So the
//! windows of a level follow from those of the level above, and from the children of its nodes.

/// Bit of the node itself in a window.
pub(crate) const CENTRE: u32 = 21;
/// The 27 bits of a window.
const WINDOW: u64 = 0x0000_0777_0777_0777;

/// Number of set bits of a byte. The baseline of x86-64 has no instruction for it.
pub(crate) const ONES: [u8; 256] = {
    let mut t = [0u8; 256];
    let mut i = 0;
    while i < 256 {
        t[i] = (i as u8).count_ones() as u8;
        i += 1;
    }
    t
};

/// Number of children in `mask` before child `c`.
#[inline]
pub(crate) fn rank(mask: u8, c: u32) -> u32 {
    u32::from(ONES[usize::from(mask) & ((1 << c) - 1)])
}

/// The children of a node.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Children {
    /// Index of the first in the next level's list.
    pub(crate) first: u32,
    /// Which of the eight are occupied.
    pub(crate) mask: u8,
}

/// The children of a mask as cells `(x, y, z)` with 0 or 1 on each axis.
const SPREAD: [u64; 256] = {
    let mut t = [0u64; 256];
    let mut mask = 0;
    while mask < 256 {
        let mut c = 0;
        while c < 8 {
            if mask >> c & 1 == 1 {
                t[mask] |= 1 << (16 * (c >> 2 & 1) + 4 * (c >> 1 & 1) + (c & 1));
            }
            c += 1;
        }
        mask += 1;
    }
    t
};

/// How the children of a neighbour enter the block, by the neighbour's bit in the parent's window.
#[derive(Clone, Copy)]
struct Entry {
    /// The children that lie in the block.
    keep: u8,
    /// By how much [`SPREAD`] of them is rotated to their cells.
    rotate: u8,
}

const ENTRY: [Entry; 64] = {
    let mut t = [Entry { keep: 0, rotate: 0 }; 64];
    let mut place = 0;
    while place < 64 {
        let d = [place / 16, place / 4 % 4, place % 4];
        if d[0] < 3 && d[1] < 3 && d[2] < 3 {
            let mut c = 0;
            while c < 8 {
                let x = [2 * d[0] + (c >> 2 & 1), 2 * d[1] + (c >> 1 & 1), 2 * d[2] + (c & 1)];
                // Cells 0 and 5 of the six do not touch the parent's children.
                if x[0] > 0 && x[0] < 5 && x[1] > 0 && x[1] < 5 && x[2] > 0 && x[2] < 5 {
                    t[place].keep |= 1 << c;
                }
                c += 1;
            }
            // Child cell 0 goes to cell 2 d - 1.
            let rotate = 16 * (2 * d[0]) + 4 * (2 * d[1]) + 2 * d[2] + 64 - 21;
            t[place].rotate = (rotate % 64) as u8;
        }
        place += 1;
    }
    t
};

/// For each cell of the block: the bit of its parent in the window around the block's node, and
/// which child of its parent it is.
const OWNER: [(u8, u8); 64] = {
    let mut t = [(0u8, 0u8); 64];
    let mut at = 0;
    while at < 64 {
        let x = [at / 16 + 1, at / 4 % 4 + 1, at % 4 + 1];
        t[at] = (
            (16 * (x[0] / 2) + 4 * (x[1] / 2) + x[2] / 2) as u8,
            (4 * (x[0] % 2) + 2 * (x[1] % 2) + x[2] % 2) as u8,
        );
        at += 1;
    }
    t
};

/// The cells of the block that the children `mask` of the neighbour at bit `place` of a window
/// fill.
#[inline]
fn cells_of(place: usize, mask: u8) -> u64 {
    let e = &ENTRY[place & 63];
    SPREAD[usize::from(mask & e.keep)].rotate_left(u32::from(e.rotate))
}

/// Number of occupied cells around the centre of a window.
#[inline]
pub(crate) fn count(window: u64) -> u8 {
    (window & !(1 << CENTRE)).count_ones() as u8
}

/// For each child of a window's centre: the seven other cells of the window that touch it.
const TOUCHING: [u64; 8] = {
    let mut t = [0u64; 8];
    let mut c = 0;
    while c < 8 {
        // The eight cells of a corner of the window; its first cell is at 0 or 1 on each axis.
        let corner = 0x0000_0000_0033_0033u64;
        t[c] = (corner << offset(c as u32)) & !(1 << CENTRE);
        c += 1;
    }
    t
};

/// For each child of a window's centre: how many of the seven other cells that touch it are occupied.
#[inline]
pub(crate) fn touching(window: u64) -> [u8; 8] {
    TOUCHING.map(|cells| (window & cells).count_ones() as u8)
}

/// Neighbourhoods of the nodes of a level, in order, without those that have no children.
#[derive(Debug, Default)]
pub(crate) struct Hoods {
    /// The window of each node: which cells around it are nodes of the level.
    pub(crate) present: Vec<u64>,
    /// For each node in turn, the indices in the level of the nodes in its window, itself included,
    /// by ascending bit.
    pub(crate) near: Vec<u32>,
}

impl Hoods {
    /// The neighbourhood of a node above the root, whose only child is the root.
    pub(crate) fn above_root() -> Self {
        Self { present: vec![1 << CENTRE], near: vec![0] }
    }
}

/// The cells in and around a node, and the children of the node and of its neighbours.
pub(crate) struct CellBlock {
    cells: u64,
    children: [Children; 64],
}

impl CellBlock {
    pub(crate) fn new() -> Self {
        Self { cells: 0, children: [Children::default(); 64] }
    }

    /// Goes to the node whose window is `present`. `near` starts at the indices of the nodes in it.
    /// Returns how many there are.
    #[inline]
    pub(crate) fn enter(&mut self, present: u64, near: &[u32], children: &[Children]) -> usize {
        self.cells = 0;
        let mut rest = present;
        let mut used = 0;
        for &i in near {
            if rest == 0 {
                break;
            }
            let place = rest.trailing_zeros() as usize & 63;
            rest &= rest - 1;
            let c = children[i as usize];
            self.children[place] = c;
            self.cells |= cells_of(place, c.mask);
            used += 1;
        }
        used
    }

    /// Children of the block's node.
    #[inline]
    pub(crate) fn own(&self) -> Children {
        self.children[CENTRE as usize]
    }

    /// Window around child `c`.
    #[inline]
    pub(crate) fn window(&self, c: u32) -> u64 {
        (self.cells >> offset(c)) & WINDOW
    }

    /// Index, in the level of the children, of the node at bit `place` of the window around child
    /// `c`.
    #[inline]
    pub(crate) fn index(&self, c: u32, place: u32) -> u32 {
        let (owner, child) = OWNER[(place + offset(c)) as usize & 63];
        let children = self.children[usize::from(owner) & 63];
        children.first + rank(children.mask, u32::from(child))
    }
}

/// Bit of the block at which the window around child `c` begins.
#[inline]
const fn offset(c: u32) -> u32 {
    16 * (c >> 2 & 1) + 4 * (c >> 1 & 1) + (c & 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cells of a plane, a line and some strays, as coordinates at depth 6.
    fn points() -> Vec<[u32; 3]> {
        let mut s = 7u32;
        let mut next = || {
            s = s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            s >> 16 & 63
        };
        let mut all: Vec<[u32; 3]> = (0..300).map(|_| [next(), next(), 20 + next() % 3]).collect();
        all.extend((0..64).map(|i| [i, 33, i]));
        all.extend((0..60).map(|_| [next(), next(), next()]));
        all
    }

    /// Windows and indices derived level by level are what a search in each level's list finds.
    #[test]
    fn neighbourhoods_agree_with_a_search() {
        let mut codes: Vec<u64> = points().into_iter().map(crate::morton::encode).collect();
        codes.sort_unstable();
        codes.dedup();
        let level = |depth: u32| {
            let mut l: Vec<u64> = codes.iter().map(|c| c >> (3 * (6 - depth))).collect();
            l.dedup();
            l
        };
        let mut hoods = Hoods::above_root();
        let mut children = vec![Children { first: 0, mask: 1 }];
        for depth in 0..=6 {
            let list = level(depth);
            let mut below = Hoods::default();
            let mut block = CellBlock::new();
            let mut near = hoods.near.as_slice();
            let mut at = 0;
            for &present in &hoods.present {
                near = &near[block.enter(present, near, &children)..];
                for c in (0..8).filter(|c| block.own().mask >> c & 1 == 1) {
                    let window = block.window(c);
                    let here = crate::morton::decode(list[at]);
                    for place in 0..64u32 {
                        let d = [place / 16, place / 4 % 4, place % 4];
                        if d.contains(&3) {
                            continue;
                        }
                        let there: Vec<i64> =
                            (0..3).map(|k| i64::from(here[k]) + i64::from(d[k]) - 1).collect();
                        let inside = there.iter().all(|&x| (0..1 << depth).contains(&x));
                        let code = crate::morton::encode([0, 1, 2].map(|k| there[k] as u32));
                        let want = if inside { list.binary_search(&code).ok() } else { None };
                        let found = window >> place & 1 == 1;
                        assert_eq!(want.is_some(), found, "{depth} {here:?} {d:?}");
                        if let Some(want) = want {
                            assert_eq!(block.index(c, place) as usize, want);
                            below.near.push(want as u32);
                        }
                    }
                    assert_eq!(u32::from(count(window)), window.count_ones() - 1);
                    below.present.push(window);
                    at += 1;
                }
            }
            assert_eq!(at, list.len());
            if depth < 6 {
                let next = level(depth + 1);
                let mut first = 0;
                children = list
                    .iter()
                    .map(|code| {
                        let own: Vec<u64> =
                            next.iter().filter(|&c| c >> 3 == *code).map(|c| c & 7).collect();
                        let mask = own.iter().fold(0, |m, c| m | 1 << c);
                        first += own.len() as u32;
                        Children { first: first - own.len() as u32, mask }
                    })
                    .collect();
            }
            hoods = below;
        }
    }
}
