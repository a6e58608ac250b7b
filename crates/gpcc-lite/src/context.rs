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

/// Running state of the chunks of a group.
#[derive(Clone, Debug)]
pub(crate) struct Magnitudes {
    chunks: usize,
    /// Magnitudes inherited from the ancestors, 8 fraction bits: coefficient by coefficient, each
    /// with all chunks.
    activity: Vec<Lanes>,
    /// The previous magnitudes and those before them, by axis and chunk.
    last: Vec<Packed>,
    before_last: Vec<Packed>,
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
    at: usize,
    axis: usize,
}

/// Magnitudes above this count as this in a context: the sums below then fit 32 bits.
const CAP: u32 = (1 << 16) - 1;

impl Magnitudes {
    pub(crate) fn new(coefficients: usize, chunks: usize) -> Self {
        Self {
            chunks,
            activity: vec![[0; CHUNK]; coefficients * chunks],
            last: vec![Packed(0); 3 * chunks],
            before_last: vec![Packed(0); 3 * chunks],
        }
    }

    /// Forgets the previous magnitudes: a new octree level begins.
    pub(crate) fn start_level(&mut self) {
        self.last.fill(Packed(0));
        self.before_last.fill(Packed(0));
    }

    /// Goes to a chunk of coefficient `k`, which splits `axis`; `first` channels precede it.
    #[inline]
    pub(crate) fn at(&self, k: usize, parent: u32, axis: u8, chunk: usize, first: usize) -> Here {
        let axis = usize::from(axis) * self.chunks + chunk;
        Here {
            above: self.activity[parent as usize * self.chunks + chunk],
            previous: [self.last[axis], self.before_last[axis]],
            first,
            at: k * self.chunks + chunk,
            axis,
        }
    }

    /// Learns the magnitudes of a chunk.
    #[inline]
    pub(crate) fn update(&mut self, here: &Here, magnitude: Packed) {
        let activity = &mut self.activity[here.at];
        for i in 0..CHUNK {
            activity[i] = (141 * here.above[i] + 115 * 256 * magnitude.get(i)) >> 8;
        }
        self.before_last[here.axis] = here.previous[0];
        self.last[here.axis] = magnitude;
    }
}

/// How much the `before > 0` channels already coded add to the expectation: 38/256 of their mean.
#[inline]
fn others(coded: u32, before: usize) -> u32 {
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

    /// Sums over the chunk: expected magnitude, activity above, previous magnitudes.
    #[inline]
    pub(crate) fn sums(&self, size: usize, coded: u32) -> [u32; 3] {
        let above: u32 = self.above.iter().sum();
        let [p1, p2] = self.previous.map(Packed::sum);
        let near = 54 * p1 + 36 * p2;
        let mut m = expected(above, near, coded, self.first);
        if self.first != 0 {
            m += others(coded, self.first) * (size as u32 - 1);
        }
        [m, above, p1 + p2]
    }
}
