//! Decides whether the part that is still hidden is attached to the table.
//!
//! ```text
//! moved(v)   = max over frames with a jaw closed of ‖live(v) − rest(v)‖
//! reached    = 95th percentile of moved
//! held       ⇔ moved ≤ 0.3 · reached next to at least half of the hidden area,  reached ≥ 6 spacings,
//!              at most a quarter of the surface is hidden, in one hole, and each of the last two manipulations revealed less than 2 %
//! ```
//! A free body is moved 8 to 15 cm when it is turned over, and all of it in two turns; an attached part stays in place, and tissue next to it is stretched.

use super::Explorer;
use crate::canonical::CanonicalModel;
use crate::canonical::graph;
use crate::canonical::topology::Topology;
use nalgebra::{Point3, Vector3};
use std::collections::BTreeMap;

/// Share of `reached` below which a vertex has stayed in place.
const STAYED: f64 = 0.3;
/// Least motion of the body, in spacings, for which this is significant.
const REACHED: f64 = 6.0;
/// Largest share of the surface that may be hidden.
const HIDDEN: f64 = 0.25;
/// Least share of the surface that a successful manipulation reveals.
const GAIN: f64 = 0.02;
/// Number of consecutive manipulations that revealed less, or that did not part what touches.
const IN_VAIN: usize = 2;

/// A part of the surface that could not be seen because it is attached to the table.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Held {
    /// Its centroid at rest, camera frame, metres.
    pub middle: Point3<f64>,
    /// Its area, m².
    pub area: f64,
    /// Its share of the surface.
    pub share: f64,
}

impl std::fmt::Display for Held {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Point3 { coords: m, .. } = self.middle;
        write!(
            f,
            "{:.1} cm² ({:.1} % of the surface) around {:.3} {:.3} {:.3} m at rest are held to the table and were not seen",
            1e4 * self.area,
            100.0 * self.share,
            m.x,
            m.y,
            m.z
        )
    }
}

/// How far the surface was moved, and what was hidden.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub(super) struct Moves {
    /// Rest position of each vertex, by identity, and its largest distance from there.
    moved: BTreeMap<u64, (Point3<f64>, f64)>,
    /// Hidden share before each decision.
    hidden: Vec<f64>,
    /// Number of consecutive decisions, up to the last one, at which only parts that touch were in the way.
    touching: usize,
}

impl Moves {
    /// Adds a frame in which a jaw is closed.
    pub fn add(&mut self, model: &CanonicalModel) {
        for ((id, rest), live) in model.ids().iter().zip(model.rest()).zip(model.live()) {
            let entry = self.moved.entry(*id).or_insert((*rest, 0.0));
            entry.0 = *rest;
            entry.1 = entry.1.max((live - rest).norm());
        }
    }

    /// Adds what is hidden, and whether parts touch, before a decision.
    pub fn decide(&mut self, topology: &Topology) {
        self.hidden.push(topology.bare);
        self.touching = topology.touching().map_or(0, |_| self.touching + 1);
    }

    /// Whether as many manipulations in a row have not parted what touches, though nothing else was left to do.
    pub fn parted_in_vain(&self) -> bool {
        self.touching > IN_VAIN
    }

    /// Whether the last manipulations revealed almost nothing.
    pub fn in_vain(&self) -> bool {
        let count = self.hidden.len();
        count > IN_VAIN
            && self.hidden[count - 1 - IN_VAIN..]
                .windows(2)
                .all(|w| w[0] - w[1] < GAIN)
    }

    /// The 95th percentile of the motions of the vertices, m, if it is large enough to be significant.
    fn reached(&self, spacing: f64) -> Option<f64> {
        let mut sorted: Vec<f64> = self.moved.values().map(|(_, far)| *far).collect();
        sorted.sort_by(f64::total_cmp);
        let reached = *sorted.get(sorted.len() - sorted.len().div_ceil(20))?;
        (reached >= REACHED * spacing).then_some(reached)
    }

    /// The hidden part, if it is attached to the table.
    pub fn held(&self, topology: &Topology, model: &CanonicalModel, spacing: f64) -> Option<Held> {
        let [pieces, holes, cavities] = topology.persistent;
        if topology.hidden.is_empty() || topology.bare > HIDDEN || [pieces, cavities] != [1, 0] {
            return None;
        }
        // One hole in a surface without handles adds no class of dimension 1; a few small ones caused by noise are not counted.
        if holes > 1 {
            return None;
        }
        let reached = self.reached(spacing)?;
        let (places, moved): (Vec<Point3<f64>>, Vec<f64>) = self.moved.values().copied().unzip();
        let tree = graph::tree(&places)?;
        let (mut area, mut stayed, mut middle) = (0.0, 0.0, Vector3::zeros());
        for hidden in &topology.hidden {
            let rest = model.rest().get(hidden.vertex as usize)?;
            let size = hidden.area.norm();
            area += size;
            middle += rest.coords * size;
            if moved[graph::nearest(&tree, rest).0] <= STAYED * reached {
                stayed += size;
            }
        }
        (area > 0.0 && stayed >= 0.5 * area).then(|| Held {
            middle: Point3::from(middle / area),
            area,
            share: topology.bare,
        })
    }
}

impl Explorer<'_> {
    /// The hidden part, if it is attached to the table.
    pub(super) fn held(&self, topology: &Topology) -> Option<Held> {
        let model = self.reconstructor.model();
        self.moves.held(topology, model, self.options.spacing)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::canonical::NewVertex;
    use crate::canonical::genus::{Genus, Handles};
    use crate::canonical::topology::Hidden;

    /// A strip of vertices along x, lifted from one end, with a hidden piece next to its beginning.
    fn strip(lift: impl Fn(f64) -> f64) -> (CanonicalModel, Topology, Moves) {
        let mut model = CanonicalModel::default();
        for k in 0..40 {
            let rest = Point3::new(0.005 * f64::from(k), 0.0, 0.5);
            model.push(NewVertex::new(rest, -Vector3::z_axis()), 0);
        }
        let mut moves = Moves::default();
        for live in model.live_mut() {
            live.z -= lift(live.x);
        }
        moves.add(&model);
        let topology = Topology {
            betti: [1, 0, 0],
            persistent: [1, 0, 0],
            genus: Genus::Any,
            handles: Handles::default(),
            boundary: Vec::new(),
            boundary_share: 0.02,
            missing: 0.05,
            bare: 0.05,
            hidden: vec![Hidden {
                vertex: 1,
                area: Vector3::new(0.0, 0.0, 2e-4),
            }],
            unseen: Vec::new(),
            farthest: 0.01,
            wholly_seen: false,
            strays: 0.0,
            bars: Vec::new(),
            shorter_bars: [0; 3],
            loops: Vec::new(),
            neck: Vec::new(),
            cut: [0; 3],
            non_manifold: 0,
            simplices: [0; 4],
            thinned: 0,
            surface: None,
        };
        (model, topology, moves)
    }

    #[test]
    fn what_stays_when_the_rest_is_lifted_is_held() {
        let (model, topology, moves) = strip(|x| x);
        let held = moves.held(&topology, &model, 0.005).unwrap();
        assert!((held.middle - model.rest()[1]).norm() < 1e-12);
        assert!((held.area - 2e-4).abs() < 1e-12);
    }

    #[test]
    fn a_body_that_is_carried_away_is_not_held() {
        let (model, topology, moves) = strip(|x| 0.1 + 0.2 * x);
        assert_eq!(moves.held(&topology, &model, 0.005), None);
    }

    #[test]
    fn a_body_that_was_hardly_moved_tells_nothing() {
        let (model, topology, moves) = strip(|x| 0.1 * x);
        assert_eq!(moves.held(&topology, &model, 0.005), None);
    }

    #[test]
    fn two_manipulations_that_show_nothing_are_in_vain() {
        let (_, mut topology, mut moves) = strip(|x| x);
        for (bare, vain) in [(0.3, false), (0.1, false), (0.095, false), (0.09, true)] {
            topology.bare = bare;
            moves.decide(&topology);
            assert_eq!(moves.in_vain(), vain, "{bare}");
        }
    }

    /// Only decisions in a row count: what was parted, or uncovered, in between starts the count anew.
    #[test]
    fn two_attempts_that_do_not_part_are_in_vain() {
        let (_, open, mut moves) = strip(|x| x);
        let touching = Topology {
            persistent: [1, 2, 1],
            handles: Handles {
                count: 1,
                crease: 1.0,
                creased_along: vec![Point3::origin(); 3],
            },
            missing: 0.0,
            boundary_share: 0.0,
            wholly_seen: true,
            ..open.clone()
        };
        assert!(touching.touching().is_some() && open.touching().is_none());
        let decisions = [
            (&touching, false),
            (&touching, false),
            (&open, false),
            (&touching, false),
            (&touching, false),
            (&touching, true),
        ];
        for (k, (topology, vain)) in decisions.into_iter().enumerate() {
            moves.decide(topology);
            assert_eq!(moves.parted_in_vain(), vain, "decision {k}");
        }
    }
}
