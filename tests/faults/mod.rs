//! What must not lose a tap, and must be named: stages that are killed, disks that fail, limits, other users.

mod disk;
mod killed;
mod limits;
mod other_users;
