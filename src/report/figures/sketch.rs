//! How to find an angle on a casing: a sketch of it from the side, with the mark where angles begin.

use maud::{Markup, html};

/// The sketch; `mark` is what marks 0 degrees, `side` is the side from which it is seen.
pub(crate) fn casing(mark: &str, side: &str) -> Markup {
    html! {
        svg class="sketch" viewBox="0 0 300 214" role="img" aria-label={ "0 degrees is at " (mark) "; angles run clockwise, seen from " (side) } {
            g fill="none" stroke="#222" stroke-width="2" {
                circle cx="150" cy="112" r="76" {}
                circle cx="150" cy="112" r="46" {}
                path d="M150 66 A46 46 0 0 1 189.8 135" stroke="#0072b2" stroke-width="3" {}
                path d="M189.8 135 l2 -13 m-2 13 l11 -7" stroke="#0072b2" stroke-width="3" {}
            }
            path d="M150 36 l-7 -14 h14 z" fill="#222" {}
            g font-size="13" fill="#222" {
                text x="150" y="16" text-anchor="middle" { "0°: " (mark) }
                text x="150" y="208" text-anchor="middle" { "seen from " (side) }
                text x="234" y="116" { "90°" }
                text x="66" y="116" text-anchor="end" { "270°" }
                text x="150" y="182" text-anchor="middle" { "180°" }
            }
        }
    }
}
