//! Every verdict is reported to every receiver, even if the line was killed: work to do = notes - acknowledgements.

use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use serde_json::Value;
use tapline_store::{Reader, Unreported};
use tapline_wire::casing_number;

use crate::line::wires::{status, unreported};
use crate::line::{INBOX, all_finished, slow_plant};
use crate::sandbox::Sandbox;
use crate::sandbox::running::{Running, until};

/// A hook that keeps the line of each verdict; one that is cut short, since the line was killed, comes again.
fn keeping_hook(sandbox: &Sandbox) -> String {
    format!(
        "[line]\non_verdict = '''read -r line && echo \"$TAPLINE_ID $line\" >> {}'''\n",
        sandbox.path("reported").display()
    )
}

/// What the hook has received: id and verdict.
fn reported(sandbox: &Sandbox) -> Vec<(String, Value)> {
    let text = fs::read_to_string(sandbox.path("reported")).unwrap_or_default();
    let pair = |line: &str| line.split_once(' ').map(|(id, text)| (id.to_owned(), serde_json::from_str(text).unwrap()));
    text.lines().filter_map(pair).collect()
}

fn parsed(line: &str) -> Value {
    serde_json::from_str(line).unwrap()
}

/// A line on `out` that has no casings to tap.
fn idle_line(sandbox: &Sandbox) -> Running {
    fs::create_dir_all(sandbox.path("inbox")).unwrap();
    sandbox.write("idle.toml", &format!("{}{INBOX}", keeping_hook(sandbox)));
    Running::start(sandbox, "line --config idle.toml --out out --json")
}

/// Catches a verdict lost, or reported again after it was acknowledged, if the line is killed between two steps: each
/// state that a kill can leave on the disk is made, and the line started on it.
#[test]
fn each_step_between_two_can_be_the_last_of_a_line() {
    let sandbox = Sandbox::new();
    slow_plant(&sandbox, 1, 400.0, &keeping_hook(&sandbox));
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json --casings 2");
    let verdicts = line.verdicts(2);
    line.finish().expect(0);
    assert!(unreported(&sandbox).is_empty(), "{:?}", unreported(&sandbox));
    assert_eq!(reported(&sandbox).len(), 2);
    let (first, second) = (&verdicts[0], &verdicts[1]);
    let path = |verdict: &Value| PathBuf::from(verdict["file"].as_str().unwrap());
    let folder = sandbox.path("out/unreported");
    let note = |verdict: &Value, number: u64| Unreported {
        number,
        name: verdict["casing"].as_str().unwrap().to_owned(),
        station: 1,
        at_ns: verdict["at_ns"].as_i64().unwrap(),
        file: path(verdict).strip_prefix(sandbox.path("out")).unwrap().to_owned(),
    };
    let number = |verdict: &Value| u64::from_str_radix(verdict["id"].as_str().unwrap(), 16).unwrap();
    let put = |verdict: &Value, end: &str| {
        let note = note(verdict, number(verdict));
        fs::write(folder.join(format!("{}{end}", note.id())), serde_json::to_vec(&note).unwrap()).unwrap();
    };

    // Killed after the file had its name and before anything was reported; and after it was printed. Something foreign stays.
    put(first, "");
    put(second, ".stdout");
    fs::write(folder.join("0123.new"), "{").unwrap();
    fs::write(folder.join("foreign"), "not a note").unwrap();
    let mut line = idle_line(&sandbox);
    assert_eq!(line.verdict(), *first, "the verdict is what it was");
    until("both are reported", || reported(&sandbox).len() == 4);
    until("nothing is left to report", || unreported(&sandbox) == ["foreign"]);
    let done = line.interrupt().expect(0);
    assert!(done.out.is_empty() && done.err.contains("foreign is not a note"), "{done:?}");
    let ids = |reported: &[(String, Value)]| reported.iter().map(|(id, _)| id.clone()).collect::<Vec<_>>();
    assert_eq!(ids(&reported(&sandbox)[..2]), ids(&reported(&sandbox)[2..]));
    assert!(reported(&sandbox).iter().all(|(id, verdict)| *id == verdict["id"]));

    // Killed after everyone had acknowledged it, and before the last word of that was on the disk.
    put(first, ".stdout.on_verdict");
    let line = idle_line(&sandbox);
    until("it is not reported again", || unreported(&sandbox) == ["foreign"]);
    assert!(line.interrupt().expect(0).out.is_empty());
    assert_eq!(reported(&sandbox).len(), 4);

    // Killed after the file was sealed, before there was a note; and with a note, before the file had its name.
    for has_note in [false, true] {
        let stem = format!("{}.{:x}", first["casing"].as_str().unwrap(), u64::from(has_note) + 0x1234);
        fs::rename(path(first), sandbox.path("out/open").join(format!("{stem}.h5"))).unwrap();
        let number = casing_number(&stem);
        if has_note {
            let note = note(first, number);
            fs::write(folder.join(note.id()), serde_json::to_vec(&note).unwrap()).unwrap();
        }
        let mut line = idle_line(&sandbox);
        let verdict = line.verdict();
        assert_eq!((&verdict["casing"], &verdict["file"]), (&first["casing"], &first["file"]));
        assert_eq!(verdict["id"], format!("{number:016x}"));
        until("it is reported", || reported(&sandbox).len() == 5 + usize::from(has_note));
        until("nothing is left to report", || unreported(&sandbox) == ["foreign"]);
        assert!(line.interrupt().expect(0).out.is_empty());
    }

    // A file that somebody has moved away before its verdict was sent: the others are sent, and it is reported.
    put(first, "");
    put(second, "");
    fs::rename(path(first), sandbox.path("elsewhere.h5")).unwrap();
    let mut line = idle_line(&sandbox);
    assert_eq!(line.verdict(), *second);
    until("it is reported", || status(&sandbox)["troubles"].to_string().contains("1 verdict cannot be reported"));
    line.interrupt().expect(0);
    fs::rename(sandbox.path("elsewhere.h5"), path(first)).unwrap();
    let mut line = idle_line(&sandbox);
    assert_eq!(line.verdict(), *first, "it was kept");
    line.interrupt().expect(0);
}

/// Catches a verdict that a line which is killed at any moment never reports, a note that stays, and verdicts that differ from what
/// the archives say.
#[test]
fn a_line_that_is_killed_again_and_again_reports_every_verdict() {
    let sandbox = Sandbox::new();
    slow_plant(&sandbox, 200, 150.0, &keeping_hook(&sandbox));
    let start = || Running::start(&sandbox, "line --config plant.toml --out out --json");
    for kill in 0..6 {
        let line = start();
        until("a casing is finished", || {
            sandbox.path("out/unreported").is_dir() && all_finished(&sandbox.path("out")).len() > 2 * kill
        });
        // A little later each time.
        std::thread::sleep(Duration::from_millis(3 * kill as u64));
        drop(line.kill());
    }
    let mut line = start();
    // It has reported what was left before.
    line.verdict();
    line.interrupt().expect(0);
    assert_eq!(unreported(&sandbox), Vec::<String>::new());
    let reported = reported(&sandbox);
    let mut files = std::collections::BTreeMap::<PathBuf, Value>::new();
    for (_, verdict) in reported {
        let file = PathBuf::from(verdict["file"].as_str().unwrap());
        // The hook may have run twice for a casing; it received the same.
        let before = files.insert(file, verdict.clone());
        assert!(before.is_none_or(|before| before == verdict), "{verdict}");
    }
    assert_eq!(files.len(), all_finished(&sandbox.path("out")).len());
    for (file, verdict) in &files {
        let reader = Reader::open(file).unwrap();
        let worst = reader.judgements().unwrap().into_iter().map(|judged| judged.unwrap().0.verdict).max().unwrap();
        let word = tapline_wire::Verdict::from_code(worst).unwrap().to_string();
        assert_eq!(verdict["verdict"], word, "{}", file.display());
    }
}

/// Catches a command that asks to be run again later and is not, or that keeps the verdicts behind it out of order.
#[test]
fn a_command_can_ask_to_be_run_again() {
    let sandbox = Sandbox::new();
    let reported = sandbox.path("reported");
    // The first run of all fails for the moment.
    let hook =
        format!("[ -e tried ] || {{ touch tried; exit 75; }}; read -r line; echo \"$line\" >> {}", reported.display());
    slow_plant(&sandbox, 2, 400.0, &format!("[line]\non_verdict = '''{hook}'''\n"));
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    let verdicts = line.verdicts(4);
    until("it is reported", || status(&sandbox)["troubles"].to_string().contains("on_verdict asks to be run again"));
    assert!(fs::read_to_string(&reported).is_err());
    until("all are reported", || fs::read_to_string(&reported).is_ok_and(|text| text.lines().count() == 4));
    let text = fs::read_to_string(&reported).unwrap();
    assert_eq!(text.lines().map(parsed).collect::<Vec<_>>(), verdicts);
    until("it is well again", || status(&sandbox)["troubles"].as_array().is_some_and(Vec::is_empty));
    line.interrupt().expect(0);
}
