//! The station's end: publishes each finished file for which no centre has given a receipt.
//!
//! Nothing is written on the station's disk: what was sent is known by the receipts, so that nothing can disagree with them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use futures_util::{StreamExt as _, TryStreamExt as _, stream};

use crate::carrier::Carrier;
use crate::file::{CasingFile, Site};
use crate::jetstream::JetStream;
use crate::receipt::{Fate, Receipt};
use crate::server::Server;
use crate::session::{self, Trouble, Until};

/// How many files of a site may be on their way at once: what a broker has to keep for it.
pub const WINDOW: usize = 8;

/// How often the folder is looked into, and receipts are asked for: when a file is on its way, and when none is.
const LOOK_EVERY: (Duration, Duration) = (Duration::from_millis(200), Duration::from_secs(1));

/// After how long without a receipt the broker is asked for a file, and reminded of it.
const ASK_AFTER: Duration = Duration::from_secs(30);

/// How often all receipts are asked for again: a centre that has lost files removes theirs.
const RECONCILE_EVERY: Duration = Duration::from_secs(3600);

/// How many receipts are asked for at once.
const ASKED_AT_ONCE: usize = 32;

/// A folder of finished files, and where they go.
#[derive(Debug, Clone)]
pub struct Sender {
    /// The folder of a line.
    pub folder: PathBuf,
    /// As what the centre knows this host.
    pub site: Site,
    /// Bucket of the broker.
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

/// What is known of a file of the folder.
#[derive(Debug, Clone)]
enum State {
    /// The broker had it when it was asked last; `None`: since this connection it was not asked.
    Waits { digest: Option<String>, asked: Option<Instant> },
    /// A centre has spoken.
    Settled { is_received: bool },
}

/// Sends the files of a folder until it is over; whether a centre has all of them. `finished` lists the paths below the folder, and
/// `tell` hears of each file once.
///
/// # Errors
/// A runtime that cannot be started: all other troubles are logged, and it is tried again.
pub fn send(
    server: &Server,
    sender: &Sender,
    until: &Until,
    mut finished: impl FnMut() -> Result<Vec<PathBuf>>,
    mut tell: impl FnMut(&Sent),
) -> Result<bool> {
    let mut sending = Sending { sender, files: BTreeMap::new(), again: sender.again, reconciled: Instant::now() };
    session::run(until, async |trouble| {
        let broker = JetStream::connect(server, &format!("tapline uplink {}", sender.site), &sender.bucket).await?;
        sending.attempt(&broker, until, &mut finished, &mut tell, trouble).await
    })?;
    Ok(sending.files.values().all(|state| matches!(state, State::Settled { is_received: true })))
}

struct Sending<'a> {
    sender: &'a Sender,
    files: BTreeMap<PathBuf, State>,
    again: bool,
    reconciled: Instant,
}

impl Sending<'_> {
    /// Sends until there is trouble, or nothing is left to send and that is all that was asked.
    async fn attempt(
        &mut self,
        broker: &impl Carrier,
        until: &Until,
        finished: &mut impl FnMut() -> Result<Vec<PathBuf>>,
        tell: &mut impl FnMut(&Sent),
        trouble: &mut Trouble,
    ) -> Result<()> {
        // Whatever ended the last connection may have cost the broker what it had.
        for state in self.files.values_mut() {
            if let State::Waits { asked, .. } = state {
                *asked = None;
            }
        }
        loop {
            if self.reconciled.elapsed() > RECONCILE_EVERY {
                self.files.retain(|_, state| matches!(state, State::Waits { .. }));
                self.reconciled = Instant::now();
            }
            let since = Instant::now();
            let paths = finished()?;
            let listed_in = since.elapsed();
            let open: Vec<PathBuf> = paths.into_iter().filter(|path| !self.is_settled(path)).collect();
            let mut unsent = Vec::new();
            for (path, file, receipt) in self.receipts(broker, &open).await? {
                match receipt {
                    Some(receipt) if !self.is_again(broker, &file, &receipt).await? => {
                        self.settle(path, file, receipt, tell)
                    }
                    _ => unsent.push((path, file)),
                }
            }
            self.again = false;
            for (path, file) in unsent {
                self.put(broker, path, &file).await?;
            }
            trouble.ends();
            if until.is_over() {
                return Ok(());
            }
            if until.is_once && open.iter().all(|path| self.is_settled(path)) {
                return Ok(());
            }
            let is_busy = self.files.values().any(|state| matches!(state, State::Waits { .. }));
            // A folder of years may take long to list: a twentieth of the time at most goes into that.
            until.wait(if is_busy { LOOK_EVERY.0 } else { LOOK_EVERY.1 }.max(20 * listed_in)).await;
        }
    }

    fn is_settled(&self, path: &Path) -> bool {
        matches!(self.files.get(path), Some(State::Settled { .. }))
    }

    /// The receipts of the files at `paths`; a file whose name cannot be sent is settled.
    async fn receipts(
        &mut self,
        broker: &impl Carrier,
        paths: &[PathBuf],
    ) -> Result<Vec<(PathBuf, CasingFile, Option<Receipt>)>> {
        let mut named = Vec::new();
        for path in paths {
            match CasingFile::new(&self.sender.site, path) {
                Ok(file) => named.push((path.clone(), file)),
                Err(error) => {
                    tracing::error!("not sent: {error:#}");
                    self.files.insert(path.clone(), State::Settled { is_received: false });
                }
            }
        }
        let ask = |(path, file): (PathBuf, CasingFile)| async move {
            let receipt = broker.receipt(&file).await?;
            anyhow::Ok((path, file, receipt))
        };
        stream::iter(named).map(ask).buffered(ASKED_AT_ONCE).try_collect().await
    }

    /// Whether a file that was refused is to be sent again; its receipt is removed then.
    async fn is_again(&self, broker: &impl Carrier, file: &CasingFile, receipt: &Receipt) -> Result<bool> {
        let is_again = self.again && matches!(receipt.fate, Fate::Refused(_));
        if is_again {
            broker.forget(file).await?;
        }
        Ok(is_again)
    }

    /// Takes what a centre says of a file for settled.
    fn settle(&mut self, path: PathBuf, file: CasingFile, receipt: Receipt, tell: &mut impl FnMut(&Sent)) {
        let there = self.sender.folder.join(&path);
        let is_same = match self.files.get(&path) {
            Some(State::Waits { digest: Some(digest), .. }) => *digest == receipt.digest,
            // Sent before this process began: a file is never written again, so that its size tells another by the same name.
            _ => there.metadata().is_ok_and(|there| there.len() == receipt.bytes),
        };
        let receipt = match is_same {
            true => receipt,
            false => {
                let text = format!("{} has another file of this name", receipt.collector);
                Receipt { fate: Fate::Refused(text), ..receipt }
            }
        };
        if let Fate::Refused(why) = &receipt.fate {
            tracing::error!("{} is not taken by the centre: {why}", there.display());
        }
        self.files.insert(path, State::Settled { is_received: receipt.fate == Fate::Received });
        tell(&Sent { file, receipt });
    }

    /// Has the broker keep a file without a receipt, if it does not, and if not too many are on their way.
    async fn put(&mut self, broker: &impl Carrier, path: PathBuf, file: &CasingFile) -> Result<()> {
        let there = self.sender.folder.join(&path);
        let known = self.files.get(&path).cloned();
        if matches!(&known, Some(State::Waits { asked: Some(asked), .. }) if asked.elapsed() < ASK_AFTER) {
            return Ok(());
        }
        let count = self.files.values().filter(|state| matches!(state, State::Waits { .. })).count();
        if known.is_none() && count >= WINDOW {
            return Ok(());
        }
        let bytes = there.metadata().with_context(|| format!("cannot read {}", there.display()))?.len();
        if broker.remind(file).await? == Some(bytes) {
            let digest = known.and_then(|known| match known {
                State::Waits { digest, .. } => digest,
                State::Settled { .. } => None,
            });
            self.files.insert(path, State::Waits { digest, asked: Some(Instant::now()) });
            return Ok(());
        }
        if known.is_some() {
            tracing::warn!("{file} was lost on its way: it is sent again");
        }
        let digest = Some(broker.publish(file, &there).await?);
        tracing::info!("sent {file}: {bytes} bytes");
        self.files.insert(path, State::Waits { digest, asked: Some(Instant::now()) });
        Ok(())
    }
}
