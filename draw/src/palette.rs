//! The colours of curves that share a pair of axes.

use plotters::style::RGBColor;

use crate::canvas::{BLUE, ORANGE, VERMILLION};

// More of Okabe and Ito's colours.
/// Bluish green.
pub const GREEN: RGBColor = RGBColor(0, 158, 115);
/// Reddish purple.
pub const PURPLE: RGBColor = RGBColor(204, 121, 167);
/// Sky blue.
pub const SKY: RGBColor = RGBColor(86, 180, 233);

/// Colours of curves, in order; neighbours differ in brightness too.
pub const COLORS: [RGBColor; 4] = [BLUE, VERMILLION, GREEN, ORANGE];
