//! Expected magnitudes of coefficients: the context of the coder and of the quantiser.

/// Most channels in a chunk.
pub(crate) const CHUNK: usize = 4;

/// One number per channel of a chunk; those of channels that are not there are 0.
pub(crate) type Lanes = [u32; CHUNK];

/// Magnitudes of a chunk, 16 bits each, the first lowest. In one register, for an array written a
/// channel at a time and read as a whole stalls the processor at every coefficient.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Packed(u64);

impl Packed {
    /// Sets channel `i`, which was 0.
    #[inline]
    pub(crate) fn set(&mut self, i: usize, magnitude: u32) {
        self.0 |= u64::from(magnitude.min(CAP)) << (16 * (i & 3));
    }

    #[inline]
    pub(crate) fn get(self, i: usize) -> u32 {
        (self.0 >> (16 * (i & 3))) as u32 & CAP
    }

    #[inline]
    pub(crate) fn is_zero(self) -> bool {
        self.0 == 0
    }

    #[inline]
    fn sum(self) -> u32 {
        let pairs = (self.0 & 0x0000_ffff_0000_ffff) + (self.0 >> 16 & 0x0000_ffff_0000_ffff);
        (pairs as u32) + (pairs >> 32) as u32
    }
}

/// How many of `left` channels make the next chunk: as even as can be.
pub(crate) fn chunk_size(left: usize) -> usize {
    left.div_ceil(left.div_ceil(CHUNK).max(1))
}

/// Sizes of the chunks of so many channels.
pub(crate) fn chunk_sizes(channels: usize) -> Vec<usize> {
    let mut sizes = Vec::new();
    let mut left = channels;
    while left > 0 {
        sizes.push(chunk_size(left));
        left -= chunk_size(left);
    }
    sizes
}

/// Running state of the chunks of a group. What a coefficient with zeros only hands down is the
/// activity of the last ancestor with more, faded: no channel is touched.
#[derive(Clone, Debug)]
pub(crate) struct Magnitudes {
    chunks: usize,
    nodes: Vec<Node>,
    /// Magnitudes inherited from the ancestors, 8 fraction bits: of each coefficient that is not
    /// all zero, all chunks. The first row is zeros.
    activity: Vec<Lanes>,
    /// Per axis two rows of previous magnitudes, and at the end one of zeros.
    previous: Vec<Packed>,
    /// Where the previous magnitudes of each axis are, and those before.
    recent: [[Recent; 3]; 2],
}

/// Activity that a coefficient hands down.
#[derive(Clone, Copy, Debug, Default)]
struct Node {
    /// Sum over all channels.
    sum: u32,
    /// Row of the activities.
    row: u32,
    /// How often they have faded.
    age: u8,
}

/// A row of previous magnitudes and its sum: the row is the lowest 8 bits. In one register, and those of one axis
/// not side by side, for what was written in parts and is read at once stalls the processor.
#[derive(Clone, Copy, Debug)]
struct Recent(u64);

impl Recent {
    const NONE: Self = Self(ZEROS as u64);

    #[inline]
    fn new(row: u8, sum: u32) -> Self {
        Self((u64::from(sum) << 8) | u64::from(row))
    }

    #[inline]
    fn row(self) -> u8 {
        self.0 as u8
    }

    #[inline]
    fn sum(self) -> u32 {
        (self.0 >> 8) as u32
    }
}

/// What is known of the channels at one coefficient.
#[derive(Clone, Copy)]
pub(crate) struct Row {
    above: Node,
    axis: u8,
    recent: [Recent; 2],
}

/// What is known of a chunk at one coefficient.
#[derive(Clone, Copy)]
pub(crate) struct Here {
    /// Activity of the coefficient above.
    pub(crate) above: Lanes,
    /// The two previous magnitudes.
    pub(crate) previous: [Packed; 2],
    /// Number of channels before those of the chunk.
    first: usize,
}

/// Share of an activity that is handed down again, 16 bits, by how often it was.
const FADE: [u32; 32] = {
    let mut t = [1 << 16; 32];
    let mut i = 1;
    while i < 32 {
        t[i] = (t[i - 1] * 141) >> 8;
        i += 1;
    }
    t
};

/// Magnitudes above this count as this in a context: activities are below 2^24 then, and all sums
/// and products of them fit 32 bits.
const CAP: u32 = (1 << 16) - 1;

/// Number of the row of zeros in `previous`.
const ZEROS: u8 = 6;

impl Magnitudes {
    pub(crate) fn new(coefficients: usize, chunks: usize) -> Self {
        let mut this = Self {
            chunks,
            nodes: vec![Node::default(); coefficients],
            activity: vec![[0; CHUNK]; chunks],
            previous: vec![Packed(0); (usize::from(ZEROS) + 1) * chunks],
            recent: [[Recent::NONE; 3]; 2],
        };
        this.start_level();
        this
    }

    /// Forgets the previous magnitudes: a new octree level begins.
    pub(crate) fn start_level(&mut self) {
        self.recent = [[Recent::NONE; 3]; 2];
    }

    /// Goes to a coefficient that splits `axis`.
    #[inline]
    pub(crate) fn at(&self, parent: u32, axis: u8) -> Row {
        let at = usize::from(axis);
        let recent = [self.recent[0][at], self.recent[1][at]];
        Row { above: self.nodes[parent as usize], axis, recent }
    }

    /// Goes to a chunk there; `first` channels precede it.
    #[inline]
    pub(crate) fn chunk(&self, row: &Row, chunk: usize, first: usize) -> Here {
        let mut above = self.activity[row.above.row as usize * self.chunks + chunk];
        if row.above.age > 0 {
            let fade = u64::from(FADE[usize::from(row.above.age) & 31]);
            above = above.map(|a| ((u64::from(a) * fade) >> 16) as u32);
        }
        Here {
            above,
            previous: row.recent.map(|r| self.previous[usize::from(r.row()) * self.chunks + chunk]),
            first,
        }
    }

    /// Learns that all of coefficient `k` is zero.
    #[inline]
    pub(crate) fn learn_zeros(&mut self, k: usize, row: &Row) {
        let Node { sum, row: at, age } = row.above;
        let sum = ((u64::from(sum) * 141) >> 8) as u32;
        self.nodes[k] = Node { sum, row: at, age: (age + 1).min(31) };
        self.push(row, Recent::NONE);
    }

    /// Learns the magnitudes of coefficient `k`, one entry per chunk.
    #[inline]
    pub(crate) fn learn(&mut self, k: usize, row: &Row, magnitudes: &[Packed]) {
        let start = self.activity.len();
        // The row of the two that does not hold the previous magnitudes.
        let free = 2 * row.axis + u8::from(row.recent[0].row() == 2 * row.axis);
        let mut activity = 0u32;
        let mut sum = 0;
        for (chunk, &magnitude) in magnitudes.iter().enumerate() {
            let above = self.chunk(row, chunk, 0).above;
            let mut lanes = [0; CHUNK];
            for i in 0..CHUNK {
                lanes[i] = (141 * above[i] + 115 * 256 * magnitude.get(i)) >> 8;
                activity = activity.saturating_add(lanes[i]);
            }
            self.activity.push(lanes);
            self.previous[usize::from(free) * self.chunks + chunk] = magnitude;
            sum += magnitude.sum();
        }
        self.nodes[k] = Node { sum: activity, row: (start / self.chunks.max(1)) as u32, age: 0 };
        self.push(row, Recent::new(free, sum));
    }

    #[inline]
    fn push(&mut self, row: &Row, last: Recent) {
        let axis = usize::from(row.axis);
        self.recent[0][axis] = last;
        self.recent[1][axis] = row.recent[0];
    }
}

impl Row {
    /// How many coefficients above were all zero, in a row.
    #[inline]
    pub(crate) fn age(&self) -> usize {
        usize::from(self.above.age)
    }

    /// Sums over all channels: expected magnitude, activity above, previous magnitudes.
    #[inline]
    pub(crate) fn sums(&self) -> (u32, u32, [u32; 2]) {
        let above = self.above.sum;
        let [p1, p2] = self.recent.map(|r| r.sum().min(CAP));
        (expected(above, 54 * p1 + 36 * p2, 0, 0), above, [p1, p2])
    }
}

/// How much the `before` channels already coded add to the expectation: 38/256 of their mean.
#[inline]
pub(crate) fn others(coded: u32, before: usize) -> u32 {
    const SCALE: [u32; 64] = {
        let mut t = [0; 64];
        let mut n = 1;
        while n < 64 {
            t[n] = 38 * 64 / n as u32;
            n += 1;
        }
        t
    };
    (coded.min(CAP) * SCALE[before.min(63)]) >> 6
}

/// Mean magnitude of the `before` channels already coded, 8 fraction bits; 0 of none.
#[inline]
pub(crate) fn mean_of(coded: u32, before: usize) -> u32 {
    const RECIPROCAL: [u32; 64] = {
        let mut t = [0; 64];
        let mut n = 1;
        while n < 64 {
            t[n] = 65536 / n as u32;
            n += 1;
        }
        t
    };
    (coded.min(CAP) * RECIPROCAL[before.min(63)]) >> 8
}

#[inline]
fn expected(above: u32, near: u32, coded: u32, before: usize) -> u32 {
    if before == 0 {
        ((150 * u64::from(above)) >> 8) as u32 + near + (near >> 3)
    } else {
        (above >> 1) + near + others(coded, before)
    }
}

impl Here {
    #[inline]
    fn near(&self, i: usize) -> u32 {
        54 * self.previous[0].get(i) + 36 * self.previous[1].get(i)
    }

    /// Expected magnitude of the chunk's channel `i` with 8 fraction bits; `coded` is the sum of
    /// the magnitudes of all channels already coded at this coefficient.
    #[inline]
    pub(crate) fn expected(&self, i: usize, coded: u32) -> u32 {
        expected(self.above[i], self.near(i), coded, self.first + i)
    }

    /// [`Here::expected`] of all channels of the chunk but for [`others`].
    #[inline]
    pub(crate) fn bases(&self) -> Lanes {
        let mut bases = [0; CHUNK];
        for (i, base) in bases.iter_mut().enumerate() {
            *base = (self.above[i] >> 1) + self.near(i);
        }
        if self.first == 0 {
            bases[0] = expected(self.above[0], self.near(0), 0, 0);
        }
        bases
    }

    /// Sums over the chunk: expected magnitude, activity above, previous magnitudes.
    #[inline]
    pub(crate) fn sums(&self, size: usize, coded: u32) -> [u32; 3] {
        let above = self.above.iter().sum::<u32>();
        let [p1, p2] = self.previous.map(Packed::sum);
        let near = 54 * p1 + 36 * p2;
        let mut m = expected(above, near, coded, self.first);
        if self.first != 0 {
            m += others(coded, self.first) * (size as u32 - 1);
        }
        [m, above, p1 + p2]
    }
}
