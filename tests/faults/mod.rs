//! Faults that must not lose a tap, and must be reported: killed stages, failing disks, limits, other users.

mod disk;
mod killed;
mod limits;
mod other_users;
