//! A line on a machine with other users, who must neither see nor disturb it. Only root can act as another user, so
//! these tests are skipped without root.

use std::fs::{self, Permissions};
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, chown, symlink};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;
use tempfile::TempDir;

use crate::sandbox::short_scan;

/// The user who runs the line, and the one who attacks it.
const VICTIM: u32 = 65_533;
const OTHER: u32 = 65_534;

/// A place that two users can reach, with the program and a folder for each.
struct Ground {
    folder: TempDir,
}

impl Ground {
    /// `None`, with a notice, if this process cannot act as another user.
    fn new() -> Option<Self> {
        if !rustix::process::geteuid().is_root() {
            tapline_testing::skip("nobody can be another user here (it takes root)");
            return None;
        }
        let ground = Self { folder: tempfile::tempdir().unwrap() };
        fs::set_permissions(ground.folder.path(), Permissions::from_mode(0o755)).unwrap();
        // Copied by another process. Otherwise a process that is started meanwhile would hold the copy open, and the
        // copy could not be started.
        let copied =
            Command::new("cp").arg(env!("CARGO_BIN_EXE_tapline")).arg(ground.path("tapline")).status().unwrap();
        assert!(copied.success());
        for (name, user) in [("victim", VICTIM), ("other", OTHER)] {
            fs::create_dir(ground.path(name)).unwrap();
            chown(ground.path(name), Some(user), Some(user)).unwrap();
        }
        // Like the system's own temporary folder: writable for everyone, and sticky.
        fs::create_dir(ground.path("t")).unwrap();
        fs::set_permissions(ground.path("t"), Permissions::from_mode(0o1777)).unwrap();
        fs::write(ground.path("scan.toml"), format!("{}[acquire]\ntaps_per_s = 40.0\n", short_scan(40))).unwrap();
        Some(ground)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The program as run by `user` in his folder, with a temporary folder that all share.
    fn command(&self, user: u32, arguments: &str) -> Command {
        let mut command = Command::new(self.path("tapline"));
        let home = self.path(if user == VICTIM { "victim" } else { "other" });
        command.args(arguments.split_whitespace()).current_dir(home).uid(user).gid(user);
        command.env("TMPDIR", self.path("t")).env_remove("XDG_RUNTIME_DIR");
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    /// A run by the victim, in the victim's folder.
    fn run(&self, more: &str) -> Command {
        self.command(
            VICTIM,
            &format!("run --config {} --reference self --json {more}", self.path("scan.toml").display()),
        )
    }

    /// Starts a run and waits for its line; returns the folder of the line.
    fn start(&self, more: &str) -> (Child, PathBuf) {
        let child = self.run(more).spawn().unwrap();
        let deadline = Instant::now() + Duration::from_secs(30);
        while Instant::now() < deadline {
            let folders = fs::read_dir(self.path("t")).unwrap().flatten().map(|entry| entry.path());
            let folder = folders.filter(|f| f.metadata().is_ok_and(|there| there.uid() == VICTIM)).find(|folder| {
                // The stages are at work once they have opened their events.
                segments(folder).iter().filter(|path| path.extension().is_some_and(|kind| kind == "data")).count() >= 3
            });
            if let Some(folder) = folder {
                return (child, folder);
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        panic!("no line has come: {:?}", child.wait_with_output());
    }
}

/// The shared-memory files of the line in `folder`.
fn segments(folder: &Path) -> Vec<PathBuf> {
    let prefix = format!("{}_", folder.file_name().unwrap().to_str().unwrap().replacen('-', "_", 1));
    let files = fs::read_dir("/dev/shm").unwrap().flatten().map(|entry| entry.path());
    files.filter(|path| path.file_name().unwrap().to_string_lossy().starts_with(&prefix)).collect()
}

/// Runs `script` in a shell of the attacker.
fn as_other(script: &str) -> Output {
    Command::new("sh").args(["-c", script]).current_dir("/").uid(OTHER).gid(OTHER).output().unwrap()
}

fn summary(child: Child) -> Value {
    let done = child.wait_with_output().unwrap();
    assert_eq!(done.status.code(), Some(0), "{}", String::from_utf8_lossy(&done.stderr));
    serde_json::from_str(std::str::from_utf8(&done.stdout).unwrap().lines().last().unwrap()).unwrap()
}

/// Catches a file of a line that another user can read or write: its configuration, its management file, its taps.
#[test]
fn nothing_of_a_line_is_open_to_another_user() {
    let Some(ground) = Ground::new() else { return };
    let (child, folder) = ground.start("--out quiet");
    assert!(!as_other(&format!("ls {}", folder.display())).status.success());
    assert!(!as_other(&format!("cat {}/run.toml", folder.display())).status.success());
    assert!(!as_other(&format!("echo x > {}/run.toml", folder.display())).status.success());
    assert!(!as_other(&format!("mv {0} {0}-away", folder.display())).status.success());
    let shared = segments(&folder);
    assert!(shared.iter().any(|path| path.extension().is_some_and(|kind| kind == "global_mgmt")), "{shared:?}");
    for path in shared {
        let name = path.display();
        for script in [
            format!("cat {name}"),
            format!("dd if=/dev/zero of={name} bs=16 count=1 conv=notrunc,nocreat"),
            format!("rm -f {name}"),
        ] {
            let done = as_other(&script);
            // A file that has gone meanwhile cannot be opened either.
            assert!(!done.status.success() || !path.exists(), "{script} was allowed: {done:?}");
        }
    }
    assert_eq!(summary(child)["pace"]["restarts"], 0);
    assert!(!folder.exists() && segments(&folder).is_empty());
}

/// Catches a line that uses, or is blocked by, files that the attacker has placed where earlier lines had their folder
/// or shared memory: predictable names.
#[test]
fn what_was_put_there_beforehand_is_not_used() {
    let Some(ground) = Ground::new() else { return };
    let out = ground.path("victim/run");
    let hash = out
        .as_os_str()
        .as_encoded_bytes()
        .iter()
        .fold(0xcbf2_9ce4_8422_2325_u64, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3));
    let foreseen = ground.path(&format!("t/tapline-{hash:016x}"));
    fs::create_dir(ground.path("victim/dear")).unwrap();
    fs::write(ground.path("victim/dear/run.toml"), "dear").unwrap();
    symlink(ground.path("victim/dear"), &foreseen).unwrap();
    let segment = format!("/dev/shm/tapline_{hash:016x}_node.0_10_0.global_mgmt");
    assert!(
        as_other(&format!("head -c16 /dev/zero | tr '\\0' '\\377' > {segment}; chmod 666 {segment}")).status.success()
    );
    let (child, folder) = ground.start("--out run");
    assert_ne!(folder, foreseen);
    let end = summary(child);
    fs::remove_file(segment).unwrap();
    assert_eq!(end["is_complete"], true, "{end}");
    assert_eq!(fs::read_to_string(ground.path("victim/dear/run.toml")).unwrap(), "dear");
    assert_eq!(fs::read_link(foreseen).unwrap(), ground.path("victim/dear"));
}

/// Catches a recovery that the attacker can prevent: with his bytes in the management file, no stage could start again.
#[test]
fn a_stage_heals_whatever_another_user_tries() {
    let Some(ground) = Ground::new() else { return };
    let (child, folder) = ground.start("--out heal");
    let management =
        segments(&folder).into_iter().find(|path| path.extension().is_some_and(|kind| kind == "global_mgmt"));
    let script = format!("head -c16 /dev/zero | tr '\\0' '\\377' > {}", management.unwrap().display());
    assert!(!as_other(&script).status.success());
    let stage = crate::sandbox::stages::stage(&child, "process");
    crate::sandbox::stages::signal(stage, rustix::process::Signal::KILL);
    let end = summary(child);
    assert_eq!((&end["is_complete"], &end["pace"]["restarts"]), (&Value::Bool(true), &Value::from(1)), "{end}");
}

/// Catches a lock or a folder of the attacker that a line uses, follows, truncates, or reports as a fault of its own
/// stages.
#[test]
fn an_output_folder_of_another_is_refused_with_his_name() {
    let Some(ground) = Ground::new() else { return };
    let refused = |more: &str, words: &str| {
        let done = ground.run(more).output().unwrap();
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(done.status.code() == Some(1) && said.contains(words), "{:?}: {said}", done.status);
    };
    // The attacker's folder, to which everyone may write.
    let his = ground.path("t/his");
    assert!(as_other(&format!("mkdir -m 777 {}", his.display())).status.success());
    refused(&format!("--out {}", his.display()), "belongs to user 65534");
    // The attacker's link to a folder of the victim.
    let link = ground.path("t/link");
    symlink(ground.path("victim"), &link).unwrap();
    std::os::unix::fs::lchown(&link, Some(OTHER), Some(OTHER)).unwrap();
    refused(&format!("--out {}", link.display()), "belongs to user 65534");
    // Links and files placed beforehand in a folder of the victim, to which the attacker could write for a while.
    let own = ground.path("victim/own");
    fs::create_dir(&own).unwrap();
    chown(&own, Some(VICTIM), Some(VICTIM)).unwrap();
    let dear = ground.path("victim/dear");
    fs::write(&dear, "dear").unwrap();
    symlink(&dear, own.join(".line")).unwrap();
    refused("--out own", "is a link");
    fs::remove_file(own.join(".line")).unwrap();
    assert!(fs::read_to_string(&dear).unwrap() == "dear");
    // A line of root was killed there.
    fs::write(own.join(".line"), "pid = 1\n").unwrap();
    fs::set_permissions(own.join(".line"), Permissions::from_mode(0o600)).unwrap();
    refused("--out own", "from a line of another user");
}
