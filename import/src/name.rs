//! Patterns of names, from which the taps of recordings are read: `{tyre}-{shoulder}-{location}.wav`.

use std::collections::BTreeMap;

/// Columns of `taps.csv` that a name may hold, and whether they are numbers.
const FIELDS: [(&str, Form); 11] = [
    ("tyre", Form::Text),
    ("shoulder", Form::Whole),
    ("location", Form::Whole),
    ("offset_mm", Form::Number),
    ("velocity_m_per_s", Form::Number),
    ("angle_deg", Form::Number),
    ("repetition", Form::Whole),
    ("velocity_measured_m_per_s", Form::Number),
    ("station", Form::Whole),
    ("attempt", Form::Whole),
    ("tap_time_ns", Form::Whole),
];

/// The placeholder for text without meaning.
const ANYTHING: &str = "_";

/// Maximum number of steps to read one name.
const STEPS_MAX: usize = 1_000_000;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    Text,
    Whole,
    Number,
}

impl Form {
    fn fits(self, text: &str) -> bool {
        match self {
            _ if text.is_empty() => false,
            Self::Text => true,
            Self::Whole => text.bytes().all(|byte| byte.is_ascii_digit()),
            Self::Number => {
                text.bytes().all(|byte| byte.is_ascii_digit() || b"+-.".contains(&byte)) && text.parse::<f64>().is_ok()
            }
        }
    }
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Piece {
    Text(String),
    Field(&'static str, Form),
    Anything,
}

/// A pattern.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Pattern {
    text: String,
    pieces: Vec<Piece>,
    /// Steps of the path up to the file's name, and those below the file.
    pub steps: usize,
    pub depth: usize,
}

/// What a name says of a tap, by column.
pub(crate) type Cells = BTreeMap<String, String>;

impl Pattern {
    /// The pattern that `text` spells; `is_recording` recognises file names.
    pub(crate) fn new(text: &str, is_recording: impl Fn(&str) -> bool) -> Result<Self, String> {
        let refuse = |what: String| Err(format!("name is {text:?}; {what}"));
        let mut pieces = Vec::new();
        let mut rest = text;
        while let Some((before, after)) = rest.split_once('{') {
            let Some((field, behind)) = after.split_once('}') else { return refuse("a { lacks its }".to_owned()) };
            if !before.is_empty() {
                pieces.push(Piece::Text(before.to_owned()));
            }
            let piece = match FIELDS.iter().find(|(name, _)| *name == field) {
                Some(&(name, form)) => Piece::Field(name, form),
                None if field == ANYTHING => Piece::Anything,
                None => {
                    let known = FIELDS.map(|(name, _)| name).join(", ");
                    return refuse(format!("{{{field}}} must be one of {known}, or {{_}} for text without meaning"));
                }
            };
            if piece != Piece::Anything && pieces.contains(&piece) {
                return refuse(format!("{{{field}}} is there twice"));
            }
            pieces.push(piece);
            rest = behind;
        }
        if rest.contains('}') {
            return refuse("a } lacks its {".to_owned());
        }
        if !rest.is_empty() {
            pieces.push(Piece::Text(rest.to_owned()));
        }
        let steps: Vec<&str> = text.split('/').collect();
        if steps.contains(&"") {
            return refuse("it must be a path without empty steps".to_owned());
        }
        // The step that ends as files do is the file; what follows is in it.
        let file = steps.iter().position(|step| is_recording(step)).unwrap_or(steps.len() - 1);
        Ok(Self { text: text.to_owned(), pieces, steps: file + 1, depth: steps.len() - file - 1 })
    }

    /// What `name` says; `None` if it does not fit.
    pub(crate) fn read(&self, name: &str) -> Result<Option<Cells>, String> {
        let mut walk = Walk { ways: Vec::new(), steps_left: STEPS_MAX };
        walk.on(&self.pieces, name, &mut Vec::new());
        let pattern = &self.text;
        match walk.ways.as_slice() {
            _ if walk.steps_left == 0 => {
                Err(format!("name is {pattern:?}; there are too many ways to read {name:?} with it"))
            }
            [] => Ok(None),
            [only] => Ok(Some(only.clone())),
            [first, second, ..] => {
                let differs = |(column, one): &(&String, &String)| second.get(*column) != Some(*one);
                let (column, one) = first.iter().find(differs).map_or(("", ""), |(column, one)| (column, one));
                let other = second.get(column).map(String::as_str).unwrap_or_default();
                Err(format!(
                    "name is {pattern:?}; in {name:?} {{{column}}} may be {one:?} or {other:?}: put other text between fields"
                ))
            }
        }
    }
}

struct Walk {
    /// The first two ways to read a name.
    ways: Vec<Cells>,
    steps_left: usize,
}

impl Walk {
    fn on<'a>(&mut self, pieces: &[Piece], text: &'a str, found: &mut Vec<(&'static str, &'a str)>) {
        if self.steps_left == 0 || self.ways.len() > 1 {
            return;
        }
        self.steps_left -= 1;
        let Some((piece, rest)) = pieces.split_first() else {
            let way: Cells = found.iter().map(|&(field, value)| (field.to_owned(), value.to_owned())).collect();
            if text.is_empty() && !self.ways.contains(&way) {
                self.ways.push(way);
            }
            return;
        };
        if let Piece::Text(known) = piece {
            if let Some(behind) = text.strip_prefix(known.as_str()) {
                self.on(rest, behind, found);
            }
            return;
        }
        let end = text.find('/').unwrap_or(text.len());
        for at in (0..=end).filter(|&at| text.is_char_boundary(at)) {
            let (taken, behind) = text.split_at(at);
            match piece {
                Piece::Field(name, form) if form.fits(taken) => {
                    found.push((name, taken));
                    self.on(rest, behind, found);
                    found.pop();
                }
                Piece::Anything => self.on(rest, behind, found),
                _ => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn pattern(text: &str) -> Result<Pattern, String> {
        Pattern::new(text, |name| name.ends_with(".wav") || name.ends_with(".h5"))
    }

    fn read(text: &str, name: &str) -> Result<Option<Vec<String>>, String> {
        let cells = pattern(text)?.read(name)?;
        Ok(cells.map(|cells| cells.into_iter().map(|(column, value)| format!("{column}={value}")).collect()))
    }

    /// Catches a serial that is cut at its own dash, a negative offset that loses its sign, and a reading that is chosen where
    /// there are two.
    #[test]
    fn a_name_is_read_one_way_or_not_at_all() {
        let long = "{tyre}-{shoulder}-{location}-{offset_mm}.wav";
        let want = ["location=003", "offset_mm=-5.5", "shoulder=1", "tyre=A-17"].map(str::to_owned).to_vec();
        assert_eq!(read(long, "A-17-1-003--5.5.wav"), Ok(Some(want)));
        assert_eq!(read(long, "A-17-1-x-5.wav"), Ok(None));
        let error = read("{tyre}{location}.wav", "A12.wav").unwrap_err();
        assert!(error.contains("in \"A12.wav\" {location} may be \"12\" or \"2\""), "{error}");
        let want = ["location=7", "tyre=A"].map(str::to_owned).to_vec();
        assert_eq!(read("{tyre}/{_}_{location}.wav", "A/2026-01-01_7.wav"), Ok(Some(want)));
        assert_eq!(read("{tyre}-{location}.wav", "a/b-7.wav"), Ok(None), "a step is no part of a field");
    }

    /// Catches steps below a file that are taken for folders, and a wrong pattern that is accepted.
    #[test]
    fn the_file_is_found_in_a_pattern() {
        let steps = |text: &str| pattern(text).map(|pattern| (pattern.steps, pattern.depth));
        assert_eq!(steps("{tyre}/{location}.wav"), Ok((2, 0)));
        assert_eq!(steps("x/{tyre}.h5/{shoulder}/{location}"), Ok((2, 2)));
        for (text, want) in [
            ("{tyre", "a { lacks its }"),
            ("tyre}.wav", "a } lacks its {"),
            ("{speed}.wav", "{speed} must be one of tyre, shoulder"),
            ("{tyre}{tyre}.wav", "{tyre} is there twice"),
            ("/{tyre}.wav", "without empty steps"),
        ] {
            let error = steps(text).unwrap_err();
            assert!(error.contains(want), "{error:?} lacks {want:?}");
        }
    }

    proptest! {
        /// Catches a panic, and a name that is tried for ever.
        #[test]
        fn no_name_makes_it_panic(
            text in "(\\{tyre\\}|\\{_\\}|\\{location\\}|[{}/a1é-]){0,9}", name in "[a1é/-]{0,60}"
        ) {
            let _unused = read(&text, &name);
        }
    }
}
