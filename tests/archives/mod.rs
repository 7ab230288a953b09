//! Work with finished archives: exports, pages, results with other options.

pub(crate) mod export_taps;
mod folders;
mod import;
mod other_readers;
mod python_pages;
mod report;
mod reprocess;
