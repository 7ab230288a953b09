use std::fs;
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, symlink};

use rustix::fs::{CWD, FileType, Mode};
use tapline_wire::LineAddress;

use super::lock::{Entry, LOCK};
use super::process::ProcessName;
use super::*;

fn refused(path: &Path) -> String {
    OutFolder::take(path).err().map(|error| format!("{error:#}")).expect("it was taken")
}

fn set_mode(path: &Path, mode: u32) {
    fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
}

#[test]
fn one_line_has_it_at_a_time_and_is_found_by_it() {
    let temp = tempfile::TempDir::new().unwrap();
    let path = temp.path().join("a/out");
    assert!(OutFolder::find_line(temp.path()).unwrap().is_none());
    let mut out = OutFolder::take(&path).unwrap();
    assert_eq!(out.path(), path);
    assert!(out.open_path().is_dir() && path.join(LOCK).metadata().unwrap().mode() & 0o777 == 0o600);
    let second = refused(&path);
    assert!(second.contains("another line") && second.contains(&std::process::id().to_string()), "{second}");
    assert!(OutFolder::find_line(&path).unwrap().is_none(), "it has no address yet");

    let address = LineAddress::fresh().unwrap();
    out.enter(&address).unwrap();
    let found = OutFolder::find_line(&path).unwrap().unwrap();
    assert_eq!((found.pid, &found.address), (std::process::id(), &address));
    drop(out);
    assert!(!path.join(LOCK).exists() && address.clear().unwrap());
}

#[test]
fn what_a_killed_line_left_is_found_and_cleared() {
    let temp = tempfile::TempDir::new().unwrap();
    let mut out = OutFolder::take(temp.path()).unwrap();
    let address = LineAddress::fresh().unwrap();
    out.enter(&address).unwrap();
    // As if it were killed: the lock is released but stays, and its process has ended.
    out.release();
    let killed = Entry { process: ProcessName { pid: 1, ..out.entry.process.clone() }, ..out.entry.clone() };
    fs::write(temp.path().join(LOCK), toml::to_string(&killed).unwrap()).unwrap();
    std::mem::forget(out);

    assert!(OutFolder::find_line(temp.path()).unwrap().is_none());
    let mut next = OutFolder::take(temp.path()).unwrap();
    assert!(OutFolder::find_line(temp.path()).unwrap().is_none(), "who looks on would keep what is to be cleared");
    assert!(address.root().exists());
    next.clear_left(Duration::ZERO).unwrap();
    assert!(!address.root().exists());
    drop(next);
    assert!(!temp.path().join(LOCK).exists());
}

#[test]
fn let_go_it_is_held_by_nothing_but_kept_for_the_line() {
    let temp = tempfile::TempDir::new().unwrap();
    let mut out = OutFolder::take(temp.path()).unwrap();
    out.release();
    let is_inside = |fd: fs::DirEntry| fs::read_link(fd.path()).is_ok_and(|to| to.starts_with(temp.path()));
    assert!(!fs::read_dir("/proc/self/fd").unwrap().flatten().any(is_inside));
    // Its disk is away: an empty folder is in its place.
    let away = temp.path().with_extension("away");
    fs::rename(temp.path(), &away).unwrap();
    assert!(!out.take_back().unwrap());
    fs::create_dir(temp.path()).unwrap();
    assert!(!out.take_back().unwrap());
    fs::remove_dir(temp.path()).unwrap();
    fs::rename(&away, temp.path()).unwrap();
    assert!(out.take_back().unwrap() && out.take_back().unwrap());
    assert!(refused(temp.path()).contains("another line"));
}

#[test]
fn what_others_have_put_there_is_refused_and_left_as_it_is() {
    let temp = tempfile::TempDir::new().unwrap();
    let dear = temp.path().join("dear");
    fs::write(&dear, "dear").unwrap();
    let out = temp.path().join("out");
    fs::create_dir(&out).unwrap();
    let lock = out.join(LOCK);

    symlink(&dear, &lock).unwrap();
    assert!(refused(&out).contains("is a link"));
    fs::remove_file(&lock).unwrap();
    set_mode(&dear, 0o600);
    fs::hard_link(&dear, &lock).unwrap();
    assert!(refused(&out).contains("links 2"));
    fs::remove_file(&lock).unwrap();
    rustix::fs::mknodat(CWD, &lock, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
    assert!(refused(&out).contains("not made by a line"));
    fs::remove_file(&lock).unwrap();
    fs::write(&lock, "").unwrap();
    set_mode(&lock, 0o666);
    assert!(refused(&out).contains("mode 666"));
    fs::remove_file(&lock).unwrap();
    assert_eq!(fs::read_to_string(&dear).unwrap(), "dear");

    symlink(temp.path(), out.join(OPEN_FOLDER)).unwrap();
    assert!(refused(&out).contains("not a folder"));
    fs::remove_file(out.join(OPEN_FOLDER)).unwrap();
    set_mode(&out, 0o777);
    assert!(refused(&out).contains("everyone may write"));
    set_mode(&out, 0o1777);
    drop(OutFolder::take(&out).unwrap());
    assert!(refused(&dear).contains("is a file"));
}
