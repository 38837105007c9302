//! Shares explored and distances of the model, against known ones.
#![allow(missing_docs, clippy::unwrap_used)]

mod common;

use common::{AXES, COUNT, Normal, SPACING, at_rest, ellipsoid, rotation};
use explore_loop::canonical::CanonicalModel;
use explore_loop::canonical::surface::triangulate;
use explore_loop::measure::{Measurer, TrueSurface};
use nalgebra::{Point3, Vector3};
use proptest::prelude::*;

fn truth(count: usize, axes: [f64; 3], spacing: f64) -> (TrueSurface, Vec<Normal>) {
    let (vertices, normals) = ellipsoid(count, axes);
    let triangles = triangulate(&vertices, &normals, spacing);
    assert_eq!(triangles.len(), 2 * count - 4);
    (
        TrueSurface {
            vertices,
            triangles,
        },
        normals,
    )
}

fn body() -> (TrueSurface, Vec<Normal>) {
    truth(COUNT, AXES, SPACING)
}

#[test]
fn the_truth_itself_is_explored_and_exact() {
    let (surface, normals) = body();
    let model = at_rest(&surface.vertices, &normals);
    let size = surface.size();
    // The diagonal of the box around the ellipsoid; the outermost points miss the poles by less than 1 %.
    let diagonal = 2.0 * Vector3::from(AXES).norm();
    assert!((0.98..=1.0).contains(&(size / diagonal)));
    let measures = Measurer::new(surface).unwrap().shape(&model, SPACING);
    assert!((measures.explored - 1.0).abs() < 1e-12);
    assert!(measures.difference < 1e-12);
    assert!((measures.relative - measures.difference / size).abs() < 1e-15);
}

/// One spacing on either side of its boundary is explored by the upper half, and nothing else of the lower half.
#[test]
fn the_upper_half_is_half() {
    let (surface, normals) = body();
    let area = surface.area();
    let upper: Vec<usize> = (0..COUNT)
        .filter(|&i| surface.vertices[i].z > 0.0)
        .collect();
    let points: Vec<_> = upper.iter().map(|&i| surface.vertices[i]).collect();
    let normals: Vec<_> = upper.iter().map(|&i| normals[i]).collect();
    let model = at_rest(&points, &normals);
    let measures = Measurer::new(surface).unwrap().shape(&model, SPACING);
    // The band below the rim is at most one spacing wide, over a rim of 2π·(longest half-axis) at most.
    let band = SPACING * std::f64::consts::TAU * AXES.into_iter().fold(0.0, f64::max) / area;
    assert!(
        (0.5..0.5 + band).contains(&measures.explored),
        "{measures:?} {band}"
    );
    assert!(measures.difference < 1e-12);
}

#[test]
fn nothing_is_explored_by_an_empty_model() {
    let measures = Measurer::new(body().0)
        .unwrap()
        .shape(&CanonicalModel::default(), SPACING);
    assert!(measures.explored == 0.0);
    assert!(Measurer::new(TrueSurface::default()).is_err());
}

proptest! {
    /// The half of a sphere explores the half and a band of two spacings: (1 + sin θ)/2 with the chord 2ε = 2 r sin(θ/2).
    /// Below 3 mm of spacing the gaps between the points of the net, 4 mm apart, count as unexplored.
    #[test]
    fn explored_reaches_two_spacings(share in 0.06..0.3f64) {
        let (radius, count) = (0.05, 2000);
        let (surface, normals) = truth(count, [radius; 3], 0.004);
        let upper = (0..count).filter(|&i| surface.vertices[i].z > 0.0);
        let (points, normals): (Vec<_>, Vec<_>) =
            upper.map(|i| (surface.vertices[i], normals[i])).unzip();
        let model = at_rest(&points, &normals);
        let spacing = share * radius;
        let measures = Measurer::new(surface).unwrap().shape(&model, spacing);
        let angle = 2.0 * (spacing / radius).asin();
        let expected = 0.5 * (1.0 + angle.sin());
        // The net is 4 mm wide: the rim of the model lies up to one such width, 0.04 of the area, above the equator.
        prop_assert!((measures.explored_2eps - expected).abs() < 0.04, "{} {expected}", measures.explored_2eps);
        prop_assert!(measures.explored <= measures.explored_2eps);
    }

    /// Material is followed through any motion, and an offset of what is hidden is what the error says.
    #[test]
    fn the_prediction_error_is_the_planted_offset(
        turn in rotation(), offset in [-0.02..0.02, -0.02..0.02, -0.02..0.02f64], stretch in 0.8..1.2f64,
    ) {
        let (surface, normals) = body();
        let offset = Vector3::from(offset);
        let mut model = at_rest(&surface.vertices, &normals);
        let mut measurer = Measurer::new(surface.clone()).unwrap();
        measurer.anchor(&model, &surface).unwrap();
        // The body is stretched and turned; the model follows, but for the hidden half.
        let moved = |p: &Point3<f64>| turn * Point3::new(stretch * p.x, p.y, p.z) + Vector3::new(0.1, 0.2, 0.3);
        let now = TrueSurface {
            vertices: surface.vertices.iter().map(moved).collect(),
            triangles: surface.triangles.clone(),
        };
        let seen: Vec<bool> = (0..COUNT).map(|i| i % 3 == 0).collect();
        for i in 0..COUNT {
            model.live_mut()[i] = now.vertices[i] + if seen[i] { Vector3::zeros() } else { offset };
        }
        let error = measurer.prediction_error(&model, &seen, &now).unwrap();
        // Anchors are projections onto triangles in double precision.
        prop_assert!((error - offset.norm()).abs() < 1e-9);
        let each = measurer.live_errors(&model, &now);
        for (e, s) in each.iter().zip(&seen) {
            let planted = if *s { 0.0 } else { offset.norm() };
            prop_assert!((e - planted).abs() < 1e-9);
        }
        prop_assert_eq!(measurer.prediction_error(&model, &[true; COUNT], &now), None);
    }
}
