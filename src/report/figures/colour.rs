//! Colours of small and large values, distinguished by lightness only.

use plotters::prelude::*;

/// Fill colour of a place without a value.
pub(crate) const ABSENT: RGBColor = RGBColor(232, 232, 232);

/// From low to high: ColorBrewer's YlGnBu. Its lightness falls steadily, so that it can be read without colours too.
const STEPS: [RGBColor; 9] = [
    RGBColor(255, 255, 217),
    RGBColor(237, 248, 177),
    RGBColor(199, 233, 180),
    RGBColor(127, 205, 187),
    RGBColor(65, 182, 196),
    RGBColor(29, 145, 192),
    RGBColor(34, 94, 168),
    RGBColor(37, 52, 148),
    RGBColor(8, 29, 88),
];

/// The colour of `value` between `low` and `high`: pale if low, so that a sound casing needs little ink.
pub(crate) fn heat(value: f64, (low, high): (f64, f64)) -> RGBColor {
    let fraction = if high > low { ((value - low) / (high - low)).clamp(0.0, 1.0) } else { 0.0 };
    DerivedColorMap::new(&STEPS).get_color(fraction)
}
