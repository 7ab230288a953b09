//! Records about casings, from `store` and from stations that propose them: headers and the bytes after them.

use iceoryx2::prelude::ZeroCopySend;

use crate::plan::codec::{TAP_BYTES, decode_taps, encode_taps};
use crate::{Limits, Plan, PlanError, PlannedTap, Stamp, Stamped, digest_of_parts};

/// Longest reason a refusal can carry, in bytes.
pub const REASON_BYTES_MAX: usize = 1024;

/// Longest name of a casing and of its file, in bytes.
pub const NAME_BYTES_MAX: usize = 192;

/// Longest path of a finished file, in bytes.
const PATH_BYTES_MAX: usize = 4096;

/// Number that records use for the casing whose file is called `file_name`, without its extension; never 0.
///
/// It follows from the name, which is unique in its folder, so a restarted `store` gives the same number.
pub fn casing_number(file_name: &str) -> u64 {
    digest_of_parts([file_name.as_bytes()]).max(1)
}

/// Header of a record from `store` about one casing, which `stamp.casing` names.
///
/// What follows depends on the [`crate::RecordKind`]. `Plan`: to `fuse` the plan ([`Plan::encode`]), to others the casing's
/// name with taps of its plan ([`encode_opened`]): to a station the added ones, to the supervisor all. `Ledger`: one byte
/// for the state and attempt of every tap and one for the state of every scan; `fuse` gets only the scans. `Closed`:
/// the path of the file. `Refusal`: why a proposal is refused.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
#[type_name("tapline.CasingHeader.v1")]
pub struct CasingHeader {
    /// Which record this is.
    pub stamp: Stamp,
    /// [`Plan::begun_digest`] of the casing's plan.
    pub plan_digest: u64,
    /// Records lost in transit so far, of all casings.
    pub lost_count: u64,
    /// When the last archived tap of an open casing was made, nanoseconds since the Unix epoch; 0 if there is none.
    pub tapped_ns: i64,
    /// Station that has the casing.
    pub station: u32,
    /// Planned taps.
    pub tap_count: u32,
    /// Taps that may still be added to the plan.
    pub room: u32,
    /// Bytes for taps that follow: their number, or 0.
    pub tap_bytes: u32,
    /// Bytes for scans that follow: their number, or 0.
    pub scan_bytes: u32,
    /// The last barrier of the casing that has passed through every stage.
    pub barrier: u32,
    /// Taps in the archive.
    pub archived_count: u32,
    /// Taps refused.
    pub refused_count: u32,
    /// 1 while the archive cannot be written, else 0.
    pub is_stalled: u32,
    /// Taps that were in the archive or refused before it was opened.
    pub settled_before_count: u32,
}

/// A station's proposal: a casing of this name, with this plan, to which its source can add `room` taps. The bytes of a `Plan`
/// record of the proposals topic.
pub fn encode_proposal(name: &str, plan: &Plan, room: u32) -> Vec<u8> {
    let mut bytes = named(name);
    bytes.extend(room.to_le_bytes());
    bytes.extend(plan.encode());
    bytes
}

/// The name, plan and room that [`encode_proposal`] wrote.
///
/// # Errors
/// [`PlanError::Encoding`] for bytes that it did not write.
pub fn decode_proposal(bytes: &[u8]) -> Result<(String, Plan, u32), PlanError> {
    let (name, rest) = split_name(bytes)?;
    let (room, plan) = rest.split_first_chunk::<4>().ok_or(PlanError::Encoding { what: "its room is cut short" })?;
    Ok((name, Plan::decode(plan)?, u32::from_le_bytes(*room)))
}

/// What `store` sends about an open casing: its name, and to a station the taps added to its plan, to the supervisor all taps.
pub fn encode_opened(name: &str, taps: &[PlannedTap]) -> Vec<u8> {
    let mut bytes = named(name);
    bytes.extend(encode_taps(taps));
    bytes
}

/// The name and taps that [`encode_opened`] wrote.
///
/// # Errors
/// [`PlanError::Encoding`] for bytes that it did not write.
pub fn decode_opened(bytes: &[u8]) -> Result<(String, Vec<PlannedTap>), PlanError> {
    let (name, taps) = split_name(bytes)?;
    Ok((name, decode_taps(taps)?))
}

fn named(name: &str) -> Vec<u8> {
    let mut bytes = (name.len() as u32).to_le_bytes().to_vec();
    bytes.extend(name.as_bytes());
    bytes
}

fn split_name(bytes: &[u8]) -> Result<(String, &[u8]), PlanError> {
    let cut = || PlanError::Encoding { what: "it ends within its name" };
    let (length, rest) = bytes.split_first_chunk::<4>().ok_or_else(cut)?;
    let (name, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize).ok_or_else(cut)?;
    let name = std::str::from_utf8(name).map_err(|_error| PlanError::Encoding { what: "its name is not UTF-8" })?;
    Ok((name.to_owned(), rest))
}

/// Bytes of the longest proposal.
pub(crate) fn proposal_bytes_max(limits: &Limits) -> usize {
    4 + NAME_BYTES_MAX + 4 + Plan::encoded_bytes_max(&limits.casing)
}

/// Bytes of the longest record about a casing that carries this many `taps` and no plan.
pub(crate) fn opened_bytes_max(limits: &Limits, taps: usize) -> usize {
    let opened = 4 + NAME_BYTES_MAX + taps * TAP_BYTES;
    opened.max(limits.casing.taps + limits.casing.scans).max(PATH_BYTES_MAX).max(REASON_BYTES_MAX)
}

impl Stamped for CasingHeader {
    fn stamp(&self) -> &Stamp {
        &self.stamp
    }
    fn stamp_mut(&mut self) -> &mut Stamp {
        &mut self.stamp
    }
}
