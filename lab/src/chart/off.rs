//! Defaults that are off their fronts, and why they are what they are.

/// A default that another point beats by more than the noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Off {
    pub panel: &'static str,
    /// Name of the facet.
    pub facet: &'static str,
    /// Name of its point.
    pub default: &'static str,
    /// Why it is the default.
    pub why: &'static str,
}

/// All of them. A test requires an entry for each default that is off its front in the committed atlas, and none for one
/// on it.
pub(crate) const OFF: [Off; 4] = [
    Off {
        panel: "force",
        facet: "tau",
        default: "tau = \"half_sine\"",
        why: "the error here is a common factor, which an index divides out: with `width_02`, which is nearer to the contact, the index finds \
              fewer cracks (panel `settings`)",
    },
    Off {
        panel: "force",
        facet: "tau-plate",
        default: "tau = \"half_sine\"",
        why: "the simulators disagree: with `impulse` tau alone finds more cracks of `plate` and fewer of `model`; what the index finds, \
              on which verdicts rest, differs by about the tolerance (panel `settings`)",
    },
    Off {
        panel: "settings",
        facet: "plate",
        default: "the default",
        why: "the method defines tau so, and the simulators disagree: with `impulse` the index finds more cracks of `plate`, by about the \
              tolerance, and no more of `model`",
    },
    Off {
        panel: "index",
        facet: "model-locations",
        default: "index = \"fused\", four offsets",
        why: "the index is the same in both; which offsets a scan has is the question of the panel `plans`",
    },
];

/// Why `default` is the default of `facet`, if it is known to be off.
pub(crate) fn why(panel: &str, facet: &str, default: &str) -> Option<&'static str> {
    let of = |off: &&Off| off.panel == panel && off.facet == facet && off.default == default;
    OFF.iter().find(of).map(|off| off.why)
}
