//! The example that swaps reconstruction and planner runs to its end.
#![allow(missing_docs, clippy::unwrap_used, dead_code)]

#[path = "../examples/custom_pipeline.rs"]
mod custom_pipeline;

#[test]
fn the_custom_pipeline_runs() {
    let (_, _, shown) = custom_pipeline::explored().unwrap();
    assert!(shown > 0.3, "{shown}");
}
