//! Expected magnitudes of coefficients: the context of the coder and of the quantiser.

/// Most channels in a chunk.
pub(crate) const CHUNK: usize = 4;

/// One number per channel of a chunk; those of channels that are not there are 0.
pub(crate) type Lanes = [u32; CHUNK];

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
    /// The two previous magnitudes, by axis and chunk.
    previous: Vec<[Lanes; 2]>,
}

/// What is known of a chunk at one coefficient.
#[derive(Clone, Copy)]
pub(crate) struct Here {
    /// Activity of the coefficient above.
    pub(crate) above: Lanes,
    /// The two previous magnitudes.
    pub(crate) previous: [Lanes; 2],
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
            previous: vec![[[0; CHUNK]; 2]; 3 * chunks],
        }
    }

    /// Forgets the previous magnitudes: a new octree level begins.
    pub(crate) fn start_level(&mut self) {
        self.previous.fill([[0; CHUNK]; 2]);
    }

    /// Goes to a chunk of coefficient `k`, which splits `axis`; `first` channels precede it.
    #[inline]
    pub(crate) fn at(&self, k: usize, parent: u32, axis: u8, chunk: usize, first: usize) -> Here {
        let axis = usize::from(axis) * self.chunks + chunk;
        Here {
            above: self.activity[parent as usize * self.chunks + chunk],
            previous: self.previous[axis],
            first,
            at: k * self.chunks + chunk,
            axis,
        }
    }

    /// Learns the magnitudes of a chunk.
    #[inline]
    pub(crate) fn update(&mut self, here: &Here, magnitude: &Lanes) {
        let activity = &mut self.activity[here.at];
        let mut capped = [0; CHUNK];
        for i in 0..CHUNK {
            let (a, m) = (here.above[i], magnitude[i].min(CAP));
            activity[i] = (141 * a + 115 * 256 * m) >> 8;
            capped[i] = m;
        }
        self.previous[here.axis] = [capped, here.previous[0]];
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
        54 * self.previous[0][i] + 36 * self.previous[1][i]
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
        let [p1, p2] = self.previous.map(|p| p.iter().sum::<u32>());
        let near = 54 * p1 + 36 * p2;
        let mut m = expected(above, near, coded, self.first);
        if self.first != 0 {
            m += others(coded, self.first) * (size as u32 - 1);
        }
        [m, above, p1 + p2]
    }
}
