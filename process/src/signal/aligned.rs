//! Memory that begins where a cache line does.

use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};

use bytemuck::Pod;
use tapline_wire::CacheLine;

/// Values whose first is the first of a cache line: a vector of 64 bytes then lies in one line, not across two, which takes longer.
#[derive(Debug)]
pub(crate) struct Aligned<T> {
    lines: Vec<CacheLine>,
    count: usize,
    of: PhantomData<T>,
}

impl<T: Pod> Aligned<T> {
    /// Without values.
    pub(crate) fn new() -> Self {
        Self { lines: Vec::new(), count: 0, of: PhantomData }
    }

    /// Makes it `count` values long, whatever they are: the caller writes all of them.
    pub(crate) fn resize(&mut self, count: usize) {
        self.lines.resize((count * size_of::<T>()).div_ceil(size_of::<CacheLine>()), CacheLine::default());
        self.count = count;
    }
}

impl<T: Pod> Deref for Aligned<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &bytemuck::cast_slice(&self.lines)[..self.count]
    }
}

impl<T: Pod> DerefMut for Aligned<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut bytemuck::cast_slice_mut(&mut self.lines)[..self.count]
    }
}
