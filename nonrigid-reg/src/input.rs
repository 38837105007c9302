//! Checks of the whole input before anything is computed.

use nalgebra::{Point3, Vector3};

use crate::cloud::Cloud;
use crate::error::{Error, check_length, check_points, check_vectors};
use crate::options::Options;
use crate::registration::{Feature, Landmark};

/// With fewer points a motion is not determined.
const FEWEST: usize = 4;

/// The data of one call.
#[derive(Clone, Copy)]
pub(crate) struct Input<'a> {
    pub source: &'a Cloud<'a>,
    pub target: &'a Cloud<'a>,
    pub landmarks: &'a [Landmark],
    pub features: &'a [Feature],
    pub initial: Option<&'a [Vector3<f64>]>,
}

impl Input<'_> {
    pub fn check(&self, options: &Options) -> Result<(), Error> {
        options.check()?;
        check_cloud("source", self.source)?;
        check_cloud("target", self.target)?;
        check_landmarks(self.landmarks, options)?;
        let features = self.features.iter().map(|f| (f.source, f.target));
        check_pairs("feature", features)?;
        if let Some(predicted) = self.initial {
            check_length(
                "initial displacements",
                self.source.points.len(),
                predicted.len(),
            )?;
            check_vectors("initial displacement", predicted)?;
        }
        Ok(())
    }
}

pub(crate) fn check_cloud(name: &'static str, cloud: &Cloud) -> Result<(), Error> {
    cloud.check(name)?;
    let found = cloud.points.len();
    if found < FEWEST {
        return Err(Error::TooFewPoints {
            cloud: name,
            found,
            needed: FEWEST,
        });
    }
    Ok(())
}

pub(crate) fn check_landmarks(landmarks: &[Landmark], options: &Options) -> Result<(), Error> {
    check_pairs("landmark", landmarks.iter().map(|l| (l.source, l.target)))?;
    for (index, landmark) in landmarks.iter().enumerate() {
        if !(landmark.sigma >= 0.0 && landmark.sigma.is_finite()) {
            let value = landmark.sigma;
            return Err(Error::BadSigma { index, value });
        }
    }
    for (second, b) in landmarks.iter().enumerate() {
        for (first, a) in landmarks[..second].iter().enumerate() {
            let gap = ((b.target - b.source) - (a.target - a.source)).norm();
            // A rotation changes the difference of two points by at most twice their distance, a stretch to twice the length by once.
            let doubt = 3.0 * (a.sigma.hypot(b.sigma) + options.point_sigma);
            if gap > 2.0 * (a.source - b.source).norm() + doubt {
                return Err(Error::ContradictoryLandmarks { first, second, gap });
            }
        }
    }
    Ok(())
}

fn check_pairs(
    what: &'static str,
    pairs: impl Iterator<Item = (Point3<f64>, Point3<f64>)>,
) -> Result<(), Error> {
    let (sources, targets): (Vec<_>, Vec<_>) = pairs.unzip();
    check_points(what, &sources)?;
    check_points(what, &targets)
}
