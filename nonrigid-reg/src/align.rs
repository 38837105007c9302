//! The start if no other is known: the rigid motion that brings one cloud onto another, with rotations of any size.
//!
//! ```text
//! starts    identity, and N rotations spread evenly over SO(3) (super-Fibonacci spirals), centroid on centroid
//! descend   from each: trimmed point-to-plane ICP on a few hundred points, gates from a third of the extent downwards
//! score     Σ (1 − d²/g²)₊ over source points whose normals agree with their match, both ways, g two point spacings
//! refine    the best few that differ on more points; the best of them is the answer
//! ```
//!
//! Plain ICP slides along smooth surfaces. The step is damped by the spread of the cloud, so that motions which the matches do not determine
//! stay zero. The starts are fixed, so the same input gives the same bits.
//!
//! Sources: P. Besl and N. McKay (1992); D. Chetverikov et al., The trimmed iterative closest point algorithm (2002); M. Alexa, Super-Fibonacci
//! spirals (2022).

use gpwrm::Tree;
use nalgebra::{
    Isometry3, Matrix6, Point3, Quaternion, Translation3, UnitQuaternion, UnitVector3, Vector3,
    Vector6,
};

use crate::cloud::{Cloud, representatives};
use crate::each::each;
use crate::error::Error;
use crate::input::check_cloud;

/// Number of rotations tried; any rotation is within some 35° of one of them.
const TURNS: usize = 200;
/// Number of points in the first descent and in the refinement.
const COARSE: usize = 150;
const FINE: usize = 600;
/// Number of candidates refined.
const REFINED: usize = 6;
/// Number of steps of the refinement.
const REFINING: i32 = 30;
/// Share of the matches kept, those with the smallest distances.
const TRIM: f64 = 0.8;
/// Two motions are the same if they differ by less than this, in radians and in root mean square distances from the centre.
const SAME: f64 = 0.15;
/// Smallest cosine between the normals of a match.
const COSINE: f64 = 0.6;

/// A rigid motion and how well it fits; by default none, with no overlap.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Alignment {
    /// Takes source points to the target.
    pub target_from_source: Isometry3<f64>,
    /// Share of source points with a target point of similar normal within two point spacings.
    pub overlap: f64,
    /// Root mean square distance of these along the normal, in m.
    pub residual: f64,
}

impl Alignment {
    /// The displacements of `points` under the motion: an `initial` for [`Registrar::register`](crate::Registrar::register).
    pub fn displacements(&self, points: &[Point3<f64>]) -> Vec<Vector3<f64>> {
        points
            .iter()
            .map(|p| self.target_from_source * p - p)
            .collect()
    }
}

/// Finds the rigid motion from `source` to `target` without an initial guess, for views that share most of their surface.
///
/// # Guarantees and limits
/// Rotations of any size are found on shapes without symmetry. On symmetric ones (a sphere, a smooth tube) one of the equivalent motions is
/// returned, the identity first. Views that share less than half of their surface may be misaligned: check `overlap`.
///
/// # Errors
/// Clouds of fewer than four points, or with coordinates that are not finite or normals that are not unit vectors.
///
/// # Complexity
/// About 200 descents on 150 points: some tens of milliseconds, whatever the size of the clouds, plus `O(n log n)`.
///
/// ```
/// use nalgebra::{Isometry3, Point3, Vector3};
/// use nonrigid_reg::{Cloud, align_rigid, estimate_normals};
/// let bumpy = |k: i32| {
///     let (x, y) = (f64::from(k % 40) * 0.003, f64::from(k / 40) * 0.002);
///     Point3::new(x, y, 0.006 * (70.0 * x).sin() + 0.008 * (40.0 * x + 90.0 * y).cos())
/// };
/// let before: Vec<_> = (0..1600).map(bumpy).collect();
/// let normals = estimate_normals(&before, 10, &Point3::new(0.06, 0.04, 1.0))?;
/// let truth = Isometry3::new(Vector3::new(0.2, 0.1, -0.3), Vector3::new(0.4, -0.3, 2.0));
/// let after: Vec<_> = before.iter().map(|p| truth * p).collect();
/// let turned: Vec<_> = normals.iter().map(|n| truth.rotation * n).collect();
/// let found = align_rigid(&Cloud { points: &before, normals: &normals }, &Cloud { points: &after, normals: &turned })?;
/// assert!(found.overlap > 0.9 && (found.target_from_source * before[0] - after[0]).norm() < 0.002);
/// # Ok::<(), nonrigid_reg::Error>(())
/// ```
pub fn align_rigid(source: &Cloud, target: &Cloud) -> Result<Alignment, Error> {
    let best = rigid_alignments(source, target)?.into_iter().next();
    Ok(best.unwrap_or_default())
}

/// Rigid motions from `source` to `target` that fit well and differ from one another, best first: up to six, at least one.
///
/// Where the clouds share only part of their surface, or the shape is nearly symmetric, the right motion need not be the first; knowledge that is
/// not in the clouds (what would hide what, where the table is) can then decide. [`align_rigid`] returns the first.
///
/// # Errors
/// Those of [`align_rigid`].
///
/// # Complexity
/// That of [`align_rigid`].
///
/// ```
/// use nalgebra::{Point3, Vector3};
/// use nonrigid_reg::{Cloud, estimate_normals, rigid_alignments};
/// // A rectangular plate fits onto itself turned by half a turn, too.
/// let plate: Vec<_> = (0..800)
///     .map(|k| Point3::new(f64::from(k % 40) * 0.004, f64::from(k / 40) * 0.004, 0.0))
///     .collect();
/// let normals = estimate_normals(&plate, 10, &Point3::new(0.08, 0.04, 1.0))?;
/// let cloud = Cloud { points: &plate, normals: &normals };
/// let found = rigid_alignments(&cloud, &cloud)?;
/// let turns: Vec<f64> = found.iter().map(|a| a.target_from_source.rotation.angle()).collect();
/// assert!(turns[0] < 0.05 && turns.iter().any(|turn| *turn > 3.0));
/// # Ok::<(), nonrigid_reg::Error>(())
/// ```
pub fn rigid_alignments(source: &Cloud, target: &Cloud) -> Result<Vec<Alignment>, Error> {
    check_cloud("source", source)?;
    check_cloud("target", target)?;
    let (coarse_source, coarse_target) =
        (Thin::new(source, COARSE)?, Thin::new(target, 4 * COARSE)?);
    let extent = coarse_source.spread.max(coarse_target.spread);
    let starts = starts(&coarse_source, &coarse_target);
    let gates = [0.7, 0.5, 0.35, 0.25, 0.2, 0.15, 0.12, 0.1].map(|share| share * extent);
    let found = each(starts.len(), |k| {
        let pose = descend(&coarse_source, &coarse_target, starts[k], &gates);
        (score(&coarse_source, &coarse_target, &pose), pose)
    });
    let fine = (Thin::new(source, FINE)?, Thin::new(target, 4 * FINE)?);
    let mut starts: Vec<_> = distinct(found, &coarse_source)
        .into_iter()
        .map(|(_, pose)| pose)
        .collect();
    starts.truncate(REFINED);
    Ok(refined(&fine, &starts))
}

/// The rigid motions nearest to these `starts` that fit well, best first; those that become the same are given once. For starts that the caller knows
/// more about than the clouds do.
///
/// # Errors
/// Those of [`align_rigid`].
///
/// # Complexity
/// Thirty steps on 600 points for each start, plus `O(n log n)`.
///
/// ```
/// use nalgebra::{Isometry3, Point3, Vector3};
/// use nonrigid_reg::{Cloud, estimate_normals, refine_rigid};
/// let place = |k: i32| (f64::from(k % 40) * 0.003, f64::from(k / 40) * 0.003);
/// let bumpy = |(x, y): (f64, f64)| Point3::new(x, y, 0.006 * (70.0 * x).sin() + 0.008 * (40.0 * x + 90.0 * y).cos());
/// let points: Vec<_> = (0..1600).map(|k| bumpy(place(k))).collect();
/// let normals = estimate_normals(&points, 10, &Point3::new(0.06, 0.06, 1.0))?;
/// let cloud = Cloud { points: &points, normals: &normals };
/// let near = Isometry3::new(Vector3::new(0.003, -0.002, 0.004), Vector3::new(0.03, 0.02, -0.04));
/// let found = refine_rigid(&cloud, &cloud, &[near])?;
/// assert!((found[0].target_from_source * points[0] - points[0]).norm() < 0.001);
/// # Ok::<(), nonrigid_reg::Error>(())
/// ```
pub fn refine_rigid(
    source: &Cloud,
    target: &Cloud,
    starts: &[Isometry3<f64>],
) -> Result<Vec<Alignment>, Error> {
    check_cloud("source", source)?;
    check_cloud("target", target)?;
    let fine = (Thin::new(source, FINE)?, Thin::new(target, 4 * FINE)?);
    Ok(refined(&fine, starts))
}

fn refined((source, target): &(Thin, Thin), starts: &[Isometry3<f64>]) -> Vec<Alignment> {
    let extent = source.spread.max(target.spread);
    let gates: Vec<f64> = (0..REFINING)
        .map(|k| extent * (0.15 * 0.85_f64.powi(k)).max(0.04))
        .collect();
    let found = each(starts.len(), |k| {
        let pose = descend(source, target, starts[k], &gates);
        (score(source, target, &pose), pose)
    });
    let kept = distinct(found, source).into_iter();
    kept.map(|(_, pose)| judge(source, target, pose)).collect()
}

/// The poses with their scores, best first, without those that differ from a better one by less than [`SAME`].
fn distinct(mut found: Vec<(f64, Isometry3<f64>)>, source: &Thin) -> Vec<(f64, Isometry3<f64>)> {
    // The sort is stable: among equals the earliest start comes first, the identity before all.
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut kept: Vec<(f64, Isometry3<f64>)> = Vec::new();
    for (score, pose) in found {
        let near = |other: &Isometry3<f64>| {
            let between = other.inverse() * pose;
            let shift = (between * source.centre - source.centre).norm();
            shift < SAME * source.spread && between.rotation.angle() < SAME
        };
        if !kept.iter().any(|(_, other)| near(other)) {
            kept.push((score, pose));
        }
    }
    kept
}

/// A down-sampled cloud with its search tree.
struct Thin {
    points: Vec<Point3<f64>>,
    normals: Vec<UnitVector3<f64>>,
    tree: Tree,
    centre: Point3<f64>,
    /// Root mean square distance from the centre.
    spread: f64,
    /// Typical distance between neighbours.
    spacing: f64,
}

impl Thin {
    /// About `count` points of `cloud`, one per cube.
    fn new(cloud: &Cloud, count: usize) -> Result<Self, Error> {
        let (low, high) = cloud.points.iter().fold(
            (Vector3::repeat(f64::MAX), Vector3::repeat(f64::MIN)),
            |(low, high), p| (low.inf(&p.coords), high.sup(&p.coords)),
        );
        let size = (high - low).norm().max(1e-9);
        // A surface fills about size²/side² cubes; the side is halved until there are enough.
        let mut side = size / 4.0;
        let mut kept = representatives(cloud.points, side)?;
        while kept.len() < count && kept.len() < cloud.points.len() && side > 1e-4 * size {
            side *= 0.8;
            kept = representatives(cloud.points, side)?;
        }
        let points: Vec<Point3<f64>> = kept.iter().map(|k| cloud.points[k.index]).collect();
        let mean = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64;
        let squares: f64 = points
            .iter()
            .map(|p| (p.coords - mean).norm_squared())
            .sum();
        Ok(Self {
            normals: kept.iter().map(|k| cloud.normals[k.index]).collect(),
            tree: Tree::new(&points).map_err(|_| Error::EmptyCloud { cloud: "thinned" })?,
            centre: mean.into(),
            spread: (squares / points.len() as f64).sqrt().max(1e-9),
            spacing: side,
            points,
        })
    }
}

/// The identity, the shift of the centroid, and rotations about it.
fn starts(source: &Thin, target: &Thin) -> Vec<Isometry3<f64>> {
    let about = |turn: UnitQuaternion<f64>| {
        let shift = target.centre.coords - turn * source.centre.coords;
        Isometry3::from_parts(Translation3::from(shift), turn)
    };
    let mut starts = vec![Isometry3::identity(), about(UnitQuaternion::identity())];
    starts.extend(even_rotations(TURNS).map(about));
    starts
}

/// `count` rotations, spread evenly over all of them: super-Fibonacci spirals (Alexa 2022).
///
/// ```
/// use nonrigid_reg::even_rotations;
/// use nonrigid_reg::nalgebra::{UnitQuaternion, Vector3};
/// let rotations: Vec<_> = even_rotations(200).collect();
/// // Any rotation is near one of them.
/// let any = UnitQuaternion::from_scaled_axis(Vector3::new(0.3, -2.0, 1.1));
/// assert!(rotations.iter().any(|near| near.angle_to(&any) < 0.7));
/// ```
pub fn even_rotations(count: usize) -> impl Iterator<Item = UnitQuaternion<f64>> {
    // √2, and the positive root of x⁴ = x + 4: Alexa's choice.
    let (phi, psi) = (std::f64::consts::SQRT_2, 1.533_751_168_755_204_3);
    (0..count).map(move |k| {
        let s = k as f64 + 0.5;
        let t = s / count as f64;
        let (r, other) = (t.sqrt(), (1.0 - t).sqrt());
        let turn = std::f64::consts::TAU * s;
        let (a, b) = (turn / phi, turn / psi);
        UnitQuaternion::from_quaternion(Quaternion::new(
            other * b.cos(),
            r * a.sin(),
            r * a.cos(),
            other * b.sin(),
        ))
    })
}

/// Match of a source point: moved point, index of the target point, squared distance.
type Hit = (Point3<f64>, usize, f64);

fn hits(source: &Thin, target: &Thin, pose: &Isometry3<f64>, gate: f64) -> Vec<Hit> {
    let hit = |(p, n): (&Point3<f64>, &UnitVector3<f64>)| {
        let y = pose * p;
        let near = target.tree.nearest(&y)?;
        let agrees = (pose.rotation * n.as_ref()).dot(&target.normals[near.index]) > COSINE;
        (agrees && near.squared < gate * gate).then_some((y, near.index, near.squared))
    };
    source
        .points
        .iter()
        .zip(&source.normals)
        .filter_map(hit)
        .collect()
}

/// Trimmed and damped point-to-plane steps, one per gate.
fn descend(source: &Thin, target: &Thin, start: Isometry3<f64>, gates: &[f64]) -> Isometry3<f64> {
    let mut pose = start;
    for &gate in gates {
        let mut hits = hits(source, target, &pose, gate);
        hits.sort_by(|a, b| a.2.total_cmp(&b.2));
        hits.truncate((TRIM * hits.len() as f64).ceil() as usize);
        if hits.len() < 6 {
            return pose;
        }
        let pivot = pose * source.centre;
        let (mut h, mut f) = (Matrix6::zeros(), Vector6::zeros());
        for (y, q, _) in &hits {
            let n = target.normals[*q].into_inner();
            let rho = n.dot(&(target.points[*q] - y));
            // Lengths are in units of the spread, so that one damping suits rotations and shifts.
            let arm = (y - pivot).cross(&n) / source.spread;
            let j = Vector6::new(arm.x, arm.y, arm.z, n.x, n.y, n.z);
            h += j * j.transpose();
            f += j * rho;
        }
        h += Matrix6::identity() * (0.01 * hits.len() as f64);
        let Some(step) = h.cholesky().map(|factor| factor.solve(&f)) else {
            return pose;
        };
        let turn = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(0) / source.spread);
        let shift = Translation3::from(step.fixed_rows::<3>(3).into_owned());
        let about = Isometry3::rotation_wrt_point(turn, pivot);
        pose = shift * about * pose;
    }
    pose
}

/// The share of each cloud that lies near the other, as in the module header.
fn score(source: &Thin, target: &Thin, pose: &Isometry3<f64>) -> f64 {
    let gate = 2.0 * source.spacing.max(target.spacing);
    let share = |a: &Thin, b: &Thin, pose: &Isometry3<f64>| {
        let near = hits(a, b, pose, gate);
        let sum: f64 = near.iter().map(|hit| 1.0 - hit.2 / (gate * gate)).sum();
        sum / a.points.len() as f64
    };
    share(source, target, pose) + share(target, source, &pose.inverse())
}

fn judge(source: &Thin, target: &Thin, pose: Isometry3<f64>) -> Alignment {
    let near = hits(
        source,
        target,
        &pose,
        2.0 * source.spacing.max(target.spacing),
    );
    let rho = |(y, q, _): &Hit| target.normals[*q].dot(&(y - target.points[*q]));
    let squares: f64 = near.iter().map(|hit| rho(hit).powi(2)).sum();
    Alignment {
        target_from_source: pose,
        overlap: near.len() as f64 / source.points.len() as f64,
        residual: (squares / (near.len() as f64).max(1.0)).sqrt(),
    }
}
