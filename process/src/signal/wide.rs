//! Kernels in the widest vectors that the machine has.
//!
//! The program must run on any x86-64, so the compiler may use no more than SSE2. A kernel is plain Rust whose loops it
//! can vectorize; [`Kernel::wide`] compiles it twice, and calls the AVX2 version where the processor has AVX2. The
//! kernel itself fixes its lanes and the order of its sums, and no product is fused with a sum, so every machine gives
//! the same bits.

use pulp::{Arch, NullaryFnOnce};

/// A pass over many samples; its fields are its arguments.
pub(crate) trait Kernel: Sized {
    /// What it returns.
    type Output;

    /// The pass. It and what it calls must be `#[inline(always)]`; otherwise it is right but no faster.
    fn run(self) -> Self::Output;

    /// The same, in the widest vectors.
    fn wide(self) -> Self::Output {
        Arch::new().dispatch(Wide(self))
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
