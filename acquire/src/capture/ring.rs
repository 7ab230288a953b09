//! The latest samples that were heard: bounded, and without waiting.

/// The samples of the last while, parts of full scale, `[channel][frame]`; frames are numbered from the start of the stream.
#[derive(Debug)]
pub(super) struct Ring {
    channels: Vec<Vec<f32>>,
    /// Number of the frame that comes next.
    end: u64,
    /// Frames before this one are unavailable: they were never heard, or lie before an overrun.
    start: u64,
}

impl Ring {
    /// With room for `frame_count` frames.
    pub(super) fn new(channel_count: usize, frame_count: usize) -> Self {
        Self { channels: vec![vec![0.0; frame_count.max(1)]; channel_count], end: 0, start: 0 }
    }

    pub(super) fn end(&self) -> u64 {
        self.end
    }

    fn len(&self) -> usize {
        self.channels.first().map_or(1, Vec::len)
    }

    /// Adds `frames`, interleaved and `width` samples each; `picked` lists those that become the channels, in this order.
    pub(super) fn push(&mut self, frames: &[f32], width: usize, picked: &[usize]) {
        let len = self.len();
        let first = (self.end % len as u64) as usize;
        for (channel, &place) in self.channels.iter_mut().zip(picked) {
            let samples = frames.chunks_exact(width).map(|frame| frame[place]);
            for (k, sample) in samples.enumerate() {
                channel[(first + k) % len] = sample;
            }
        }
        self.end += (frames.len() / width) as u64;
    }

    /// Skips `lost` frames: earlier samples do not continue after them.
    pub(super) fn skip(&mut self, lost: u64) {
        self.end += lost;
        self.start = self.end;
    }

    /// Whether frames `first` to `first + count - 1` are all there.
    pub(super) fn has(&self, first: u64, count: usize) -> bool {
        first >= self.start && first + count as u64 <= self.end && self.end - first <= self.len() as u64
    }

    /// The last `count` samples of the first two channels, the oldest first; fewer where fewer have come.
    pub(super) fn latest(&self, count: usize) -> [impl Iterator<Item = f32> + '_; 2] {
        let count = (count as u64).min(self.end - self.start).min(self.len() as u64);
        let frames = self.end - count..self.end;
        [0, 1]
            .map(|channel: usize| frames.clone().map(move |n| self.channels[channel][(n % self.len() as u64) as usize]))
    }

    /// Copies frames from `first` on, channel by channel, into `to` until it is full; `of` converts each sample. Only
    /// if [`Self::has`] them.
    pub(super) fn copy_to<T>(&self, first: u64, to: &mut [T], of: impl Fn(f32) -> T) {
        let (len, count) = (self.len(), to.len() / self.channels.len().max(1));
        let at = (first % len as u64) as usize;
        for (channel, to) in self.channels.iter().zip(to.chunks_exact_mut(count.max(1))) {
            let heard = channel[at..].iter().chain(&channel[..at]);
            to.iter_mut().zip(heard).for_each(|(to, &sample)| *to = of(sample));
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// Catches a frame at another's place, what is overwritten or was lost and still given, and a channel taken for another.
        #[test]
        fn what_is_there_is_what_was_heard(
            room in 1_usize..40, pieces in prop::collection::vec((0_usize..30, 0_u64..3), 1..12), first in 0_u64..200, count in 1_usize..30,
        ) {
            let mut ring = Ring::new(2, room);
            let mut heard: Vec<Option<i32>> = Vec::new();
            for (frames, lost) in pieces {
                let numbers = heard.len()..heard.len() + frames;
                let interleaved: Vec<f32> =
                    numbers.clone().flat_map(|n| [-1.0, 2.0 * n as f32, 2.0 * n as f32 + 1.0]).collect();
                // A device gives no more at once than the ring holds.
                for piece in interleaved.chunks(3 * room) {
                    ring.push(piece, 3, &[2, 1]);
                }
                heard.extend(numbers.map(|n| Some(n as i32)));
                if lost > 0 {
                    ring.skip(lost);
                    heard.fill(None);
                    heard.extend((0..lost).map(|_| None));
                }
            }
            let wanted = (first as usize..first as usize + count).map(|n| heard.get(n).copied().flatten());
            let wanted: Option<Vec<i32>> = wanted.collect();
            let in_room = heard.len() as u64 <= first + room as u64;
            prop_assert_eq!(ring.has(first, count), wanted.is_some() && in_room);
            if ring.has(first, count) {
                let mut got = vec![0; 2 * count];
                ring.copy_to(first, &mut got, |x| x as i32);
                let wanted = wanted.unwrap();
                prop_assert_eq!(&got[..count], wanted.iter().map(|n| 2 * n + 1).collect::<Vec<_>>());
                prop_assert_eq!(&got[count..], wanted.iter().map(|n| 2 * n).collect::<Vec<_>>());
            }
        }
    }
}
