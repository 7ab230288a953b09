//! The simulator `plate` as a source of taps, like a line of `model`.

use anyhow::Result;
use tapline_acquire::{About, Refusal, Source};
use tapline_plate::{Line, Population, Tyre};
use tapline_wire::{CacheLine, Plan, SourceKind, TapHeader, f32_of_mut};

#[derive(Debug)]
pub(super) struct PlateLine {
    about: About,
    line: Line,
}

impl PlateLine {
    pub(super) fn new(population: &Population, seed: u64, tyres: &[Tyre], plan: &Plan) -> Result<Self> {
        let line = Line::new(population, seed, tyres, plan)?;
        Ok(Self { about: About { plan: plan.clone(), kind: SourceKind::Simulated, can_retake: true, room: 0 }, line })
    }
}

impl Source for PlateLine {
    fn about(&self) -> &About {
        &self.about
    }

    fn fill(&mut self, header: &mut TapHeader, buffer: &mut [CacheLine]) -> Result<(), Refusal> {
        self.line.record(header, f32_of_mut(buffer));
        Ok(())
    }
}
