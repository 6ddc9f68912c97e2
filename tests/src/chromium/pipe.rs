//! The DevTools protocol over a browser's pipes: JSON messages, each ended by a zero byte.

use std::fs;
use std::io::{self, BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::{Child, ChildStdin};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

/// How long an answer may take on a busy machine.
pub(super) const LIMIT: Duration = Duration::from_secs(60);

#[derive(Debug)]
pub(super) struct Pipe {
    input: ChildStdin,
    messages: Receiver<Value>,
    last_id: u64,
    /// All that the browser told unasked, in order.
    pub(super) events: Vec<Value>,
    log: PathBuf,
}

impl Pipe {
    /// Over the standard input and output of a process that writes errors to `log`.
    pub(super) fn new(process: &mut Child, log: PathBuf) -> Self {
        let input = process.stdin.take().unwrap();
        let mut output = BufReader::new(process.stdout.take().unwrap());
        let (sender, messages) = mpsc::channel();
        // A read has no time limit; a channel has. The thread ends with the process.
        thread::spawn(move || {
            let mut message = Vec::new();
            while output.read_until(0, &mut message).is_ok() && message.pop() == Some(0) {
                let Ok(value) = serde_json::from_slice(&message) else { return };
                if sender.send(value).is_err() {
                    return;
                }
                message.clear();
            }
        });
        Self { input, messages, last_id: 0, events: Vec::new(), log }
    }

    /// Sends a command to a page's session, or to the browser itself, and returns its number.
    pub(super) fn send(
        &mut self,
        session: Option<&str>,
        method: &str,
        parameters: Value,
    ) -> io::Result<u64> {
        self.last_id += 1;
        let mut message = json!({ "id": self.last_id, "method": method, "params": parameters });
        if let Some(session) = session {
            message["sessionId"] = session.into();
        }
        self.input.write_all(format!("{message}\0").as_bytes())?;
        Ok(self.last_id)
    }

    /// The result of a command.
    #[track_caller]
    pub(super) fn call(&mut self, session: Option<&str>, method: &str, parameters: Value) -> Value {
        let deadline = Instant::now() + LIMIT;
        let id = match self.send(session, method, parameters) {
            Ok(id) => id,
            Err(error) => self.fail(&format!("Chromium does not take {method}: {error}")),
        };
        loop {
            match self.receive(deadline) {
                Some(mut answer) if answer["id"] == id => match answer.get("error") {
                    Some(error) => self.fail(&format!("{method}: {error}")),
                    None => return answer["result"].take(),
                },
                // The answer to a command that a test has given up on.
                Some(answer) if answer.get("id").is_some() => {}
                Some(event) => self.events.push(event),
                None => self.fail(&format!("Chromium does not answer {method} in {LIMIT:?}")),
            }
        }
    }

    /// Waits until the events are as wanted; false if the limit comes first.
    #[track_caller]
    pub(super) fn wait(
        &mut self,
        limit: Duration,
        mut wanted: impl FnMut(&[Value]) -> bool,
    ) -> bool {
        let deadline = Instant::now() + limit;
        while !wanted(&self.events) {
            match self.receive(deadline) {
                Some(answer) if answer.get("id").is_some() => {}
                Some(event) => self.events.push(event),
                None => return false,
            }
        }
        true
    }

    /// The next message; none if the deadline comes first.
    #[track_caller]
    fn receive(&self, deadline: Instant) -> Option<Value> {
        let left = deadline.saturating_duration_since(Instant::now());
        match self.messages.recv_timeout(left) {
            Ok(message) if message["method"] == "Inspector.targetCrashed" => {
                self.fail("the page crashed")
            }
            Ok(message) => Some(message),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => self.fail("Chromium has ended"),
        }
    }

    #[track_caller]
    fn fail(&self, what: &str) -> ! {
        let log = fs::read(&self.log).unwrap_or_default();
        let log = String::from_utf8_lossy(&log);
        // Without what every machine without a desktop makes it say.
        let lines: Vec<_> = log.lines().filter(|line| !line.contains(":dbus/")).collect();
        let last = lines[lines.len().saturating_sub(10)..].join("\n");
        panic!("{what}; its last messages:\n{last}")
    }
}
