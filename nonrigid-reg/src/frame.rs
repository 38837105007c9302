//! One pair of frames in terms of nodes: what is assembled once, and what every iteration adds.

use gpwrm::{ShapeFunctions, nearest_rotation};
use nalgebra::{Matrix3, Point3, Vector3};

use crate::cloud::Cloud;
use crate::error::{Error, check_length, check_points, check_vectors};
use crate::matching::{Match, Matcher};
use crate::nodes::Nodes;
use crate::options::Options;
use crate::prior::Prior;
use crate::registration::{Feature, Landmark};
use crate::system::System;

/// Nodes that a point leans on.
const SHAPE_NODES: usize = 8;
/// Ties what nothing else determines (a part without matches or neighbours that have any) to where it started.
const ANCHOR: f64 = 1e-7;

/// A source point or feature in terms of nodes: `u(p) = Σ φ_k u_k`.
pub(crate) type Shape = Vec<(usize, f64)>;

/// What stays the same over the iterations of one frame.
pub(crate) struct Frame<'a> {
    pub source: &'a Cloud<'a>,
    pub landmarks: &'a [Landmark],
    features: &'a [Feature],
    pub options: &'a Options,
    pub nodes: Nodes,
    pub prior: Prior,
    pub shapes: Vec<Shape>,
    feature_shapes: Vec<Shape>,
}

impl<'a> Frame<'a> {
    pub fn new(
        source: &'a Cloud<'a>,
        landmarks: &'a [Landmark],
        features: &'a [Feature],
        initial: Option<&[Vector3<f64>]>,
        options: &'a Options,
    ) -> Result<Self, Error> {
        source.check("source")?;
        check_pairs("landmark", landmarks.iter().map(|l| (l.source, l.target)))?;
        check_pairs("feature", features.iter().map(|f| (f.source, f.target)))?;
        for (index, landmark) in landmarks.iter().enumerate() {
            if !(landmark.sigma >= 0.0 && landmark.sigma.is_finite()) {
                let value = landmark.sigma;
                return Err(Error::BadSigma { index, value });
            }
        }
        if let Some(predicted) = initial {
            check_length(
                "initial displacements",
                source.points.len(),
                predicted.len(),
            )?;
            check_vectors("initial displacement", predicted)?;
        }
        let spacing = options.node_spacing;
        let nodes = Nodes::new(source.points, landmarks.iter().map(|l| l.source), spacing)?;
        let prior = Prior::new(&nodes, options.bending, options.strain * spacing * spacing);
        let functions = ShapeFunctions::new(&nodes.positions, SHAPE_NODES)
            .map_err(|_| Error::EmptyCloud { cloud: "source" })?;
        Ok(Self {
            shapes: each(source.points.len(), |i| functions.at(&source.points[i])),
            feature_shapes: features.iter().map(|f| functions.at(&f.source)).collect(),
            source,
            landmarks,
            features,
            options,
            nodes,
            prior,
        })
    }

    /// Node displacements from predicted point displacements: the mean over the points that lean on a node.
    pub fn smoothed(&self, predicted: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut sums = vec![(Vector3::zeros(), 0.0); self.nodes.len()];
        for (shape, u) in self.shapes.iter().zip(predicted) {
            for &(k, phi) in shape {
                let w = phi.max(0.0).powi(2);
                sums[k].0 += w * u;
                sums[k].1 += w;
            }
        }
        let mut start: Vec<Vector3<f64>> = sums
            .iter()
            .map(|(sum, w)| if *w > 0.0 { sum / *w } else { Vector3::zeros() })
            .collect();
        for (landmark, &node) in self.landmarks.iter().zip(&self.nodes.of_landmark) {
            start[node] = landmark.target - landmark.source;
        }
        start
    }

    /// Every source point is drawn to its predicted displacement.
    pub fn add_prediction(&self, predicted: &[Vector3<f64>], system: &mut System) {
        let metric = Matrix3::from_diagonal_element(
            self.options.prediction / self.source.points.len() as f64,
        );
        for (shape, wanted) in self.shapes.iter().zip(predicted) {
            add_observation(shape, &metric, wanted, system);
        }
    }

    /// Membrane, landmarks and anchor: the same in all iterations.
    pub fn assemble_fixed(&self, start: &[Vector3<f64>], system: &mut System) {
        system.reset(self.nodes.len());
        self.prior.add_membrane(&self.nodes, system);
        let points = self.source.points.len() as f64;
        for (landmark, &node) in self.landmarks.iter().zip(&self.nodes.of_landmark) {
            let relative = self.options.point_sigma / landmark.sigma;
            // Exact landmarks have relative = ∞.
            let w = (relative * relative).min(self.options.landmark_weight) / points;
            system.add_scalar(node, node, w);
            system.add_right(node, &(w * (landmark.target - landmark.source)));
        }
        let anchor = ANCHOR / self.nodes.len() as f64;
        for (k, u) in start.iter().enumerate() {
            system.add_scalar(k, k, anchor);
            system.add_right(k, &(anchor * u));
        }
    }

    pub fn rotations(&self, u: &[Vector3<f64>]) -> Vec<Matrix3<f64>> {
        let polar = |g: &Matrix3<f64>| nearest_rotation(&(Matrix3::identity() + g)).into_inner();
        self.prior.gradients(u).iter().map(polar).collect()
    }

    pub fn find_matches(
        &self,
        u: &[Vector3<f64>],
        rotations: &[Matrix3<f64>],
        gate: f64,
        matcher: &mut Matcher,
    ) -> Vec<Option<Match>> {
        let hits = each(self.source.points.len(), |i| {
            let (p, n, shape) = (
                &self.source.points[i],
                self.source.normals[i],
                &self.shapes[i],
            );
            let turn: Matrix3<f64> = shape.iter().map(|&(k, phi)| phi * rotations[k]).sum();
            let turned = (turn * n.as_ref()).try_normalize(1e-12);
            matcher.find(
                &(p + blend(shape, u)),
                &turned.unwrap_or(*n),
                gate,
                self.options,
            )
        });
        hits.into_iter()
            .map(|hit| Some(matcher.weigh(hit?, gate, self.options)))
            .collect()
    }

    pub fn add_matches(
        &self,
        u: &[Vector3<f64>],
        matches: &[Option<Match>],
        matcher: &Matcher,
        system: &mut System,
    ) {
        let points = self.source.points.len() as f64;
        for (i, m) in matches.iter().enumerate() {
            let Some(m) = m else { continue };
            let n = matcher.normal(m).as_ref();
            let across = n * n.transpose();
            let along = Matrix3::identity() - across;
            let here = blend(&self.shapes[i], u);
            let gap = matcher.point(m) - self.source.points[i] - here;
            // Onto the plane of the match, and not along it.
            let wanted = here + across * gap;
            let metric = across + self.options.drag * along;
            add_observation(
                &self.shapes[i],
                &(metric * (m.weight / points)),
                &wanted,
                system,
            );
        }
    }

    /// Features, weighed by how well they agree with the motion so far.
    pub fn add_features(&self, u: &[Vector3<f64>], system: &mut System) {
        let wanted: Vec<Vector3<f64>> = self.features.iter().map(|f| f.target - f.source).collect();
        let misfit: Vec<f64> = wanted
            .iter()
            .zip(&self.feature_shapes)
            .map(|(d, shape)| (blend(shape, u) - d).norm())
            .collect();
        let cutoff = (2.5 * median(&misfit)).max(2.7 * self.options.feature_sigma);
        let relative = self.options.point_sigma / self.options.feature_sigma;
        let full = relative * relative / self.source.points.len() as f64;
        for (k, shape) in self.feature_shapes.iter().enumerate() {
            let share = (1.0 - (misfit[k] / cutoff).powi(2)).max(0.0);
            let metric = Matrix3::from_diagonal_element(full * share * share);
            add_observation(shape, &metric, &wanted[k], system);
        }
    }
}

/// Adds `(Φu − wanted)ᵀ metric (Φu − wanted)`.
fn add_observation(
    shape: &[(usize, f64)],
    metric: &Matrix3<f64>,
    wanted: &Vector3<f64>,
    system: &mut System,
) {
    let force = metric * wanted;
    for &(k, phi_k) in shape {
        system.add_right(k, &(phi_k * force));
        for &(l, phi_l) in shape {
            if l <= k {
                system.add_block(k, l, &(metric * (phi_k * phi_l)));
            }
        }
    }
}

pub(crate) fn blend(shape: &[(usize, f64)], u: &[Vector3<f64>]) -> Vector3<f64> {
    shape.iter().map(|&(k, phi)| phi * u[k]).sum()
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

fn check_pairs(
    what: &'static str,
    pairs: impl Iterator<Item = (Point3<f64>, Point3<f64>)>,
) -> Result<(), Error> {
    let (sources, targets): (Vec<_>, Vec<_>) = pairs.unzip();
    check_points(what, &sources)?;
    check_points(what, &targets)
}

/// `f` of every index; in parallel with the feature `rayon`, which changes no bit of the answer.
fn each<T: Send>(count: usize, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    #[cfg(feature = "rayon")]
    {
        use rayon::prelude::*;
        (0..count).into_par_iter().map(f).collect()
    }
    #[cfg(not(feature = "rayon"))]
    (0..count).map(f).collect()
}
