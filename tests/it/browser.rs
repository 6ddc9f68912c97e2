//! What the harness around Chromium promises to the tests that use it.
//!
//! `chromium/find.sh` finds or installs the browser; where that cannot be, the tests say so and are skipped.

use std::fs;
use std::io::ErrorKind;
use std::net::TcpListener;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use hksl_tests::chromium::{Browser, Key};
use serde_json::json;

const SOUND: &str = r##"<!doctype html><html lang="en"><meta charset="utf-8"><title>Sound</title>
<style>
  body { margin: 0; background: white; height: 1500px }
  footer { position: absolute; top: 1400px; width: 100%; height: 100px; background: rgb(200, 100, 50) }
  @media (prefers-color-scheme: dark) { body { background: rgb(1, 2, 3) } }
</style>
<a id="first" href="#first">one</a> <a id="second" href="#second">two</a>
<button id="last" onclick="window.pressed = (window.pressed ?? 0) + 1">three</button>
<img alt="" src="data:image/gif;base64,R0lGODlhAQABAAAAACH5BAEAAAAALAAAAAABAAEAAAIA">
<img alt="" src="a%20picture%20%C3%BC.svg"><script>console.log("fine")</script><footer></footer></html>"##;

const PICTURE: &str = r#"<svg xmlns="http://www.w3.org/2000/svg" width="2" height="2"></svg>"#;

fn write(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, text).unwrap();
    path
}

/// A folder and the sound page in it, whose names must be escaped in an address.
fn sound() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::Builder::new().prefix("50% #ü ?").tempdir().unwrap();
    write(folder.path(), "a picture ü.svg", PICTURE);
    let page = write(folder.path(), "sound page.html", SOUND);
    (folder, page)
}

#[test]
fn a_sound_page_has_no_complaints() {
    let Some(browser) = Browser::open(800, 600) else { return };
    let (_folder, path) = sound();
    let page = browser.page();
    page.goto(&path);
    // Again: the address is the same, the page is not.
    page.evaluate("window.old = true");
    page.goto(&path);
    assert_eq!(page.evaluate("window.old ?? null"), json!(null));
    assert_eq!(page.evaluate("document.title"), "Sound");
    let widths = "[...document.images].map(image => image.naturalWidth)";
    assert_eq!(page.evaluate(widths), json!([1, 2]));
    assert_eq!(page.complaints(), [""; 0]);
}

#[test]
fn each_fault_is_a_complaint() {
    let Some(browser) = Browser::open(800, 600) else { return };
    let folder = tempfile::tempdir().unwrap();
    // Stands for the network: nobody may come.
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.set_nonblocking(true).unwrap();
    let address = listener.local_addr().unwrap();
    let page = browser.page();
    // Each fault alone, on one page after another, and what is said of it.
    let faults = [
        ("<script>console.error('told', 7, {a: 1})</script>", "console error: told 7 Object"),
        ("<script>console.warn('careful')</script>", "console warning: careful"),
        ("<script>console.assert(false, 'denied')</script>", "console assert: denied"),
        ("<script>\n\nthrow new Error('thrown')</script>", "Uncaught: Error: thrown"),
        ("<script>Promise.reject(new Error('left'))</script>", "Error: left"),
        ("<script>onload = () => setTimeout(() => { throw 'soon' })</script>", "soon"),
        ("<img src='absent.png'>", "absent.png: net::ERR_FILE_NOT_FOUND"),
        ("<link rel=stylesheet href='http://styles.example/a.css'>", "http://styles.example/a.css"),
        ("<img src='http://ADDRESS/picture.png'>", "http://ADDRESS/picture.png"),
        ("<script>fetch('https://data.example/').catch(() => 0)</script>", "https://data.example/"),
        ("<script>new WebSocket('ws://ADDRESS/socket')</script>", "ws://ADDRESS/socket"),
        ("<script>navigator.sendBeacon('http://ADDRESS/beacon')</script>", "http://ADDRESS/beacon"),
        ("<script>open('http://ADDRESS/window')</script>", "http://ADDRESS/window"),
        ("<iframe src='http://ADDRESS/frame'></iframe>", "http://ADDRESS/frame"),
        (
            "<iframe sandbox=allow-scripts srcdoc='<script>console.error(`inside`)</script>'></iframe>",
            "console error: inside",
        ),
        (
            "<meta http-equiv=content-security-policy content=\"img-src 'none'\"><img src=x.png>",
            "Content Security Policy",
        ),
    ];
    let mut before = 0;
    for (number, (fault, said)) in faults.into_iter().enumerate() {
        let fault = fault.replace("ADDRESS", &address.to_string());
        let said = said.replace("ADDRESS", &address.to_string());
        let text = format!("<!doctype html><meta charset=utf-8><title>x</title>{fault}");
        page.goto(&write(folder.path(), &format!("{number}.html"), &text));
        let complaints = page.complaints();
        let new = &complaints[before..];
        assert!(new.iter().any(|line| line.contains(&said)), "{said}: {new:#?}");
        before = complaints.len();
    }
    assert!(page.complaints().iter().any(|line| line.ends_with("3.html:3")), "places are told");
    // What one page did is no complaint about another.
    assert_eq!(browser.page().complaints(), [""; 0]);
    assert_eq!(listener.accept().unwrap_err().kind(), ErrorKind::WouldBlock);
}

#[test]
fn expressions_have_values_and_exceptions_texts() {
    let Some(browser) = Browser::open(800, 600) else { return };
    let page = browser.page();
    assert_eq!(
        page.evaluate("({ a: [1, 'two', true, null] })"),
        json!({ "a": [1, "two", true, null] })
    );
    assert_eq!(page.evaluate("Promise.resolve(3)"), 3);
    let later = "new Promise(done => setTimeout(() => done('later'), 50))";
    assert_eq!(page.evaluate(later), "later");
    assert_eq!(page.evaluate("undefined"), json!(null));
    assert_eq!(page.evaluate("0 / 0"), "NaN");
    for wrong in ["throw new Error('a reason')", "Promise.reject(new Error('a reason'))"] {
        let ended = catch_unwind(AssertUnwindSafe(|| page.evaluate(wrong))).unwrap_err();
        let text = ended.downcast_ref::<String>().unwrap();
        assert!(text.contains("Error: a reason"), "{text}");
    }
    let ended = catch_unwind(AssertUnwindSafe(|| page.evaluate("1 +"))).unwrap_err();
    assert!(ended.downcast_ref::<String>().unwrap().contains("SyntaxError"));
    // Exceptions of questions are no complaints about the page.
    assert_eq!(page.complaints(), [""; 0]);
}

#[test]
fn keys_move_the_focus_and_press_buttons() {
    let Some(browser) = Browser::open(800, 600) else { return };
    let (folder, path) = sound();
    let page = browser.page();
    page.goto(&path);
    // One in front of it, as it were, which must not take the keys, nor stop the page from being drawn.
    let _other = browser.page();
    assert_eq!(
        page.evaluate("new Promise(requestAnimationFrame).then(() => document.hasFocus())"),
        true
    );
    let focused = || page.evaluate("document.activeElement.id");
    for id in ["first", "second", "last"] {
        page.press(Key::Tab);
        assert_eq!(focused(), id);
    }
    page.press(Key::Enter);
    assert_eq!(page.evaluate("window.pressed"), 1);
    page.press(Key::ShiftTab);
    assert_eq!(focused(), "second");
    assert_eq!(page.evaluate("document.activeElement.matches(':focus-visible')"), true);
    page.press(Key::Enter);
    assert_eq!(page.evaluate("location.hash"), "#second");

    let text = "<!doctype html><title>x</title><button onclick='pressed = true'>b</button><script>
        var pressed = false, keys = [];
        onkeydown = event => { keys.push(event.key + event.code); event.preventDefault() };
        onkeyup = event => keys.push('up');
        document.querySelector('button').focus()</script>";
    page.goto(&write(folder.path(), "keys.html", text));
    let keys = [Key::Escape, Key::ArrowLeft, Key::ArrowUp, Key::ArrowRight, Key::ArrowDown];
    for key in keys {
        page.press(key);
        let name = format!("{key:?}{key:?}");
        assert_eq!(page.evaluate("keys.splice(0)"), json!([name, "up"]));
    }
    // A page that keeps Enter to itself keeps it from the button.
    page.press(Key::Enter);
    assert_eq!(page.evaluate("pressed"), false);
    assert_eq!(page.complaints(), [""; 0]);
}

#[test]
fn colours_follow_the_preference() {
    let Some(browser) = Browser::open(800, 600) else { return };
    let (_folder, path) = sound();
    let page = browser.page();
    page.goto(&path);
    let background = || page.evaluate("getComputedStyle(document.body).backgroundColor");
    assert_eq!(background(), "rgb(255, 255, 255)");
    page.prefer_dark(true);
    assert_eq!(background(), "rgb(1, 2, 3)");
    page.goto(&path);
    assert_eq!(background(), "rgb(1, 2, 3)");
    page.prefer_dark(false);
    assert_eq!(background(), "rgb(255, 255, 255)");
}

#[test]
fn a_screenshot_shows_the_whole_page() {
    let Some(browser) = Browser::open(800, 600) else { return };
    let (folder, path) = sound();
    let page = browser.page();
    page.goto(&path);
    // The browser decodes it: its size and the colours of two points, one of them below the viewport.
    let shown = || {
        let file = folder.path().join("page.png");
        page.screenshot(&file);
        let bytes = fs::read(file).unwrap();
        assert!(bytes.starts_with(b"\x89PNG\r\n\x1a\n"));
        page.evaluate(&format!(
            "createImageBitmap(new Blob([new Uint8Array({bytes:?})])).then(image => {{
                const canvas = new OffscreenCanvas(image.width, image.height).getContext('2d');
                canvas.drawImage(image, 0, 0);
                const colour = y => [...canvas.getImageData(300, y, 1, 1).data].slice(0, 3);
                return [image.width, image.height, colour(1000), colour(1450)];
            }})"
        ))
    };
    let (above, footer) = ([255, 255, 255], [200, 100, 50]);
    assert_eq!(shown(), json!([800, 1500, above, footer]));
    page.viewport(360, 700);
    assert_eq!(page.evaluate("[innerWidth, innerHeight]"), json!([360, 700]));
    // Another page neither covers this one nor shares its size.
    let other = browser.page();
    assert_eq!(other.evaluate("[innerWidth, innerHeight]"), json!([800, 600]));
    page.prefer_dark(true);
    assert_eq!(shown(), json!([360, 1500, [1, 2, 3], footer]));
}
