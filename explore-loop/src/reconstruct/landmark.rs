//! Landmarks: points of the material that are recognised by colour features.
//!
//! ```text
//! created   where a feature was first seen, moved to rest with the nearest vertex: X = X_v + R_vᵀ (y − x_v)
//! matched   in later frames: from frame to frame, or found again near its last predicted position
//! cost      Σ_t (t · (x(X) − y))² / σ²          two directions t along the surface; across it the cloud is more accurate
//! weight    confidence · Tukey (1 − r²/c²)²₊     r the distance along the surface, c as for matches
//! ```
//! A landmark keeps its position at rest, so that the errors of frames do not accumulate. It holds a surface whose shape does not determine how it
//! slides along itself.

use super::matching::Gates;
use super::recognise::Recognised;
use super::track::embed_beside;
use crate::canonical::{CanonicalModel, graph, tangent};
use crate::visibility::facing;
use dvrk_io::features::{Descriptor, Feature, FeatureOptions, match_features};
use nalgebra::{Point3, UnitVector3};
use topo_ekf::body::{Embedding, Lattice, Pose, Row};

/// Standard deviation of a landmark along the surface, metres: corners shift by a pixel or two between views.
const SIGMA: f64 = 0.001;
/// Largest distance from its predicted position at which a landmark is found again, metres; largest Hamming distance, and ratio to the second best.
const AGAIN: f64 = 0.010;
const AGAIN_BITS: (u32, f64) = (45, 0.75);
/// Least facing of a visible landmark.
const FACING: f64 = 0.3;
/// A landmark at least this far along the surface from its prediction, metres, in this many consecutive frames, is a wrong match.
const ASTRAY: f64 = 0.006;
const STRIKES: u8 = 3;
/// No landmark is created this near to one that was recently seen, metres: older landmarks have drifted less.
const CROWDED: f64 = 0.004;
const LATELY: u32 = 20;
/// Most landmarks; those not seen for longest are removed.
const MOST: usize = 1500;

/// A feature of the last frame that is a landmark.
#[derive(Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Seen {
    /// Index of the feature.
    feature: usize,
    /// Its position.
    point: Point3<f64>,
    confidence: f64,
}

/// A point of the material.
#[derive(Clone, serde::Serialize, serde::Deserialize)]
struct Landmark {
    rest: Point3<f64>,
    normal: UnitVector3<f64>,
    /// Its latest appearance.
    descriptor: Descriptor,
    seen: Option<Seen>,
    /// Number of frames in which it was matched.
    times: u32,
    last: u32,
    strikes: u8,
}

/// A landmark in a frame.
#[derive(Clone, serde::Serialize, serde::Deserialize)]
pub(crate) struct Sighting {
    rest: Point3<f64>,
    normal: UnitVector3<f64>,
    /// Its position.
    point: Point3<f64>,
    confidence: f64,
}

/// All landmarks of a hypothesis.
#[derive(Clone, Default, serde::Serialize, serde::Deserialize)]
pub(crate) struct Landmarks {
    all: Vec<Landmark>,
}

impl Landmarks {
    /// The landmarks recognised in the last frame that were created before it.
    pub fn sighted(&self) -> Vec<Sighting> {
        let known = self.all.iter().filter(|l| l.times > 0);
        let sighted =
            known.filter_map(|l| l.seen.map(|seen| l.sighting(seen.point, seen.confidence)));
        sighted.collect()
    }

    /// Breaks the chain of matches from frame to frame.
    pub fn lose(&mut self) {
        self.all.iter_mut().for_each(|l| l.seen = None);
    }

    /// Recognises landmarks in a frame before the body is registered: `pose` is that of the previous frame.
    pub fn recognise(&mut self, frame: &Recognised, lattice: &Lattice, pose: &Pose, number: u32) {
        for landmark in &mut self.all {
            let gone = went(landmark, frame);
            landmark.seen = None;
            if let Some((feature, confidence)) = gone {
                let as_seen = frame.features[feature];
                landmark.see(feature, confidence, as_seen, number);
            }
        }
        self.find_again(frame, lattice, pose, number);
    }

    /// Checks the landmarks with the registered pose; those that are repeatedly off are removed.
    pub fn judge(&mut self, lattice: &Lattice, pose: &Pose) {
        for landmark in &mut self.all {
            let Some((seen, (at, normal))) = landmark.seen.zip(landmark.posed(lattice, pose))
            else {
                continue;
            };
            let astray = tangent::aside(&normal, &(at - seen.point)) > ASTRAY;
            landmark.strikes = if astray { landmark.strikes + 1 } else { 0 };
        }
        self.all.retain(|l| l.strikes < STRIKES);
    }

    /// Searches for lost landmarks near their predicted positions, among the features that are not matched.
    fn find_again(&mut self, frame: &Recognised, lattice: &Lattice, pose: &Pose, number: u32) {
        let free = self.free(frame);
        let lost: Vec<(usize, Feature)> = (0..self.all.len())
            .filter(|&l| self.all[l].seen.is_none())
            .filter_map(|l| {
                let landmark = &self.all[l];
                let (point, normal) = landmark.posed(lattice, pose)?;
                let descriptor = landmark.descriptor;
                let feature = Feature { point, descriptor };
                (facing(&point, &normal, &frame.eye) > FACING).then_some((l, feature))
            })
            .collect();
        let features = |list: &[(usize, Feature)]| -> Vec<Feature> {
            list.iter().map(|(_, feature)| *feature).collect()
        };
        let options = FeatureOptions::default()
            .with_motion(AGAIN)
            .with_most_different(AGAIN_BITS.0)
            .with_ratio(AGAIN_BITS.1);
        for pair in match_features(&features(&lost), &features(&free), &options) {
            let (feature, found) = free[pair.b];
            let landmark = &mut self.all[lost[pair.a].0];
            landmark.see(feature, pair.confidence, found, number);
        }
    }

    /// Features of a frame that are not landmarks.
    fn free(&self, frame: &Recognised) -> Vec<(usize, Feature)> {
        let mut taken = vec![false; frame.features.len()];
        for seen in self.all.iter().filter_map(|l| l.seen) {
            taken[seen.feature] = true;
        }
        let all = frame.features.iter().copied().enumerate();
        all.filter(|(k, _)| !taken[*k]).collect()
    }

    /// Creates a landmark at every other feature where the surface was measured and no landmark was recently seen.
    pub fn plant(
        &mut self,
        frame: &Recognised,
        (lattice, pose): (&Lattice, &Pose),
        (model, measured): (&CanonicalModel, &[bool]),
        spacing: f64,
        number: u32,
    ) {
        let lately = self.all.iter().filter(|l| l.last + LATELY >= number);
        let known: Vec<Point3<f64>> = lately
            .filter_map(|l| l.posed(lattice, pose).map(|(at, _)| at))
            .collect();
        let known = graph::tree(&known);
        let crowded = |p: &Point3<f64>| {
            let nearest = known.as_ref().map(|tree| graph::nearest(tree, p).1);
            nearest.is_some_and(|away| away < CROWDED)
        };
        let vertices: Vec<usize> = (0..model.len()).filter(|&v| measured[v]).collect();
        let places: Vec<Point3<f64>> = vertices.iter().map(|&v| model.live()[v]).collect();
        let Some(tree) = graph::tree(&places) else {
            return;
        };
        for (k, feature) in self.free(frame) {
            let (nearest, distance) = graph::nearest(&tree, &feature.point);
            let v = vertices[nearest];
            let turned_away = facing(&feature.point, &model.live_normal(v), &frame.eye) < FACING;
            if distance > spacing || turned_away || crowded(&feature.point) {
                continue;
            }
            let offset = feature.point - model.live()[v];
            self.all.push(Landmark {
                rest: model.rest()[v] + model.rotations()[v].transpose() * offset,
                normal: model.rest_normals()[v],
                descriptor: feature.descriptor,
                seen: Some(Seen {
                    feature: k,
                    point: feature.point,
                    confidence: 1.0,
                }),
                times: 0,
                last: number,
                strikes: 0,
            });
        }
        if self.all.len() > MOST {
            self.all.sort_by_key(|l| std::cmp::Reverse(l.last));
            self.all.truncate(MOST);
        }
    }
}

/// The feature of a frame that continues a landmark of the previous frame.
fn went(landmark: &Landmark, frame: &Recognised) -> Option<(usize, f64)> {
    let (feature, confidence) = (*frame.from.get(landmark.seen?.feature)?)?;
    (feature < frame.features.len()).then_some((feature, confidence))
}

impl Landmark {
    fn sighting(&self, point: Point3<f64>, confidence: f64) -> Sighting {
        Sighting {
            rest: self.rest,
            normal: self.normal,
            point,
            confidence,
        }
    }

    fn posed(&self, lattice: &Lattice, pose: &Pose) -> Option<(Point3<f64>, UnitVector3<f64>)> {
        let at = embed_beside(lattice, &self.rest, &self.normal)?;
        let normal = pose.normal(lattice, &at, &self.normal);
        Some((pose.position(lattice, &at), normal))
    }

    fn see(&mut self, feature: usize, confidence: f64, as_seen: Feature, number: u32) {
        self.seen = Some(Seen {
            feature,
            point: as_seen.point,
            confidence,
        });
        self.descriptor = as_seen.descriptor;
        self.times += 1;
        self.last = number;
    }
}

/// Sightings with the coordinates of each in the lattice.
pub(crate) fn embedded(sightings: &[Sighting], lattice: &Lattice) -> Vec<(Embedding, Sighting)> {
    let place = |s: &Sighting| {
        let at = embed_beside(lattice, &s.rest, &s.normal)?;
        Some((at, s.clone()))
    };
    sightings.iter().filter_map(place).collect()
}

/// The landmarks as rows of the fit of a pose.
pub(crate) fn rows(
    met: &[(Embedding, Sighting)],
    lattice: &Lattice,
    pose: &Pose,
    gates: Gates,
) -> Vec<Row> {
    let mut rows = Vec::with_capacity(2 * met.len());
    for (at, sighting) in met {
        let normal = pose.normal(lattice, at, &sighting.normal);
        let offset = pose.position(lattice, at) - sighting.point;
        let relative = tangent::aside(&normal, &offset) / gates.tukey;
        let share = (1.0 - relative * relative).max(0.0);
        let weight = SIGMA.powi(-2) * sighting.confidence * share * share;
        if weight > 0.0 {
            let (u, v) = tangent::tangents(&normal);
            for along in [u, v] {
                let along = UnitVector3::new_normalize(along);
                rows.push(Row::along(*at, sighting.point, along, weight));
            }
        }
    }
    rows
}
