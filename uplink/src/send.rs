//! The station's end: publishes each finished file for which no centre has given a receipt.
//!
//! Nothing is written on the station's disk: what was sent is known by the receipts, so that nothing can disagree with them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, UNIX_EPOCH};

use anyhow::Result;
use futures_util::{StreamExt as _, TryStreamExt as _, stream};

use crate::file::{CasingFile, Site};
use crate::jetstream::{JetStream, Unreadable};
use crate::receipt::{Fate, Receipt};
use crate::server::Server;
use crate::session::{self, Trouble, Until};
use crate::staging::digest_of;

/// How many files of a site may be on their way at once: what a server has to keep for it.
pub const WINDOW: usize = 8;

/// How often the folder is looked into, and receipts are asked for: when a file is on its way, and when none is.
const LOOK_EVERY: (Duration, Duration) = (Duration::from_millis(200), Duration::from_secs(1));

/// After how long without a receipt the server is asked for a file, and reminded of it.
const ASK_AFTER: Duration = Duration::from_secs(30);

/// After how long it is logged that nobody takes what waits.
const WARN_AFTER: Duration = Duration::from_secs(60);

/// How often all receipts are asked for again: they may have been removed, so that files are sent again.
const RECONCILE_EVERY: Duration = Duration::from_secs(3600);

/// How many receipts are asked for at once.
const ASKED_AT_ONCE: usize = 32;

/// A folder of finished files, and where they go.
#[derive(Debug, Clone)]
pub struct Sender {
    /// The folder of a line.
    pub folder: PathBuf,
    /// This host's name at the centre.
    pub site: Site,
    /// Bucket of the server.
    pub bucket: String,
    /// Whether files that a centre has refused are sent again, once.
    pub again: bool,
}

/// What has become of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sent {
    /// The file.
    pub file: CasingFile,
    /// What a centre says of it.
    pub receipt: Receipt,
}

/// The state of a folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Standing {
    /// Finished files in it.
    pub files: usize,
    /// How many of them a centre has.
    pub at_centre: usize,
}

/// What is known of a file of the folder.
#[derive(Debug, Clone)]
enum State {
    /// No centre has said anything of it, and the server does not have it.
    Unsent,
    /// It could not be read when this was tried last.
    Unreadable(Instant),
    /// The server had it when it was asked last; `None`: since this connection it was not asked.
    Waits { digest: Option<String>, asked: Option<Instant> },
    /// A centre has spoken, of this file or of another of its name; `is_due`: it is to be asked again.
    Settled { receipt: Receipt, is_same: bool, is_due: bool },
}

impl State {
    fn is_settled(&self) -> bool {
        matches!(self, Self::Settled { .. })
    }

    /// Whether a receipt is to be asked for.
    fn is_asked(&self) -> bool {
        match self {
            Self::Waits { .. } | Self::Settled { is_due: true, .. } => true,
            // It may be the receipt that could not be read.
            Self::Unreadable(at) => at.elapsed() >= ASK_AFTER,
            Self::Unsent | Self::Settled { .. } => false,
        }
    }
}

/// Sends the files of a folder until `until`; returns how many have reached a centre. `finished` lists the paths below the folder, and
/// `report` gets each that was sent or refused, once.
///
/// # Errors
/// A runtime that cannot be started and, if this is done once, trouble that lasts for a minute. Other troubles are
/// logged, and it is tried again.
pub fn send(
    server: &Server,
    sender: &Sender,
    until: &Until,
    mut finished: impl FnMut() -> Result<Vec<PathBuf>>,
    mut report: impl FnMut(&Sent),
) -> Result<Standing> {
    let now = Instant::now();
    let mut sending =
        Sending { sender, files: BTreeMap::new(), again: sender.again, reconciled: now, taken: now, has_warned: false };
    session::run(until, async |trouble| {
        let carrier = JetStream::connect(server, &format!("tapline uplink {}", sender.site), &sender.bucket).await?;
        sending.attempt(&carrier, until, &mut finished, &mut report, trouble).await
    })?;
    let is_received = |state: &&State| matches!(state, State::Settled { receipt, is_same: true, .. } if receipt.fate == Fate::Received);
    Ok(Standing { files: sending.files.len(), at_centre: sending.files.values().filter(is_received).count() })
}

struct Sending<'a> {
    sender: &'a Sender,
    files: BTreeMap<PathBuf, State>,
    again: bool,
    reconciled: Instant,
    /// When a centre took a file last, or none waited.
    taken: Instant,
    has_warned: bool,
}

impl Sending<'_> {
    /// Sends until there is trouble, or nothing is left to send and that is all that was asked.
    async fn attempt(
        &mut self,
        carrier: &JetStream,
        until: &Until,
        finished: &mut impl FnMut() -> Result<Vec<PathBuf>>,
        report: &mut impl FnMut(&Sent),
        trouble: &mut Trouble,
    ) -> Result<()> {
        // What ended the last connection may also have lost files on the server.
        for state in self.files.values_mut() {
            if let State::Waits { asked, .. } = state {
                *asked = None;
            }
        }
        loop {
            if self.reconciled.elapsed() > RECONCILE_EVERY {
                for state in self.files.values_mut() {
                    if let State::Settled { is_due, .. } = state {
                        *is_due = true;
                    }
                }
                self.reconciled = Instant::now();
            }
            let since = Instant::now();
            let paths = finished()?;
            let listed_in = since.elapsed();
            // What was taken out of the folder is no longer sent.
            let listed: BTreeSet<&PathBuf> = paths.iter().collect();
            self.files.retain(|path, _| listed.contains(path));
            self.ask(carrier, &paths, report).await?;
            self.again = false;
            for path in &paths {
                self.put(carrier, path, trouble).await?;
            }
            trouble.ends();
            let is_unreadable = |state: &State| matches!(state, State::Unreadable(_));
            let is_done = |path: &PathBuf| self.files.get(path).is_some_and(|s| s.is_settled() || is_unreadable(s));
            if until.is_over() || (until.is_once && paths.iter().all(is_done)) {
                return Ok(());
            }
            let is_busy = self.files.values().any(|state| matches!(state, State::Waits { .. }));
            self.warn_of_waiting(is_busy);
            // A folder of years may take long to list: a twentieth of the time at most goes into that.
            until.wait(if is_busy { LOOK_EVERY.0 } else { LOOK_EVERY.1 }.max(20 * listed_in)).await;
        }
    }

    /// Logs when no centre takes what waits, and when one does again.
    fn warn_of_waiting(&mut self, is_busy: bool) {
        if !is_busy {
            self.taken = Instant::now();
        }
        let is_waiting = self.taken.elapsed() > WARN_AFTER;
        if is_waiting != self.has_warned {
            let what = format!("no collector takes the files that wait in the bucket {}", self.sender.bucket);
            match is_waiting {
                true => tracing::warn!("for {} s {what}", WARN_AFTER.as_secs()),
                false => tracing::warn!("over: {what}"),
            }
        }
        self.has_warned = is_waiting;
    }

    /// Asks for the receipts of files that wait, and of those of which nothing is known yet.
    async fn ask(&mut self, carrier: &JetStream, paths: &[PathBuf], report: &mut impl FnMut(&Sent)) -> Result<()> {
        let mut asked = Vec::new();
        for path in paths {
            if self.files.get(path).is_some_and(|state| !state.is_asked()) {
                continue;
            }
            match CasingFile::new(&self.sender.site, path) {
                Ok(file) => asked.push((path.clone(), file)),
                Err(error) => {
                    tracing::error!("not sent: {error:#}");
                    self.files.insert(path.clone(), State::Unreadable(Instant::now()));
                }
            }
        }
        let ask = |(path, file): (PathBuf, CasingFile)| async move {
            let receipt = match carrier.receipt(&file).await {
                // That concerns this file alone.
                Err(error) if error.is::<Unreadable>() => Err(error),
                receipt => Ok(receipt?),
            };
            anyhow::Ok((path, file, receipt))
        };
        let mut answers = stream::iter(asked).map(ask).buffered(ASKED_AT_ONCE);
        while let Some((path, file, receipt)) = answers.try_next().await? {
            match receipt {
                Err(error) => drop(self.files.insert(path, unreadable(&error))),
                Ok(Some(receipt)) => {
                    let is_same = self.is_of(&path, &receipt);
                    // What was refused may be another file by now, such as one that was damaged then.
                    if matches!(receipt.fate, Fate::Refused(_)) && (self.again || !is_same) {
                        carrier.forget(&file).await?;
                        self.files.insert(path, State::Unsent);
                    } else {
                        self.settle(path, file, receipt, is_same, report);
                    }
                }
                Ok(None) if matches!(self.files.get(&path), Some(State::Waits { .. })) => {}
                Ok(None) => drop(self.files.insert(path, State::Unsent)),
            }
        }
        Ok(())
    }

    /// Whether `receipt` is of the file at `path`, and not of another of that name.
    fn is_of(&self, path: &Path, receipt: &Receipt) -> bool {
        match self.files.get(path) {
            Some(State::Waits { digest: Some(digest), .. }) => *digest == receipt.digest,
            Some(State::Settled { receipt: before, is_same, .. }) if before == receipt => *is_same,
            // Sent before this process began. A file is never written again: another of that name differs in its size or, if it
            // was written after the receipt, in its digest.
            _ => {
                let there = self.sender.folder.join(path);
                there.metadata().is_ok_and(|metadata| {
                    let written = metadata.modified().ok().and_then(|at| at.duration_since(UNIX_EPOCH).ok());
                    let written = written.and_then(|written| i64::try_from(written.as_nanos()).ok());
                    let is_old = written.is_some_and(|written| written <= receipt.at_ns);
                    let digest = || digest_of(&there).ok().flatten().map(|(digest, _)| digest);
                    metadata.len() == receipt.bytes && (is_old || digest().as_ref() == Some(&receipt.digest))
                })
            }
        }
    }

    /// Settles a file by its receipt, and passes it to `report` if it is news: a file that was there before this process
    /// began is none.
    fn settle(
        &mut self,
        path: PathBuf,
        file: CasingFile,
        receipt: Receipt,
        is_same: bool,
        report: &mut impl FnMut(&Sent),
    ) {
        let state = State::Settled { receipt: receipt.clone(), is_same, is_due: false };
        let there = self.sender.folder.join(&path);
        let before = self.files.insert(path, state);
        if matches!(&before, Some(State::Settled { receipt: before, .. }) if *before == receipt) {
            return;
        }
        let receipt = match is_same {
            true => receipt,
            false => {
                let why = format!("{} has another file of this name: give this one another name", receipt.collector);
                Receipt { fate: Fate::Refused(why), ..receipt }
            }
        };
        match &receipt.fate {
            Fate::Received if before.is_none() => return,
            Fate::Received => self.taken = Instant::now(),
            Fate::Refused(why) => tracing::error!("{} is not taken by the centre: {why}", there.display()),
        }
        report(&Sent { file, receipt });
    }

    /// Publishes the file at `path` if it has no receipt and is not on the server, and not too many are on their way.
    async fn put(&mut self, carrier: &JetStream, path: &PathBuf, trouble: &mut Trouble) -> Result<()> {
        let (is_sent, digest) = match self.files.get(path) {
            None | Some(State::Settled { .. }) => return Ok(()),
            Some(State::Waits { asked: Some(asked), .. } | State::Unreadable(asked)) if asked.elapsed() < ASK_AFTER => {
                return Ok(());
            }
            Some(State::Waits { digest, .. }) => (true, digest.clone()),
            Some(State::Unsent | State::Unreadable(_)) => (false, None),
        };
        let count = self.files.values().filter(|state| matches!(state, State::Waits { .. })).count();
        if !is_sent && count >= WINDOW {
            return Ok(());
        }
        let Ok(file) = CasingFile::new(&self.sender.site, path) else { return Ok(()) };
        let there = self.sender.folder.join(path);
        let state = match there.metadata() {
            Ok(metadata) if carrier.remind(&file).await? == Some(metadata.len()) => {
                State::Waits { digest, asked: Some(Instant::now()) }
            }
            Ok(metadata) => {
                if is_sent {
                    tracing::warn!("{file} was lost on its way: it is sent again");
                }
                match carrier.publish(&file, &there).await {
                    Ok(digest) => {
                        tracing::info!("sent {file}: {} bytes", metadata.len());
                        trouble.starts_over();
                        State::Waits { digest: Some(digest), asked: Some(Instant::now()) }
                    }
                    Err(error) => match digest_of(&there) {
                        Ok(_) => return Err(error),
                        // It is the file that cannot be read: the others are sent.
                        Err(error) => unreadable(&error),
                    },
                }
            }
            // It was taken out of the folder just now.
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
            Err(error) => unreadable(&anyhow::Error::new(error).context(format!("cannot read {}", there.display()))),
        };
        self.files.insert(path.clone(), state);
        Ok(())
    }
}

/// A file that cannot be read now; the others are sent.
fn unreadable(error: &anyhow::Error) -> State {
    tracing::error!("not sent: {error:#}");
    State::Unreadable(Instant::now())
}
