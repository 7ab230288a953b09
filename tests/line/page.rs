//! The page of a running line, its metrics and its health.

use std::collections::BTreeSet;
use std::fs;
use std::io::{self, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use rustix::process::Signal;
use serde_json::{Value, json};
use tapline_testing::documents::csv_rows;
use tapline_testing::program::Done;
use tapline_wire::now_ns;

use crate::line::{INBOX, ROOM, assert_like_undisturbed, slow_plant, tap_sets};
use crate::sandbox::Sandbox;
use crate::sandbox::browser::Browser;
use crate::sandbox::running::{PATIENCE, Running, until};
use crate::sandbox::stages::{signal, stage};

/// Answer of a page.
#[derive(Debug)]
pub(super) struct Answer {
    pub code: u16,
    head: String,
    pub body: String,
}

impl Answer {
    /// The value of a header.
    fn header(&self, name: &str) -> Option<&str> {
        let lines = self.head.lines().filter_map(|line| line.split_once(": "));
        lines.into_iter().find(|(key, _)| key.eq_ignore_ascii_case(name)).map(|(_, value)| value)
    }
}

/// Where the line serves its page, after it has said so.
pub(super) fn address_of(line: &mut Running) -> String {
    let said = line.log_line(&["the line is shown at http://"]);
    said.rsplit_once("http://").unwrap().1.trim().to_owned()
}

/// Asks for `path` with more `headers`, a line each.
pub(super) fn ask(address: &str, path: &str, headers: &str) -> Answer {
    send(address, &format!("GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n{headers}\r\n"))
}

fn send(address: &str, request: &str) -> Answer {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    let mut text = String::new();
    stream.read_to_string(&mut text).unwrap();
    let (head, body) = text.split_once("\r\n\r\n").unwrap();
    let code = head.split(' ').nth(1).unwrap().parse().unwrap();
    Answer { code, head: head.to_owned(), body: body.to_owned() }
}

/// Follows the line at `address`, and takes nothing. Fails where the line has closed the connection already.
fn follow(address: &str) -> io::Result<TcpStream> {
    let mut stream = TcpStream::connect(address)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.write_all(format!("GET /events HTTP/1.1\r\nHost: {address}\r\n\r\n").as_bytes())?;
    Ok(stream)
}

/// Catches a page that shows a verdict late, elsewhere than where the crack is, not in words, or still when the line has gone;
/// and a page that its own policy keeps from working.
#[test]
fn a_browser_shows_each_verdict_and_where_the_crack_is() {
    let sandbox = Sandbox::new();
    let Some(mut browser) = Browser::start(&sandbox) else { return };
    tap_sets(&sandbox);
    let printed = "[report]\nplant = \"North & <Co>\"\nline = \"2\"\n";
    sandbox.write("plant.toml", &format!("{printed}[acquire]\ntaps_per_s = 25\n{ROOM}{INBOX}"));
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json --serve 127.0.0.1:0");
    let address = address_of(&mut line);
    until("the inbox is made", || sandbox.path("inbox/failed").is_dir());
    browser.open(&format!("http://{address}/"));
    let state = "document.getElementById('station-1')?.dataset.state";
    until("there is no casing", || browser.value(state) == "idle");
    let heads = browser.value("[document.title, document.getElementById('title').innerText].join('; ')");
    assert_eq!(heads, "North & <Co>, line 2; North & <Co>, line 2");
    // The page itself records when what it shows has changed.
    browser.value(
        "window.seen = [];
         new MutationObserver(() => {
           const { state, casing } = document.getElementById('station-1').dataset;
           if (seen.at(-1)?.state !== state) seen.push({ state, casing, atMs: Date.now() });
         }).observe(document.getElementById('stations'), { attributes: true, subtree: true }); 0",
    );
    let mut ring = Vec::new();
    fs::rename(sandbox.path("sets/A"), sandbox.path("inbox/A")).unwrap();
    let reported = loop {
        if let Some(said) = line.line_within(Duration::from_millis(100)) {
            break said;
        }
        ring.push(browser.value("document.querySelectorAll('#station-1 .place.all').length").as_u64().unwrap());
    };
    let judged_ms = now_ns() / 1_000_000;
    let verdict: Value = serde_json::from_str(&reported).unwrap();
    assert_eq!((&verdict["casing"], &verdict["verdict"]), (&"A".into(), &"REJECT".into()), "{reported}");
    until("the page shows the verdict", || browser.value(state) == "reject");

    let seen = browser.value("seen");
    let seen: Vec<(&str, i64)> = seen
        .as_array()
        .unwrap()
        .iter()
        .map(|step| (step["state"].as_str().unwrap(), step["atMs"].as_i64().unwrap()))
        .collect();
    let (_, shown_ms) = *seen.iter().find(|(state, _)| *state == "reject").unwrap();
    eprintln!("shown {} ms after it was judged; {seen:?}; {ring:?} locations", shown_ms - judged_ms);
    assert!(shown_ms - judged_ms < 1000, "{seen:?}, judged {judged_ms}");
    assert!(seen.iter().any(|(state, _)| *state == "scanning"), "{seen:?}");
    // The ring has filled in meanwhile.
    assert!(ring.is_sorted() && ring.iter().any(|&count| count > 0 && count < 48), "{ring:?}");
    // The crack is at the locations 10 to 13 of 24, of the second shoulder alone.
    let arcs = browser.value("[...document.querySelectorAll('#station-1 figure')].map((ring) => [...ring.querySelectorAll('.arc')].map((arc) => [+arc.dataset.from, +arc.dataset.peak, +arc.dataset.to]))");
    assert_eq!((arcs[0].as_array().unwrap().len(), arcs[1].as_array().unwrap().len()), (0, 1), "{arcs}");
    let [from, peak, to] = [0, 1, 2].map(|k| arcs[1][0][k].as_f64().unwrap());
    assert!((150.0..=195.0).contains(&peak), "{arcs}");
    assert!(from > 115.0 && from < peak && to > peak && to < 230.0, "{arcs}");
    let text = browser.value("document.getElementById('station-1').innerText").to_string();
    assert!(text.contains("REJECT") && text.contains("Shoulder 2: "), "{text}");
    // It is in the list, with the report, and is read out.
    let row = browser.value("document.querySelector('#verdict-list tr').innerText").to_string();
    assert!(row.contains("REJECT") && row.contains("2: REJECT, "), "{row}");
    let news = browser.value("document.getElementById('news').innerText").to_string();
    assert!(news.contains("casing A: REJECT. shoulder 2: damage at "), "{news}");
    let link = browser.value("document.querySelector('#verdict-list a').getAttribute('href')");
    let report = ask(&address, link.as_str().unwrap(), "");
    assert!(report.code == 200 && report.body.contains("REJECT") && report.body.contains("</html>"), "{}", report.head);
    // Somebody tidies up.
    let file = verdict["file"].as_str().unwrap();
    fs::rename(file, sandbox.path("moved.h5")).unwrap();
    let report = ask(&address, link.as_str().unwrap(), "");
    assert!(
        report.code == 404 && report.body.contains(&format!("{file} is not there any more: it was moved")),
        "{report:?}"
    );

    // But a line that has gone shows no verdict.
    drop(line.kill());
    until("the page says that it knows nothing", || browser.value(state) == "unknown");
    assert_eq!(browser.value("document.body.dataset.link"), "lost");
    let words =
        browser.value("[...document.querySelectorAll('.word, .mid, .arc')].map((node) => node.textContent).join()");
    assert!(!words.to_string().contains("REJECT"), "{words}");
    let banner = browser.value("document.getElementById('banner').innerText").to_string();
    assert!(banner.contains("No verdict is known"), "{banner}");
}

/// Catches a casing whose taps never came and that is explained, to those who look at the line, by what follows from this; programs that
/// do not get every reason, or more than the schema has; and counts since a start that nobody knows.
#[test]
fn who_looks_at_the_line_learns_why_taps_lack() {
    let sandbox = Sandbox::new();
    tap_sets(&sandbox);
    let table = fs::read_to_string(sandbox.path("sets/B/taps.csv")).unwrap();
    let second: Vec<_> = csv_rows(&table).into_iter().filter(|row| row["shoulder"] == "2").collect();
    second.iter().for_each(|row| sandbox.write(&format!("sets/B/{}", row["file"]), &"no sound ".repeat(2000)));
    sandbox.write("plant.toml", &format!("{ROOM}{INBOX}"));
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json");
    until("the inbox is made", || sandbox.path("inbox/failed").is_dir());
    fs::rename(sandbox.path("sets/B"), sandbox.path("inbox/B")).unwrap();
    let verdict = line.verdict();
    let sent = verdict["shoulders"][1].as_object().unwrap();
    for reason in ["taps_refused", "location_blind", "no_index", "discriminators_absent"] {
        assert!(sent["reasons"].as_str().unwrap().contains(reason), "{sent:?}");
    }
    assert!(!sent.contains_key("refused_taps"), "{sent:?}");
    until("the verdict is shown", || sandbox.run("status --out out").out.contains("Last verdicts"));
    let count = second.len();
    let cause =
        format!("{count} of {count} planned taps were refused: not a WAV file: it does not start with RIFF and WAVE");
    let shown = sandbox.run("status --out out").expect(0).out;
    assert!(shown.contains(&format!("B/2 RE-INSPECT  {cause}")) && !shown.contains("discriminators_absent"), "{shown}");
    let status = sandbox.run("status --out out --json").json(0);
    assert_eq!(status["verdicts"][0]["shoulders"][1]["refused_taps"]["text"], cause);
    assert_eq!(status["stations"][0]["tally"]["since_ns"], verdict["at_ns"]);
    line.interrupt();
}

/// A server of the page alone, which shows `status` every second, and its address.
fn show(status: Value) -> String {
    let of_page = |name: &str| {
        fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("src/serve/page").join(name)).unwrap()
    };
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    in_background(move || {
        for mut stream in listener.incoming().flatten() {
            let status = status.clone();
            in_background(move || {
                let mut head = [0; 2048];
                let count = stream.read(&mut head).unwrap_or(0);
                let path = String::from_utf8_lossy(&head[..count]).split(' ').nth(1).unwrap_or_default().to_owned();
                let (kind, body) = match path.as_str() {
                    "/" => ("text/html", of_page("index.html").replace("{reasons}", "{}")),
                    "/app.js" => ("text/javascript", of_page("app.js")),
                    "/app.css" => ("text/css", of_page("app.css")),
                    _ => ("text/event-stream", String::new()),
                };
                let head = format!("HTTP/1.1 200 OK\r\nContent-Type: {kind}\r\nConnection: close\r\n\r\n{body}");
                let mut sent = stream.write_all(head.as_bytes());
                while sent.is_ok() && kind == "text/event-stream" {
                    sent = write!(stream, "data: {status}\n\n");
                    std::thread::sleep(Duration::from_millis(500));
                }
            });
        }
    });
    address
}

fn in_background(work: impl FnOnce() + Send + 'static) {
    std::thread::Builder::new().name("page".to_owned()).spawn(work).unwrap();
}

/// Catches a number of alarms with those that are over, a banner of the newest alone or without a bound, a station that seems empty while
/// its last casing is on the rig, counts since nobody knows when, and reasons that hide why taps lack.
#[test]
fn the_page_says_what_lasts() {
    let sandbox = Sandbox::new();
    let Some(mut browser) = Browser::start(&sandbox) else { return };
    let at_ns = now_ns();
    let alarm = |k: i64, text: String| json!({ "at_ns": at_ns - k * 1_000_000_000, "text": text });
    let lasting = (0..7).map(|k| alarm(k, format!("lasts-{k}")));
    let old = alarm(3600, "lasts since an hour".to_owned());
    let alarms: Vec<Value> = [alarm(0, "over: ended".to_owned())].into_iter().chain(lasting).chain([old]).collect();
    let shoulder = json!({
        "tyre": "K-9", "shoulder": 1, "verdict": "RE-INSPECT", "arcs": [], "flags": {},
        "reasons": "taps_refused|discriminators_absent|level_off",
        "refused_taps": { "text": "3 of 4 planned taps were refused: it was taken away", "covers": "taps_refused|discriminators_absent" },
    });
    let verdict = json!({
        "casing": "K-9", "station": 1, "verdict": "RE-INSPECT", "at_ns": at_ns, "file": "out/K-9.h5", "shoulders": [shoulder],
    });
    let counts = json!({ "pass": 4, "re_inspect": 0, "reject": 0 });
    let station = |number: u16, waits_for: &str, since_ns: Option<i64>| {
        json!({
            "number": number, "casing": null, "last": null, "is_removed": false, "refused": null, "waits_for": waits_for,
            "stopped": null, "fault": null, "signs": [],
            "tally": { "since_ns": since_ns, "verdicts": counts, "archived": 0, "refused": 0, "missing": 0, "retaken": 0 },
        })
    };
    let address = show(json!({
        "out": "out", "at_ns": at_ns, "held_by": null, "troubles": [], "taps_per_s": 0.0, "closed_count": 0, "refused_count": 0,
        "verdicts": [verdict], "alarms": alarms,
        "stations": [
            station(1, "another casing on the rig \"a: b\" at 127.0.0.1:7: K-9 is done", Some(at_ns)),
            station(2, "nothing: its list is done", None),
            station(3, "another casing on the rig \"r\" at 127.0.0.1:8: K-8 was refused", None),
        ],
    }));
    browser.open(&format!("http://{address}/"));
    until("it is shown", || browser.value("document.querySelectorAll('.station').length") == 3);
    let mut text =
        |of: &str| browser.value(&format!("document.querySelector('{of}').innerText")).as_str().unwrap().to_owned();
    assert_eq!(text("#alarm-count"), "▲ 8 alarms");
    let banner = text("#banner");
    assert!(banner.contains("lasts-4") && !banner.contains("lasts-5") && banner.ends_with("and 2 more"), "{banner}");
    let (first, second) = (text("#station-1"), text("#station-2"));
    let lines: Vec<&str> = first.lines().filter(|line| !line.trim().is_empty()).collect();
    assert!(lines[1] == "DONE" && lines[2] == "K-9" && lines[3].starts_with("RE-INSPECT, at "), "{lines:?}");
    assert!(first.contains("Since ") && !first.contains("So far") && !first.contains("Previous"), "{first}");
    assert!(second.contains("NO CASING") && second.contains("So far: PASS"), "{second}");
    let third = text("#station-3");
    assert!(third.contains("REFUSED") && third.contains("K-8 was refused"), "{third}");
    let row = text("#verdict-list .shoulders");
    assert_eq!(row.trim(), "1: RE-INSPECT, 3 of 4 planned taps were refused: it was taken away. level_off");
}

/// Catches a line that waits for pages that take nothing, or for more of them than it serves, and pages without a bound.
#[test]
fn pages_that_take_nothing_change_nothing() {
    let sandbox = Sandbox::new();
    slow_plant(&sandbox, 2, 60.0, "");
    let mut line =
        Running::start(&sandbox, "line --config plant.toml --out watched --json --casings 4 --serve 127.0.0.1:0");
    let address = address_of(&mut line);
    let frozen: Vec<TcpStream> = (0..40).map(|_| follow(&address).unwrap()).collect();
    // Some ask for nothing at all; of one machine the line serves 48.
    let silent: Vec<TcpStream> = (0..7).map(|_| TcpStream::connect(&address).unwrap()).collect();
    until("there are too many", || ask(&address, "/events", "").code == 503);
    let mut more = Vec::new();
    until("no more are served", || match follow(&address) {
        Ok(mut stream) => {
            let answered = stream.read(&mut [0]);
            more.push(stream);
            assert!(more.len() < 10, "more are served");
            match answered {
                Ok(count) => count == 0,
                Err(error) => error.kind() == io::ErrorKind::ConnectionReset,
            }
        }
        Err(error) => [io::ErrorKind::BrokenPipe, io::ErrorKind::ConnectionReset].contains(&error.kind()),
    });
    let verdicts = line.verdicts(4);
    line.finish().expect(0);
    drop((frozen, silent, more));
    assert_like_undisturbed(&sandbox, &verdicts, "watched");
}

/// Catches a text that is no metrics, numbers that are not those of the line, and series that grow with its casings.
#[test]
fn the_metrics_are_those_of_the_line() {
    let Some(python) = tapline_testing::python_with("prometheus_client") else { return };
    let sandbox = Sandbox::new();
    slow_plant(&sandbox, 2, 100.0, "");
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json --serve 127.0.0.1:0");
    let address = address_of(&mut line);
    let script = "import sys, json\nfrom prometheus_client.openmetrics.parser import text_string_to_metric_families as parse\n\
                  print(json.dumps([[s.name, s.labels, s.value] for f in parse(sys.stdin.read()) for s in f.samples]))";
    let scrape = || -> Vec<(String, Value, f64)> {
        let answer = ask(&address, "/metrics", "");
        assert!(answer.header("content-type").unwrap().starts_with("application/openmetrics-text"), "{answer:?}");
        sandbox.write("metrics.txt", &answer.body);
        let text = fs::File::open(sandbox.path("metrics.txt")).unwrap();
        let parsed = Done::from(Command::new(&python).args(["-c", script]).stdin(text).output().unwrap());
        serde_json::from_value(parsed.json(0)).unwrap()
    };
    // Their order means nothing.
    let names = |series: &[(String, Value, f64)]| -> BTreeSet<String> {
        series.iter().map(|(name, labels, _)| format!("{name} {labels}")).collect()
    };
    line.verdict();
    // The status is shown a moment after the verdict.
    until("a verdict is counted", || {
        scrape().iter().any(|(name, _, value)| name == "tapline_verdicts_total" && *value > 0.0)
    });
    let first = scrape();
    line.verdicts(3);
    let sum =
        |series: &[(String, Value, f64)], name: &str| series.iter().filter(|s| s.0 == name).map(|s| s.2).sum::<f64>();
    let mut last = first.clone();
    until("all verdicts are counted", || {
        last = scrape();
        sum(&last, "tapline_verdicts_total") > 3.5
    });
    assert_eq!(names(&first), names(&last));
    assert!(first.len() < 80, "{first:?}");
    let of = |name: &str| sum(&last, name);
    let is_close = |a: f64, b: f64| (a - b).abs() < 1e-9;
    assert!(
        is_close(of("tapline_taps_total"), 200.0) && is_close(of("tapline_verdict_latency_seconds_count"), 4.0),
        "{last:?}"
    );
    assert!(
        of("tapline_verdict_latency_seconds_sum") > 0.0 && of("tapline_verdict_latency_seconds_sum") < 40.0,
        "{last:?}"
    );
    for name in ["tapline_disk_free_bytes", "tapline_shm_free_bytes", "tapline_resident_memory_bytes"] {
        assert!(of(name) > 1e6, "{name}: {last:?}");
    }
    let stages = last.iter().filter(|s| s.0 == "tapline_resident_memory_bytes").count();
    assert_eq!(stages, last.iter().filter(|s| s.0 == "tapline_stage_restarts_total").count() + 1, "{last:?}");
    line.interrupt().expect(0);
}

/// Catches a health that is good while a stage hangs or dies again and again, and one that stays bad.
#[test]
fn the_health_is_that_of_the_line() {
    let sandbox = Sandbox::new();
    slow_plant(&sandbox, 10, 2.0, "");
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json --serve 127.0.0.1:0");
    let address = address_of(&mut line);
    let health = || ask(&address, "/healthz", "");
    let alarms = || sandbox.run("status --out out --json").json(0)["alarms"].to_string();
    until("the line is well", || health().code == 200);
    until("a casing is under way", || sandbox.run("status --out out --json").out.contains("\"archived\":2"));
    for name in ["store", "fuse", "process", "acquire-0"] {
        let process = stage(line.child(), name);
        signal(process, Signal::STOP);
        until("the stage is missed", || health().code == 503);
        assert!(health().body.contains(&format!("{name} does not answer")), "{:?}", health());
        signal(process, Signal::CONT);
        until("the stage is back", || health().code == 200);
        until("the alarm is over", || {
            let alarms = alarms();
            alarms.contains(&format!("\"over: the process {name} does not answer"))
                && !alarms.contains(&format!("\"the process {name} does not answer"))
        });
    }
    // One that hangs and is killed answers again as well.
    let fuse = stage(line.child(), "fuse");
    signal(fuse, Signal::STOP);
    until("fuse is missed again", || alarms().contains("\"the process fuse does not answer"));
    for count in 1..=3 {
        let fuse = stage(line.child(), "fuse");
        signal(fuse, Signal::KILL);
        until("fuse is started again", || stage(line.child(), "fuse") != fuse);
        until("it is counted", || {
            ask(&address, "/metrics", "").body.contains(&format!("stage_restarts_total{{stage=\"fuse\"}} {count}"))
        });
    }
    let ill = health();
    assert!(ill.code == 503 && ill.body.contains("fuse was started again 3 times"), "{ill:?}");
    until("no alarm says that it hangs", || !alarms().contains("\"the process fuse does not answer"));
    line.interrupt().expect(0);
}

/// Catches a station whose rig is away that nothing but a line of text shows, one that shows a verdict meanwhile, and one that stays
/// ill.
#[test]
fn a_rig_that_is_away_is_a_fault() {
    let sandbox = Sandbox::new();
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let rig = format!("[[station]]\nnumber = 3\nsource = \"rig\"\nrig = \"127.0.0.1:{port}\"\n");
    sandbox.write("plant.toml", &format!("[fuse]\nreference = \"self\"\n{rig}"));
    let mut line = Running::start(&sandbox, "line --config plant.toml --out out --json --serve 127.0.0.1:0");
    let address = address_of(&mut line);
    let is_faulty = |fault: u8| {
        let metrics = ask(&address, "/metrics", "").body;
        metrics.contains(&format!("tapline_station_fault{{station=\"3\"}} {fault}.0"))
    };
    until("it is missed", || ask(&address, "/healthz", "").code == 503 && is_faulty(1));
    let health = ask(&address, "/healthz", "").body;
    assert!(health.contains(&format!("station 3: there is no connection to the rig at 127.0.0.1:{port}")), "{health}");
    let shown = sandbox.run("status --out out").expect(0).out;
    assert!(shown.contains("TROUBLE station 3: there is no connection to the rig"), "{shown}");
    let rig = Running::start(&sandbox, &format!("rig --listen 127.0.0.1:{port}"));
    until("it is there", || ask(&address, "/healthz", "").code == 200 && is_faulty(0));
    drop(rig);
    until("it is missed again", || ask(&address, "/healthz", "").code == 503 && is_faulty(1));
    line.interrupt();
}

/// Catches a page that others can read without the token, or by a name of theirs for this machine, a token that is not taken or is
/// waited for for ever, a file that anyone can ask for, and answers without the headers that bind a browser.
#[test]
fn only_who_may_sees_the_line() {
    let sandbox = Sandbox::new();
    slow_plant(&sandbox, 1, 50.0, "");
    let refused = sandbox.run("line --config plant.toml --out out --serve 0.0.0.0:0").expect(1);
    assert!(refused.err.contains("--serve-token-file") && !sandbox.path("out").exists(), "{refused:?}");

    let mut line = Running::start(&sandbox, "line --config plant.toml --out near --json --serve 127.0.0.1:0");
    let address = address_of(&mut line);
    let busy = sandbox.run(&format!("line --config plant.toml --out out --serve {address}")).expect(1);
    assert!(busy.err.contains(&format!("cannot listen at {address}")), "{busy:?}");
    let page = ask(&address, "/", "");
    assert!(page.code == 200 && page.header("x-content-type-options") == Some("nosniff"), "{page:?}");
    assert!(page.header("cache-control") == Some("no-store"), "{page:?}");
    let policy = page.header("content-security-policy").unwrap();
    assert!(policy.contains("default-src 'none'") && !policy.contains("unsafe"), "{policy}");
    // A foreign name that resolves to this machine.
    let rebound = send(&address, "GET /events HTTP/1.1\r\nHost: elsewhere.example:80\r\nConnection: close\r\n\r\n");
    assert_eq!(rebound.code, 403, "{rebound:?}");
    for path in ["/report?file=/etc/passwd", "/report?file=plant.toml", "/nothing"] {
        assert_eq!(ask(&address, path, "").code, 404, "{path}");
    }
    for method in ["POST", "PUT", "DELETE"] {
        let answer = send(&address, &format!("{method} / HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n"));
        assert_eq!(answer.code, 405, "{answer:?}");
    }
    line.interrupt().expect(0);

    sandbox.write_secret("token", "a-token-of-20-letters\n");
    let mut line = Running::start(
        &sandbox,
        "line --config plant.toml --out far --json --serve 0.0.0.0:0 --serve-token-file token",
    );
    let address = address_of(&mut line).replace("0.0.0.0", "127.0.0.1");
    for path in ["/events", "/metrics", "/healthz", "/app.js", "/report?file=x"] {
        assert_eq!(ask(&address, path, "").code, 401, "{path}");
    }
    assert_eq!(ask(&address, "/", "").header("location"), Some("/login"));
    assert!(ask(&address, "/login", "").body.contains("<form"));
    assert_eq!(ask(&address, "/metrics", "Authorization: Bearer a-token-of-20-letterz\r\n").code, 401);
    until("the line is well", || {
        ask(&address, "/healthz", "Authorization: Bearer a-token-of-20-letters\r\n").code == 200
    });
    let form = "token=a-token-of-20-letters";
    let post = |bytes: usize, body: &str| {
        let head =
            format!("POST /login HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\nContent-Length: {bytes}\r\n");
        format!("{head}Content-Type: application/x-www-form-urlencoded\r\n\r\n{body}")
    };
    let posted = post(form.len(), form);
    for answer in [ask(&address, "/?token=a-token-of-20-letters", ""), send(&address, &posted)] {
        let cookie = answer.header("set-cookie").unwrap();
        assert!(answer.code == 303 && cookie.contains("HttpOnly") && !cookie.contains("a-token"), "{answer:?}");
        let cookie = format!("Cookie: {}\r\n", cookie.split(';').next().unwrap());
        assert_eq!(ask(&address, "/app.js", &cookie).code, 200);
    }
    let wrong = ask(&address, "/?token=a-token-of-20-letterz", "");
    assert!(wrong.header("set-cookie").is_none() && wrong.code == 303, "{wrong:?}");
    assert_eq!(send(&address, &post(5000, &"x".repeat(5000))).code, 413, "too long");
    assert_eq!(send(&address, &post(form.len(), "token=")).code, 408, "the rest does not come");
    line.interrupt().expect(0);
}

/// Catches an event that is no line of JSON, of the line itself or of one of its stages, and an error at the end that is none.
#[test]
fn a_log_for_programs_is_a_line_of_json_for_each_event() {
    let sandbox = Sandbox::new();
    slow_plant(&sandbox, 2, 50.0, "");
    let mut line = Running::start(
        &sandbox,
        "--log json line --config plant.toml --out out --json --reference self --serve 127.0.0.1:0",
    );
    let said = line.log_line(&["the line is shown at"]);
    assert_eq!(serde_json::from_str::<Value>(&said).unwrap()["level"], "INFO", "{said}");
    line.verdict();
    signal(stage(line.child(), "process"), Signal::KILL);
    line.wait_for_log(&["was killed by signal 9"]);
    line.verdict();
    let done = line.interrupt().expect(0);
    let events: Vec<Value> =
        done.err.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|_| panic!("{line}"))).collect();
    assert!(events.len() >= 4, "{events:?}");
    for event in &events {
        let has_text = |key: &str| event[key].as_str().is_some_and(|text| !text.is_empty());
        assert!(["timestamp", "level", "message"].into_iter().all(has_text), "{event}");
    }
    let killed = events.iter().find(|event| event["message"].as_str().unwrap().contains("was killed")).unwrap();
    assert_eq!((&killed["level"], &killed["stage"]), (&"ERROR".into(), &"process".into()));
    let failed = sandbox.run("export nothing.h5 verdicts --log json").expect(1);
    let error: Value = serde_json::from_str(failed.err.trim()).unwrap();
    assert!(error["level"] == "ERROR" && error["message"].as_str().unwrap().contains("nothing.h5"), "{error}");
}
