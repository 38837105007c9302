use nalgebra::{Point3, Vector3};

/// A point known to move to another: a grip.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Landmark {
    /// Where it was, in m.
    pub source: Point3<f64>,
    /// Where it is, in m.
    pub target: Point3<f64>,
    /// Standard deviation, in m; 0 is exact.
    pub sigma: f64,
}

impl Landmark {
    /// From where it was to where it is, in m.
    pub fn motion(&self) -> Vector3<f64> {
        self.target - self.source
    }
}

/// A point believed to move to another: an image feature. May be wrong altogether.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Feature {
    /// Where it was, in m.
    pub source: Point3<f64>,
    /// Where it seems to be, in m.
    pub target: Point3<f64>,
}

/// How a registration ended.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Status {
    /// The nodes came to rest.
    Converged,
    /// The iterations ran out first; usual for large motions, and no sign of a bad fit by itself.
    MaxIterations,
    /// The matched surface slides on the target, and nothing else holds it: a plane, a sphere or a cylinder without landmarks; or the source
    /// is a line, which rolls about itself. The displacements are one answer of many. Told by what the noise of the normals hides: relief of 1 mm
    /// on a plane is not enough to hold it against 0.5 mm of noise.
    Undetermined {
        /// Rigid motions left free: 3 on a plane or a sphere, 2 on a cylinder, 1 on a surface of revolution, 4 of a line, whose normals say next to nothing.
        free_motions: usize,
    },
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

/// What the landmarks alone say of the motion.
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
    /// How well matched the source is around each node, 0 to 1.
    pub node_confidence: Vec<f64>,
    /// Displacement of each source point, in m.
    pub displacements: Vec<Vector3<f64>>,
    /// How far each source point's displacement rests on good matches around it, 0 to 1; 0 where the whole surface may slide on the target
    /// ([`Status::Undetermined`]). It ranks points and is no probability: the README has the errors measured at each level.
    pub confidence: Vec<f64>,
    /// Index of the target point that each source point met; none for points without a match or on the rim of the target.
    pub matches: Vec<Option<u32>>,
    /// How far each feature agrees with the motion found, 0 (an outlier) to 1.
    pub feature_confidence: Vec<f64>,
    /// How well the matches fit.
    pub residuals: Residuals,
    /// Share of source points that met a target point.
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
    /// Matches counted: all but those with the rim of the target.
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
