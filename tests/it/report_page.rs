//! The report's page in a real browser: nothing to complain of, every figure there, all of it reached by the keyboard.
//!
//! `chromium/find.sh` finds or installs the browser; where that cannot be, the test says so and is skipped.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use hksl_tests::chromium::{Browser, Key};
use hksl_tests::done;
use hksl_tests::synthetic::Synthetic;

/// Methods and ablations on control tasks and Falling Pixels, one run not done.
fn study(runs: &Path) {
    for seed in 1..=2 {
        for (task, distractor) in [
            ("cartpole-swingup", "none"),
            ("walker-walk", "camera-easy"),
            ("falling-pixels", "none"),
        ] {
            for method in ["hksl", "drq", "dreamer-v2"] {
                let evaluations =
                    if (method, task, seed) == ("drq", "walker-walk", 2) { 4 } else { 11 };
                Synthetic { task, distractor, method, seed, evaluations, ..Synthetic::default() }
                    .write(runs);
            }
        }
        for (task, ablation) in [("cartpole-swingup", "no-c"), ("falling-pixels", "h2")] {
            Synthetic { task, ablation, seed, ..Synthetic::default() }.write(runs);
        }
    }
}

#[test]
fn the_page_is_sound_whole_and_reached_by_the_keyboard() {
    let Some(browser) = Browser::open(1280, 900) else { return };
    let folder = tempfile::tempdir().unwrap();
    study(&folder.path().join("runs"));
    done(folder.path(), &["report", "runs", "--replicates", "500"]);
    let report = folder.path().join("report");
    let page = browser.page();
    page.goto(&report.join("index.html"));

    let figures = page.evaluate(
        "[...document.querySelectorAll('figure')].map(figure => {
            const box = figure.querySelector('svg').getBoundingClientRect();
            return {id: figure.id, wide: box.width > 300 && box.height > 120};
        })",
    );
    let shown: BTreeSet<&str> =
        figures.as_array().unwrap().iter().map(|of| of["id"].as_str().unwrap()).collect();
    let drawn: BTreeSet<String> = fs::read_dir(report.join("figures"))
        .unwrap()
        .map(|entry| entry.unwrap().path().file_stem().unwrap().to_str().unwrap().to_owned())
        .collect();
    assert_eq!(shown, drawn.iter().map(String::as_str).collect());
    assert!(figures.as_array().unwrap().iter().all(|of| of["wide"] == true), "{figures}");

    // Every link leads somewhere: within the page, or to a file beside it.
    let links =
        page.evaluate("[...document.querySelectorAll('a')].map(link => link.getAttribute('href'))");
    for link in links.as_array().unwrap().iter().map(|link| link.as_str().unwrap()) {
        let there = match link.strip_prefix('#') {
            Some(id) => page.evaluate(&format!("document.getElementById('{id}') !== null")) == true,
            None => report.join(link).is_file(),
        };
        assert!(there, "{link}");
    }
    let outside = "[...document.querySelectorAll('link, script[src], img')]\
                   .map(one => one.href || one.src).filter(to => !to.startsWith('data:')).length";
    assert_eq!(page.evaluate(outside), 0);

    // By the keyboard alone: the button first, then every link and figure.
    page.press(Key::Tab);
    let background = "getComputedStyle(document.body).backgroundColor";
    let light = page.evaluate(background);
    page.press(Key::Enter);
    assert_ne!(page.evaluate(background), light);
    page.press(Key::Enter);
    assert_eq!(page.evaluate(background), light);
    let mut reached = BTreeSet::new();
    for _ in 0..500 {
        page.press(Key::Tab);
        let at = page.evaluate(
            "document.activeElement === document.body ? '' :
             document.activeElement.id || document.activeElement.tagName",
        );
        let at = at.as_str().unwrap().to_owned();
        if at.is_empty() {
            break;
        }
        reached.insert(at);
    }
    for id in drawn.iter().map(String::as_str).chain(["A", "SUMMARY"]) {
        assert!(reached.contains(id), "{id} is not reached by Tab: {reached:?}");
    }

    // Narrow and dark, nothing spills over the page's edge. Pressed twice, the button follows the system again.
    page.viewport(420, 900);
    page.prefer_dark(true);
    assert_ne!(page.evaluate(background), light);
    let spills = page
        .evaluate("document.documentElement.scrollWidth > document.documentElement.clientWidth");
    assert_eq!(spills, false);
    let picture = folder.path().join("narrow.png");
    page.screenshot(&picture);
    assert!(fs::metadata(&picture).unwrap().len() > 20_000);
    assert_eq!(page.complaints(), Vec::<String>::new());
}
