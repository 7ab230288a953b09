//! How much is measured: the default, and what `--quick` does.

#[derive(Debug, Clone)]
pub(crate) struct Size {
    /// Seeds of everything that is simulated.
    pub seed_count: u64,
    /// Alternating rounds that measure processor time.
    pub rounds: usize,
    /// Taps that pass through a kernel in a round.
    pub taps: usize,
    /// Contacts per seed.
    pub contacts: usize,
    /// Taps per pulse and seed.
    pub pulses: u32,
    /// Casings per seed, simulator and population, in the order reference, sound, faint, strong.
    pub casings: Casings,
    /// The same for casings that are recorded whole and read in many ways.
    pub recorded: Casings,
    /// Tyres of each set of the study, and seeds of these.
    pub study: (usize, u64),
    /// Whether everything is tried: three velocities, all scenes, all sizes; if not, some.
    pub is_full: bool,
    /// Numbers of casings that make a reference.
    pub reference_sizes: Vec<usize>,
    /// Records of 64 KiB that are sent over each hop in a round; of larger ones fewer.
    pub hops: u64,
    /// Records of a paced run.
    pub paced: u64,
    pub hop_rounds: usize,
}

/// How many casings of each kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Casings {
    pub reference: usize,
    pub sound: usize,
    pub cracked: usize,
}

impl Size {
    /// The default: a quarter of an hour on two cores.
    pub(crate) fn full() -> Self {
        Self {
            seed_count: 5,
            rounds: 31,
            taps: 64,
            contacts: 200,
            pulses: 300,
            casings: Casings { reference: 12, sound: 10, cracked: 8 },
            recorded: Casings { reference: 8, sound: 0, cracked: 8 },
            study: (8, 4),
            is_full: true,
            reference_sizes: vec![1, 2, 4, 6, 8, 12],
            hops: 4_000,
            paced: 300,
            hop_rounds: 5,
        }
    }

    /// Enough to see that all of it works: less than a minute.
    pub(crate) fn quick() -> Self {
        Self {
            seed_count: 2,
            rounds: 7,
            taps: 16,
            contacts: 40,
            pulses: 40,
            casings: Casings { reference: 4, sound: 6, cracked: 2 },
            recorded: Casings { reference: 4, sound: 0, cracked: 2 },
            study: (8, 0),
            is_full: false,
            reference_sizes: vec![2, 4],
            hops: 300,
            paced: 50,
            hop_rounds: 2,
        }
    }
}
