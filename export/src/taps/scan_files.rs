//! Folders with one file for each shoulder: it has one verdict, and is one test for programs that analyse vibration.
//!
//! Beside the files, `taps.csv` lists every planned tap, and its file or why it has none.

use std::fmt;
use std::fs::File;
use std::path::{Path, PathBuf};

use tapline_store::Reader;
use tapline_wire::Scan;

use crate::folder::Draft;
use crate::taps::{COLUMNS, ListedTap, TapCounts, TapFolder, Taps, cells, known, scan_names};
use crate::{Error, Result};

/// The columns after [`COLUMNS`], as `tapline import` takes them: which part of its file a tap is, from 1, and the distance that
/// times of the sound are counted with.
const OWN_COLUMNS: [&str; 2] = ["part", "microphone_distance_m"];

/// Lists a tap with the part of the file that it is; with none where the file does not have it.
pub(crate) type List<'a> = dyn FnMut(&ListedTap<'_>, &str) -> Result<()> + 'a;

/// What a file for a shoulder is.
pub(crate) trait ScanFormat: fmt::Debug {
    /// How its name ends.
    const ENDING: &'static str;

    /// Writes the taps of `scan`, called `name`, to `path`, and lists each.
    fn write(&self, taps: &Taps<'_>, scan: &Scan, name: &str, path: &Path, list: &mut List<'_>) -> Result<()>;
}

/// A folder of such files.
#[derive(Debug)]
pub(crate) struct ScanFiles<F> {
    format: F,
    draft: Draft,
    list: csv::Writer<File>,
    counts: TapCounts,
    last: PathBuf,
}

impl<F: ScanFormat> ScanFiles<F> {
    pub(crate) fn begin(folder: &Path, format: F) -> Result<Self> {
        let draft = Draft::new(folder)?;
        let mut list = csv::Writer::from_path(draft.path("taps.csv")?)?;
        list.write_record(COLUMNS.iter().chain(&OWN_COLUMNS))?;
        Ok(Self { format, draft, list, counts: TapCounts::default(), last: folder.to_owned() })
    }
}

impl<F: ScanFormat> TapFolder for ScanFiles<F> {
    fn add(&mut self, reader: &Reader, on_part: &dyn Fn(f64)) -> Result<()> {
        let (plan, taps) = (reader.plan(), Taps::new(reader, on_part));
        let file_of = |name: &str| format!("{name}.{}", F::ENDING);
        let names = scan_names(plan, |name| self.draft.has(&file_of(name)));
        for (scan, name) in plan.scans().iter().zip(names) {
            let file = file_of(&name);
            let path = self.draft.path(&file)?;
            let mut list = |tap: &ListedTap<'_>, part: &str| {
                let header = tap.record.as_ref().ok().map(|(header, _)| header);
                let distance_m = known(header.map(|header| header.microphone_distance_m));
                let own = [part, &distance_m];
                Ok(self.list.write_record(cells(tap, &file).iter().map(String::as_str).chain(own))?)
            };
            self.format.write(&taps, scan, &name, &path, &mut list)?;
        }
        self.counts = self.counts.and(taps.counts());
        reader.path().clone_into(&mut self.last);
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<TapCounts> {
        let Self { draft, mut list, counts, last, .. } = *self;
        list.flush().map_err(|error| Error::Csv(error.into()))?;
        drop(list);
        let counts = counts.if_any(&last)?;
        draft.finish()?;
        Ok(counts)
    }
}
