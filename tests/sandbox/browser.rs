//! A browser without a window, controlled through pipes.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Command, Stdio};

use crossbeam::channel::{Receiver, bounded};
use rustix::fs::{CWD, FileType, Mode, mknodat};
use serde_json::{Value, json};

use crate::sandbox::Sandbox;
use crate::sandbox::running::{KilledOnDrop, PATIENCE};

/// Chromium, with one page.
pub(crate) struct Browser {
    _child: KilledOnDrop,
    commands: File,
    answers: Receiver<Value>,
    session: Option<String>,
    asked: u64,
}

impl Browser {
    /// Starts it; `None`, and a skip, where there is none.
    pub(crate) fn start(sandbox: &Sandbox) -> Option<Self> {
        let is_there = |name: &&str| Command::new(name).arg("--version").output().is_ok_and(|out| out.status.success());
        let Some(program) = ["chromium", "chromium-browser", "google-chrome"].into_iter().find(is_there) else {
            tapline_testing::skip("no chromium here");
            return None;
        };
        let [commands, answers] = ["commands", "answers"].map(|name| sandbox.path(name));
        for pipe in [&commands, &answers] {
            mknodat(CWD, pipe, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        }
        // The browser is led through the descriptors 3 and 4.
        let leading = format!(
            "exec {program} --headless=new --no-sandbox --disable-gpu --disable-dev-shm-usage --no-first-run \
             --remote-debugging-pipe --user-data-dir=browser about:blank 3<commands 4>answers"
        );
        let child = Command::new("/bin/sh")
            .args(["-c", &leading])
            .current_dir(sandbox.path(""))
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let commands = File::options().write(true).open(commands).unwrap();
        let answers = messages_of(&answers);
        let mut browser = Self { _child: KilledOnDrop(child), commands, answers, session: None, asked: 0 };
        let target = browser.command("Target.createTarget", &json!({ "url": "about:blank" }));
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let session = browser.command("Target.attachToTarget", &attach);
        browser.session = Some(session["sessionId"].as_str().unwrap().to_owned());
        Some(browser)
    }

    /// Sends the browser a command; returns its answer.
    fn command(&mut self, method: &str, parameters: &Value) -> Value {
        self.asked += 1;
        let mut message = json!({ "id": self.asked, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            message["sessionId"] = session.as_str().into();
        }
        self.commands.write_all(format!("{message}\0").as_bytes()).unwrap();
        loop {
            let answer = self.answers.recv_timeout(PATIENCE).unwrap();
            if answer["id"] == self.asked {
                assert!(answer["error"].is_null(), "{method}: {answer}");
                return answer["result"].clone();
            }
        }
    }

    pub(crate) fn open(&mut self, address: &str) {
        self.command("Page.navigate", &json!({ "url": address }));
    }

    /// The value of a JavaScript `expression` on the page; what it promises is waited for.
    pub(crate) fn value(&mut self, expression: &str) -> Value {
        let parameters = json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        let answer = self.command("Runtime.evaluate", &parameters);
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {answer}");
        answer["result"]["value"].clone()
    }
}

/// The messages of a pipe, each of which ends with a zero byte.
fn messages_of(pipe: &Path) -> Receiver<Value> {
    let (send, messages) = bounded(10_000);
    let pipe = BufReader::new(File::open(pipe).unwrap());
    let read = move || {
        let messages =
            pipe.split(0).map_while(Result::ok).map(|bytes| serde_json::from_slice::<Value>(&bytes).unwrap());
        messages.into_iter().try_for_each(|message| send.send(message))
    };
    std::thread::Builder::new().name("browser".to_owned()).spawn(read).unwrap();
    messages
}
