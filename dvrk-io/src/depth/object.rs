//! From what a depth camera saw to the object: oriented points, and an account of everything else.
//!
//! ```text
//! missing → outside → arm → table → flying → voxel grid → lone → other parts → without a normal
//! ```
//! Every point of the message ends in exactly one of these, or in a point of the object ([`Account`]).

use nalgebra::{Point3, UnitVector3};

use super::Capsule;
use super::account::Account;
use super::hanging::Hanging;
use super::normals::normals;
use super::options::ObjectOptions;
use super::scan::{LengthUnit, Scan, UnitSource, is_measured};
use super::table::Table;
use super::voxels::{Neighbours, Voxel, parts, voxels};
use crate::Error;

/// The object, and how it was told from the rest.
#[derive(Debug, Clone, PartialEq)]
pub struct Object {
    /// Mean point of each voxel, metres, in the order in which the message met them.
    pub points: Vec<Point3<f64>>,
    /// Towards the camera, one a point.
    pub normals: Vec<UnitVector3<f64>>,
    /// Mean red, green and blue, one a point, if the message has colours.
    pub colors: Option<Vec<[u8; 3]>>,
    /// The table, given or found.
    pub table: Table,
    /// The unit of the message, and what told it.
    pub unit: (LengthUnit, UnitSource),
    /// What was removed, and why.
    pub account: Account,
}

/// Finds the object in what a depth camera saw: takes away arms, table, flying pixels and everything that is not
/// connected, and gives one oriented point a voxel.
///
/// *Guarantees.* Points lie inside the workspace, above the table by more than the clearance and outside of every
/// capsule up to the averaging within a voxel; every point of the message is accounted for; the same input gives the same bits.
///
/// *Limits.* The table that is found is the largest plane in view: a larger floor or wall must be cropped by the
/// workspace. What touches the object is part of it. Flying pixels are found in scans with a grid; without one, only
/// strays are.
///
/// # Errors
/// An option or capsule out of range; no table among the points; nothing left to be the object, or nothing within `gap`
/// of the seed point.
///
/// # Complexity
/// O(points · (30 + capsules) + voxels · neighbours).
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
    let part = object_voxels(scan, &left, options, &mut account)?;
    let (points, normals, colors) = oriented(&part, options, &mut account);
    if points.is_empty() {
        return Err(nothing(&account));
    }
    account.kept = points.len();
    Ok(Object {
        points,
        normals,
        colors: scan.colors().map(|_| colors),
        table,
        unit: scan.unit(),
        account,
    })
}

fn nothing(account: &Account) -> Error {
    Error::NoObject {
        reason: format!("nothing is left of {account}"),
    }
}

/// Indices of the points that are measured, inside the workspace and no arm.
fn visible(
    scan: &Scan,
    arms: &[Capsule],
    options: &ObjectOptions,
    account: &mut Account,
) -> Vec<usize> {
    let is_arm = |point: &Point3<f64>| {
        arms.iter()
            .any(|arm| arm.distance(point) <= options.arm_clearance)
    };
    let mut is_visible = |point: &Point3<f64>| {
        let gone = if !is_measured(point) {
            &mut account.missing
        } else if options
            .workspace
            .is_some_and(|workspace| !workspace.contains(point))
        {
            &mut account.outside
        } else if is_arm(point) {
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

/// Indices of the points above the table that do not hang.
fn above(
    seen: &[usize],
    scan: &Scan,
    table: &Table,
    hanging: Option<&Hanging>,
    options: &ObjectOptions,
    account: &mut Account,
) -> Vec<usize> {
    let mut is_left = |index: usize| {
        if table.height(&scan.points()[index]) <= options.table_clearance {
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

/// The voxels of the object.
fn object_voxels(
    scan: &Scan,
    left: &[usize],
    options: &ObjectOptions,
    account: &mut Account,
) -> Result<Vec<Voxel>, Error> {
    let points: Vec<_> = left.iter().map(|&index| scan.points()[index]).collect();
    let colors = scan.colors().unwrap_or_default();
    let colors: Vec<_> = left
        .iter()
        .filter_map(|&index| colors.get(index).copied())
        .collect();
    let mut voxels = voxels(&points, &colors, options.voxel);
    let means: Vec<_> = voxels.iter().map(|voxel| voxel.point).collect();
    let neighbours = Neighbours::new(&means, options.gap);
    let company = |voxel: &Voxel| {
        neighbours
            .of(&voxel.point)
            .map(|other| voxels[other].count)
            .sum::<usize>()
    };
    let trusted: Vec<bool> = voxels
        .iter()
        .map(|voxel| company(voxel) >= options.support)
        .collect();
    account.lone = counted(
        voxels
            .iter()
            .zip(&trusted)
            .filter(|(_, trusted)| !**trusted)
            .map(|(voxel, _)| voxel),
    );
    voxels = voxels
        .into_iter()
        .zip(trusted)
        .filter(|(_, trusted)| *trusted)
        .map(|(voxel, _)| voxel)
        .collect();

    let means: Vec<_> = voxels.iter().map(|voxel| voxel.point).collect();
    let part = parts(&means, options.gap);
    let object = match options.seed_point {
        None => largest(&voxels, &part).ok_or_else(|| nothing(account))?,
        Some(seed) => nearest(&means, &part, &seed, options.gap).map_err(|distance| Error::NoObject {
            reason: format!(
                "the nearest point is {:.3} m from the seed point, more than the gap of {:.3} m ({account})",
                distance, options.gap
            ),
        })?,
    };
    let (kept, others): (Vec<_>, Vec<_>) = voxels
        .iter()
        .zip(&part)
        .partition(|(_, part)| **part == object);
    account.other_parts = counted(others.into_iter().map(|(voxel, _)| voxel));
    Ok(kept.into_iter().map(|(voxel, _)| *voxel).collect())
}

fn counted<'a>(voxels: impl Iterator<Item = &'a Voxel>) -> usize {
    voxels.map(|voxel| voxel.count).sum()
}

/// The part with most points of the message, the first of those with as many.
fn largest(voxels: &[Voxel], part: &[usize]) -> Option<usize> {
    let mut counts = vec![0; voxels.len()];
    for (voxel, part) in voxels.iter().zip(part) {
        counts[*part] += voxel.count;
    }
    (0..counts.len()).rev().max_by_key(|&part| counts[part])
}

/// The part nearest to the seed point, or how far everything is.
fn nearest(
    points: &[Point3<f64>],
    part: &[usize],
    seed: &Point3<f64>,
    gap: f64,
) -> Result<usize, f64> {
    let distance = |index: &usize| (points[*index] - seed).norm();
    let closest = (0..points.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)));
    match closest {
        Some(index) if distance(&index) <= gap => Ok(part[index]),
        Some(index) => Err(distance(&index)),
        None => Err(f64::INFINITY),
    }
}

type Oriented = (Vec<Point3<f64>>, Vec<UnitVector3<f64>>, Vec<[u8; 3]>);

fn oriented(part: &[Voxel], options: &ObjectOptions, account: &mut Account) -> Oriented {
    // Two and a half cells: some twenty voxels of a surface.
    let radius = 2.5 * options.voxel;
    let means: Vec<_> = part.iter().map(|voxel| voxel.point).collect();
    let mut object = Oriented::default();
    for (voxel, normal) in part.iter().zip(normals(&means, radius, &options.viewpoint)) {
        let Some(normal) = normal else {
            account.without_normal += voxel.count;
            continue;
        };
        account.merged += voxel.count - 1;
        object.0.push(voxel.point);
        object.1.push(normal);
        object.2.push(voxel.color);
    }
    object
}
