//! Files that describe a cell: errors name the line, and no content causes a panic.
//!
//! `PROPTEST_CASES=1000000 cargo test --release -p explore-loop --test cell_file` tries a million damaged files and a million random ones.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

use std::path::Path;

use dvrk_io::transport::Interfaces;
use explore_loop::cell::dvrk::CellFile;
use proptest::prelude::*;

const FILE: &str = include_str!("../doc/CELL.toml");

fn parse(text: &str) -> Result<CellFile, String> {
    CellFile::parse(text, Path::new("CELL.toml")).map_err(|error| error.to_string())
}

#[test]
fn a_file_that_is_wrong_is_named_with_its_line() {
    parse(FILE).unwrap();
    let two_lines = "image = \"/camera/camera/depth/image_rect_raw\"\ninfo = \"/camera/camera/depth/camera_info\"";
    let coloured = FILE.replacen(two_lines, &format!("{two_lines}\ncolour = \"/rgb\""), 1);
    assert_eq!(
        parse(&coloured).unwrap().camera.colour.as_deref(),
        Some("/rgb")
    );
    let cases = [
        (
            two_lines,
            "cloud = \"/points\"\ncolour = \"/rgb\"",
            "has its own colours",
        ),
        ("rate = 10.0", "rate = -1.0", "positive"),
        ("kind = \"si\"", "kind = \"mk3\"", "unknown variant"),
        (
            "name = \"PSM2\"",
            "name = \"PSM1\"",
            "a second arm with the name PSM1",
        ),
        ("speed = 0.05", "sped = 0.05", "unknown field"),
        (
            "normal = [0.0, 0.0, -1.0]",
            "normal = [0.0, 0.0, 0.0]",
            "is not a direction",
        ),
        ("version = 1", "version = 2", "version 1"),
        ("open = 1.0", "open = -1.0", "cannot close"),
        ("domain = 0", "domain = 233", "0 to 232"),
        ("loopback = false", "interfaces = [\"eth0\"]", "IP address"),
        (
            "loopback = false",
            "loopback = true\ninterfaces = [\"10.0.0.1\"]",
            "either",
        ),
    ];
    for (from, to, why) in cases {
        assert!(FILE.contains(from), "{from}");
        let wrong = FILE.replacen(from, to, 1);
        let error = parse(&wrong).unwrap_err();
        assert!(error.contains(why), "{error}");
        let line: usize = error.split(':').nth(1).unwrap().parse().unwrap();
        let lines: Vec<&str> = wrong.lines().collect();
        // The line itself, or that of the arm, the network or the camera that it is of.
        let named = lines[line - 1];
        let whole = named == "[[arm]]"
            || ["[network]", "[camera]"]
                .iter()
                .any(|table| named.starts_with(table));
        assert!(named.contains(to) || whole, "{error}: {named}");
    }
}

#[test]
fn the_network_is_that_of_the_file() {
    let network = |entry: &str| {
        let text = FILE.replacen("loopback = false", entry, 1);
        parse(&text.replacen("domain = 0", "domain = 42", 1))
            .unwrap()
            .network()
            .unwrap()
    };
    assert_eq!(network("").domain(), 42);
    assert_eq!(*network("").interfaces(), Interfaces::All);
    assert_eq!(
        *network("loopback = true").interfaces(),
        Interfaces::Loopback
    );
    let two = network("interfaces = [\"192.168.1.5\", \"::1\"]");
    let addresses = ["192.168.1.5", "::1"].map(|address| address.parse().unwrap());
    assert_eq!(*two.interfaces(), Interfaces::Only(addresses.to_vec()));
}

/// A file that is accepted is complete: everything can be constructed from it.
fn is_whole(file: &CellFile) {
    file.network().unwrap_or_default();
    let options = file.scan_options().unwrap();
    assert_eq!(options.arms.len(), file.arm.len());
    for arm in &options.arms {
        let pose = arm.camera_from_rcm.to_homogeneous();
        assert!(pose.iter().all(|value| value.is_finite()));
    }
    file.camera.topics().unwrap();
    // Written, it can be read again.
    parse(&file.to_toml().unwrap()).unwrap();
}

/// Bytes of the file that are replaced: where, how many, and by what.
fn damage() -> impl Strategy<Value = Vec<(usize, usize, Vec<u8>)>> {
    let text = prop_oneof![
        prop::collection::vec(any::<u8>(), 0..6),
        prop::sample::select(vec![
            "nan",
            "inf",
            "-1",
            "1e999",
            "[[arm]]",
            "[",
            "]",
            "\"",
            "= {",
            "\n",
            "0x7fff",
            "2026-01-01",
        ])
        .prop_map(|text| text.as_bytes().to_vec()),
    ];
    prop::collection::vec((0..FILE.len(), 0..9_usize, text), 1..4)
}

proptest! {
    #[test]
    fn damaged_files(damage in damage()) {
        let mut bytes = FILE.as_bytes().to_vec();
        for (at, length, by) in damage {
            let at = at.min(bytes.len());
            let end = bytes.len().min(at + length);
            bytes.splice(at..end, by);
        }
        if let Ok(file) = parse(&String::from_utf8_lossy(&bytes)) {
            is_whole(&file);
        }
    }

    /// Behind the first bytes of a whole file, or none.
    #[test]
    fn random_files(kept in 0..FILE.len(), bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let kept = FILE.as_bytes().get(..kept).filter(|_| bytes.len() % 2 == 0);
        let text = [kept.unwrap_or_default(), &bytes].concat();
        if let Ok(file) = parse(&String::from_utf8_lossy(&text)) {
            is_whole(&file);
        }
    }
}
