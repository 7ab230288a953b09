//! The alarm that the records of a station's taps cannot be used.
//!
//! The archive asks for such taps again. One record may be bad by chance, and a place may give a bad one each time; several places in
//! a row show that a sensor is dead.

use tapline_wire::OVER;

/// Places in a row with an unusable record that raise it.
const IN_A_ROW: u32 = 5;

/// What the archive made of a tap that could still be taken again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Answer {
    /// It is kept.
    Kept,
    /// It is asked for again, and this was the first attempt at its place.
    FirstAgain,
    /// It is asked for again, after an earlier attempt: it comes of places that are bad already, so many in a row mean nothing.
    StillAgain,
}

/// The taps of a station in a row that must be taken again. It outlasts a casing: a dead sensor does too.
#[derive(Debug, Default)]
pub(crate) struct Unusable {
    in_a_row: u32,
    is_raised: bool,
}

impl Unusable {
    /// Takes note of the next answer; returns the alarm that is due, or the end of it.
    pub(crate) fn note(&mut self, answer: Answer) -> Option<String> {
        match answer {
            Answer::StillAgain => None,
            Answer::FirstAgain => {
                self.in_a_row = self.in_a_row.saturating_add(1);
                let is_due = self.in_a_row >= IN_A_ROW && !std::mem::replace(&mut self.is_raised, true);
                is_due.then(alarm)
            }
            Answer::Kept => {
                self.in_a_row = 0;
                std::mem::take(&mut self.is_raised).then(|| format!("{OVER}{}", alarm()))
            }
        }
    }
}

/// It names no casing, because its end may come with the next one.
fn alarm() -> String {
    format!(
        "the last {IN_A_ROW} taps had no usable record and are taken again: look at the microphone, the force sensor and their cables"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The alarms at each of `answers`, by its place among them: `k` for a tap that is kept, `a` and `s` for one that is asked for again
    /// after its first or a later attempt.
    fn alarms(answers: &str) -> Vec<(usize, String)> {
        let mut unusable = Unusable::default();
        let answers = answers.chars().map(|c| match c {
            'k' => Answer::Kept,
            'a' => Answer::FirstAgain,
            _ => Answer::StillAgain,
        });
        answers.enumerate().filter_map(|(at, answer)| Some((at, unusable.note(answer)?))).collect()
    }

    /// Catches a dead microphone without an alarm, an alarm for each tap, one that is never over or over twice, one of a bad tap
    /// now and then, and one of the places of a casing that are bad each time.
    #[test]
    fn a_dead_sensor_is_one_alarm() {
        let over = format!("{OVER}{}", alarm());
        assert_eq!(alarms("aaaaaaaaasskkk"), [(4, alarm()), (11, over.clone())]);
        assert_eq!(alarms("aaaaksaaaa"), []);
        assert_eq!(alarms("kakakaksssssssk"), []);
        let twice = alarms("aaaaakaaaaak");
        assert_eq!(twice, [(4, alarm()), (5, over.clone()), (10, alarm()), (11, over)]);
        assert!(alarm().starts_with("the last 5 taps had no usable record") && alarm().contains("the microphone"));
    }
}
