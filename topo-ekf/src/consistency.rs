//! Whether the covariances are consistent: errors measured in the filter's own standard deviations.
//!
//! ```text
//! innovation   ε = νᵀ (H P⁻ Hᵀ + R)⁻¹ ν,   ν = z − H x⁻           ~ χ² with 3 · (seen vertices) degrees
//! estimation   ε = (x̂ − x)ᵀ Λ (x̂ − x),     x the true positions             ~ χ² with 3 Q degrees
//! band         χ²_p(k) ≈ k (1 − 2/(9k) + u_p √(2/(9k)))³            Wilson and Hilferty
//! ```
//!
//! In the information form no covariance is needed: with the posterior `x⁺` from the same prior, `(H P⁻ Hᵀ + R)⁻¹ ν = R⁻¹ (z − H x⁺)`.
//! Source: Bar-Shalom, Li and Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001), section 5.4.

use nalgebra::Point3;

use crate::filter::Filter;
use crate::graph::check_points;
use crate::observation::{Frame, Observation};
use crate::{Error, columns};

/// A sum of squares of normalised errors with its degrees of freedom.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Consistency {
    /// `ε`: squared error in the metric of its information.
    pub squared: f64,
    /// Degrees of freedom: the expected value of `squared`.
    pub degrees: usize,
}

/// Whether a statistic agrees with the covariances it was normalised by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Verdict {
    /// Below the band: errors are smaller than claimed.
    Conservative,
    /// Inside the 95 % band.
    Consistent,
    /// Above the band: errors are larger than claimed.
    Overconfident,
}

/// 97.5 % quantile of the normal distribution.
const TWO_SIDED_95: f64 = 1.959_963_984_540_054;

impl Consistency {
    pub(crate) fn new(squared: f64, degrees: usize) -> Self {
        Self { squared, degrees }
    }

    /// The sum of both statistics: frames of a run, or runs with different noise. They must be independent.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self::new(self.squared + other.squared, self.degrees + other.degrees)
    }

    /// `ε / degrees`: 1 in the mean for consistent covariances. NaN without degrees of freedom.
    pub fn mean(&self) -> f64 {
        self.squared / self.degrees as f64
    }

    /// The 95 % band of [`Consistency::mean`] for consistent covariances.
    pub fn band(&self) -> [f64; 2] {
        let spread = 2.0 / (9.0 * self.degrees as f64);
        [-TWO_SIDED_95, TWO_SIDED_95].map(|u| (1.0 - spread + u * spread.sqrt()).max(0.0).powi(3))
    }

    /// The mean compared with the band; `Consistent` without degrees of freedom.
    pub fn verdict(&self) -> Verdict {
        let [low, high] = self.band();
        match self.mean() {
            mean if mean < low => Verdict::Conservative,
            mean if mean > high => Verdict::Overconfident,
            _ => Verdict::Consistent,
        }
    }
}

/// How many vertices of a group lie inside the ball that should contain 95 % of the errors, by the standard deviation of each.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Coverage {
    /// Number of vertices in the group.
    pub vertices: usize,
    /// Number of those inside.
    pub inside: usize,
}

impl Coverage {
    /// The sum of both: frames of a run.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            vertices: self.vertices + other.vertices,
            inside: self.inside + other.inside,
        }
    }

    /// Share of vertices inside: 0.95 for correct covariances. NaN without vertices.
    pub fn share(&self) -> f64 {
        self.inside as f64 / self.vertices as f64
    }

    /// `Consistent` from 90 to 99 % inside, and without vertices. Errors of neighbours are correlated, so a narrower band would not be significant.
    pub fn verdict(&self) -> Verdict {
        match self.share() {
            share if share < 0.90 => Verdict::Overconfident,
            share if share > 0.99 => Verdict::Conservative,
            _ => Verdict::Consistent,
        }
    }
}

/// [`Coverage`] of vertices seen in the last step and of hidden ones, separately: in a sum over all vertices the hidden ones hardly count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Calibration {
    /// Vertices measured in the last step.
    pub seen: Coverage,
    /// The others.
    pub hidden: Coverage,
}

impl Calibration {
    /// The sum of both: frames of a run.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            seen: self.seen.and(other.seen),
            hidden: self.hidden.and(other.hidden),
        }
    }
}

/// 95 % quantile of χ² with three degrees of freedom.
const BALL_95: f64 = 7.814_727_903_251_179;

impl Filter {
    /// How many vertices lie within the bounds of [`Filter::marginal_sigmas`], for simulations, where the true positions are known.
    ///
    /// # Errors
    /// Another number of true positions, or invalid ones; otherwise as [`Filter::marginal_sigmas`], whose cost it has.
    ///
    /// ```
    /// use topo_ekf::{Filter, Frame, Observation, Options, nalgebra::{Point3, Vector3}};
    ///
    /// let rest: Vec<_> = (0..10).map(|k| Point3::new(0.005 * f64::from(k), 0.0, 0.0)).collect();
    /// let edges: Vec<_> = (1..10).map(|k| [k - 1, k]).collect();
    /// let mut filter = Filter::new(&rest, &edges, &Options::default())?;
    /// // All of it moves by 2 mm; six vertices are seen.
    /// let truth: Vec<_> = rest.iter().map(|p| p + Vector3::x() * 0.002).collect();
    /// let seen = |k: u32| Observation { vertex: k, position: truth[k as usize], sigma: 5e-4 };
    /// filter.step(&Frame::new(&(0..6).map(seen).collect::<Vec<_>>()))?;
    /// let found = filter.calibration(&truth)?;
    /// assert_eq!((found.seen.inside, found.hidden.inside, found.hidden.vertices), (6, 4, 4));
    /// # Ok::<(), topo_ekf::Error>(())
    /// ```
    pub fn calibration(&self, truth: &[Point3<f64>]) -> Result<Calibration, Error> {
        self.check_truth(truth)?;
        let sigmas = self.marginal_sigmas()?;
        let mut found = Calibration::default();
        for i in 0..truth.len() {
            let group = if self.seen[i] {
                &mut found.seen
            } else {
                &mut found.hidden
            };
            let squared = (self.live[i] - truth[i]).norm_squared();
            group.vertices += 1;
            group.inside += usize::from(squared <= BALL_95 * sigmas[i] * sigmas[i]);
        }
        Ok(found)
    }

    fn check_truth(&self, truth: &[Point3<f64>]) -> Result<(), Error> {
        let (found, expected) = (truth.len(), self.live.len());
        if found != expected {
            return Err(Error::Length {
                what: "truth",
                found,
                expected,
            });
        }
        check_points("truth", truth)
    }

    /// Normalised innovation squared of the last step: observations compared with the prediction by data, shape and motion, one innovation
    /// for each seen vertex. `None` before the first step and after a change of graph or stiffness.
    ///
    /// Exact for [`Motion::Still`](crate::Motion::Still). With [`Motion::Spread`](crate::Motion::Spread) the motion was estimated from the same observations, so the statistic
    /// is too low (by how much: see the README).
    ///
    /// # Errors
    /// As [`Filter::step`].
    ///
    /// # Complexity
    /// One factorisation and one solve.
    ///
    /// ```
    /// use topo_ekf::{Error, Filter, Frame, Motion, Observation, Options, Verdict, nalgebra::{Point3, Vector3}};
    /// # let rest: Vec<_> = (0..10).map(|k| Point3::new(0.005 * f64::from(k), 0.0, 0.0)).collect();
    /// # let edges: Vec<_> = (1..10).map(|k| [k - 1, k]).collect();
    /// // A chain of ten vertices, 5 mm apart.
    /// let mut filter = Filter::new(&rest, &edges, &Options::default().with_motion(Motion::Still))?;
    /// assert!(filter.innovation_statistic()?.is_none());
    /// // Six vertices are seen 50 mm away, ten times the initial standard deviation.
    /// let jump = Vector3::new(0.0, 0.0, 0.05);
    /// let seen = |k: u32| Observation { vertex: k, position: rest[k as usize] + jump, sigma: 5e-4 };
    /// filter.step(&Frame::new(&(0..6).map(seen).collect::<Vec<_>>()))?;
    /// let found = filter.innovation_statistic()?.ok_or(Error::NoVertices)?;
    /// assert_eq!((found.degrees, found.verdict()), (18, Verdict::Overconfident));
    /// # Ok::<(), Error>(())
    /// ```
    pub fn innovation_statistic(&mut self) -> Result<Option<Consistency>, Error> {
        let Some(last) = &self.last else {
            return Ok(None);
        };
        let values = self.values(&last.information, &self.weights());
        let factor = self.system.factorise(&values)?;
        let mut expected = last.pull.clone();
        self.system.solve(&factor, &mut expected);
        let expected = columns::read(&expected);
        let (mut squared, mut count) = (0.0, 0);
        for i in 0..self.live.len() {
            let r = last.seen.information[i];
            if r > 0.0 {
                let innovation = last.seen.position[i] - (last.origin[i] + expected[i]);
                let residual = last.seen.position[i] - self.estimate[i];
                squared += r * innovation.dot(&residual);
                count += 1;
            }
        }
        Ok(Some(Consistency::new(squared, 3 * count)))
    }

    /// Normalised estimation error squared of the live positions, for simulations, where the true positions are known.
    ///
    /// # Errors
    /// Another number of true positions, or invalid ones.
    ///
    /// ```
    /// use topo_ekf::{Filter, Options, nalgebra::{Point3, Vector3}};
    /// # let rest: Vec<_> = (0..10).map(|k| Point3::new(0.005 * f64::from(k), 0.0, 0.0)).collect();
    /// # let edges: Vec<_> = (1..10).map(|k| [k - 1, k]).collect();
    /// // Ten vertices, of which nothing is known but their initial standard deviation.
    /// let options = Options::default();
    /// let filter = Filter::new(&rest, &edges, &options)?;
    /// // All of them are off by that, along one of three axes.
    /// let truth: Vec<_> = rest.iter().map(|p| p + Vector3::z() * options.initial_sigma).collect();
    /// let found = filter.error_statistic(&truth)?;
    /// assert_eq!(found.degrees, 30);
    /// assert!((found.squared - 10.0).abs() < 0.05); // the anchor adds a little
    /// # Ok::<(), topo_ekf::Error>(())
    /// ```
    pub fn error_statistic(&self, truth: &[Point3<f64>]) -> Result<Consistency, Error> {
        self.check_truth(truth)?;
        let values = self.values(&self.information, &self.weights());
        let along = |axis: usize| {
            let error: Vec<f64> = self
                .live
                .iter()
                .zip(truth)
                .map(|(x, t)| x[axis] - t[axis])
                .collect();
            let pulled = self.system.pattern.multiply(&values, &error);
            error.iter().zip(&pulled).map(|(e, p)| e * p).sum::<f64>()
        };
        Ok(Consistency::new((0..3).map(along).sum(), 3 * truth.len()))
    }

    /// Residuals of the last step's observations in units of their standard deviation: `‖z − x̂‖ / √(3 (σ² − P))`, with `P` the marginal
    /// variance. About 1 is normal, 3 and more is an outlier.
    ///
    /// # Errors
    /// Invalid observations; otherwise as [`Filter::marginal_sigmas`], whose cost it has.
    ///
    /// ```
    /// use topo_ekf::{Filter, Frame, Motion, Observation, Options, nalgebra::{Point3, Vector3}};
    /// # let rest: Vec<_> = (0..10).map(|k| Point3::new(0.005 * f64::from(k), 0.0, 0.0)).collect();
    /// # let edges: Vec<_> = (1..10).map(|k| [k - 1, k]).collect();
    /// // A chain of ten vertices, 5 mm apart.
    /// let mut filter = Filter::new(&rest, &edges, &Options::default().with_motion(Motion::Still))?;
    /// let seen = |k: u32| Observation { vertex: k, position: rest[k as usize], sigma: 5e-4 };
    /// let mut observations: Vec<_> = (0..10).map(seen).collect();
    /// observations[4].position += Vector3::new(0.0, 0.0, 0.02); // a wrong correspondence
    /// filter.step(&Frame::new(&observations))?;
    /// let residuals = filter.normalised_residuals(&observations)?;
    /// assert!(residuals[4] > 3.0);
    /// assert!((0..10).all(|k| k == 4 || residuals[k] < residuals[4]));
    /// # Ok::<(), topo_ekf::Error>(())
    /// ```
    pub fn normalised_residuals(&self, observations: &[Observation]) -> Result<Vec<f64>, Error> {
        Frame::new(observations).check(self.live.len())?;
        let variances = self.variances()?;
        let of = |o: &Observation| {
            let i = o.vertex as usize;
            // If a vertex is determined by this observation alone, residual and variance are both zero: the result is 0, not 0/0.
            let left = (o.sigma * o.sigma - variances[i]).max(1e-12 * o.sigma * o.sigma);
            (o.position - self.estimate[i]).norm() / (3.0 * left).sqrt()
        };
        Ok(observations.iter().map(of).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_band_is_that_of_the_tables() {
        // χ² quantiles at 2.5 % and 97.5 %: 10 degrees 3.247, 20.483; 100 degrees 74.222, 129.561.
        for (degrees, low, high) in [(10, 3.247, 20.483), (100, 74.222, 129.561)] {
            let band = Consistency::new(0.0, degrees).band();
            let found = band.map(|b| b * degrees as f64);
            // The approximation is good to one per cent from ten degrees on.
            assert!((found[0] / low - 1.0).abs() < 0.01, "{found:?}");
            assert!((found[1] / high - 1.0).abs() < 0.01, "{found:?}");
        }
    }

    #[test]
    fn the_verdict_follows_the_band() {
        let of = |squared| Consistency::new(squared, 100).verdict();
        assert_eq!(of(70.0), Verdict::Conservative);
        assert_eq!(of(100.0), Verdict::Consistent);
        assert_eq!(of(135.0), Verdict::Overconfident);
        assert_eq!(Consistency::new(0.0, 0).verdict(), Verdict::Consistent);
    }
}
