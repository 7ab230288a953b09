//! The centre's end: takes files from the queue, and gives a receipt for each that is on the disk.
//!
//! The receipt decides which of several collectors has a file: only the first receipt of a name counts, and a draft goes to its
//! place after it. Killed at any moment, a collector finds out at its next start which of its drafts count.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, anyhow, ensure};
use async_nats::jetstream::{AckKind, Message};
use futures_util::StreamExt as _;
use tapline_wire::now_ns;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::time::timeout;

use crate::file::CasingFile;
use crate::jetstream::{JetStream, TAKEN_WITHIN, Unreadable};
use crate::receipt::{Fate, Receipt};
use crate::server::Server;
use crate::session::{self, Trouble, Until};
use crate::staging::{Folder, digest_of};

/// How long to wait for the queue until it counts as empty.
const WAIT: Duration = Duration::from_secs(2);

/// How long a request for the next file is valid; the server sends a heartbeat three times as often.
const ASKED_FOR: Duration = Duration::from_secs(15);

/// How long a server may take for the next bytes of a file before the file is given up, to be sent again.
const NEXT_BYTES_WITHIN: Duration = Duration::from_secs(20);

/// How often the server is informed that a file is still being taken or checked.
const INFORM_EVERY: Duration = Duration::from_secs(5);

/// After how long a file that could not be written may be given to another collector.
const OTHER_AFTER: Duration = Duration::from_secs(5);

/// How many times longer that becomes with each failure, at most.
const OFTEN: i64 = 12;

/// A centre's folder, and where its files come from.
#[derive(Debug, Clone)]
pub struct Collector {
    /// The folder; each site has one in it.
    pub folder: PathBuf,
    /// Name of this host.
    pub host: String,
    /// Bucket of the server.
    pub bucket: String,
    /// What is wrong with the file at a path; `None` if it is a whole and unaltered archive; an error if unknown now.
    pub check: fn(&Path) -> Result<Option<String>>,
}

/// A file for which this collector has given a receipt.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Collected {
    /// The file.
    pub file: CasingFile,
    /// Where it is, if it was taken.
    pub path: PathBuf,
    /// The receipt for it.
    pub receipt: Receipt,
}

/// Takes files until it is over; returns whether none was refused, and none is left that could not be put in its place. `report` gets
/// each.
///
/// # Errors
/// A folder that cannot be used and, if this is done once, trouble that lasts for a minute. Other troubles are logged,
/// and it is tried again.
pub fn collect(
    server: &Server,
    collector: &Collector,
    until: &Until,
    mut report: impl FnMut(&Collected),
) -> Result<bool> {
    let folder = Folder::open(&collector.folder, &collector.host)?;
    let mut is_fine = true;
    session::run(until, async |trouble| {
        let jetstream =
            JetStream::connect(server, &format!("tapline collect {}", folder.name), &collector.bucket).await?;
        let mut report_one = |collected: Collected| {
            if let Fate::Refused(why) = &collected.receipt.fate {
                tracing::error!("{} is not taken: {why}", collected.file);
                is_fine = false;
            }
            report(&collected);
        };
        let mut collecting = Collecting { jetstream: &jetstream, folder: &folder, check: collector.check };
        let is_clear = collecting.recover(&mut report_one).await?;
        collecting.attempt(until, &mut report_one, trouble).await?;
        is_fine &= is_clear;
        Ok(())
    })?;
    Ok(is_fine)
}

struct Collecting<'a> {
    jetstream: &'a JetStream,
    folder: &'a Folder,
    check: fn(&Path) -> Result<Option<String>>,
}

impl Collecting<'_> {
    /// Puts the drafts in their places for which this collector has given the receipt, and removes the others. One that cannot be
    /// put in its place stays for the next time, and holds up no other file; returns whether there is none.
    async fn recover(&mut self, report: &mut impl FnMut(Collected)) -> Result<bool> {
        let mut is_clear = true;
        for file in self.folder.drafts()? {
            let receipt = match self.jetstream.receipt(&file).await {
                Err(error) if error.is::<Unreadable>() => {
                    tracing::error!("{error:#}; its draft stays");
                    is_clear = false;
                    continue;
                }
                receipt => receipt?,
            };
            let is_ours = |receipt: &Receipt| receipt.collector == self.folder.name && receipt.fate == Fate::Received;
            match receipt.filter(is_ours) {
                Some(receipt) => {
                    if let Err(error) = self.place(file, receipt, report) {
                        tracing::error!("{error:#}");
                        is_clear = false;
                    }
                }
                None => self.folder.discard(&file),
            }
        }
        Ok(is_clear)
    }

    /// Takes files until there is trouble, or nothing is left to take and that is all that was asked.
    async fn attempt(
        &mut self,
        until: &Until,
        report: &mut impl FnMut(Collected),
        trouble: &mut Trouble,
    ) -> Result<()> {
        let mut queue = self.jetstream.queue().await?;
        // No more than is taken at once, so that nothing waits behind a collector while another is idle.
        let messages = queue.stream().max_messages_per_batch(1).expires(ASKED_FOR).heartbeat(ASKED_FOR / 3);
        let mut messages = messages.messages().await.context("the queue cannot be read")?;
        loop {
            let Ok(next) = timeout(WAIT, messages.next()).await else {
                let state = queue.info().await.context("the server does not answer")?;
                trouble.ends();
                if until.is_once && state.num_pending == 0 && state.num_ack_pending == 0 {
                    return Ok(());
                }
                continue;
            };
            let message = next.context("the queue has ended")?.context("the queue returns no message")?;
            if let Err(error) = self.take(&message, report).await {
                // Another collector, or this one again, gets the file. If the server does not hear it, the file's time runs out.
                // What fails again and again comes less often, so that it keeps no others waiting.
                let count = message.info().map_or(1, |info| info.delivered.clamp(1, OFTEN));
                let after = OTHER_AFTER * u32::try_from(count).unwrap_or(1);
                drop(message.ack_with(AckKind::Nak(Some(after))).await);
                return Err(error);
            }
            message.double_ack().await.map_err(|error| anyhow!(error)).context("the server does not answer")?;
            trouble.ends();
        }
    }

    /// Takes the file that was announced, unless it is settled.
    async fn take(&mut self, message: &Message, report: &mut impl FnMut(Collected)) -> Result<()> {
        let name = String::from_utf8_lossy(&message.payload);
        let file: CasingFile = match name.parse() {
            Ok(file) => file,
            Err(error) => {
                tracing::error!("a file is left with the server: {error:#}");
                return Ok(());
            }
        };
        // It may have been taken since it was announced.
        let Some(info) = self.jetstream.info(&file).await? else { return Ok(()) };
        let is_settled = match self.jetstream.receipt(&file).await {
            // Whoever has given it has settled the file.
            Err(error) if error.is::<Unreadable>() => {
                tracing::error!("{error:#}; the file is not taken");
                true
            }
            receipt => receipt?.is_some(),
        };
        if is_settled {
            return self.jetstream.remove(&file).await;
        }
        let digest = info.digest.with_context(|| format!("the server returns no digest of {file}"))?;
        match digest_of(&self.folder.place(&file))? {
            Some((there, bytes)) if there == digest => {
                self.give(file, self.receipt(digest, bytes, Fate::Received), report).await
            }
            Some(_) => {
                let why = format!("{} has another file of this name", self.folder.name);
                self.give(file, self.receipt(digest, info.size as u64, Fate::Refused(why)), report).await
            }
            None => match self.write_draft(message, &file, info.size as u64).await {
                Ok(Read::Whole { digest, bytes }) => {
                    let fate = self.checked(message, &file).await;
                    let fate = fate.inspect_err(|_| self.folder.discard(&file))?;
                    self.give(file, self.receipt(digest, bytes, fate), report).await
                }
                Ok(Read::Lost(why)) => {
                    tracing::warn!("{file} was lost on its way ({why}): it is asked for again");
                    self.folder.discard(&file);
                    self.jetstream.remove(&file).await
                }
                Err(error) => {
                    self.folder.discard(&file);
                    Err(error)
                }
            },
        }
    }

    fn receipt(&self, digest: String, bytes: u64, fate: Fate) -> Receipt {
        Receipt { digest, bytes, collector: self.folder.name.clone(), at_ns: now_ns(), fate }
    }

    /// What the check says of the draft of `file`.
    async fn checked(&self, message: &Message, file: &CasingFile) -> Result<Fate> {
        let (check, draft) = (self.check, self.folder.draft(file));
        let mut checking = tokio::task::spawn_blocking(move || check(&draft));
        loop {
            match timeout(INFORM_EVERY, &mut checking).await {
                Ok(found) => return Ok(found??.map_or(Fate::Received, Fate::Refused)),
                Err(_) => drop(message.ack_with(AckKind::Progress).await),
            }
        }
    }

    /// Writes the `bytes` of `file` into its draft, if there is room for them, and has them on the disk.
    async fn write_draft(&self, message: &Message, file: &CasingFile, bytes: u64) -> Result<Read> {
        self.folder.ensure_room(bytes)?;
        let draft = self.folder.draft(file);
        let context = || format!("cannot write {}", draft.display());
        let mut to = tokio::fs::File::from_std(self.folder.begin(file)?);
        let mut from = self.jetstream.object(file).await.with_context(|| format!("the server does not give {file}"))?;
        let (mut buffer, mut count, mut informed_at) = (vec![0; 1 << 17], 0, Instant::now());
        loop {
            let read = match timeout(NEXT_BYTES_WITHIN, from.read(&mut buffer)).await {
                Err(_) => return Ok(Read::Lost(format!("nothing came for {} s", NEXT_BYTES_WITHIN.as_secs()))),
                Ok(Err(error)) => return Ok(Read::Lost(error.to_string())),
                Ok(Ok(0)) => break,
                Ok(Ok(read)) => read,
            };
            to.write_all(&buffer[..read]).await.with_context(context)?;
            count += read as u64;
            if informed_at.elapsed() > INFORM_EVERY {
                // If the server does not hear it, another collector may get the file too: the receipt decides.
                drop(message.ack_with(AckKind::Progress).await);
                informed_at = Instant::now();
            }
        }
        to.flush().await.with_context(context)?;
        self.folder.keep_draft(file)?;
        let info = from.info();
        match &info.digest {
            Some(digest) if count == info.size as u64 => Ok(Read::Whole { digest: digest.clone(), bytes: count }),
            _ => Ok(Read::Lost(format!("{count} of {} bytes came", info.size))),
        }
    }

    /// Gives the receipt of `file`, unless another has given one, and places or discards its draft.
    async fn give(&self, file: CasingFile, receipt: Receipt, report: &mut impl FnMut(Collected)) -> Result<()> {
        if receipt.fate == Fate::Received {
            // A file that cannot get there is not this collector's.
            self.folder.make_place(&file)?;
        }
        let is_ours = self.jetstream.give(&file, &receipt).await?;
        match is_ours && receipt.fate == Fate::Received {
            true => self.place(file.clone(), receipt, report)?,
            false => {
                self.folder.discard(&file);
                if is_ours {
                    report(Collected { path: self.folder.place(&file), file: file.clone(), receipt });
                }
            }
        }
        self.jetstream.remove(&file).await
    }

    /// Puts the draft of `file`, for which `receipt` was given, in its place.
    fn place(&self, file: CasingFile, receipt: Receipt, report: &mut impl FnMut(Collected)) -> Result<()> {
        let path = self.folder.place(&file);
        if self.folder.draft(&file).exists() {
            self.folder.put_in_place(&file)?;
        }
        ensure!(path.exists(), "{} is gone, although {} has given a receipt for it", path.display(), receipt.collector);
        report(Collected { file, path, receipt });
        Ok(())
    }
}

/// How reading a file from the server ended.
enum Read {
    Whole {
        digest: String,
        bytes: u64,
    },
    /// The server does not have all of it, and what shows this.
    Lost(String),
}

const _: () = assert!(INFORM_EVERY.as_secs() + NEXT_BYTES_WITHIN.as_secs() < TAKEN_WITHIN.as_secs());
