//! The document: a template whose placeholders are filled with style, scripts and data.
//!
//! Data are JSON without any `<`, so that no text can end its element; the page shows them as text, never as markup.

use serde_json::Value;
use std::fmt::Write;

const TEMPLATE: &str = include_str!("page.html");
const STYLE: &str = include_str!("page.css");
const THREE: &str = include_str!("vendor/three.min.js");
const LICENCE: &str = include_str!("vendor/LICENSE-three.txt");
const SCRIPTS: [&str; 6] = [
    include_str!("data.js"),
    include_str!("stage.js"),
    include_str!("model.js"),
    include_str!("live.js"),
    include_str!("charts.js"),
    include_str!("main.js"),
];

/// The page of a run.
pub(super) fn document(subject: &str, data: &Value, times: &Value) -> String {
    let mut page = String::with_capacity(1 << 20);
    let mut rest = TEMPLATE;
    // Placeholders are filled in order, and inserted text is not searched for further ones.
    while let Some((before, after)) = rest.split_once("{{") {
        page.push_str(before);
        let (name, after) = after.split_once("}}").unwrap_or((after, ""));
        match name {
            "title" => page.push_str(&escaped(subject)),
            "style" => page.push_str(STYLE),
            "licence" => page.push_str(LICENCE),
            "three" => page.push_str(THREE),
            "scripts" => page.extend(SCRIPTS),
            "data" => page.push_str(&json(data)),
            "times" => page.push_str(&json(times)),
            _ => {}
        }
        rest = after;
    }
    page.push_str(rest);
    page
}

/// JSON that is safe in a script element.
fn json(value: &Value) -> String {
    value.to_string().replace('<', "\\u003c")
}

/// Text that is safe in an element.
fn escaped(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '&' | '<' | '>' | '"' | '\'' => {
                // Writing to a String cannot fail.
                let _ = write!(out, "&#{};", c as u32);
            }
            _ => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::{SCRIPTS, THREE, document};
    use serde_json::json;

    /// No text from outside becomes markup, and none is taken for a place of the template.
    #[test]
    fn text_stays_text() {
        let hostile = "</script><script>alert(1)</script><!-- {{three}} \"'& ";
        let page = document(hostile, &json!({ "name": hostile }), &json!(hostile));
        let plain = document("", &json!({ "name": "" }), &json!(""));
        for mark in ["<script", "</script", "<!--", "alert(1)</"] {
            assert_eq!(page.matches(mark).count(), plain.matches(mark).count());
        }
        assert_eq!(page.matches(THREE).count(), 1);
    }

    /// The page's own parts must not end their element either, nor load anything.
    #[test]
    fn the_parts_are_whole() {
        for part in SCRIPTS.iter().chain(&[THREE]) {
            assert!(!part.contains("</script") && !part.contains("<!--"));
        }
        for part in SCRIPTS {
            assert!(!part.contains("innerHTML") && !part.contains("fetch("));
        }
    }
}
