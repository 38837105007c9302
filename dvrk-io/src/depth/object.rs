//! From what a depth camera saw to the object: oriented points, and an account of everything else.
//!
//! ```text
//! missing → outside → arm → table → flying → voxel grid → lone → other parts → without a normal
//! ```
//! Every point of the message ends in exactly one of these, or in a point of the object ([`Account`]).

use std::fmt;

use nalgebra::{Point3, UnitVector3};

use super::hanging::Hanging;
use super::normals::normals;
use super::scan::{LengthUnit, Scan, UnitSource, is_measured};
use super::table::Table;
use super::voxels::{Neighbours, Voxel, parts, voxels};
use super::{Capsule, Workspace};
use crate::Error;

/// Settings of [`find_object`]. All lengths in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct ObjectOptions {
    /// Everything outside goes. Default: no crop.
    pub workspace: Option<Workspace>,
    /// The table, `normal · x + offset ≥ 0` on its free side, where the camera is. Default: it is found.
    pub table: Option<(UnitVector3<f64>, f64)>,
    /// How far from its plane a point of the table may be. Default 4 mm: twice the depth noise of a close stereo camera.
    pub table_tolerance: f64,
    /// Share of the points that a plane needs to be the table. Default 0.3: the visible cap of a ball that is all there is
    /// to see stays below it.
    pub least_table_share: f64,
    /// Everything up to this height above the table goes with it. Default 4 mm.
    pub table_clearance: f64,
    /// How far outside of its capsule a point may still belong to an arm. Default 5 mm.
    pub arm_clearance: f64,
    /// Steepest trusted angle between normal and ray, radians. Default 80°.
    pub max_incidence: f64,
    /// Differences of distance that noise alone makes. Default 2 mm.
    pub noise: f64,
    /// Edge of the cells of which one point is kept each. Default 3 mm.
    pub voxel: f64,
    /// Parts farther from each other than this are not one object; 2 to 50 voxels. Default 10 mm.
    pub gap: f64,
    /// Points within `gap` of a voxel, its own included, that make it trusted. Default 4: stray points are fewer.
    pub support: usize,
    /// The object is the part nearest to this point. Default: the part with most points.
    pub seed_point: Option<Point3<f64>>,
    /// Where the camera is in the frame of the points. Default: the origin.
    pub viewpoint: Point3<f64>,
    /// Seed of the search for the table.
    pub seed: u64,
}

impl Default for ObjectOptions {
    fn default() -> Self {
        Self {
            workspace: None,
            table: None,
            table_tolerance: 0.004,
            least_table_share: 0.3,
            table_clearance: 0.004,
            arm_clearance: 0.005,
            max_incidence: 80_f64.to_radians(),
            noise: 0.002,
            voxel: 0.003,
            gap: 0.010,
            support: 4,
            seed_point: None,
            viewpoint: Point3::origin(),
            seed: 0,
        }
    }
}

impl ObjectOptions {
    /// The same options with this workspace.
    #[must_use]
    pub fn with_workspace(self, workspace: Workspace) -> Self {
        Self {
            workspace: Some(workspace),
            ..self
        }
    }

    /// The same options with this table.
    #[must_use]
    pub fn with_table(self, normal: UnitVector3<f64>, offset: f64) -> Self {
        Self {
            table: Some((normal, offset)),
            ..self
        }
    }

    /// The same options with this search for the table: tolerance in metres, least share of the points, seed.
    #[must_use]
    pub fn with_table_search(self, tolerance: f64, least_share: f64, seed: u64) -> Self {
        Self {
            table_tolerance: tolerance,
            least_table_share: least_share,
            seed,
            ..self
        }
    }

    /// The same options with these clearances, metres.
    #[must_use]
    pub fn with_clearances(self, table_clearance: f64, arm_clearance: f64) -> Self {
        Self {
            table_clearance,
            arm_clearance,
            ..self
        }
    }

    /// The same options with this definition of a flying pixel: steepest angle in radians, noise in metres.
    #[must_use]
    pub fn with_edges(self, max_incidence: f64, noise: f64) -> Self {
        Self {
            max_incidence,
            noise,
            ..self
        }
    }

    /// The same options with this edge of the voxels, metres.
    #[must_use]
    pub fn with_voxel(self, voxel: f64) -> Self {
        Self { voxel, ..self }
    }

    /// The same options with this definition of a part: largest gap in metres, and points that make a voxel trusted.
    #[must_use]
    pub fn with_parts(self, gap: f64, support: usize) -> Self {
        Self {
            gap,
            support,
            ..self
        }
    }

    /// The same options with a point on or near the object.
    #[must_use]
    pub fn with_seed_point(self, point: Point3<f64>) -> Self {
        Self {
            seed_point: Some(point),
            ..self
        }
    }

    /// The same options for points in a frame in which the camera is here.
    #[must_use]
    pub fn with_viewpoint(self, viewpoint: Point3<f64>) -> Self {
        Self { viewpoint, ..self }
    }

    fn check(&self) -> Result<(), Error> {
        let refuse = |what, value, expected| {
            Err(Error::OutOfRange {
                what,
                value,
                expected,
            })
        };
        for (what, value) in [
            ("table tolerance", self.table_tolerance),
            ("table clearance", self.table_clearance),
            ("arm clearance", self.arm_clearance),
            ("depth noise", self.noise),
        ] {
            if !(value >= 0.0 && value.is_finite()) {
                return refuse(what, value, "must be finite and not negative");
            }
        }
        // Below a micrometre there is nothing to see, and the cells of a large cloud could no longer be counted.
        if !(1e-6..=1e3).contains(&self.voxel) {
            return refuse("voxel", self.voxel, "must be between 1 µm and 1 km");
        }
        // The mean points of neighbouring cells are up to two cells apart; far beyond that every voxel is a neighbour.
        if !(2.0..=50.0).contains(&(self.gap / self.voxel)) {
            return refuse("gap", self.gap, "must be 2 to 50 voxels");
        }
        if !(0.0..=1.0).contains(&self.least_table_share) {
            return refuse(
                "least share of the table",
                self.least_table_share,
                "must be between 0 and 1",
            );
        }
        if !(self.max_incidence > 0.0 && self.max_incidence < std::f64::consts::FRAC_PI_2) {
            return refuse(
                "largest incidence",
                self.max_incidence,
                "must be between 0 and π/2",
            );
        }
        for (index, point) in [Some(self.viewpoint), self.seed_point]
            .into_iter()
            .flatten()
            .enumerate()
        {
            if !point.iter().all(|value| value.is_finite()) {
                return Err(Error::NonFinitePoint {
                    index,
                    point: point.into(),
                });
            }
        }
        if let Some((normal, offset)) = self.table {
            let height = normal.dot(&self.viewpoint.coords) + offset;
            if !(height > 0.0 && height.is_finite()) {
                return refuse(
                    "height of the camera above the table",
                    height,
                    "must be positive and finite",
                );
            }
        }
        Ok(())
    }
}

/// Where every point of the message went. The tests run in this order, and the first that fails counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Account {
    /// Points, or pixels, of the message.
    pub total: usize,
    /// Nothing was measured: zero, NaN or infinite.
    pub missing: usize,
    /// Outside the workspace.
    pub outside: usize,
    /// In or near a capsule of an arm.
    pub arm: usize,
    /// On the table, below it, or no higher above it than the clearance.
    pub table: usize,
    /// Between a near and a far surface.
    pub flying: usize,
    /// With too few others around.
    pub lone: usize,
    /// In parts that are not the object.
    pub other_parts: usize,
    /// In voxels whose neighbours span no plane.
    pub without_normal: usize,
    /// Joined with others of the same voxel.
    pub merged: usize,
    /// Left: the points of the object.
    pub kept: usize,
}

impl fmt::Display for Account {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rows = [
            (self.missing, "nothing measured"),
            (self.outside, "outside the workspace"),
            (self.arm, "arm"),
            (self.table, "table"),
            (self.flying, "between two surfaces"),
            (self.lone, "alone"),
            (self.other_parts, "in other parts"),
            (self.without_normal, "without a normal"),
            (self.merged, "joined with others of their voxel"),
        ];
        write!(formatter, "{} points, {} kept", self.total, self.kept)?;
        let removed = rows.iter().filter(|(count, _)| *count > 0);
        removed
            .into_iter()
            .try_for_each(|(count, why)| write!(formatter, "; {count} {why}"))
    }
}

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
