//! Evaluates judged shoulders whose truth is known, simulated or scanned in a plant: ROC curves, detection, false calls,
//! gauge studies; and tables and figures of them.

mod areas;
mod call;
mod detection;
mod draw;
mod gauge;
mod page;
mod table;

pub(crate) use areas::{Areas, FALSE_ALARMS, FoundAt, TYRES_MIN};
pub(crate) use call::Call;
pub(crate) use detection::{DETECTION_COLUMNS, Detection, Target};
pub(crate) use draw::{HALF_BOX, Key, Mark, Picture, Plot, axis, keys};
pub(crate) use gauge::{GAUGE_COLUMNS, GaugedBy, gauge_cells};
pub(crate) use page::{files_of, page_of, print_tables};
pub(crate) use table::{Cell, Table, cell, ends, rounded, yes_or_no};
