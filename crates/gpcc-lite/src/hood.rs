//! The 3x3x3 neighbourhood of a node, derived from its parent's: no hashing, no search.

/// Index of the node itself in its neighbourhood.
pub(crate) const CENTRE: usize = 13;

/// The 27 cells around a node, numbered `9 x + 3 y + z`, each 0 to 2.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hood {
    /// Which of them exist; bit [`CENTRE`] is the node itself.
    pub(crate) present: u32,
    /// Index of each in the level's list; meaningless where not present.
    pub(crate) index: [u32; 27],
}

impl Hood {
    /// The root: nobody around.
    pub(crate) const ROOT: Self = Self { present: 1 << CENTRE, index: [0; 27] };

    /// True if the node touches no other.
    #[inline]
    pub(crate) fn alone(&self) -> bool {
        self.present == 1 << CENTRE
    }
}

/// Number of set bits of a byte: the baseline x86-64 has no instruction for it.
pub(crate) const ONES: [u8; 256] = {
    let mut t = [0u8; 256];
    let mut i = 0;
    while i < 256 {
        t[i] = (i as u8).count_ones() as u8;
        i += 1;
    }
    t
};

/// Rank of child `c` among the children in `mask`.
#[inline]
pub(crate) fn rank(mask: u8, c: u32) -> u32 {
    u32::from(ONES[usize::from(mask) & ((1 << c) - 1)])
}

/// `STEP[c][p]`: the children of the parent's neighbour `p` that touch its child `c`, as a mask,
/// and the place each of them takes in the neighbourhood of `c`.
const STEP: [[(u8, [u8; 8]); 27]; 8] = {
    let mut t = [[(0u8, [0u8; 8]); 27]; 8];
    let mut c = 0;
    while c < 8 {
        let mut n = 0;
        while n < 27 {
            let d = [n / 9, n / 3 % 3, n % 3];
            let b = [c >> 2 & 1, c >> 1 & 1, c & 1];
            let mut parent = 0;
            let mut child = 0;
            let mut k = 0;
            while k < 3 {
                // Coordinate in units of children, from -1 to 2, shifted by 2.
                let x = b[k] + d[k] + 1;
                parent = parent * 3 + x / 2;
                child = child * 2 + x % 2;
                k += 1;
            }
            t[c][parent].0 |= 1 << child;
            t[c][parent].1[child] = n as u8;
            n += 1;
        }
        c += 1;
    }
    t
};

/// The children of a node.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Children {
    /// Index of the first in the next level's list.
    pub(crate) first: u32,
    /// Which of the eight there are.
    pub(crate) mask: u8,
}

/// The neighbourhood of child `c` of a node with neighbourhood `parent`.
#[inline]
pub(crate) fn child_hood(parent: &Hood, c: usize, children: &[Children]) -> Hood {
    let mut out = Hood { present: 0, index: [0; 27] };
    let mut rest = parent.present;
    while rest != 0 {
        let p = rest.trailing_zeros() as usize;
        rest &= rest - 1;
        let (touching, places) = &STEP[c][p];
        let Children { first, mask: occupied } = children[parent.index[p] as usize];
        let mut near = occupied & touching;
        while near != 0 {
            let k = near.trailing_zeros();
            near &= near - 1;
            let n = places[k as usize];
            out.present |= 1 << n;
            out.index[usize::from(n)] = first + rank(occupied, k);
        }
    }
    out
}
