//! Little-endian numbers at a place in bytes that are known to be there.

#[inline]
pub(crate) fn array<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    let mut out = [0; N];
    out.copy_from_slice(&bytes[at..at + N]);
    out
}

#[cfg(feature = "formats")]
#[inline]
pub(crate) fn half_word(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes(array(bytes, at))
}

/// An IEEE 754 half float.
#[cfg(feature = "formats")]
#[inline]
pub(crate) fn half(bytes: &[u8], at: usize) -> f32 {
    half::f16::from_bits(half_word(bytes, at)).to_f32()
}

#[cfg(feature = "formats")]
#[inline]
pub(crate) fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(array(bytes, at))
}

#[inline]
pub(crate) fn float(bytes: &[u8], at: usize) -> f32 {
    f32::from_le_bytes(array(bytes, at))
}
