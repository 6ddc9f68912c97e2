//! A page: opened, questioned, operated by keys.

use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::pipe::LIMIT;
use super::{Browser, complaints};

/// A key that [`Page::press`] presses and releases.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Key {
    /// To the next element.
    Tab,
    /// To the one before.
    ShiftTab,
    /// Enter.
    Enter,
    /// Escape.
    Escape,
    /// Arrow to the left.
    ArrowLeft,
    /// Arrow upwards.
    ArrowUp,
    /// Arrow to the right.
    ArrowRight,
    /// Arrow downwards.
    ArrowDown,
}

/// A page of a [`Browser`].
///
/// # Panics
/// All methods do, if the browser ends, the page crashes, or an answer takes longer than a minute.
#[derive(Debug)]
pub struct Page<'browser> {
    browser: &'browser Browser,
    session: String,
}

impl<'browser> Page<'browser> {
    #[track_caller]
    pub(super) fn new(browser: &'browser Browser) -> Self {
        let target = json!({ "url": "about:blank" });
        let target = browser.call(None, "Target.createTarget", target);
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let attached = browser.call(None, "Target.attachToTarget", attach);
        let page = Self { browser, session: attached["sessionId"].as_str().unwrap().to_owned() };
        for domain in ["Page", "Runtime", "Log", "Network", "Inspector"] {
            page.call(&format!("{domain}.enable"), json!({}));
        }
        page.call("Page.setLifecycleEventsEnabled", json!({ "enabled": true }));
        // Each page believes that it is in front: it takes keys and is drawn, whatever else is open.
        page.call("Emulation.setFocusEmulationEnabled", json!({ "enabled": true }));
        page.viewport(browser.size.0, browser.size.1);
        page.prefer_dark(false);
        page
    }

    /// Opens a file and waits until all that belongs to it has been loaded.
    ///
    /// # Panics
    /// If it cannot be opened.
    #[track_caller]
    pub fn goto(&self, path: &Path) {
        let url = file_url(path);
        let navigated = self.call("Page.navigate", json!({ "url": url }));
        assert!(navigated.get("errorText").is_none(), "{url}: {}", navigated["errorText"]);
        let loader = &navigated["loaderId"];
        let loaded = |event: &Value| {
            let load = &event["params"];
            event["method"] == "Page.lifecycleEvent"
                && load["name"] == "load"
                && load["loaderId"] == *loader
        };
        let mut pipe = self.browser.pipe.borrow_mut();
        let in_time = pipe.wait(LIMIT, |events| events.iter().any(loaded));
        assert!(in_time, "{url} does not finish loading");
    }

    /// The value of a JavaScript expression, awaited where it is a promise. What JSON lacks, like NaN, is its name;
    /// undefined is null.
    ///
    /// # Panics
    /// With the text of an exception that it throws.
    #[track_caller]
    pub fn evaluate(&self, expression: &str) -> Value {
        let request = json!({
            "expression": expression, "returnByValue": true, "awaitPromise": true,
        });
        let mut answer = self.call("Runtime.evaluate", request);
        if let Some(exception) = answer.get("exceptionDetails") {
            panic!("{expression}: {}", complaints::exception(exception));
        }
        let result = &mut answer["result"];
        let name = result["unserializableValue"].take();
        if name.is_null() { result["value"].take() } else { name }
    }

    /// Presses a key and releases it.
    #[track_caller]
    pub fn press(&self, key: Key) {
        let (name, code, shift) = match key {
            Key::Tab => ("Tab", 9, false),
            Key::ShiftTab => ("Tab", 9, true),
            Key::Enter => ("Enter", 13, false),
            Key::Escape => ("Escape", 27, false),
            Key::ArrowLeft => ("ArrowLeft", 37, false),
            Key::ArrowUp => ("ArrowUp", 38, false),
            Key::ArrowRight => ("ArrowRight", 39, false),
            Key::ArrowDown => ("ArrowDown", 40, false),
        };
        // Of these, Enter alone types a character; buttons wait for it.
        let kinds: &[&str] = match key {
            Key::Enter => &["rawKeyDown", "char", "keyUp"],
            _ => &["rawKeyDown", "keyUp"],
        };
        for kind in kinds {
            let mut event = json!({
                "type": kind, "key": name, "code": name, "windowsVirtualKeyCode": code,
                "modifiers": if shift { 8 } else { 0 },
            });
            if *kind == "char" {
                event["text"] = "\r".into();
            }
            self.call("Input.dispatchKeyEvent", event);
        }
    }

    /// Writes the whole page, also what lies below the viewport, as a PNG of one pixel for each CSS pixel.
    #[track_caller]
    pub fn screenshot(&self, path: &Path) {
        let size = self.call("Page.getLayoutMetrics", json!({}))["cssContentSize"].take();
        let clip = json!({
            "x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1,
        });
        let request = json!({ "format": "png", "captureBeyondViewport": true, "clip": clip });
        let answer = self.call("Page.captureScreenshot", request);
        fs::write(path, from_base64(answer["data"].as_str().unwrap())).unwrap();
    }

    /// Whether the page is told that its reader prefers dark colours.
    #[track_caller]
    pub fn prefer_dark(&self, dark: bool) {
        let scheme = if dark { "dark" } else { "light" };
        let feature = json!({ "name": "prefers-color-scheme", "value": scheme });
        self.call("Emulation.setEmulatedMedia", json!({ "features": [feature] }));
    }

    /// Sets the size that the page is laid out for, in CSS pixels.
    #[track_caller]
    pub fn viewport(&self, width: u32, height: u32) {
        let metrics =
            json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false });
        self.call("Emulation.setDeviceMetricsOverride", metrics);
    }

    /// All that was wrong since the page was made: errors and warnings of the console and of the browser, uncaught
    /// exceptions, requests that failed or have not ended, and every request for something that is not a local file
    /// or part of the page itself.
    ///
    /// The browser does not tell of icons, nor of hints like `rel="preconnect"`; and no request goes anywhere.
    #[track_caller]
    pub fn complaints(&self) -> Vec<String> {
        let unfinished = |events: &[Value]| complaints::unfinished(events, &self.session);
        let deadline = Instant::now() + Duration::from_secs(10);
        loop {
            // What the page has done by now is reported before the answer to this.
            self.evaluate("new Promise(done => setTimeout(done))");
            let mut pipe = self.browser.pipe.borrow_mut();
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() || unfinished(&pipe.events).is_empty() {
                break;
            }
            // And what ends now may have consequences.
            pipe.wait(left, |events| unfinished(events).is_empty());
        }
        let events = &self.browser.pipe.borrow().events;
        let mut all = complaints::all(events, &self.session);
        all.extend(unfinished(events).iter().map(|url| format!("request has not ended: {url}")));
        all
    }

    #[track_caller]
    fn call(&self, method: &str, parameters: Value) -> Value {
        self.browser.call(Some(&self.session), method, parameters)
    }
}

fn file_url(path: &Path) -> String {
    let path = path.canonicalize().unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut url = "file://".to_owned();
    for &byte in path.as_os_str().as_bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'/' | b'-' | b'_' | b'.' | b'~' => {
                url.push(byte.into());
            }
            _ => url.push_str(&format!("%{byte:02X}")),
        }
    }
    url
}

fn from_base64(text: &str) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    let (mut held, mut bits) = (0_u32, 0);
    for letter in text.trim_end_matches('=').bytes() {
        let value = match letter {
            b'A'..=b'Z' => letter - b'A',
            b'a'..=b'z' => letter - b'a' + 26,
            b'0'..=b'9' => letter - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => panic!("{letter} is not base64"),
        };
        held = held << 6 | u32::from(value);
        bits += 6;
        if bits >= 8 {
            bits -= 8;
            bytes.push((held >> bits) as u8);
        }
    }
    bytes
}
