//! The report in a real browser: it loads nothing else, shows the figures of `metrics.json`, and draws the moving model.
//!
//! Where no Chromium is found the pages are still written and checked as text; `.ci/run` installs and requires one (`BROWSER_REQUIRED`).
#![allow(missing_docs, clippy::unwrap_used)]

#[path = "common/browser.rs"]
mod browser;
#[path = "common/closing_table.rs"]
mod closing_table;

use browser::{Page, browser};
use closing_table::{check_table, numbers};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

fn explore(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_explore"))
        .args(arguments)
        .output()
        .unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A run that closes, for all tests.
fn run() -> &'static Path {
    static RUN: OnceLock<tempfile::TempDir> = OnceLock::new();
    RUN.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let output = explore(&["run", "--scene", "ellipsoid", "--out", text(folder.path())]);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{stderr}");
        folder
    })
    .path()
}

fn metrics(folder: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(folder.join("metrics.json")).unwrap()).unwrap()
}

fn report(folder: &Path) -> String {
    std::fs::read_to_string(folder.join("report.html")).unwrap()
}

/// The data of a page, read as the page reads them.
fn data(page: &str, id: &str) -> Value {
    let start = format!("<script type=\"application/json\" id=\"{id}\">");
    let (_, rest) = page.split_once(&start).unwrap();
    let (json, _) = rest.split_once("</script>").unwrap();
    serde_json::from_str(json).unwrap()
}

/// Pixels of a picture, three bytes each.
fn pixels(png: &[u8]) -> Vec<[u8; 3]> {
    let mut reader = png::Decoder::new(std::io::Cursor::new(png))
        .read_info()
        .unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    let per = info.color_type.samples();
    bytes[..info.buffer_size()]
        .chunks_exact(per)
        .map(|p| [p[0], p[1], p[2]])
        .collect()
}

/// Share of pixels that differ by more than what smoothing does.
fn difference(a: &[[u8; 3]], b: &[[u8; 3]]) -> f64 {
    assert_eq!(a.len(), b.len());
    let far = |(p, q): &(&[u8; 3], &[u8; 3])| p.iter().zip(*q).any(|(x, y)| x.abs_diff(*y) > 24);
    a.iter().zip(b).filter(far).count() as f64 / a.len() as f64
}

/// Share of pixels that are not the background.
fn drawn(picture: &[[u8; 3]]) -> f64 {
    let background = [0xf6, 0xf7, 0xf9];
    let far = |p: &&[u8; 3]| p.iter().zip(background).any(|(x, y)| x.abs_diff(y) > 12);
    picture.iter().filter(far).count() as f64 / picture.len() as f64
}

fn choose(page: &mut Page, selector: &str, value: &str) {
    page.value(&format!(
        "(() => {{ const s = document.querySelector('{selector}'); s.value = '{value}'; \
         s.dispatchEvent(new Event(s.type === 'range' ? 'input' : 'change')); }})()"
    ));
    page.settle();
}

/// The colouring by what the camera saw.
const SEEN: &str = "colour as seen";
const REST: &str = "#rest .canvas canvas";
const LIVE: &str = "#live .canvas canvas";

/// The whole page of a run that closed.
#[test]
fn a_browser_shows_the_run() {
    let Some(browser) = browser() else { return };
    let mut page = Page::open(&browser, &run().join("report.html"), 1280, 800);
    let wide = page.value("document.documentElement.scrollWidth");
    assert!(wide.as_u64().unwrap() <= 1280, "{wide} pixels wide");

    // Both views show something, and not only their legends.
    let rest = pixels(&page.picture(Some(REST)));
    let live = pixels(&page.picture(Some(LIVE)));
    assert!(drawn(&rest) > 0.08, "{}", drawn(&rest));
    assert!(drawn(&live) > 0.08, "{}", drawn(&live));

    // Every colour of both views gives another picture.
    for (view, canvas) in [("rest", REST), ("live", LIVE)] {
        let names = page.value(&format!(
            "[...document.querySelectorAll('#{view} .colour option')].map(o => o.textContent)"
        ));
        let names: Vec<String> = serde_json::from_value(names).unwrap();
        assert!(
            names.len() >= 4
                && names
                    .iter()
                    .any(|n| n.contains("true") || n.contains("truth"))
        );
        assert!(names.iter().any(|n| n == "first seen"));
        assert_eq!(names.iter().any(|n| n == SEEN), view == "rest");
        // Half way through: by then some of the body is new.
        let middle = page.value("Math.floor(document.querySelector('#live .time').max * 0.7)");
        choose(&mut page, "#live .time", &middle.to_string());
        let mut pictures: Vec<Vec<[u8; 3]>> = Vec::new();
        for (k, name) in names.iter().enumerate() {
            choose(&mut page, &format!("#{view} .colour"), &k.to_string());
            let picture = pixels(&page.picture(Some(canvas)));
            for (other, before) in names.iter().zip(&pictures) {
                let changed = difference(before, &picture);
                assert!(
                    changed > 0.01,
                    "{view}: {name} looks like {other}: {changed}"
                );
            }
            pictures.push(picture);
        }
    }

    as_seen(&mut page);

    // The slider moves the body, the clock and the mark in the curves.
    let last = page.value("document.querySelector('#live .time').max");
    let mut seen = Vec::new();
    for k in ["0", "20", last.as_str().unwrap()] {
        choose(&mut page, "#live .time", k);
        let clock = page.value("document.querySelector('#live .clock').textContent");
        let mark = page.value("document.querySelector('svg .now').getAttribute('x1')");
        seen.push((pixels(&page.picture(Some(LIVE))), clock, mark));
    }
    for pair in seen.windows(2) {
        assert!(difference(&pair[0].0, &pair[1].0) > 0.005, "{}", pair[1].1);
        assert!(pair[0].1 != pair[1].1 && pair[0].2 != pair[1].2);
    }

    // Playing goes on by itself.
    choose(&mut page, "#live .time", "0");
    page.value("document.querySelector('#live .play').click()");
    page.wait("Number(document.querySelector('#live .time').value) >= 3");
    page.value("document.querySelector('#live .play').click()");

    // Parts can be hidden, the model can be turned and put back.
    choose(&mut page, "#live .time", "20");
    for part in ["mesh", "tools", "ways"] {
        let before = pixels(&page.picture(Some(LIVE)));
        page.value(&format!("document.querySelector('#live .{part}').click()"));
        let after = pixels(&page.picture(Some(LIVE)));
        assert!(difference(&before, &after) > 0.0005, "{part}");
    }
    turn(&mut page);

    // An earlier model is another one.
    let end = pixels(&page.picture(Some(REST)));
    choose(&mut page, "#rest .when", "0");
    let begin = pixels(&page.picture(Some(REST)));
    assert!(difference(&end, &begin) > 0.02);

    let curves = page.value("[...document.querySelectorAll('.chart')].map(c => c.querySelector('h3').textContent + ': ' + [...c.querySelectorAll('.curve')].map(p => p.getAttribute('d').length).join())");
    let curves: Vec<String> = serde_json::from_value(curves).unwrap();
    for name in [
        "Explored",
        "Accuracy",
        "Betti",
        "Error of the live model",
        "Time of a frame",
    ] {
        let found = curves
            .iter()
            .find(|c| c.starts_with(name) || c.contains(name));
        let lengths = numbers(found.unwrap_or_else(|| panic!("{name}: {curves:?}")));
        assert!(
            lengths.len() >= 2 && lengths.iter().all(|l| *l > 10.0),
            "{found:?}"
        );
    }
    let bars = page.value(
        "[...document.querySelectorAll('.barcode')].map(b => b.querySelectorAll('.bar').length)",
    );
    let bars: Vec<usize> = serde_json::from_value(bars).unwrap();
    let manipulations = metrics(run())["manipulations"].as_u64().unwrap();
    assert_eq!(bars.len() as u64, manipulations + 1);
    assert!(bars.iter().all(|n| *n > 3), "{bars:?}");

    check_table(&mut page, &metrics(run()));
    assert_eq!(page.complaints(), [""; 0]);
    let own = page.requests();
    assert!(own.len() == 1 && own[0].starts_with("file://"), "{own:?}");
}

/// What the camera saw is ochre all over: red above green above blue, except for the marked boundary.
fn as_seen(page: &mut Page) {
    page.value(&format!(
        "(() => {{ const s = document.querySelector('#rest .colour'); \
         s.value = [...s.options].findIndex(o => o.textContent === '{SEEN}'); \
         s.dispatchEvent(new Event('change')); }})()"
    ));
    page.settle();
    let seen = pixels(&page.picture(Some(REST)));
    let ochre = |p: &&[u8; 3]| p[0] > p[1] && 10 * u16::from(p[1]) > 11 * u16::from(p[2]);
    let share = seen.iter().filter(ochre).count() as f64 / seen.len() as f64;
    assert!(share > 0.8 * drawn(&seen), "{share} of {}", drawn(&seen));
    if let Some(folder) = std::env::var_os("PICTURES") {
        std::fs::write(Path::new(&folder).join("seen.png"), page.picture(None)).unwrap();
    }
}

/// Drags the model with the mouse, and puts it back.
fn turn(page: &mut Page) {
    let before = pixels(&page.picture(Some(REST)));
    let place = page.value("(() => { const r = document.querySelector('#rest canvas').getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; })()");
    let [x, y]: [f64; 2] = serde_json::from_value(place).unwrap();
    for (kind, by) in [
        ("mousePressed", 0.0),
        ("mouseMoved", 60.0),
        ("mouseMoved", 120.0),
        ("mouseReleased", 120.0),
    ] {
        page.call(
            "Input.dispatchMouseEvent",
            &serde_json::json!({"type": kind, "x": x + by, "y": y, "button": "left", "buttons": 1, "clickCount": 1}),
        );
    }
    let turned = pixels(&page.picture(Some(REST)));
    assert!(difference(&before, &turned) > 0.02);
    page.value("document.querySelector('#rest .reset').click()");
    let back = pixels(&page.picture(Some(REST)));
    assert!(difference(&before, &back) < 0.002);
}

/// A page is small enough for an e-mail and names its run.
#[test]
fn the_report_is_one_small_file() {
    let page = report(run());
    assert!(page.len() < 15_000_000, "{} bytes", page.len());
    assert!(
        page.contains("MIT License"),
        "three.js comes with its licence"
    );
    let about = &data(&page, "data")["about"];
    assert!(
        about["command"]
            .as_str()
            .unwrap()
            .contains("--scene ellipsoid")
    );
    assert_eq!(about["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(data(&page, "times")["metrics"], metrics(run()));
}

/// A recording without a truth, a hostile name, and one that shows nothing.
#[test]
fn a_browser_shows_recordings_too() {
    let folder = tempfile::tempdir().unwrap();
    let name = r#"<script>alert('x')</script> & "quotes" {{data}}.mcap"#.replace('/', "\u{2215}");
    let session = folder.path().join(&name);
    without_truth(&run().join("session.mcap"), &session);
    let out = folder.path().join("out");
    let arguments = [
        "replay",
        text(&session),
        "--until",
        "2",
        "--out",
        text(&out),
    ];
    let output = explore(&arguments);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    let metrics = metrics(&out);
    assert!(metrics["accuracy_m"].is_null());
    let Some(browser) = browser() else { return };
    let mut page = Page::open(&browser, &out.join("report.html"), 1280, 800);
    let title = page.value("document.getElementById('title').textContent");
    assert!(title.as_str().unwrap().ends_with(&name), "{title}");
    assert_eq!(page.value("document.querySelectorAll('script').length"), 4);
    let colours =
        page.value("[...document.querySelectorAll('.colour option')].map(o => o.textContent)");
    assert!(!colours.to_string().contains("tru"), "{colours}");
    assert!(drawn(&pixels(&page.picture(Some(REST)))) > 0.08);
    assert!(drawn(&pixels(&page.picture(Some(LIVE)))) > 0.08);
    check_table(&mut page, &metrics);
    assert_eq!(page.complaints(), [""; 0]);
    assert_eq!(page.requests().len(), 1);
}

/// Copies what a camera and arms said, without the truth.
fn without_truth(from: &Path, to: &Path) {
    let session = dvrk_io::session::SessionReader::open(from).unwrap();
    let mut writer = dvrk_io::session::SessionWriter::create(to).unwrap();
    let (normal, offset) = session.table.unwrap();
    writer.table(0.0, &normal, offset).unwrap();
    for frame in &session.frames {
        writer.points(frame.stamp, &frame.points).unwrap();
    }
    writer.finish().unwrap();
}

/// A report without data is a valid page.
#[test]
fn a_browser_shows_a_run_that_failed_at_once() {
    use explore_loop::report::html::{About, Closing, Report};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("report.html");
    let mut empty = Report::new(About::default());
    let rows = vec![("stop", "error: <b>nothing</b> was seen".into())];
    let closing = Closing::new(rows, &serde_json::json!({})).unwrap();
    empty.note("</script><img src=x onerror=alert(1)>".into());
    std::fs::write(&path, empty.page(&closing)).unwrap();
    let Some(browser) = browser() else { return };
    let mut page = Page::open(&browser, &path, 1280, 800);
    let shown = page.value("document.body.innerText");
    let shown = shown.as_str().unwrap();
    for words in [
        "<b>nothing</b> was seen",
        "<img src=x",
        "No frame was processed",
    ] {
        assert!(shown.contains(words), "{shown}");
    }
    assert_eq!(page.complaints(), [""; 0]);
}

/// Timing apart, the same run gives the same page.
#[test]
fn the_report_of_a_seed_is_the_same_every_time() {
    let folder = tempfile::tempdir().unwrap();
    let read = |name: &str, more: &[&str]| {
        let out = folder.path().join(name);
        let run = [
            "run",
            "--scene",
            "ellipsoid",
            "--max-manipulations",
            "0",
            "--quiet",
        ];
        let output = explore(&[&run, more, &["--out", text(&out)]].concat());
        assert_eq!(output.status.code(), Some(1));
        let mut data = data(&report(&out), "data");
        data["about"]["command"] = Value::Null;
        data
    };
    let first = read("a", &[]);
    assert_eq!(first, read("b", &[]));
    assert_ne!(first, read("c", &["--seed", "1"]));
    // From the checkpoint of its beginning it goes on to the same page.
    assert_eq!(first, read("a", &["--resume"]));
}

/// The path is printed whether or not a browser is there; a folder without a report is refused.
#[cfg(unix)]
#[test]
fn the_report_is_found_by_its_folder() {
    let view = |dir: &Path| {
        Command::new(env!("CARGO_BIN_EXE_explore"))
            .args(["view", text(dir)])
            .env("PATH", "")
            .output()
            .unwrap()
    };
    let folder = tempfile::tempdir().unwrap();
    let missing = view(folder.path());
    assert_eq!(missing.status.code(), Some(1));
    assert!(missing.stdout.is_empty());
    assert!(String::from_utf8_lossy(&missing.stderr).contains("report.html"));
    let path: PathBuf = folder.path().canonicalize().unwrap().join("report.html");
    std::fs::write(&path, "<!DOCTYPE html>").unwrap();
    for named in [folder.path(), &path] {
        let found = view(named);
        assert_eq!(found.status.code(), Some(0));
        let stdout = String::from_utf8_lossy(&found.stdout);
        assert_eq!(stdout.trim_end(), text(&path));
        assert!(String::from_utf8_lossy(&found.stderr).contains("no browser"));
    }
}
