use nalgebra::{Point3, Vector3};

/// A point known to move to another: a grip.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Landmark {
    /// Position in the source, in m.
    pub source: Point3<f64>,
    /// Position in the target, in m.
    pub target: Point3<f64>,
    /// Standard deviation, in m; 0 is exact.
    pub sigma: f64,
}

impl Landmark {
    /// The displacement, in m.
    pub fn motion(&self) -> Vector3<f64> {
        self.target - self.source
    }
}

/// A point assumed to move to another: an image feature, which may be an outlier.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Feature {
    /// Position in the source, in m.
    pub source: Point3<f64>,
    /// Supposed position in the target, in m.
    pub target: Point3<f64>,
}

/// How a registration ended.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Status {
    /// The nodes came to rest.
    Converged,
    /// The iterations ran out first; usual for large motions and by itself no sign of a bad fit.
    MaxIterations,
    /// The matched surface can slide on the target, and nothing else holds it: a plane, a sphere or a cylinder without landmarks; or the source
    /// is a line, which can rotate about itself. The displacements are one solution of many. A motion also counts as free if the noise of the normals hides its
    /// resistance: a relief of 1 mm on a plane is not enough against 0.5 mm of noise.
    Undetermined {
        /// Number of free rigid motions: 3 on a plane or a sphere, 2 on a cylinder, 1 on a surface of revolution, 4 for collinear points, whose normals say almost nothing.
        free_motions: usize,
    },
    /// Too few source points found a match: the field follows mostly from the prior.
    LowOverlap {
        /// Share of source points with a match.
        overlap: f64,
        /// The threshold, [`Options::min_overlap`](crate::Options::min_overlap).
        threshold: f64,
    },
    /// The matches that were found do not fit.
    HighResidual {
        /// Root mean square distance of matches, in m.
        residual: f64,
        /// The threshold, [`Options::max_residual`](crate::Options::max_residual).
        threshold: f64,
    },
}

/// The motion that follows from the landmarks alone.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct LandmarkField {
    /// Deformation nodes on the source, landmarks first.
    pub node_positions: Vec<Point3<f64>>,
    /// Their displacements, in m.
    pub node_displacements: Vec<Vector3<f64>>,
    /// Displacement of each source point, in m.
    pub displacements: Vec<Vector3<f64>>,
}

/// The motion from source to target.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Registration {
    /// Deformation nodes on the source, landmarks first.
    pub node_positions: Vec<Point3<f64>>,
    /// Their displacements, in m.
    pub node_displacements: Vec<Vector3<f64>>,
    /// How well the source is matched around each node, 0 to 1.
    pub node_confidence: Vec<f64>,
    /// Displacement of each source point, in m.
    pub displacements: Vec<Vector3<f64>>,
    /// How far each source point's displacement is supported by good matches around it, 0 to 1; 0 where the whole surface may slide on the target
    /// ([`Status::Undetermined`]). It ranks points and is no probability: the README has the errors measured at each level.
    pub confidence: Vec<f64>,
    /// Index of the target point matched with each source point; `None` without a match or for a match with a boundary point.
    pub matches: Vec<Option<u32>>,
    /// How far each feature agrees with the motion found, 0 (an outlier) to 1.
    pub feature_confidence: Vec<f64>,
    /// How well the matches fit.
    pub residuals: Residuals,
    /// Share of source points with a match.
    pub overlap: f64,
    /// Iterations made.
    pub iterations: usize,
    /// How it ended.
    pub status: Status,
}

/// Distances of matches, along the normal unless the caller's own residual says otherwise, in m.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Residuals {
    /// Number of matches, without those with boundary points.
    pub count: usize,
    /// Root mean square, with the weights of the matches.
    pub rms: f64,
    /// Median.
    pub median: f64,
    /// 95th percentile.
    pub p95: f64,
    /// Largest.
    pub largest: f64,
}
