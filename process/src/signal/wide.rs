//! Kernels in the widest vectors that the machine has.
//!
//! The program runs on any x86-64, so that the compiler may count on no more than SSE2. A kernel is plain Rust whose loops
//! it can make vectors of; [`Kernel::wide`] has it made twice, and takes the one for AVX2 where the processor has that.
//! Which lanes there are, and the order in which they are summed, stands in the kernel, and no product is fused with a
//! sum: every machine gives the same bits.

use pulp::{Arch, NullaryFnOnce};

/// A pass over many samples, whose fields are what it needs.
pub(crate) trait Kernel: Sized {
    /// What it returns.
    type Output;

    /// The pass itself. It must be `#[inline(always)]`, and so must what it calls, or it is right but no faster.
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
