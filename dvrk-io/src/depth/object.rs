//! From the scan of a depth camera to the object: oriented points, and an account of everything else.
//!
//! ```text
//! missing → outside → arm → table → flying → voxel grid → lone → other parts → without a normal
//! ```
//! Every point of the message ends in exactly one of these classes, or in a point of the object ([`Account`]).

use nalgebra::{Point3, UnitVector3};

use super::Capsule;
use super::account::Account;
use super::hanging::Hanging;
use super::normals::normals;
use super::options::ObjectOptions;
use super::part::{nothing, object_part};
use super::scan::{LengthUnit, Scan, UnitSource, is_measured};
use super::table::Table;
use super::voxels::{Voxel, voxels};
use crate::Error;

/// The object, and how it was found.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Object {
    /// Mean point of each voxel, metres, in the order of the message. If the mean lies in an arm, as may happen between points on two
    /// sides of it, the first point of the voxel is used.
    pub points: Vec<Point3<f64>>,
    /// Unit normals towards the camera, one for each point.
    pub normals: Vec<UnitVector3<f64>>,
    /// Mean red, green and blue for each point, if the message has colours.
    pub colours: Option<Vec<[u8; 3]>>,
    /// For each point of the scan, the index in `points` of its voxel; `None` if it was removed. Gives the pixels of
    /// the object in an aligned image.
    pub point_of: Vec<Option<usize>>,
    /// The table, given or found.
    pub table: Table,
    /// The unit of the message, and how it was determined.
    pub unit: (LengthUnit, UnitSource),
    /// What was removed, and why.
    pub account: Account,
}

/// Finds the object in the scan of a depth camera: removes arms, table, flying pixels and everything that is not
/// connected, and returns one oriented point for each voxel.
///
/// *Guarantees.* The points, and the points of the scan that they average, lie inside the workspace, above the table
/// by more than the clearance and outside of every capsule by more than the clearance; every point of the message is
/// accounted for; the same input gives the same bits.
///
/// *Limits.* The largest plane in view is taken as the table: a larger floor or wall must be cropped by the
/// workspace. Bodies that touch the object are part of it. Flying pixels are found only in scans with rows; otherwise only
/// isolated ones are removed. A step of depth as large as that of a surface at the steepest trusted angle counts as a surface, and
/// an outlier within `gap` of the object as part of it.
///
/// # Errors
/// An option or capsule out of range; no table among the points; no points left for the object, or none within `gap`
/// of the seed point.
///
/// # Complexity
/// O(points · (30 + capsules) + voxels · (neighbours + capsules)).
pub fn find_object(
    scan: &Scan,
    arms: &[Capsule],
    options: &ObjectOptions,
) -> Result<Object, Error> {
    options.check()?;
    arms.iter()
        .enumerate()
        .try_for_each(|(index, capsule)| capsule.check(index))?;
    let mut account = Account {
        total: scan.points().len(),
        ..Account::default()
    };
    let seen = visible(scan, arms, options, &mut account);
    let points: Vec<_> = seen.iter().map(|&index| scan.points()[index]).collect();
    let table = table(&points, options)?;
    let hanging = Hanging::of(
        scan,
        &options.viewpoint,
        options.noise,
        options.max_incidence,
    );
    let left = above(&seen, scan, &table, hanging.as_ref(), options, &mut account);
    let (mut voxels, voxel_of) = voxels_of(scan, &left, options.voxel);
    for voxel in &mut voxels {
        // A mean may lie where none of its points may.
        if is_outside(&voxel.point, options)
            || is_arm(&voxel.point, arms, options)
            || is_table(&voxel.point, &table, options)
        {
            voxel.point = voxel.first;
        }
    }
    let part = object_part(voxels, options, &mut account)?;
    let oriented = oriented(&part, options, &mut account);
    if oriented.is_empty() {
        return Err(nothing(&account));
    }
    account.kept = oriented.len();
    let colour = |(voxel, _): &(Voxel, _)| voxel.colour;
    Ok(Object {
        points: oriented.iter().map(|(voxel, _)| voxel.point).collect(),
        normals: oriented.iter().map(|(_, normal)| *normal).collect(),
        colours: scan
            .colours()
            .map(|_| oriented.iter().map(colour).collect()),
        point_of: point_of(account.total, &left, &voxel_of, &oriented),
        table,
        unit: scan.unit(),
        account,
    })
}

fn is_outside(point: &Point3<f64>, options: &ObjectOptions) -> bool {
    options
        .workspace
        .is_some_and(|workspace| !workspace.contains(point))
}

fn is_arm(point: &Point3<f64>, arms: &[Capsule], options: &ObjectOptions) -> bool {
    arms.iter()
        .any(|arm| arm.distance(point) <= options.arm_clearance)
}

fn is_table(point: &Point3<f64>, table: &Table, options: &ObjectOptions) -> bool {
    table.height(point) <= options.table_clearance
}

/// Indices of the points that are measured, inside the workspace and not on an arm.
fn visible(
    scan: &Scan,
    arms: &[Capsule],
    options: &ObjectOptions,
    account: &mut Account,
) -> Vec<usize> {
    let mut is_visible = |point: &Point3<f64>| {
        let gone = if !is_measured(point) {
            &mut account.missing
        } else if is_outside(point, options) {
            &mut account.outside
        } else if is_arm(point, arms, options) {
            &mut account.arm
        } else {
            return true;
        };
        *gone += 1;
        false
    };
    let points = scan.points();
    (0..points.len())
        .filter(|&index| is_visible(&points[index]))
        .collect()
}

fn table(points: &[Point3<f64>], options: &ObjectOptions) -> Result<Table, Error> {
    match options.table {
        Some((normal, offset)) => Ok(Table::judged(
            normal,
            offset,
            points,
            options.table_tolerance,
        )),
        None => Table::find(
            points,
            &options.viewpoint,
            options.table_tolerance,
            options.least_table_share,
            options.seed,
        ),
    }
}

/// Indices of the points above the table that are not flying.
fn above(
    seen: &[usize],
    scan: &Scan,
    table: &Table,
    hanging: Option<&Hanging>,
    options: &ObjectOptions,
    account: &mut Account,
) -> Vec<usize> {
    let mut is_left = |index: usize| {
        if is_table(&scan.points()[index], table, options) {
            account.table += 1;
            return false;
        }
        let hangs = hanging.is_some_and(|hanging| hanging.hangs(index));
        account.flying += usize::from(hangs);
        !hangs
    };
    seen.iter()
        .copied()
        .filter(|&index| is_left(index))
        .collect()
}

/// Voxels of the remaining points, and the voxel index of each.
fn voxels_of(scan: &Scan, left: &[usize], size: f64) -> (Vec<Voxel>, Vec<usize>) {
    let points: Vec<_> = left.iter().map(|&index| scan.points()[index]).collect();
    let colours = scan.colours().unwrap_or_default();
    let colours: Vec<_> = left
        .iter()
        .filter_map(|&index| colours.get(index).copied())
        .collect();
    voxels(&points, &colours, size)
}

/// The voxels that have a normal, with it.
fn oriented(
    part: &[Voxel],
    options: &ObjectOptions,
    account: &mut Account,
) -> Vec<(Voxel, UnitVector3<f64>)> {
    // Two and a half cells contain about twenty voxels of a surface.
    let radius = 2.5 * options.voxel;
    let means: Vec<_> = part.iter().map(|voxel| voxel.point).collect();
    let mut oriented = Vec::with_capacity(part.len());
    for (voxel, normal) in part.iter().zip(normals(&means, radius, &options.viewpoint)) {
        let Some(normal) = normal else {
            account.without_normal += voxel.count;
            continue;
        };
        account.merged += voxel.count - 1;
        oriented.push((*voxel, normal));
    }
    oriented
}

/// For each of `total` points of the scan, the index of its voxel among those that are kept.
fn point_of(
    total: usize,
    left: &[usize],
    voxel_of: &[usize],
    kept: &[(Voxel, UnitVector3<f64>)],
) -> Vec<Option<usize>> {
    // There are no more voxels than points left.
    let mut kept_as = vec![None; left.len()];
    for (index, (voxel, _)) in kept.iter().enumerate() {
        kept_as[voxel.number] = Some(index);
    }
    let mut point_of = vec![None; total];
    for (&index, &voxel) in left.iter().zip(voxel_of) {
        point_of[index] = kept_as[voxel];
    }
    point_of
}
