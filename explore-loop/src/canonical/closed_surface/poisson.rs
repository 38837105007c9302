//! The indicator function of the body, one inside and zero outside, from oriented points.
//!
//! Its gradient is concentrated on the surface and points inwards. Each sample spreads its normal over a disc in its own tangent
//! plane, wide enough to overlap its neighbours but only two grid steps thick, so that two sheets a few millimetres apart are not
//! blurred into one, as they would be by round kernels. The indicator is the function whose gradient fits best,
//!
//! ```text
//! min_χ  Σ_edges (χ_b − χ_a − V_ab)²  +  α Σ_i (χ(p_i) − ½)²
//! ```
//! over the edges of a grid, where `V_ab` is the contribution of the discs to the edge (Kazhdan and Hoppe, Screened Poisson surface
//! reconstruction, 2013, with discs). It is solved on the whole box on two coarse grids, each starting from the previous one,
//! and then on the finest grid, only in a band around the samples and the coarse surface.

use super::grid::{Field, Grid};
use super::samples::Samples;
use nalgebra::{Point3, Vector3};

/// Standard deviation of a disc, in spacings: with 0.6, the sum of the discs of a sheet varies by less than 3 %.
pub(super) const DISC: f64 = 0.6;
/// Radius at which discs end, in standard deviations.
const DISC_END: f64 = 2.3;
/// Half the thickness of a disc, in steps.
const HALF_THICKNESS: f64 = 1.0;
/// Weight of the term that keeps the value at samples at ½.
const SCREEN: f64 = 1.0;
/// Number of coarse cells between the samples and the boundary of the box, where the indicator is zero.
const MARGIN: f64 = 3.0;
/// Most nodes of the finest grid: 64 million suffice for an object of 0.8 m at 2 mm.
const MOST_NODES: f64 = 6.4e7;
/// A sample whose value differs by more than this from that of the surface is off the surface: a first, coarse bound, then a finer one.
const STRAY: [f64; 2] = [0.38, 0.27];

/// The grid for samples at `step`: with a margin around them, and node counts that can be halved twice. `None` if too large.
pub(super) fn grid_around(points: &[Point3<f64>], step: f64) -> Option<Grid> {
    let first = points.first()?;
    let low = points.iter().fold(*first, |a, p| a.inf(p));
    let high = points.iter().fold(*first, |a, p| a.sup(p));
    let margin = MARGIN * 4.0 * step;
    let cells = (high - low).map(|x| ((x + 2.0 * margin) / (4.0 * step)).ceil());
    if cells.map(|c| 4.0 * c + 1.0).product() > MOST_NODES {
        return None;
    }
    let cells = cells.map(|c| c as usize);
    let size = cells.map(|c| c as f64 * 4.0 * step);
    Some(Grid {
        origin: low - (size - (high - low)) / 2.0,
        step,
        nodes: [0, 1, 2].map(|a| 4 * cells[a] + 1),
    })
}

/// The indicator on `grid`, and which samples lie on its surface.
pub(super) fn indicator(samples: Samples, grid: &Grid, spacing: f64) -> (Field, Samples) {
    let middle = grid.coarser();
    let mut samples = samples;
    let mut start = Field::zero(middle.coarser());
    let coarse = loop_strays(&mut samples, &mut start, &middle, spacing);
    let band = band(&coarse, &samples, grid, spacing);
    let mut fine = coarse.refined(grid.clone());
    solve(&mut fine, &band, &samples, spacing, 1e-3);
    (fine, samples)
}

/// Solves the coarse grids, drops the samples that are off their surface, and solves again.
fn loop_strays(samples: &mut Samples, coarsest: &mut Field, middle: &Grid, spacing: f64) -> Field {
    let all = |grid: &Grid| {
        let mut nodes = Vec::with_capacity(grid.len());
        grid.inner(|_, i| nodes.push(i as u32));
        nodes
    };
    let (every_coarsest, every_middle) = (all(&coarsest.grid), all(middle));
    solve(coarsest, &every_coarsest, samples, spacing, 1e-3);
    let mut field = coarsest.refined(middle.clone());
    solve(&mut field, &every_middle, samples, spacing, 3e-3);
    for most in STRAY {
        let level = level(&field, samples);
        let keep: Vec<bool> = samples
            .points
            .iter()
            .map(|p| (field.at(p) - level).abs() < most)
            .collect();
        let lost = keep.iter().filter(|k| !**k).count();
        // If many samples would be dropped, the surface is too poor to judge them by.
        if lost > 0 && 4 * lost < samples.len() {
            *samples = samples.retain(&keep, spacing);
            solve(&mut field, &every_middle, samples, spacing, 3e-3);
        }
    }
    field
}

/// The level of the surface: the median over the samples, kept away from the values inside and outside.
pub(super) fn level(field: &Field, samples: &Samples) -> f64 {
    let mut values: Vec<f64> = samples.points.iter().map(|p| field.at(p)).collect();
    values.sort_by(f64::total_cmp);
    values
        .get(values.len() / 2)
        .map_or(0.5, |v| v.clamp(0.3, 0.7))
}

/// Inner nodes of the fine grid near a sample or near the coarse surface.
fn band(coarse: &Field, samples: &Samples, fine: &Grid, spacing: f64) -> Vec<u32> {
    let grid = &coarse.grid;
    let mut near = vec![false; grid.len()];
    let radius = DISC * DISC_END * spacing / grid.step;
    for p in &samples.points {
        let local = grid.local(p);
        let low = [0, 1, 2].map(|a| (local[a] - radius).max(0.0) as usize);
        let high = [0, 1, 2].map(|a| ((local[a] + radius) as usize).min(grid.nodes[a] - 1));
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    near[grid.index([x, y, z])] = true;
                }
            }
        }
    }
    let level = level(coarse, samples);
    let strides = grid.strides();
    grid.inner(|_, i| {
        let inside = coarse.values[i] > level;
        for s in strides {
            if inside != (coarse.values[i + s] > level) {
                // Two cells on each side.
                for t in strides {
                    near[i] = true;
                    near[i + s] = true;
                    near[i - t] = true;
                    near[i + t] = true;
                }
            }
        }
    });
    let mut nodes = Vec::new();
    fine.inner(|node, i| {
        if near[grid.index(node.map(|n| n / 2))] {
            nodes.push(i as u32);
        }
    });
    nodes
}

/// Improves the field at `unknowns` by conjugate gradients until the residual is `tolerance` of the right-hand side.
fn solve(field: &mut Field, unknowns: &[u32], samples: &Samples, spacing: f64, tolerance: f64) {
    let system = System::new(&field.grid, unknowns, samples, spacing);
    let mut residual = vec![0.0; field.values.len()];
    system.apply(&field.values, &mut residual);
    let mut scale = 0.0;
    for &i in unknowns {
        let i = i as usize;
        residual[i] = system.right[i] - residual[i];
        scale += system.right[i] * system.right[i];
    }
    let mut direction = residual.clone();
    for i in 0..direction.len() {
        if !system.unknown[i] {
            direction[i] = 0.0;
        }
    }
    let mut image = vec![0.0; direction.len()];
    let mut squared: f64 = unknowns.iter().map(|&i| residual[i as usize].powi(2)).sum();
    for _ in 0..MOST_ITERATIONS {
        if squared <= tolerance * tolerance * scale {
            break;
        }
        system.apply(&direction, &mut image);
        let curvature: f64 = unknowns
            .iter()
            .map(|&i| direction[i as usize] * image[i as usize])
            .sum();
        let step = squared / curvature;
        let mut after = 0.0;
        for &i in unknowns {
            let i = i as usize;
            field.values[i] += step * direction[i];
            residual[i] -= step * image[i];
            after += residual[i] * residual[i];
        }
        let ratio = after / squared;
        for &i in unknowns {
            let i = i as usize;
            direction[i] = residual[i] + ratio * direction[i];
        }
        squared = after;
    }
}

/// Most steps of conjugate gradients.
const MOST_ITERATIONS: usize = 200;

/// The normal equations of the fit.
struct System<'a> {
    unknowns: &'a [u32],
    unknown: Vec<bool>,
    strides: [usize; 3],
    right: Vec<f64>,
    screens: Vec<([(usize, f64); 8], f64)>,
}

impl<'a> System<'a> {
    fn new(grid: &Grid, unknowns: &'a [u32], samples: &Samples, spacing: f64) -> Self {
        let mut unknown = vec![false; grid.len()];
        for &i in unknowns {
            unknown[i as usize] = true;
        }
        let sigma = DISC * spacing;
        let crowding = samples.crowding(sigma);
        let mut right = vec![0.0; grid.len()];
        let mut screens = Vec::with_capacity(samples.len());
        for i in 0..samples.len() {
            let share = samples.weights[i] / crowding[i];
            let normal = samples.normals[i];
            spread(grid, &samples.points[i], &normal, share, sigma, &mut right);
            let stencil = grid.stencil(&samples.points[i]);
            // Area of the sample in squares of the grid: 2πσ², divided among the samples around it.
            let area = std::f64::consts::TAU * (sigma / grid.step).powi(2) * share;
            let hold = SCREEN * area.min(4.0);
            for (node, weight) in stencil {
                right[node] += 0.5 * hold * weight;
            }
            screens.push((stencil, hold));
        }
        Self {
            unknowns,
            unknown,
            strides: grid.strides(),
            right,
            screens,
        }
    }

    /// `y = A x` at the unknowns; the other entries of `x` are given.
    fn apply(&self, x: &[f64], y: &mut [f64]) {
        let [_, b, c] = self.strides;
        for &i in self.unknowns {
            let i = i as usize;
            y[i] = 6.0 * x[i] - x[i - 1] - x[i + 1] - x[i - b] - x[i + b] - x[i - c] - x[i + c];
        }
        for (stencil, hold) in &self.screens {
            let value: f64 = stencil.iter().map(|(i, w)| x[*i] * w).sum();
            for (i, w) in stencil {
                y[*i] += hold * w * value;
            }
        }
    }
}

/// Adds the inward normal of a disc to the grid edges that pass through it, directly in the right-hand side.
fn spread(
    grid: &Grid,
    centre: &Point3<f64>,
    normal: &Vector3<f64>,
    share: f64,
    sigma: f64,
    right: &mut [f64],
) {
    let sigma = sigma / grid.step;
    let radius = DISC_END * sigma;
    let strides = grid.strides();
    // The innermost loop runs along the axis closest to the normal, along which the disc is thin.
    let m = normal.iamax();
    let (u, v) = ((m + 1) % 3, (m + 2) % 3);
    for axis in 0..3 {
        // The midpoints of the edges along `axis` form a grid of their own, shifted by half a step.
        let mut local = grid.local(centre);
        local[axis] -= 0.5;
        let range = |a: usize, half: f64| {
            let low = (local[a] - half).ceil().max(1.0) as usize;
            let high = (local[a] + half).floor().min(grid.nodes[a] as f64 - 2.0);
            low..(high + 1.0).max(0.0) as usize
        };
        let half =
            |a: usize| radius * (1.0 - normal[a] * normal[a]).max(0.0).sqrt() + HALF_THICKNESS;
        for iu in range(u, half(u)) {
            for iv in range(v, half(v)) {
                let (du, dv) = (iu as f64 - local[u], iv as f64 - local[v]);
                let flat = -(normal[u] * du + normal[v] * dv) / normal[m];
                let reach = HALF_THICKNESS / normal[m].abs();
                let low = (local[m] + flat - reach).ceil().max(1.0) as usize;
                let high = (local[m] + flat + reach)
                    .floor()
                    .min(grid.nodes[m] as f64 - 2.0);
                for im in low..(high + 1.0).max(0.0) as usize {
                    let dm = im as f64 - local[m];
                    let height = normal[u] * du + normal[v] * dv + normal[m] * dm;
                    let aside = du * du + dv * dv + dm * dm - height * height;
                    if aside > radius * radius {
                        continue;
                    }
                    let thick = (1.0 - height.abs() / HALF_THICKNESS).max(0.0) / HALF_THICKNESS;
                    let value =
                        -normal[axis] * share * thick * (-0.5 * aside / (sigma * sigma)).exp();
                    let mut node = [0; 3];
                    (node[u], node[v], node[m]) = (iu, iv, im);
                    let i = grid.index(node);
                    right[i + strides[axis]] += value;
                    right[i] -= value;
                }
            }
        }
    }
}
