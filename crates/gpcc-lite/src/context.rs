//! Expected magnitude of a coefficient: the context of the coder and of the quantiser.

use crate::raht::Plan;

/// Running state of one channel.
#[derive(Clone, Debug)]
pub(crate) struct Magnitudes {
    /// Magnitude inherited from the ancestors, 8 fraction bits, per coefficient.
    activity: Vec<u32>,
    /// The two previous magnitudes of each axis.
    previous: [[u32; 2]; 3],
}

/// Magnitudes above this count as this in a context.
const CAP: u32 = 1 << 20;

impl Magnitudes {
    pub(crate) fn new(plan: &Plan) -> Self {
        Self { activity: vec![0; plan.len()], previous: [[0; 2]; 3] }
    }

    /// Forgets the previous magnitudes: a new octree level begins.
    pub(crate) fn start_level(&mut self) {
        self.previous = [[0; 2]; 3];
    }

    /// Activity of the coefficient above, and the two previous magnitudes, raw.
    #[inline]
    pub(crate) fn parts(&self, parent: usize, axis: u8) -> (u32, [u32; 2]) {
        (self.activity[parent], self.previous[usize::from(axis)])
    }

    /// Expected magnitude with 8 fraction bits; `coded` is the sum of the magnitudes of the
    /// `channels` channels already coded at this coefficient.
    #[inline]
    pub(crate) fn expected(&self, parent: usize, axis: u8, coded: u32, channels: u32) -> u32 {
        let a = u64::from(self.activity[parent]);
        let [p1, p2] = self.previous[usize::from(axis)].map(u64::from);
        let near = 54 * p1 + 36 * p2;
        let m = match (38 * coded.min(CAP)).checked_div(channels) {
            Some(others) => ((128 * a) >> 8) + near + u64::from(others),
            None => ((150 * a) >> 8) + near + (near >> 3),
        };
        m as u32
    }

    /// Learns the magnitude of coefficient `k`.
    #[inline]
    pub(crate) fn update(&mut self, k: usize, parent: usize, axis: u8, magnitude: u32) {
        let m = magnitude.min(CAP);
        let a = u64::from(self.activity[parent]);
        self.activity[k] = ((141 * a + 115 * (u64::from(m) << 8)) >> 8) as u32;
        let p = &mut self.previous[usize::from(axis)];
        *p = [m, p[0]];
    }
}
