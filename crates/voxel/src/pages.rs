//! [`Pages`]: large arrays for temporary use, in huge pages where the system has them.

#[cfg(target_os = "linux")]
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};

use bytemuck::Pod;
#[cfg(target_os = "linux")]
use memmap2::{Advice, MmapMut};

/// Arrays of at least this many bytes ask for pages of 2 MB. Part of the last page is wasted.
///
/// The kernel provides memory page by page, at the first touch, and a processor caches the
/// addresses of some thousand pages. With pages of 4 kB, the arrays for 2.5 million Gaussians take
/// 60,000 page faults, and reading records in Morton order misses that cache each time.
#[cfg(target_os = "linux")]
const HUGE: usize = 4 << 20;

/// An array of numbers that starts as zeros. Huge pages change the time only, not the contents.
#[derive(Debug)]
pub(crate) struct Pages<T>(Memory<T>);

#[derive(Debug)]
enum Memory<T> {
    Heap(Vec<T>),
    #[cfg(target_os = "linux")]
    Map(MmapMut, PhantomData<T>),
}

impl<T: Pod> Pages<T> {
    /// `len` zeros.
    pub(crate) fn zeroed(len: usize) -> Self {
        Self(map(len).unwrap_or_else(|| Memory::Heap(bytemuck::zeroed_vec(len))))
    }
}

impl<T> From<Vec<T>> for Pages<T> {
    fn from(list: Vec<T>) -> Self {
        Self(Memory::Heap(list))
    }
}

/// A separate mapping, if the array is large enough and the system grants one.
#[cfg(target_os = "linux")]
fn map<T: Pod>(len: usize) -> Option<Memory<T>> {
    let bytes = len.checked_mul(size_of::<T>()).filter(|&bytes| bytes >= HUGE)?;
    let map = MmapMut::map_anon(bytes).ok()?;
    // A kernel without huge pages refuses. The pages are ordinary ones then.
    let _ = map.advise(Advice::HugePage);
    Some(Memory::Map(map, PhantomData))
}

#[cfg(not(target_os = "linux"))]
fn map<T: Pod>(_: usize) -> Option<Memory<T>> {
    None
}

impl<T: Pod> Deref for Pages<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        match &self.0 {
            Memory::Heap(list) => list,
            #[cfg(target_os = "linux")]
            Memory::Map(map, _) => bytemuck::cast_slice(map),
        }
    }
}

impl<T: Pod> DerefMut for Pages<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        match &mut self.0 {
            Memory::Heap(list) => list,
            #[cfg(target_os = "linux")]
            Memory::Map(map, _) => bytemuck::cast_slice_mut(map),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn starts_as_zeros_and_keeps_what_is_written() {
        for len in [0, 1, 1000, 600_000, 3_000_001] {
            let mut pages = Pages::<[u32; 3]>::zeroed(len);
            assert_eq!(pages.len(), len);
            assert!(pages.iter().all(|x| *x == [0; 3]));
            pages.iter_mut().enumerate().for_each(|(i, x)| *x = [i as u32; 3]);
            assert!(pages.iter().enumerate().all(|(i, x)| *x == [i as u32; 3]));
        }
    }
}
