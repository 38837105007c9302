//! Known results: half-seen bodies that are turned over, rigidly and bending.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test may say what it measured"
)]

mod common;

use common::{Noise, ellipsoid, mean_error};
use nalgebra::{Point3, Rotation3, Vector3};
use topo_ekf::{Filter, Frame, Observation, Options};

/// Seen from above: the upper half by normal, which for an ellipsoid is the upper half by height of the unit sphere.
fn visible(rest: &[Point3<f64>], half: [f64; 3], turn: &Rotation3<f64>) -> Vec<bool> {
    rest.iter()
        .map(|p| {
            let normal = Vector3::new(
                p.x / half[0].powi(2),
                p.y / half[1].powi(2),
                p.z / half[2].powi(2),
            );
            (turn * normal.normalize()).z > 0.1
        })
        .collect()
}

struct Run {
    hidden: f64,
    nearest: f64,
    worst_frame: f64,
}

/// Turns by 180° in `frames` frames; returns errors of the hidden half averaged over the frames.
fn turn_over(
    options: &Options,
    count: usize,
    frames: usize,
    sigma: f64,
    bend: impl Fn(&Point3<f64>, f64) -> Point3<f64>,
) -> Run {
    let half = [0.06, 0.045, 0.025];
    let (rest, edges) = ellipsoid(count, half, 6);
    let mut filter = Filter::new(&rest, &edges, options).unwrap();
    let mut nearest = rest.clone();
    let mut noise = Noise(1);
    let (mut hidden_sum, mut nearest_sum, mut worst) = (0.0, 0.0, 0f64);
    let mut before = rest.clone();
    for frame in 1..=frames {
        let share = frame as f64 / frames as f64;
        let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), std::f64::consts::PI * share);
        let lift = Vector3::new(0.02, 0.01, 0.03) * share;
        let truth: Vec<_> = rest.iter().map(|p| turn * bend(p, share) + lift).collect();
        let seen = visible(&rest, half, &turn);
        let observations: Vec<_> = (0..rest.len())
            .filter(|&i| seen[i])
            .map(|i| Observation {
                vertex: i as u32,
                position: truth[i] + noise.vector(sigma),
                sigma: sigma.max(1e-4),
            })
            .collect();
        filter.step(&Frame::new(&observations)).unwrap();
        // Baseline: hidden vertices move with the nearest visible neighbour (in the truth, without noise).
        let shown: Vec<usize> = (0..rest.len()).filter(|&i| seen[i]).collect();
        nearest = (0..rest.len())
            .map(|i| {
                if seen[i] {
                    return truth[i];
                }
                let by = |&&a: &&usize, &&b: &&usize| {
                    (nearest[a] - nearest[i])
                        .norm()
                        .total_cmp(&(nearest[b] - nearest[i]).norm())
                };
                let &j = shown.iter().min_by(by).unwrap();
                nearest[i] + (truth[j] - before[j])
            })
            .collect();
        let hidden = mean_error(filter.live(), &truth, |i| !seen[i]);
        hidden_sum += hidden;
        worst = worst.max(hidden);
        nearest_sum += mean_error(&nearest, &truth, |i| !seen[i]);
        before = truth;
    }
    Run {
        hidden: hidden_sum / frames as f64,
        nearest: nearest_sum / frames as f64,
        worst_frame: worst,
    }
}

#[test]
fn the_hidden_half_of_a_rigid_body_is_carried_round() {
    for (sigma, bound) in [(0.0, 1e-4), (0.5e-3, 1.0e-3), (1e-3, 2e-3)] {
        let run = turn_over(&Options::default(), 600, 60, sigma, |p, _| *p);
        println!(
            "sigma {sigma}: hidden {:.6} nearest {:.6} worst {:.6}",
            run.hidden, run.nearest, run.worst_frame
        );
        assert!(run.hidden < run.nearest / 3.0);
        assert!(run.worst_frame < bound);
    }
}

#[test]
fn the_hidden_half_of_a_bending_body_is_carried_round() {
    // Bends into an arc about the y axis while it turns: curvature up to 1/(0.15 m).
    let bend = |p: &Point3<f64>, share: f64| {
        let k = share / 0.15;
        if k == 0.0 {
            return *p;
        }
        let a = p.x * k;
        Point3::new(
            (1.0 / k + p.z) * a.sin(),
            p.y,
            (1.0 / k + p.z) * a.cos() - 1.0 / k,
        )
    };
    let run = turn_over(&Options::default(), 600, 60, 0.5e-3, bend);
    println!(
        "bending: hidden {:.6} nearest {:.6} worst {:.6}",
        run.hidden, run.nearest, run.worst_frame
    );
    assert!(run.hidden < run.nearest / 3.0);
}

#[test]
fn a_hidden_end_follows_the_turn_of_what_is_seen_before_it() {
    // A strip of 96 mm: the first 24 mm stay, the next 24 mm are seen to bend by up to 60°, the last 48 mm are hidden and
    // carried straight on. A common motion cannot tell this, and alternations alone would need hundreds to carry the turn out.
    let (square, square_edges, _) = common::sheet(25, 4e-3);
    let inside = |k: usize| square[k].y < 18e-3;
    let rest: Vec<_> = (0..square.len())
        .filter(|&k| inside(k))
        .map(|k| square[k])
        .collect();
    let edges: Vec<_> = square_edges
        .into_iter()
        .filter(|e| e.iter().all(|&k| inside(k as usize)))
        .collect();
    let (start, length) = (24e-3, 24e-3);
    let bent = |p: &Point3<f64>, angle: f64| {
        let s = p.x - start;
        if s <= 0.0 {
            return *p;
        }
        let radius = length / angle;
        let a = s.min(length) / radius;
        let straight = (s - length).max(0.0);
        let (x, z) = (
            radius * a.sin() + straight * a.cos(),
            radius * (1.0 - a.cos()) + straight * a.sin(),
        );
        Point3::new(start + x, p.y, z)
    };
    let mut filter = Filter::new(&rest, &edges, &Options::default()).unwrap();
    let mut noise = Noise(4);
    let mut tip = 0.0;
    for frame in 1..=40 {
        let truth: Vec<_> = rest
            .iter()
            .map(|p| bent(p, f64::from(frame) / 40.0 * std::f64::consts::FRAC_PI_3))
            .collect();
        let observations: Vec<_> = (0..rest.len())
            .filter(|&i| rest[i].x <= start + length + 1e-9)
            .map(|i| Observation {
                vertex: i as u32,
                position: truth[i] + noise.vector(2e-4),
                sigma: 2e-4,
            })
            .collect();
        filter.step(&Frame::new(&observations)).unwrap();
        tip = mean_error(filter.live(), &truth, |i| rest[i].x > start + length + 1e-9);
    }
    println!(
        "hidden end off by {tip:.6} after moving by {:.6}",
        0.5 * 0.048
    );
    assert!(tip < 1e-3);
}
