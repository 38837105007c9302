//! Known self-contacts: sheets folded onto themselves and pushed through.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test may say what it measured"
)]

mod common;

use common::{Noise, sheet};
use nalgebra::{Point3, UnitVector3, Vector3};
use topo_ekf::{Filter, Frame, Observation, Options, Plane, Status};

/// A sheet bent round a cylinder of radius `r` about the middle of x, its upper flap `2r` over the lower one.
fn folded(rest: &[Point3<f64>], middle: f64, r: f64) -> Vec<Point3<f64>> {
    let arc = std::f64::consts::PI * r;
    rest.iter()
        .map(|p| {
            let s = p.x - (middle - arc / 2.0);
            if s <= 0.0 {
                Point3::new(p.x, p.y, 0.0)
            } else if s < arc {
                let a = s / r;
                Point3::new(middle - arc / 2.0 + r * a.sin(), p.y, r - r * a.cos())
            } else {
                Point3::new(middle - arc / 2.0 - (s - arc), p.y, 2.0 * r)
            }
        })
        .collect()
}

#[test]
fn a_flap_pushed_through_the_other_stays_on_its_side() {
    press(|t| t);
}

#[test]
fn the_side_does_not_depend_on_the_order_of_the_corners() {
    press(|[a, b, c]| [a, c, b]);
}

fn press(orient: impl Fn([u32; 3]) -> [u32; 3]) {
    let (rest, edges, triangles) = sheet(20, 4e-3);
    let triangles: Vec<_> = triangles.into_iter().map(orient).collect();
    let fold = folded(&rest, 0.038, 4e-3);
    let mut filter = Filter::new(&fold, &edges, &Options::default()).unwrap();
    let flap = |i: usize| fold[i].z > 7.9e-3;
    let up = [Plane {
        normal: UnitVector3::new_unchecked(Vector3::z()),
        offset: 0.0,
    }];
    let mut noise = Noise(5);
    let mut pushing = 0;
    for frame in 1..=8 {
        // The seen flap is reported lower and lower, at last 4 mm under the hidden one on the table.
        let drop = 1.5e-3 * f64::from(frame);
        let observations: Vec<_> = (0..rest.len())
            .filter(|&i| flap(i))
            .map(|i| Observation {
                vertex: i as u32,
                position: fold[i] - Vector3::z() * drop + noise.vector(2e-4),
                sigma: 1e-3,
            })
            .collect();
        let frame = Frame::new(&observations)
            .with_planes(&up)
            .with_triangles(&triangles);
        let report = filter.step(&frame).unwrap();
        println!(
            "{:?} {:?} {:?} resting {} pushing {} rounds {}",
            report.status,
            report.plane_depth,
            report.contact_depth,
            report.resting.len(),
            report.pushing,
            report.rounds
        );
        assert!(
            matches!(report.status, Status::Free | Status::Constrained),
            "{:?}",
            report.status
        );
        assert!(report.plane_depth[1] <= 1e-9);
        assert!(report.contact_depth[1] <= 1e-6);
        pushing = pushing.max(report.pushing);
    }
    assert!(pushing > 50, "the test must press something");
    // Every flap vertex is above the sheet that lies under it.
    for i in (0..rest.len()).filter(|&i| flap(i)) {
        assert!(filter.live()[i].z > 0.5e-3, "{i} {}", filter.live()[i]);
    }
}

#[test]
fn a_surface_that_does_not_touch_itself_is_left_alone() {
    let (rest, edges, triangles) = sheet(12, 4e-3);
    let mut noise = Noise(2);
    let observations: Vec<_> = (0..rest.len())
        .map(|i| Observation {
            vertex: i as u32,
            position: rest[i] + noise.vector(5e-4),
            sigma: 5e-4,
        })
        .collect();
    let run = |triangles: &[[u32; 3]]| {
        let mut filter = Filter::new(&rest, &edges, &Options::default()).unwrap();
        let report = filter
            .step(&Frame::new(&observations).with_triangles(triangles))
            .unwrap();
        assert_eq!(report.status, Status::Free);
        filter.live().to_vec()
    };
    assert_eq!(run(&triangles), run(&[]));
}
