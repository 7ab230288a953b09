//! Whether most of a shoulder is sound, by the word of something that is known to be.

use crate::stats::{Spread, median};

/// Whether the middle of `index` lies within `limit` robust standard deviations of the middle of `prior`, the index of
/// something else by the same scale: the other shoulder, a named one, or the archive's of that construction.
///
/// Centring by a shoulder's own median calls the damage normal as soon as more than half of it is damaged; what it has in
/// common with nothing else is then the only sign. `None` when either has too few values, or the prior no scatter.
pub fn has_sound_majority(index: &[Option<f64>], prior: &[Option<f64>], limit: f64) -> Option<bool> {
    let numbers = |of: &[Option<f64>]| of.iter().copied().flatten().filter(|x| x.is_finite()).collect::<Vec<f64>>();
    let Spread { centre, sigma } = Spread::of(&mut numbers(prior))?;
    let mut numbers = numbers(index);
    Spread::of(&mut numbers.clone())?;
    Some((median(&mut numbers)? - centre) / sigma <= limit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_prior_decides_not_the_shoulder() {
        // Catches a shoulder that is centred by itself, a limit on the wrong side, and NaN that decides.
        let sound: Vec<Option<f64>> = (0..100_u32).map(|i| Some(f64::from(i * 37 % 100) * 0.02 - 1.0)).collect();
        let damaged = |share: usize| -> Vec<Option<f64>> {
            sound.iter().enumerate().map(|(i, x)| x.map(|x| if i < share { x + 6.0 } else { x })).collect()
        };
        let says = |index: &[Option<f64>]| has_sound_majority(index, &sound, 3.0);
        assert_eq!((says(&sound), says(&damaged(40))), (Some(true), Some(true)));
        assert_eq!((says(&damaged(60)), says(&damaged(100))), (Some(false), Some(false)));
        let better: Vec<Option<f64>> = sound.iter().map(|x| x.map(|x| x - 60.0)).collect();
        assert_eq!(says(&better), Some(true), "better than the prior is sound");
        assert_eq!(says(&[None; 100]), None);
        assert_eq!(has_sound_majority(&sound, &[Some(1.0); 100], 3.0), None, "a prior without scatter");
        let mut gaps = damaged(60);
        gaps[99] = Some(f64::NAN);
        assert_eq!(says(&gaps), Some(false));
    }
}
