//! Kernels in the widest vectors that the machine has.
//!
//! The program must run on any x86-64, so the compiler may use no more than SSE2. A kernel is plain Rust whose loops it
//! can vectorize; [`Kernel::wide`] compiles it also for AVX2 and for AVX-512, and calls the version of the widest that the
//! processor has. The kernel itself fixes its lanes and the order of its sums, and no product is fused with a sum, so
//! every machine gives the same bits.

use std::cell::Cell;

#[cfg(target_arch = "x86_64")]
use pulp::x86::V4;
use pulp::{Arch, NullaryFnOnce};

thread_local! {
    static IS_NARROW: Cell<bool> = const { Cell::new(false) };
}

/// Makes this thread compute as on a processor without AVX-512, or ends that: so the results and run times of such
/// a processor can be seen on any other.
///
/// Transforms that are already planned do not change.
pub fn without_avx512(is_narrow: bool) {
    IS_NARROW.set(is_narrow);
}

/// Whether this thread may use AVX-512 where the processor has it.
pub(crate) fn may_use_avx512() -> bool {
    !IS_NARROW.get()
}

/// The widest vectors that this thread may use.
fn widest() -> Arch {
    match Arch::new() {
        #[cfg(target_arch = "x86_64")]
        Arch::V4(_) if !may_use_avx512() => pulp::x86::V3::try_new().map_or(Arch::Scalar, Arch::V3),
        widest => widest,
    }
}

/// A pass over many samples; its fields are its arguments.
pub(crate) trait Kernel: Sized {
    /// What it returns.
    type Output;

    /// The pass. It and what it calls must be `#[inline(always)]`; otherwise it is right but no faster.
    fn run(self) -> Self::Output;

    /// The pass where there is AVX-512, if its masks serve better than what the compiler makes of `run`; with the same bits.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    fn run_with_masks(self, _: V4) -> Self::Output {
        self.run()
    }

    /// Runs it in the widest vectors that the thread may use.
    fn wide(self) -> Self::Output {
        match widest() {
            #[cfg(target_arch = "x86_64")]
            Arch::V4(simd) => simd.vectorize(WithMasks(simd, self)),
            widest => widest.dispatch(Wide(self)),
        }
    }
}

#[cfg(target_arch = "x86_64")]
struct WithMasks<K>(V4, K);

#[cfg(target_arch = "x86_64")]
impl<K: Kernel> NullaryFnOnce for WithMasks<K> {
    type Output = K::Output;

    #[inline(always)]
    fn call(self) -> K::Output {
        self.1.run_with_masks(self.0)
    }
}

struct Wide<K>(K);

impl<K: Kernel> NullaryFnOnce for Wide<K> {
    type Output = K::Output;

    #[inline(always)]
    fn call(self) -> K::Output {
        self.0.run()
    }
}

/// What a `kernel` returns without vectors of its own, without AVX-512, and in the widest vectors.
#[cfg(test)]
pub(crate) fn in_all_vectors<K: Kernel>(mut kernel: impl FnMut() -> K) -> [K::Output; 3] {
    let plain = kernel().run();
    without_avx512(true);
    let narrow = kernel().wide();
    without_avx512(false);
    [plain, narrow, kernel().wide()]
}
