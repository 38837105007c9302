//! Attachments to the table, and other bodies on it.

use nalgebra::{Isometry3, Point2, Point3, Vector3};

use super::Scene;
use super::body::Body;
use super::mesh::TriangleMesh;
use super::scene::Placed;

/// A patch of a body's underside that is held to the table.
///
/// ```text
/// held  ⇔  ‖(x, y) − middle‖ ≤ radius  and  height above the table ≤ 4 mm,    once the body is at rest
/// ```
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Attachment {
    /// Centre of the patch in the scene's own frame, metres.
    pub middle: Point2<f64>,
    /// Radius, metres.
    pub radius: f64,
}

/// Height above the table up to which nodes are held, metres: the underside of a soft body is flat there.
const NEAR: f64 = 0.004;

impl Default for Attachment {
    /// 3 cm across, below the thick lobe of the liver.
    fn default() -> Self {
        Self {
            middle: Point2::new(-0.06, 0.0),
            radius: 0.015,
        }
    }
}

impl Attachment {
    /// The held nodes with their positions.
    pub(super) fn nodes(&self, body: &Body, placed: &Placed<'_>) -> Vec<(usize, Point3<f64>)> {
        let middle = placed.of(&Point3::new(self.middle.x, self.middle.y, 0.0));
        body.carriers_of(|p| p.z <= NEAR && (p.xy() - middle.xy()).norm() <= self.radius)
    }
}

/// Position of a second body relative to the first, metres: out of the way of a turn, well in view.
const BESIDE: [f64; 2] = [0.185, -0.13];

/// A fixed body in view that is not explored.
#[derive(Debug, Clone)]
pub(super) struct Beside {
    /// World frame.
    pub surface: TriangleMesh,
}

impl Beside {
    pub fn seen_from(self, camera_from_world: &Isometry3<f64>) -> TriangleMesh {
        let mut mesh = self.surface;
        for p in &mut mesh.vertices {
            *p = camera_from_world * *p;
        }
        mesh
    }
}

/// Selects which body of a scene is the object, placed, and which is beside it: the object is the body whose surface is nearest to the seed point
/// (world frame); without one, the main body of the scene.
pub(super) fn choose(
    scene: &Scene,
    yaw: f64,
    at: Point3<f64>,
    seed_point: Option<Point3<f64>>,
) -> (Placed<'_>, Option<Beside>) {
    let own = scene.placed(yaw, at);
    let Some(second) = scene.beside() else {
        return (own, None);
    };
    let there = at + Vector3::new(BESIDE[0], BESIDE[1], 0.0);
    let other = second.placed(yaw, there);
    let nearest = |placed: &Placed<'_>, seed: &Point3<f64>| {
        let vertices = placed.surface.vertices.iter();
        vertices
            .map(|p| (p - seed).norm())
            .fold(f64::INFINITY, f64::min)
    };
    let swapped = seed_point.is_some_and(|seed| nearest(&other, &seed) < nearest(&own, &seed));
    let (object, mut rest) = if swapped { (other, own) } else { (own, other) };
    // The other body is not dropped, so it is placed on the table.
    for p in &mut rest.surface.vertices {
        p.z -= at.z;
    }
    let beside = Beside {
        surface: rest.surface,
    };
    (object, Some(beside))
}
