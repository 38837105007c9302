//! Explores the egg and checks the result.

use super::egg::{AXES, EggCell};
use explore_loop::Error;
use explore_loop::canonical::CanonicalModel;
use explore_loop::explore::{Event, ExploreOptions, Explorer, Watcher};
use explore_loop::nalgebra::{Isometry3, Point3};
use explore_loop::plan::CoveragePlanner;

/// Result of an exploration of the egg.
pub struct End {
    pub stop: &'static str,
    pub manipulations: usize,
    /// Share of the egg's area that the camera truly saw.
    pub shown: f64,
    /// Half the extents of the model along the axes of the egg at the start, metres.
    pub axes: [f64; 3],
    pub frames: usize,
    pub failed: usize,
}

impl End {
    /// Whether the surface is complete and accurate, if it is reported as closed.
    pub fn is_honest(&self) -> bool {
        let off = self.axes.iter().zip(AXES).map(|(a, b)| (a - b).abs());
        self.stop != "closed" || (self.shown >= 0.99 && off.fold(0.0, f64::max) <= 1e-3)
    }
}

#[derive(Default)]
struct Count {
    frames: usize,
    failed: usize,
}

impl Watcher for Count {
    fn event(&mut self, event: Event<'_>, _: &CanonicalModel) -> Result<(), Error> {
        if let Event::Frame(_, report) = event {
            self.frames += 1;
            self.failed += usize::from(report.failure.is_some());
        }
        Ok(())
    }
}

/// Explores the egg in the pose of `seed`, with jaws that hold it or let it slip.
pub fn explored(seed: u64, slips: bool) -> Result<End, Error> {
    let mut cell = EggCell::new(seed);
    cell.slips = slips;
    let egg_from_camera = cell.camera_from_egg.inverse();
    let (mut planner, mut count) = (CoveragePlanner::default(), Count::default());
    let mut options = ExploreOptions::new(5e-3, 0.03);
    options.max_manipulations = 4;
    let mut explorer = Explorer::new(&mut cell, &mut planner, &mut count, options)?;
    let outcome = explorer.run()?;
    let rest = explorer.model().rest();
    let points = outcome
        .topology
        .surface
        .as_ref()
        .map_or(rest, |s| &s.vertices);
    let axes = extents(points, &egg_from_camera);
    drop(explorer);
    Ok(End {
        stop: outcome.stop.word(),
        manipulations: outcome.manipulations,
        shown: cell.share_shown(),
        axes,
        frames: count.frames,
        failed: count.failed,
    })
}

fn extents(points: &[Point3<f64>], egg_from_camera: &Isometry3<f64>) -> [f64; 3] {
    let here: Vec<Point3<f64>> = points.iter().map(|p| egg_from_camera * p).collect();
    [0, 1, 2].map(|k| {
        let high = here.iter().map(|p| p[k]).fold(f64::NEG_INFINITY, f64::max);
        let low = here.iter().map(|p| p[k]).fold(f64::INFINITY, f64::min);
        0.5 * (high - low)
    })
}
