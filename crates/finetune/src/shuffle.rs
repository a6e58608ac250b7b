//! Random numbers, and the order in which views are visited.

/// Random numbers: SplitMix64.
#[derive(Clone, Debug)]
pub struct SplitMix(u64);

impl SplitMix {
    /// The numbers of a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// From 0 to below 1.
    pub fn uniform(&mut self) -> f64 {
        (self.next() >> 11) as f64 * libm::exp2(-53.0)
    }

    /// Two numbers of the standard normal distribution (Box and Muller).
    pub fn normal(&mut self) -> [f64; 2] {
        let radius = (-2.0 * libm::log(1.0 - self.uniform())).sqrt();
        let angle = std::f64::consts::TAU * self.uniform();
        [radius * libm::cos(angle), radius * libm::sin(angle)]
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
}

/// The permutation of `0..n` that epoch `epoch` of a run with `seed` visits: a function of its
/// arguments alone, so that a resumed run continues with the same order.
#[must_use]
pub fn permutation(seed: u64, epoch: u64, n: usize) -> Vec<u32> {
    let mut rng = SplitMix(seed ^ epoch.wrapping_mul(0xd134_2543_de82_ef95));
    let mut order: Vec<u32> = (0..n as u32).collect();
    for i in (1..n).rev() {
        let j = ((u128::from(rng.next()) * (i as u128 + 1)) >> 64) as usize;
        order.swap(i, j);
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn visits_every_view_once_in_an_order_of_its_own() {
        for n in [0, 1, 2, 7, 100] {
            let mut p = permutation(5, 3, n);
            p.sort_unstable();
            assert_eq!(p, (0..n as u32).collect::<Vec<_>>());
        }
        assert_eq!(permutation(5, 3, 50), permutation(5, 3, 50));
        assert_ne!(permutation(5, 3, 50), permutation(5, 4, 50));
        assert_ne!(permutation(5, 3, 50), permutation(6, 3, 50));
    }
}
