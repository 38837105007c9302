//! Selects the voxels of the object.
//!
//! ```text
//! lone          fewer than `support` points within `gap` of the voxel, its own included
//! object        the part nearest to the seed point, or the one with most points
//! other parts   the rest
//! ```

use nalgebra::Point3;

use super::account::Account;
use super::options::ObjectOptions;
use super::voxels::{Neighbours, Voxel, parts};
use crate::Error;

/// The voxels of the object.
///
/// # Errors
/// No trusted voxel at all, or none within `gap` of the seed point.
pub(super) fn object_part(
    mut voxels: Vec<Voxel>,
    options: &ObjectOptions,
    account: &mut Account,
) -> Result<Vec<Voxel>, Error> {
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

/// The error with the account of all points.
pub(super) fn nothing(account: &Account) -> Error {
    Error::NoObject {
        reason: format!("no points are left: {account}"),
    }
}
