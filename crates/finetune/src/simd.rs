//! Run-time choice of the vector instruction set.
//!
//! The hot loops are plain Rust over `[f32; 16]` lanes that the compiler vectorises. For baseline
//! x86-64 it would use SSE2. This module also compiles them for AVX2 and AVX-512 and picks a version
//! at run time. Rust never fuses `a * b + c`, so all versions give the same bits.
#![allow(unsafe_code, reason = "calls to #[target_feature] functions after detection")]

/// A computation that [`run`] compiles once per instruction set. `call` must be
/// `#[inline(always)]`, as must what it calls in its hot loops.
pub(crate) trait Kernel {
    /// What the computation returns.
    type Output;
    /// The computation.
    fn call(self) -> Self::Output;
}

/// Runs `kernel` with the widest vector instructions that this machine has.
#[inline]
pub(crate) fn run<K: Kernel>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    {
        if std::arch::is_x86_feature_detected!("avx512f")
            && std::arch::is_x86_feature_detected!("avx512vl")
            && std::arch::is_x86_feature_detected!("avx512dq")
            && std::arch::is_x86_feature_detected!("avx512bw")
        {
            // SAFETY: the features that `avx512` enables were just detected.
            return unsafe { avx512(kernel) };
        }
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the feature that `avx2` enables was just detected.
            return unsafe { avx2(kernel) };
        }
    }
    kernel.call()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2")]
fn avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.call()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.call()
}
