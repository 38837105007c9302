//! The loop: match, weigh, solve, until nothing moves (Algorithm 1).
//!
//! ```text
//! E(u) = (1/n) Σ_p w_p ( (n_q·(p + Φu − q))² + α |Π_q Φ(u − u₀)|² )        matches
//!      + (1/n) Σ_l w_l |u_l − (y_l − x_l)|²                             landmarks, which are nodes
//!      + (1/n) Σ_f w_f |Φ_f u − (y_f − x_f)|²                           features, Tukey weights
//!      + prior(u)                                                       see `prior`
//! ```
//!
//! `u₀` is the previous iterate and `Π_q` projects on the tangent plane of the match: `α` drags on sliding, in every iteration
//! anew. The usual term pulls to the matched point itself, `α |p + Φu − q|²`; it drags as well, but also pulls the surface by the offset
//! between the two samplings, which on regular clouds does not average out (0.5 mm at rest on clouds 4 mm apart).

use gpwrm::{ShapeFunctions, nearest_rotation};
use nalgebra::{Matrix3, Point3, Vector3};

use crate::cloud::Cloud;
use crate::error::{Error, check_length, check_points, check_vectors};
use crate::matching::{Match, Matcher};
use crate::nodes::Nodes;
use crate::options::Options;
use crate::prior::Prior;
use crate::system::System;
use crate::tree::Tree;

/// Nodes that a point leans on.
const SHAPE_NODES: usize = 8;
/// Ties what nothing else determines (a part without matches or neighbours that have any) to where it started.
const ANCHOR: f64 = 1e-7;

/// A point known to move to another: a grip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Landmark {
    /// Where it was, in m.
    pub source: Point3<f64>,
    /// Where it is, in m.
    pub target: Point3<f64>,
    /// Standard deviation, in m; 0 is exact.
    pub sigma: f64,
}

/// A point believed to move to another: an image feature. May be wrong altogether.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Feature {
    /// Where it was, in m.
    pub source: Point3<f64>,
    /// Where it seems to be, in m.
    pub target: Point3<f64>,
}

/// How a registration ended.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Status {
    /// The nodes came to rest.
    Converged,
    /// The iterations ran out first; usual for large motions, and no sign of a bad fit by itself.
    MaxIterations,
    /// Too few source points found a match: the field is mostly prior.
    LowOverlap {
        /// Share of source points with a match.
        overlap: f64,
        /// The threshold it missed.
        threshold: f64,
    },
    /// The matches that were found do not fit.
    HighResidual {
        /// Root mean square distance of matches, in m.
        residual: f64,
        /// The threshold it passed.
        threshold: f64,
    },
}

/// The motion from source to target.
#[derive(Debug, Clone, PartialEq)]
pub struct Registration {
    /// Deformation nodes on the source, landmarks first.
    pub node_positions: Vec<Point3<f64>>,
    /// Their displacements, in m.
    pub node_displacements: Vec<Vector3<f64>>,
    /// How well matched the source is around each node, 0 to 1.
    pub node_confidence: Vec<f64>,
    /// Displacement of each source point, in m.
    pub displacements: Vec<Vector3<f64>>,
    /// How far each source point's displacement rests on good matches around it, 0 to 1.
    pub confidence: Vec<f64>,
    /// Index of the target point that each source point met; none for points without a match or on the rim of the target.
    pub matches: Vec<Option<u32>>,
    /// Root mean square distance of matches along the target normal, in m.
    pub residual_rms: f64,
    /// Share of source points that met a target point.
    pub overlap: f64,
    /// Iterations made.
    pub iterations: usize,
    /// How it ended.
    pub status: Status,
}

/// Registers `source` onto `target`: [`Registrar::register`] for a single pair.
///
/// # Errors
/// See [`Registrar::register`].
pub fn register(
    source: &Cloud,
    target: &Cloud,
    landmarks: &[Landmark],
    features: &[Feature],
    options: &Options,
) -> Result<Registration, Error> {
    Registrar::new(options.clone()).register(source, target, landmarks, features, None)
}

/// Registers frame after frame and keeps its storage between them.
#[derive(Default)]
pub struct Registrar {
    options: Options,
    fixed: System,
    system: System,
}

/// A source point or feature in terms of nodes: `u(p) = Σ φ_k u_k`.
type Shape = Vec<(usize, f64)>;

/// What stays the same over the iterations of one frame.
struct Frame<'a> {
    source: &'a Cloud<'a>,
    landmarks: &'a [Landmark],
    features: &'a [Feature],
    options: &'a Options,
    nodes: Nodes,
    prior: Prior,
    shapes: Vec<Shape>,
    feature_shapes: Vec<Shape>,
}

impl Registrar {
    /// A registrar with these settings.
    pub fn new(options: Options) -> Self {
        Self {
            options,
            ..Self::default()
        }
    }

    /// The settings.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Finds the motion that carries `source` onto `target`.
    ///
    /// `initial` is a displacement predicted for every source point: the search starts from it instead of from rest.
    ///
    /// # Errors
    /// Empty or mismatched clouds, coordinates that are not finite, a negative `sigma`, options out of range, a node spacing that
    /// makes too many nodes, or normal equations that lose definiteness. A poor fit is no error but a [`Status`].
    pub fn register(
        &mut self,
        source: &Cloud,
        target: &Cloud,
        landmarks: &[Landmark],
        features: &[Feature],
        initial: Option<&[Vector3<f64>]>,
    ) -> Result<Registration, Error> {
        let Self {
            options,
            fixed,
            system,
        } = self;
        options.check()?;
        let frame = Frame::new(source, landmarks, features, initial, options)?;
        target.check("target")?;
        let tree = Tree::new(target.points).ok_or(Error::EmptyCloud { cloud: "target" })?;
        let mut matcher = Matcher::new(target, tree);

        let start = initial.map_or_else(
            || vec![Vector3::zeros(); frame.nodes.len()],
            |predicted| frame.smoothed(predicted),
        );
        frame.assemble_fixed(&start, fixed);
        let mut u = start;
        let mut rotations = frame.rotations(&u);
        let mut status = Status::MaxIterations;
        let mut iterations = 0;
        while iterations < options.iterations {
            let gate = options.gate(iterations);
            let matches = frame.find_matches(&u, &rotations, gate, &mut matcher);
            system.copy_from(fixed);
            frame.prior.add_forms(&rotations, system);
            frame.add_matches(&u, &matches, &matcher, system);
            frame.add_features(&u, system);
            let next = system.solve().ok_or(Error::Singular {
                iteration: iterations,
            })?;
            let step = largest_step(&u, &next);
            u = next;
            rotations = frame.rotations(&u);
            iterations += 1;
            if step <= options.tolerance && iterations >= options.gates.len() {
                status = Status::Converged;
                break;
            }
        }
        Ok(frame.report(u, &rotations, &mut matcher, iterations, status))
    }
}

impl<'a> Frame<'a> {
    fn new(
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
            shapes: source.points.iter().map(|p| functions.at(p)).collect(),
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
    fn smoothed(&self, predicted: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
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

    /// Membrane, landmarks and anchor: the same in all iterations.
    fn assemble_fixed(&self, start: &[Vector3<f64>], system: &mut System) {
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

    fn rotations(&self, u: &[Vector3<f64>]) -> Vec<Matrix3<f64>> {
        let polar = |g: &Matrix3<f64>| nearest_rotation(&(Matrix3::identity() + g)).into_inner();
        self.prior.gradients(u).iter().map(polar).collect()
    }

    fn find_matches(
        &self,
        u: &[Vector3<f64>],
        rotations: &[Matrix3<f64>],
        gate: f64,
        matcher: &mut Matcher,
    ) -> Vec<Option<Match>> {
        let points = self.source.points.iter().zip(self.source.normals);
        points
            .zip(&self.shapes)
            .map(|((p, n), shape)| {
                let y = p + blend(shape, u);
                let turn: Matrix3<f64> = shape.iter().map(|&(k, phi)| phi * rotations[k]).sum();
                let turned = (turn * n.as_ref()).try_normalize(1e-12).unwrap_or(**n);
                matcher.find(&y, &turned, gate, self.options)
            })
            .collect()
    }

    fn add_matches(
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
    fn add_features(&self, u: &[Vector3<f64>], system: &mut System) {
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

    fn report(
        self,
        u: Vec<Vector3<f64>>,
        rotations: &[Matrix3<f64>],
        matcher: &mut Matcher,
        iterations: usize,
        ended: Status,
    ) -> Registration {
        let gate = self.options.gate(usize::MAX);
        let matches = self.find_matches(&u, rotations, gate, matcher);
        let displacements: Vec<Vector3<f64>> =
            self.shapes.iter().map(|shape| blend(shape, &u)).collect();
        let mut fit = Fit::default();
        let trust: Vec<f64> = matches
            .iter()
            .enumerate()
            .map(|(i, m)| {
                let Some(m) = m.filter(|m| !m.on_rim) else {
                    return 0.0;
                };
                let y = self.source.points[i] + displacements[i];
                let rho = matcher.normal(&m).dot(&(y - matcher.point(&m)));
                fit.add(m.weight, rho);
                // Three sigma of a point is the scale at which a match stops being one.
                m.weight * (-(rho / (3.0 * self.options.point_sigma)).powi(2)).exp()
            })
            .collect();
        let node_confidence = self.node_confidence(&trust);
        let confidence = self
            .shapes
            .iter()
            .map(|shape| positive_mean(shape, |k| node_confidence[k]))
            .collect();
        let overlap = fit.count / self.source.points.len() as f64;
        let residual_rms = fit.rms();
        Registration {
            node_positions: self.nodes.positions,
            node_displacements: u,
            node_confidence,
            displacements,
            confidence,
            matches: matches
                .iter()
                .map(|m| m.filter(|m| !m.on_rim).map(|m| m.target as u32))
                .collect(),
            residual_rms,
            overlap,
            iterations,
            status: judge(ended, overlap, residual_rms, self.options),
        }
    }

    /// Mean trust of the points that lean on a node; exact landmarks are trusted.
    fn node_confidence(&self, trust: &[f64]) -> Vec<f64> {
        let mut sums = vec![(0.0, 0.0); self.nodes.len()];
        for (shape, t) in self.shapes.iter().zip(trust) {
            for &(k, phi) in shape {
                sums[k].0 += phi.max(0.0) * t;
                sums[k].1 += phi.max(0.0);
            }
        }
        let mut confidence: Vec<f64> = sums
            .iter()
            .map(|(sum, w)| if *w > 0.0 { sum / w } else { 0.0 })
            .collect();
        for (landmark, &node) in self.landmarks.iter().zip(&self.nodes.of_landmark) {
            if landmark.sigma <= self.options.point_sigma {
                confidence[node] = 1.0;
            }
        }
        confidence
    }
}

/// Weighted residuals.
#[derive(Default)]
struct Fit {
    count: f64,
    weight: f64,
    squares: f64,
}

impl Fit {
    fn add(&mut self, weight: f64, rho: f64) {
        self.count += 1.0;
        self.weight += weight;
        self.squares += weight * rho * rho;
    }

    fn rms(&self) -> f64 {
        if self.weight > 0.0 {
            (self.squares / self.weight).sqrt()
        } else {
            0.0
        }
    }
}

fn judge(ended: Status, overlap: f64, residual: f64, options: &Options) -> Status {
    if overlap < options.min_overlap {
        let threshold = options.min_overlap;
        Status::LowOverlap { overlap, threshold }
    } else if residual > options.max_residual {
        let threshold = options.max_residual;
        Status::HighResidual {
            residual,
            threshold,
        }
    } else {
        ended
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

fn blend(shape: &[(usize, f64)], u: &[Vector3<f64>]) -> Vector3<f64> {
    shape.iter().map(|&(k, phi)| phi * u[k]).sum()
}

/// Mean of a node value over the nodes a point leans on, negative parts left out.
fn positive_mean(shape: &[(usize, f64)], value: impl Fn(usize) -> f64) -> f64 {
    let total: f64 = shape.iter().map(|(_, phi)| phi.max(0.0)).sum();
    let sum: f64 = shape.iter().map(|&(k, phi)| phi.max(0.0) * value(k)).sum();
    if total > 0.0 { sum / total } else { 0.0 }
}

fn largest_step(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    let step = |(x, y): (&Vector3<f64>, &Vector3<f64>)| (x - y).norm();
    a.iter().zip(b).map(step).fold(0.0, f64::max)
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
