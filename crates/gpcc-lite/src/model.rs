//! Adaptive models: the probability of a decision, and of a symbol out of sixteen.
//!
//! Both are integers, so that encoder and decoder agree on every machine.

use crate::coder::Coder;

pub use crate::bit::Bit;
pub use crate::symbols::Symbols;

/// `N` models without any observation.
pub(crate) fn table<const N: usize>() -> Box<[Bit; N]> {
    match vec![Bit::default(); N].try_into() {
        Ok(t) => t,
        Err(_) => unreachable!("the vector has N elements"),
    }
}

impl Bit {
    /// Codes a decision and learns it; `limit` (at most 1023) is the memory in observations.
    #[inline]
    pub fn code<C: Coder>(&mut self, coder: &mut C, value: bool, limit: u32) -> bool {
        let value = coder.decision(self.p1(), value);
        self.learn(value, limit);
        value
    }
}
