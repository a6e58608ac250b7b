//! The 3x3x3 neighbourhood of a node, derived from its parent's: no hashing, no search.

/// No such node.
pub(crate) const NONE: u32 = u32::MAX;
/// Index of the node itself in its neighbourhood.
pub(crate) const CENTRE: usize = 13;

/// Indices, in the level's list, of the 27 cells around a node; `9 x + 3 y + z`, each 0 to 2.
pub(crate) type Hood = [u32; 27];

/// For child `c` and neighbour `n` of the child: which neighbour of the parent holds that cell,
/// and which of its children it is.
const CHILD_STEP: [[(u8, u8); 27]; 8] = {
    let mut t = [[(0u8, 0u8); 27]; 8];
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
            t[c][n] = (parent as u8, child as u8);
            n += 1;
        }
        c += 1;
    }
    t
};

/// The neighbourhood of child `c` of a node with neighbourhood `hood`, given each node's child
/// mask and the index of its first child in the next level's list.
#[inline]
pub(crate) fn child_hood(hood: &Hood, c: usize, mask: &[u8], first: &[u32]) -> Hood {
    let mut out = [NONE; 27];
    for (n, slot) in out.iter_mut().enumerate() {
        let (p, k) = CHILD_STEP[c][n];
        let at = hood[p as usize];
        if at == NONE {
            continue;
        }
        let m = mask[at as usize];
        if m >> k & 1 == 1 {
            let before = (m & ((1u16 << k) - 1) as u8).count_ones();
            *slot = first[at as usize] + before;
        }
    }
    out
}
