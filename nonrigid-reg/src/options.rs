use crate::error::{Error, check_range};
use derive_setters::Setters;

/// Settings of a registration. The defaults are the measured best for objects of 0.1 to 0.3 m, clouds of 1,000 to 5,000 points, 0.5 mm noise and up to
/// 10 mm of motion a frame.
///
/// ```
/// use nonrigid_reg::Options;
/// let coarse = Options::default().with_node_spacing(0.02);
/// assert!(coarse.gates.len() <= coarse.iterations);
/// ```
#[derive(Debug, Clone, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Options {
    /// Spacing `r` of the deformation nodes, in m. Cost grows with its inverse to the sixth.
    pub node_spacing: f64,
    /// Largest number of Gauss–Newton iterations. Every gate is used once; small motions need no more than that, large ones do.
    pub iterations: usize,
    /// Distance beyond which a match has no weight, in m, per iteration; the last gate stays. The first gate limits the motion that
    /// can be found without landmarks, the last the residual of a match.
    pub gates: Vec<f64>,
    /// Stop once no node moves more than this in an iteration with the last gate, in m. Below the noise, because matches
    /// keep changing at that level without getting better.
    pub tolerance: f64,
    /// `λ_b`: weight of the difference between the gradients of neighbours; no unit.
    pub bending: f64,
    /// `λ_s`: weight of the strain, in units of `r²`.
    pub strain: f64,
    /// `α`: resistance of a match to sliding along the surface, per iteration, relative to the point-to-plane part of weight one.
    /// A larger value stabilises what geometry does not determine, a smaller one follows larger motions.
    pub drag: f64,
    /// Weight of the predicted displacement of every source point, relative to the point-to-plane part of weight one. A grip
    /// pulls at a soft body locally, but a smooth field would extend its motion along surfaces that can slide;
    /// a prediction (the motion of the last frame) prevents that. Default 0: `initial` is only the start of the search.
    pub prediction: f64,
    /// Number of neighbours over which the noise of a point across the surface is averaged before it is matched, on both clouds; 0 leaves the
    /// points as they are.
    pub denoise: usize,
    /// Smallest cosine between the normals of a match.
    pub normal_cosine: f64,
    /// Weight of a match with a boundary point of the target: the true match may be hidden.
    pub boundary_weight: f64,
    /// Gap among the directions of a target point's neighbours that makes it a boundary point, in rad.
    pub boundary_angle: f64,
    /// Standard deviation of a cloud point, in m: the unit for the weights of landmarks and features.
    pub point_sigma: f64,
    /// Weight of an exact landmark, as a number of cloud points.
    pub landmark_weight: f64,
    /// Standard deviation of an image feature, in m; a robust weight suppresses outliers.
    pub feature_sigma: f64,
    /// Without landmarks, features or `initial`: share of matched source points, at the start or at the end, below which the
    /// registration also starts from [`align_rigid`](crate::align_rigid) and the better result is taken; so it does when it has not converged and bends
    /// the source by more than 4 % of its size. 0: only if it failed. 1: always.
    pub align_below: f64,
    /// Share of matched source points below which the status is [`Status::LowOverlap`](crate::Status::LowOverlap).
    pub min_overlap: f64,
    /// Root mean square distance of matches, in m, above which the status is [`Status::HighResidual`](crate::Status::HighResidual).
    pub max_residual: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            node_spacing: 0.014,
            iterations: 12,
            gates: vec![0.020, 0.014, 0.009, 0.006],
            tolerance: 1.5e-4,
            bending: 1.0,
            strain: 0.02,
            drag: 0.012,
            prediction: 0.0,
            denoise: 12,
            normal_cosine: 0.5,
            boundary_weight: 0.05,
            boundary_angle: 130_f64.to_radians(),
            point_sigma: 0.001,
            landmark_weight: 1e7,
            feature_sigma: 0.0011,
            align_below: 0.6,
            min_overlap: 0.3,
            max_residual: 0.003,
        }
    }
}

impl Options {
    /// These settings for an object `factor` times as large, seen with as many points and with noise in proportion: all lengths are multiplied,
    /// weights stay.
    #[must_use]
    pub fn scaled(mut self, factor: f64) -> Self {
        self.gates.iter_mut().for_each(|gate| *gate *= factor);
        for length in [
            &mut self.node_spacing,
            &mut self.tolerance,
            &mut self.point_sigma,
            &mut self.feature_sigma,
            &mut self.max_residual,
        ] {
            *length *= factor;
        }
        self
    }

    pub(crate) fn check(&self) -> Result<(), Error> {
        let positive = [
            ("node_spacing", self.node_spacing),
            ("bending", self.bending),
            ("strain", self.strain),
            ("point_sigma", self.point_sigma),
            ("landmark_weight", self.landmark_weight),
            ("feature_sigma", self.feature_sigma),
            ("boundary_angle", self.boundary_angle),
            ("max_residual", self.max_residual),
        ];
        for (option, value) in positive {
            let ok = value > 0.0 && value <= 1e12;
            check_range(option, value, ok, "positive and at most 1e12")?;
        }
        let not_negative = [
            ("tolerance", self.tolerance),
            ("drag", self.drag),
            ("prediction", self.prediction),
            ("boundary_weight", self.boundary_weight),
        ];
        for (option, value) in not_negative {
            let ok = (0.0..=1e12).contains(&value);
            check_range(option, value, ok, "between 0 and 1e12")?;
        }
        let cosine = self.normal_cosine;
        check_range(
            "normal_cosine",
            cosine,
            (-1.0..1.0).contains(&cosine),
            "in [-1, 1)",
        )?;
        for (option, share) in [
            ("min_overlap", self.min_overlap),
            ("align_below", self.align_below),
        ] {
            let ok = (0.0..=1.0).contains(&share);
            check_range(option, share, ok, "in [0, 1]")?;
        }
        check_range("iterations", 0.0, self.iterations > 0, "at least 1")?;
        let neighbours = self.denoise as f64;
        check_range("denoise", neighbours, self.denoise <= 100, "at most 100")?;
        check_range("gates.len()", 0.0, !self.gates.is_empty(), "at least 1")?;
        for &gate in &self.gates {
            check_range(
                "gates",
                gate,
                gate > 0.0 && gate <= 1e12,
                "positive and at most 1e12",
            )?;
        }
        Ok(())
    }
}
