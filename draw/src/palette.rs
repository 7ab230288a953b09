//! The colours of curves that share a pair of axes.

use plotters::style::RGBColor;

use crate::canvas::{BLUE, ORANGE, VERMILLION};

/// One more of Okabe and Ito's colours.
pub const GREEN: RGBColor = RGBColor(0, 158, 115);

/// Colours of curves, in order; neighbours differ in brightness too.
pub const COLORS: [RGBColor; 4] = [BLUE, VERMILLION, GREEN, ORANGE];
