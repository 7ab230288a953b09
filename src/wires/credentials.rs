//! A user's name and password, in a file that only its user can read.

use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;

use anyhow::{Context as _, Result, ensure};

/// Longest file of credentials, in bytes.
const CREDENTIALS_BYTES_MAX: usize = 4096;

/// A user's name and password.
#[derive(Clone, PartialEq, Eq)]
pub(crate) struct Credentials {
    pub user: String,
    pub password: String,
}

impl Credentials {
    /// Reads the file that the key `key` of the configuration names.
    pub(crate) fn read(key: &str, path: &Path) -> Result<Self> {
        let shown = path.display();
        let context = || format!("{key} = \"{shown}\": cannot read it");
        let mode = fs::metadata(path).with_context(context)?.mode();
        ensure!(mode & 0o007 == 0, "{key} = \"{shown}\": every user of this machine can read it: chmod 600 {shown}");
        let text = fs::read_to_string(path).with_context(context)?;
        ensure!(
            text.len() <= CREDENTIALS_BYTES_MAX,
            "{key} = \"{shown}\": it has {} bytes, and {CREDENTIALS_BYTES_MAX} at most are allowed",
            text.len()
        );
        let lines: Vec<&str> = text.lines().collect();
        match lines.as_slice() {
            [user, password] if !user.is_empty() && !password.is_empty() => {
                Ok(Self { user: (*user).to_owned(), password: (*password).to_owned() })
            }
            _ => {
                anyhow::bail!("{key} = \"{shown}\": it has {} lines, and must have two: user and password", lines.len())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    /// Catches a password that others can read, and a file without one.
    #[test]
    fn credentials_are_of_their_user_alone() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("user");
        let read = |text: &str, mode| {
            fs::write(&file, text).unwrap();
            fs::set_permissions(&file, fs::Permissions::from_mode(mode)).unwrap();
            Credentials::read("line.mqtt.credentials_file", &file)
        };
        let fine = read("line\nsecret\n", 0o600).map_err(|error| error.to_string());
        assert!(fine.is_ok_and(|read| read.user == "line" && read.password == "secret"));
        for (text, mode, why) in
            [("line\nsecret\n", 0o604, "every user"), ("line\n", 0o600, "1 lines"), ("\nx\n", 0o600, "two")]
        {
            let Err(error) = read(text, mode) else { panic!("{text:?} was read") };
            assert!(error.to_string().contains(why) && error.to_string().contains("credentials_file"), "{error}");
        }
    }
}
