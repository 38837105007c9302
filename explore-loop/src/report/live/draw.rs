//! The entities that the viewer draws.

use crate::cell::{ArmState, Observation, Plane};
use crate::report::colour::{Rgb, mix};
use nalgebra::{Isometry3, Point3, UnitVector3, Vector3};
use re_sdk_types::archetypes::{LineStrips3D, Mesh3D, Points3D};

/// Points of a cloud without colours.
const CLOUD: Rgb = [150, 150, 160];
/// The table.
const TABLE: Rgb = [90, 80, 70];
/// An arm with open jaws, and one that holds something.
const OPEN: Rgb = [60, 110, 200];
const HOLDING: Rgb = [220, 60, 50];
/// The planned paths of the tips.
const PLANNED: Rgb = [240, 190, 60];
/// A vertex of unknown accuracy.
const UNKNOWN: Rgb = [110, 110, 120];
/// A vertex known to [`SURE`] metres, and one not known to [`UNSURE`].
const SURE_COLOUR: Rgb = [60, 180, 75];
const BETWEEN_COLOUR: Rgb = [245, 200, 60];
const UNSURE_COLOUR: Rgb = [215, 50, 45];
const SURE: f64 = 0.5e-3;
const UNSURE: f64 = 2.5e-3;

/// Radius of a point of the cloud in spacings of the model, and of a grip, m.
const POINT: f64 = 0.12;
const GRIP: f32 = 0.006;
/// Half the side of the table, in sizes of the object, and the height of the object above it beyond which no table is drawn, m.
const TABLE_SIZE: f64 = 1.5;
const NO_TABLE: f64 = 2.0;
/// Lengths of the shaft and of the jaws of a tool, and half its thickness, m.
const SHAFT: f64 = 0.06;
const JAW: f64 = 0.012;
const THICKNESS: f32 = 0.001;

pub(super) fn single(p: &Point3<f64>) -> [f32; 3] {
    [p.x as f32, p.y as f32, p.z as f32]
}

fn directions<'a>(
    normals: impl IntoIterator<Item = &'a UnitVector3<f64>>,
) -> impl Iterator<Item = [f32; 3]> {
    normals.into_iter().map(|n| single(&n.into_inner().into()))
}

/// The points of the cloud, in their colours if they have any.
pub(super) fn cloud(observation: &Observation, spacing: f64) -> Points3D {
    let colours = observation
        .colours()
        .map_or_else(|| vec![CLOUD], <[Rgb]>::to_vec);
    Points3D::new(observation.points.iter().map(single))
        .with_radii([(POINT * spacing) as f32])
        .with_colors(colours)
}

/// Vertices with a colour each.
pub(super) fn vertices(points: &[Point3<f64>], colours: Vec<Rgb>, spacing: f64) -> Points3D {
    Points3D::new(points.iter().map(single))
        .with_radii([(2.0 * POINT * spacing) as f32])
        .with_colors(colours)
}

/// A surface; without triangles the previous ones are kept.
pub(super) fn surface(
    points: &[Point3<f64>],
    normals: &[UnitVector3<f64>],
    triangles: Option<&[[u32; 3]]>,
) -> Mesh3D {
    let mesh = Mesh3D::update_fields()
        .with_vertex_positions(points.iter().map(single))
        .with_vertex_normals(directions(normals));
    match triangles {
        Some(triangles) => mesh.with_triangle_indices(triangles.iter().copied()),
        None => mesh,
    }
}

/// Centre and size of the bounding box of a cloud, m.
pub(super) fn extent(points: &[Point3<f64>]) -> Option<(Point3<f64>, f64)> {
    let first = *points.first()?;
    let (low, high) = points
        .iter()
        .fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)));
    Some((nalgebra::center(&low, &high), (high - low).norm()))
}

/// A square of the table below an object with this centre and size; empty where no table was recorded.
pub(super) fn table(table: &Plane, middle: &Point3<f64>, size: f64) -> Option<Mesh3D> {
    let height = table.height(middle);
    let normal = table.normal.into_inner();
    if height.abs() > NO_TABLE {
        return None;
    }
    let foot = middle - normal * height;
    let side = normal.cross(&Vector3::y()).try_normalize(1e-3);
    let side =
        side.unwrap_or_else(|| normal.cross(&Vector3::x()).normalize()) * (TABLE_SIZE * size);
    let other = normal.cross(&side);
    let corners = [-side - other, side - other, side + other, other - side].map(|c| foot + c);
    let up = [single(&normal.into()); 4];
    let square = Mesh3D::new(corners.iter().map(single))
        .with_vertex_normals(up)
        .with_triangle_indices([[0u32, 1, 2], [0, 2, 3]])
        .with_vertex_colors([TABLE; 4]);
    Some(square)
}

/// The end of a tool: its shaft and the two jaws, red while they hold something.
pub(super) fn arm(arm: &ArmState) -> LineStrips3D {
    let at = |x: f64, z: f64| single(&(arm.camera_from_tip * Point3::new(0.0, x, z)));
    let (sin, cos) = (0.5 * arm.jaw).sin_cos();
    let jaw = |side: f64| vec![at(0.0, -JAW), at(side * JAW * sin, JAW * (cos - 1.0))];
    let shaft = vec![at(0.0, -JAW - SHAFT), at(0.0, -JAW)];
    LineStrips3D::new([shaft, jaw(1.0), jaw(-1.0)])
        .with_radii([THICKNESS])
        .with_colors([if arm.holding { HOLDING } else { OPEN }])
}

/// The points that arms hold, with the names of the arms.
pub(super) fn grips<'a>(arms: impl Iterator<Item = (&'a str, &'a ArmState)>) -> Points3D {
    let (names, places): (Vec<&str>, Vec<[f32; 3]>) = arms
        .filter(|(_, arm)| arm.holding)
        .map(|(name, arm)| (name, position(&arm.camera_from_tip)))
        .unzip();
    Points3D::new(places)
        .with_radii([GRIP])
        .with_colors([HOLDING])
        .with_labels(names)
}

/// The paths of the tips.
pub(super) fn ways<'a>(tips: impl Iterator<Item = Vec<&'a Isometry3<f64>>>) -> LineStrips3D {
    let ways = tips.map(|way| way.into_iter().map(position).collect::<Vec<_>>());
    LineStrips3D::new(ways)
        .with_radii([THICKNESS])
        .with_colors([PLANNED])
}

fn position(camera_from_tip: &Isometry3<f64>) -> [f32; 3] {
    single(&camera_from_tip.translation.vector.into())
}

/// Colour of a standard deviation, m, on a logarithmic scale: green up to [`SURE`], yellow at 1.1 mm, red from [`UNSURE`] on; grey if infinite.
pub(super) fn certainty(sigma: f64) -> Rgb {
    if !sigma.is_finite() {
        return UNKNOWN;
    }
    let share = (sigma.max(SURE) / SURE).ln() / (UNSURE / SURE).ln();
    if share < 0.5 {
        mix(SURE_COLOUR, BETWEEN_COLOUR, 2.0 * share)
    } else {
        mix(BETWEEN_COLOUR, UNSURE_COLOUR, 2.0 * share - 1.0)
    }
}

/// Colour where the accuracy is unknown: green if measured in the frame, grey otherwise.
pub(super) fn measured(measured: bool) -> Rgb {
    if measured { SURE_COLOUR } else { UNKNOWN }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_less_certain_the_redder() {
        assert_eq!(certainty(0.0), SURE_COLOUR);
        assert_eq!(certainty(SURE), SURE_COLOUR);
        assert_eq!(certainty(UNSURE), UNSURE_COLOUR);
        assert_eq!(certainty(1.0), UNSURE_COLOUR);
        assert_eq!(certainty(f64::INFINITY), UNKNOWN);
        assert_eq!(certainty(f64::NAN), UNKNOWN);
        let less_green = |a: f64, b: f64| {
            let (a, b) = (certainty(a), certainty(b));
            i32::from(a[1]) - i32::from(a[0]) > i32::from(b[1]) - i32::from(b[0])
        };
        assert!(less_green(0.6e-3, 1e-3) && less_green(1e-3, 1.5e-3) && less_green(1.5e-3, 2.4e-3));
    }
}
