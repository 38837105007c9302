//! Places of the material that are recognised by their colours.
//!
//! ```text
//! planted   where a feature was seen first, carried to rest by the vertex it is nearest to: X = X_v + R_vᵀ (y − x_v)
//! met       in later frames: the same feature from frame to frame, or found again near where the body last had it
//! costs     Σ_t (t · (x(X) − y))² / σ²          two directions t along the surface; across it the cloud knows better
//! counts    confidence · Tukey (1 − r²/c²)²₊     r the distance along the surface, c as for matches
//! ```
//! A landmark stays where it was planted, so that the errors of frames do not add up: this is what holds a surface whose shape does not tell
//! where along itself it is.

use super::matching::Gates;
use super::recognise::Recognised;
use super::track::embed_beside;
use crate::canonical::{CanonicalModel, graph, tangent};
use crate::visibility::facing;
use dvrk_io::features::{Descriptor, Feature, FeatureOptions, match_features};
use nalgebra::{Point3, UnitVector3};
use topo_ekf::body::{Embedding, Lattice, Pose, Row};

/// Standard deviation of a landmark along the surface, metres: corners shift by a pixel or two as they are seen from elsewhere.
const SIGMA: f64 = 0.001;
/// Farthest from where the body last had it that a landmark is found again, metres, with how few different bits, and how clearly.
const AGAIN: f64 = 0.010;
const AGAIN_BITS: (u32, f64) = (45, 0.75);
/// Least facing of a landmark that may be seen.
const FACING: f64 = 0.3;
/// A landmark this far along the surface from where the body has it, metres, so many frames in a row, is not what it was taken for.
const ASTRAY: f64 = 0.006;
const STRIKES: u8 = 3;
/// Nothing is planted this near to a landmark that was seen in so many frames before, metres: what is older is less astray.
const CROWDED: f64 = 0.004;
const LATELY: u32 = 20;
/// Most landmarks; the ones not seen for longest go.
const MOST: usize = 1500;

/// A feature of the last frame that is a landmark.
#[derive(Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Seen {
    /// Which feature.
    feature: usize,
    /// Where it is.
    point: Point3<f64>,
    confidence: f64,
}

/// A place of the material.
#[derive(Clone, serde::Serialize, serde::Deserialize)]
struct Landmark {
    rest: Point3<f64>,
    normal: UnitVector3<f64>,
    /// As it looked last.
    descriptor: Descriptor,
    seen: Option<Seen>,
    /// Frames in which it was met.
    times: u32,
    last: u32,
    strikes: u8,
}

/// A landmark in a frame.
#[derive(Clone, serde::Serialize, serde::Deserialize)]
pub(crate) struct Sighting {
    rest: Point3<f64>,
    normal: UnitVector3<f64>,
    /// Where it is.
    point: Point3<f64>,
    confidence: f64,
}

/// All landmarks of a hypothesis.
#[derive(Clone, Default, serde::Serialize, serde::Deserialize)]
pub(crate) struct Landmarks {
    all: Vec<Landmark>,
}

impl Landmarks {
    /// Those recognised in the last frame that were planted before it.
    pub fn sighted(&self) -> Vec<Sighting> {
        let known = self.all.iter().filter(|l| l.times > 0);
        let sighted =
            known.filter_map(|l| l.seen.map(|seen| l.sighting(seen.point, seen.confidence)));
        sighted.collect()
    }

    /// The chain from frame to frame is broken.
    pub fn lose(&mut self) {
        self.all.iter_mut().for_each(|l| l.seen = None);
    }

    /// Recognises landmarks in a frame in which the body is not posed yet: `pose` is that of the frame before.
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

    /// Judges the landmarks by the pose that was found: those that stay astray go.
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

    /// Looks for the landmarks that were lost, where the body has them, among the features that are none yet.
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
            .with_bits(AGAIN_BITS.0, AGAIN_BITS.1);
        for pair in match_features(&features(&lost), &features(&free), &options) {
            let (feature, found) = free[pair.b];
            let landmark = &mut self.all[lost[pair.a].0];
            landmark.see(feature, pair.confidence, found, number);
        }
    }

    /// Features of a frame that are no landmarks.
    fn free(&self, frame: &Recognised) -> Vec<(usize, Feature)> {
        let mut taken = vec![false; frame.features.len()];
        for seen in self.all.iter().filter_map(|l| l.seen) {
            taken[seen.feature] = true;
        }
        let all = frame.features.iter().copied().enumerate();
        all.filter(|(k, _)| !taken[*k]).collect()
    }

    /// Plants a landmark at every feature that is none, where the surface was measured and no other was seen lately.
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

/// Which feature of a frame a landmark that was seen in the one before is.
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

/// Sightings with the place of each in the lattice.
pub(crate) fn embedded(sightings: &[Sighting], lattice: &Lattice) -> Vec<(Embedding, Sighting)> {
    let place = |s: &Sighting| {
        let at = embed_beside(lattice, &s.rest, &s.normal)?;
        Some((at, s.clone()))
    };
    sightings.iter().filter_map(place).collect()
}

/// What landmarks say of a pose: rows on the body.
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
