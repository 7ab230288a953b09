//! How a program that a test has run ended.

use std::process::Output;

use serde_json::Value;

/// How a program ended, and what it wrote.
#[derive(Debug)]
pub struct Done {
    /// Its exit code; `None` of one that a signal has ended.
    pub code: Option<i32>,
    /// Its standard output.
    pub out: String,
    /// Its standard error.
    pub err: String,
}

impl From<Output> for Done {
    fn from(output: Output) -> Self {
        let [out, err] = [output.stdout, output.stderr]
            .map(|text| String::from_utf8(text).unwrap_or_else(|error| panic!("not text: {error}")));
        Self { code: output.status.code(), out, err }
    }
}

impl Done {
    /// The last JSON value that it printed, after checking that it ended with `code`.
    ///
    /// # Panics
    /// If it ended with another code, or printed anything but JSON, or nothing.
    pub fn json(&self, code: i32) -> Value {
        assert_eq!(self.code, Some(code), "{self:#?}");
        let last = serde_json::Deserializer::from_str(&self.out).into_iter().last();
        last.and_then(Result::ok).unwrap_or_else(|| panic!("no JSON: {self:#?}"))
    }

    /// Itself, after checking that it ended with `code`.
    ///
    /// # Panics
    /// If it ended with another.
    pub fn expect(self, code: i32) -> Self {
        assert_eq!(self.code, Some(code), "{self:#?}");
        self
    }
}
