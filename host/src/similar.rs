//! Which known name an unknown one probably means.

/// How similar two names must be, from 0 to 1, for one to be a typo of the other.
const ALIKE: f64 = 0.8;

/// The most similar of `known` to `name`, if one is similar enough.
pub fn most_like<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // One letter extra, missing, wrong or swapped with its neighbour counts little, even in a short name.
    let is_one_off = |known: &str| known.len() > 2 && strsim::damerau_levenshtein(name, known) == 1;
    let score = |known: &str| if is_one_off(known) { 1.0 } else { strsim::jaro_winkler(name, known) };
    let alike = known.into_iter().map(|known| (score(known), known)).filter(|(score, _)| *score >= ALIKE);
    alike.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, known)| known)
}

/// `did you mean "KNOWN"?`, if one of `known` is like `name`.
pub fn did_you_mean<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<String> {
    most_like(name, known).map(|known| format!("did you mean {known:?}?"))
}

/// `did you mean "KNOWN"?` for the name that the reader of a TOML file or a table refuses in `message`: it quotes this name and
/// then the known ones.
pub fn meant_instead(message: &str) -> Option<String> {
    if let Some((before, known)) = message.split_once(" is not a discriminator; known: ") {
        let name = before.trim_end_matches('"').rsplit('"').next()?;
        return did_you_mean(name, known.lines().next()?.split(", "));
    }
    if let Some((_, column)) = message.split_once("unknown column \"") {
        let (name, known) = column.split_once("\"; the columns are ")?;
        return did_you_mean(name, known.split_once(", in any order")?.0.split(','));
    }
    let refused = ["unknown field `", "unknown variant `"].iter().find_map(|begin| message.split_once(begin));
    let mut names = refused?.1.lines().next()?.split('`').step_by(2);
    let name = names.next()?;
    did_you_mean(name, names)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a slip without help, and help that leads astray.
    #[test]
    fn a_slip_is_recognised_and_a_stranger_is_not() {
        let known = ["f_max", "f_hi_hz", "tau", "velocities_m_per_s"];
        assert_eq!(most_like("f_hi", known), Some("f_hi_hz"));
        assert_eq!(most_like("velocity_m_per_s", known), Some("velocities_m_per_s"));
        assert_eq!(did_you_mean("tua", known).as_deref(), Some("did you mean \"tau\"?"));
        assert_eq!(most_like("colour", known), None);
    }

    /// Catches a name that is taken from the wrong place of a message.
    #[test]
    fn what_a_file_means_is_found_in_the_refusal() {
        let refusal = "a.toml: TOML parse error at line 1\nunknown field `ofset`, expected one of `offset`, `angle`\n";
        assert_eq!(meant_instead(refusal).as_deref(), Some("did you mean \"offset\"?"));
        let refusal = "taps.csv line 1: unknown column \"tire\"; the columns are file,tyre,shoulder, in any order";
        assert_eq!(meant_instead(refusal).as_deref(), Some("did you mean \"tyre\"?"));
        assert_eq!(meant_instead("cannot read `ofset`, expected `offset`"), None);
    }
}
