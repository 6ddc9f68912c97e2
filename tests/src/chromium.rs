//! Local HTML pages in a headless Chromium that cannot reach a network: opened, questioned, operated by keys.
//!
//! `chromium/find.sh` finds or installs the browser. All waits have a limit; what fails panics, as this is for tests.

mod complaints;
mod page;
mod pipe;

use std::cell::RefCell;
use std::fs::File;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tempfile::TempDir;

pub use page::{Key, Page};
use pipe::Pipe;

/// DevTools speaks on descriptors 3 and 4. Only bash gives a child those without unsafe code; what the browser itself
/// prints goes to the log. When a test is killed, its end of the pipe closes, and the browser ends too.
const LAUNCH: &str = r#"exec "$0" "$@" 3<&0 4>&1 0</dev/null 1>&2"#;

const FLAGS: [&str; 17] = [
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--remote-debugging-pipe",
    // No network: no name or address resolves, and the browser's own services stay off.
    "--host-resolver-rules=MAP * ~NOTFOUND",
    "--no-proxy-server",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-extensions",
    // The same pixels everywhere.
    "--force-color-profile=srgb",
    "--hide-scrollbars",
    "--lang=en-US",
    // Frames in one process, so that a page's session hears of all of them.
    "--disable-features=IsolateOrigins,site-per-process,IsolateSandboxedIframes",
    // Keys that come before the first picture count.
    "--allow-pre-commit-input",
    // Containers have little shared memory.
    "--disable-dev-shm-usage",
];

/// A running Chromium, which ends with this.
#[derive(Debug)]
pub struct Browser {
    process: Child,
    pipe: RefCell<Pipe>,
    size: (u32, u32),
    // Its files, which go last.
    _folder: TempDir,
}

impl Browser {
    /// Starts one whose pages are this large, or says why the test is skipped.
    ///
    /// # Panics
    /// If it does not start.
    pub fn open(width: u32, height: u32) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("chromium/find.sh");
        let found = Command::new("bash").arg(script).arg(folder.path()).output().unwrap();
        if found.status.code() == Some(77) {
            println!("skipped: {}", String::from_utf8_lossy(&found.stderr).trim());
            return None;
        }
        assert!(found.status.success(), "{found:?}");
        let program = String::from_utf8(found.stdout).unwrap();
        let log = folder.path().join("chromium.log");
        let mut process = Command::new("bash")
            .args(["-c", LAUNCH, program.trim()])
            .args(FLAGS)
            .arg(format!("--user-data-dir={}", folder.path().join("profile").display()))
            .arg(format!("--window-size={width},{height}"))
            .arg("about:blank")
            // Nor does it read or write what belongs to the user.
            .env("HOME", folder.path())
            .env_remove("XDG_CONFIG_HOME")
            .env_remove("XDG_CACHE_HOME")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(File::create(&log).unwrap())
            .spawn()
            .unwrap();
        let pipe = Pipe::new(&mut process, log);
        let browser =
            Self { process, pipe: RefCell::new(pipe), size: (width, height), _folder: folder };
        browser.call(None, "Browser.getVersion", json!({}));
        Some(browser)
    }

    /// A new empty page, focused, with light colours.
    ///
    /// # Panics
    /// If the browser does not answer.
    #[track_caller]
    pub fn page(&self) -> Page<'_> {
        Page::new(self)
    }

    #[track_caller]
    fn call(&self, session: Option<&str>, method: &str, parameters: Value) -> Value {
        self.pipe.borrow_mut().call(session, method, parameters)
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.pipe.get_mut().send(None, "Browser.close", json!({}));
        let asked = Instant::now();
        while asked.elapsed() < Duration::from_secs(10) {
            if !matches!(self.process.try_wait(), Ok(None)) {
                return;
            }
            sleep(Duration::from_millis(20));
        }
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
