//! The input points, checked and merged, with normals averaged over their own sheet.
//!
//! Two sheets of a thin body can be closer to each other than two points of one sheet. Only their normals distinguish them, so every
//! average here is taken over neighbours whose normals agree.

use super::cells::Cells;
use super::{ClosedSurfaceError, ClosedSurfaceOptions};
use nalgebra::{Point3, UnitVector3, Vector3};

/// Fewest points from which a mesh is computed.
const FEWEST: usize = 12;
/// Clusters farther apart than this, in spacings, are separate: wider than any gap that a view leaves by chance.
const APART: f64 = 8.0;
/// Clusters with less than this share of the points are clutter.
const CLUTTER: f64 = 0.08;
/// If the mean of the normals is longer than this, all face one way, as on a flat patch; for half a ball it is 0.5.
const ONE_WAY: f64 = 0.97;
/// Normals within 60 degrees are averaged: more than the noise, less than the angle at the edge of a box.
const ALIKE: f64 = 0.5;

/// The points used, with normals averaged over neighbours.
pub(super) struct Samples {
    pub(super) points: Vec<Point3<f64>>,
    pub(super) normals: Vec<Vector3<f64>>,
    pub(super) weights: Vec<f64>,
    /// Index of each point in the input.
    pub(super) source: Vec<u32>,
    /// The points sorted into cubes of 1.5 spacings.
    pub(super) cells: Cells,
}

impl Samples {
    /// Checks the input, drops points without weight and clutter far from the object, and averages the normals.
    pub(super) fn new(
        points: &[Point3<f64>],
        normals: &[UnitVector3<f64>],
        weights: &[f64],
        options: &ClosedSurfaceOptions,
    ) -> Result<Self, ClosedSurfaceError> {
        check(points, normals, weights)?;
        let used: Vec<u32> = (0u32..)
            .zip(weights)
            .filter(|(_, w)| **w > 0.0)
            .map(|(i, _)| i)
            .collect();
        within_reach(points, &used, options)?;
        let used = without_clutter(points, used, options.spacing);
        if used.len() < FEWEST {
            return Err(ClosedSurfaceError::TooFewPoints {
                points: used.len(),
                needed: FEWEST,
            });
        }
        let facing: Vector3<f64> = used.iter().map(|&i| normals[i as usize].into_inner()).sum();
        if facing.norm() > ONE_WAY * used.len() as f64 {
            return Err(ClosedSurfaceError::NothingEnclosed);
        }
        // Only ratios of weights matter; the largest is scaled to 1 so that sums neither overflow nor underflow.
        let heaviest = used
            .iter()
            .map(|&i| weights[i as usize])
            .fold(0.0, f64::max);
        let chosen: Vec<Point3<f64>> = used.iter().map(|&i| points[i as usize]).collect();
        let mut samples = Self {
            cells: Cells::new(&chosen, 1.5 * options.spacing),
            normals: used
                .iter()
                .map(|&i| normals[i as usize].into_inner())
                .collect(),
            weights: used
                .iter()
                .map(|&i| (weights[i as usize] / heaviest).max(1e-6))
                .collect(),
            points: chosen,
            source: used,
        };
        for _ in 0..2 {
            samples.normals = samples.averaged_normals(options.spacing);
        }
        Ok(samples)
    }

    /// Number of samples.
    pub(super) fn len(&self) -> usize {
        self.points.len()
    }

    /// The samples with `keep[i]`.
    pub(super) fn retain(&self, keep: &[bool], spacing: f64) -> Self {
        let stays: Vec<usize> = (0..self.len()).filter(|&i| keep[i]).collect();
        let points: Vec<Point3<f64>> = stays.iter().map(|&i| self.points[i]).collect();
        Self {
            cells: Cells::new(&points, 1.5 * spacing),
            points,
            normals: stays.iter().map(|&i| self.normals[i]).collect(),
            weights: stays.iter().map(|&i| self.weights[i]).collect(),
            source: stays.iter().map(|&i| self.source[i]).collect(),
        }
    }

    /// Normals averaged over neighbours that face the same way, with weights that fall with distance and angle.
    fn averaged_normals(&self, spacing: f64) -> Vec<Vector3<f64>> {
        (0..self.len())
            .map(|i| {
                let mut sum = Vector3::zeros();
                self.cells.visit(&self.points[i], 1.5 * spacing, |j| {
                    let alike = self.normals[i].dot(&self.normals[j]) - ALIKE;
                    let far =
                        (self.points[j] - self.points[i]).norm_squared() / (spacing * spacing);
                    if alike > 0.0 && far < 2.25 {
                        sum += self.normals[j] * (self.weights[j] * alike * (-far).exp());
                    }
                });
                // The sum contains the normal itself, so it is never zero.
                sum.normalize()
            })
            .collect()
    }

    /// The density of samples around each sample: `Σ_j w_j exp(−t_ij²/2σ²)` over samples that face the same way
    /// and lie within `1.2 σ` of its tangent plane; `t` is the distance within the plane.
    pub(super) fn crowding(&self, sigma: f64) -> Vec<f64> {
        (0..self.len())
            .map(|i| {
                let mut sum = 0.0;
                self.cells.visit(&self.points[i], 2.5 * sigma, |j| {
                    if self.normals[i].dot(&self.normals[j]) > 0.3 {
                        let offset = self.points[j] - self.points[i];
                        let height = offset.dot(&self.normals[i]);
                        let aside = offset.norm_squared() - height * height;
                        if height.abs() < 1.2 * sigma {
                            sum += self.weights[j] * (-0.5 * aside / (sigma * sigma)).exp();
                        }
                    }
                });
                sum
            })
            .collect()
    }
}

fn check(
    points: &[Point3<f64>],
    normals: &[UnitVector3<f64>],
    weights: &[f64],
) -> Result<(), ClosedSurfaceError> {
    if points.len() != normals.len() || points.len() != weights.len() {
        return Err(ClosedSurfaceError::LengthMismatch {
            points: points.len(),
            normals: normals.len(),
            weights: weights.len(),
        });
    }
    let usable = |i: usize| {
        points[i].iter().all(|x| x.is_finite())
            && (normals[i].norm() - 1.0).abs() < 1e-3
            && weights[i].is_finite()
            && weights[i] >= 0.0
    };
    match (0..points.len()).find(|&i| !usable(i)) {
        Some(index) => Err(ClosedSurfaceError::BadPoint { index }),
        None => Ok(()),
    }
}

/// Rejects boxes so large that cubes could not be counted, most likely a wrong unit.
fn within_reach(
    points: &[Point3<f64>],
    used: &[u32],
    options: &ClosedSurfaceOptions,
) -> Result<(), ClosedSurfaceError> {
    let furthest = used
        .iter()
        .flat_map(|&i| {
            points[i as usize]
                .iter()
                .map(|x| x.abs())
                .collect::<Vec<_>>()
        })
        .fold(0.0, f64::max);
    if furthest > 1e7 * options.spacing {
        return Err(ClosedSurfaceError::TooLarge {
            extent: furthest,
            grid: options.grid,
        });
    }
    Ok(())
}

/// Drops clusters that hold few of the points and lie far from the others.
fn without_clutter(points: &[Point3<f64>], used: Vec<u32>, spacing: f64) -> Vec<u32> {
    let chosen: Vec<Point3<f64>> = used.iter().map(|&i| points[i as usize]).collect();
    // Touching cubes of the linking distance are linked: slightly generous, and fast however many points share a cube.
    let side = APART * spacing;
    let cells = Cells::new(&chosen, side);
    let mut cluster = vec![usize::MAX; chosen.len()];
    let mut sizes = Vec::new();
    for seed in 0..chosen.len() {
        if cluster[seed] != usize::MAX {
            continue;
        }
        cluster[seed] = sizes.len();
        let (mut front, mut size) = (vec![seed], 0);
        while let Some(i) = front.pop() {
            size += 1;
            cells.visit(&chosen[i], side, |j| {
                if cluster[j] == usize::MAX && (chosen[j] - chosen[i]).norm() < side {
                    cluster[j] = sizes.len();
                    front.push(j);
                }
            });
        }
        sizes.push(size);
    }
    let enough = CLUTTER * used.len() as f64;
    used.into_iter()
        .zip(cluster)
        .filter(|(_, c)| f64::from(sizes[*c]) >= enough)
        .map(|(i, _)| i)
        .collect()
}
