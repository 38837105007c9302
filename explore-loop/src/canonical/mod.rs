//! The canonical model: what is known of the object, at rest and in the live frame.
//!
//! Every vertex keeps its **rest** position (frame of the first observation), its **live** position (camera
//! frame, now), the local rotation from rest to live, and when it was seen. The surface graph joins neighbours on
//! one sheet; the complex, the mesh and the filter are built on it.
//!
//! | file | question |
//! |---|---|
//! | [`graph`] | which vertices are neighbours on the surface? |
//! | [`colour`] | which colour does the surface have at rest? |
//! | [`cut`] | which edges join parts that only touched? |
//! | [`genus`] | how many handles does the surface have, and which are faults? |
//! | [`topology`] | is the surface closed, where is its boundary, what is cut? |
//! | `sample_complex` | which complex do points of the surface span, and what are its Betti numbers? |
//! | `obstacle` | what keeps a surface from counting as closed? |
//! | [`surface`] | triangles, areas, normals |
//! | [`tangent`] | offsets and directions in the plane of a normal |
//! | [`closed_surface`] | which closed surface do the points describe, and which parts of it were seen? |

use nalgebra::{Matrix3, Point3, UnitVector3, Vector3};

pub mod closed_surface;
pub mod colour;
pub mod cut;
pub mod genus;
pub mod graph;
mod obstacle;
mod sample_complex;
pub mod surface;
pub mod tangent;
pub mod topology;

/// The canonical model of the object: parallel arrays with one entry for each vertex.
///
/// ```
/// use explore_loop::canonical::{CanonicalModel, NewVertex};
/// use explore_loop::nalgebra::{Point3, Vector3};
///
/// // Three vertices in a row, 6 mm apart, and one beneath them that faces the other way.
/// let mut model = CanonicalModel::default();
/// for x in [0.0, 0.006, 0.012] {
///     model.push(NewVertex::new(Point3::new(x, 0.0, 0.5), -Vector3::z_axis()), 0);
/// }
/// model.push(NewVertex::new(Point3::new(0.006, 0.0, 0.501), Vector3::z_axis()), 1);
/// model.join(0.005);
/// assert_eq!(model.edges(), &[[0, 1], [1, 2]]);
/// // Identities survive the removal of others; indices do not.
/// assert_eq!(model.retain(&[false, true, true, true]), [1, 2, 3]);
/// assert_eq!(model.ids(), &[1, 2, 3]);
/// assert_eq!(model.edges(), &[[0, 1]]);
/// ```
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
// The derived functions are the inherent ones that the traits below call.
#[serde(remote = "Self")]
pub struct CanonicalModel {
    ids: Vec<u64>,
    rest: Vec<Point3<f64>>,
    rest_normals: Vec<UnitVector3<f64>>,
    live: Vec<Point3<f64>>,
    rotations: Vec<Matrix3<f64>>,
    born: Vec<u32>,
    last_seen: Vec<u32>,
    times_seen: Vec<u32>,
    edges: Vec<[u32; 2]>,
    colours: colour::ColourMap,
    /// Identities of the ends of edges that were cut (see [`cut`]).
    cuts: std::collections::BTreeSet<[u64; 2]>,
    next_id: u64,
}

impl serde::Serialize for CanonicalModel {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        Self::serialize(self, serializer)
    }
}

impl<'de> serde::Deserialize<'de> for CanonicalModel {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let model = Self::deserialize(deserializer)?;
        if model.is_consistent() {
            Ok(model)
        } else {
            let reason = "a model whose lists are of different vertices";
            Err(serde::de::Error::custom(reason))
        }
    }
}

/// A vertex about to enter the model.
#[derive(Debug, Clone, Copy)]
pub struct NewVertex {
    /// Position at rest.
    pub rest: Point3<f64>,
    /// Normal at rest.
    pub rest_normal: UnitVector3<f64>,
    /// Current position.
    pub live: Point3<f64>,
    /// Rotation from rest to live.
    pub rotation: Matrix3<f64>,
}

impl NewVertex {
    /// A vertex whose live position is its rest position.
    pub fn new(rest: Point3<f64>, rest_normal: UnitVector3<f64>) -> Self {
        Self {
            rest,
            rest_normal,
            live: rest,
            rotation: Matrix3::identity(),
        }
    }
}

impl CanonicalModel {
    /// Number of vertices.
    pub fn len(&self) -> usize {
        self.rest.len()
    }

    /// Whether nothing has been seen yet.
    pub fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }

    /// Stable identity of each vertex: never reused, survives removals of others.
    pub fn ids(&self) -> &[u64] {
        &self.ids
    }

    /// Positions in the frame of the first observation, metres.
    pub fn rest(&self) -> &[Point3<f64>] {
        &self.rest
    }

    /// Outward normals at rest.
    pub fn rest_normals(&self) -> &[UnitVector3<f64>] {
        &self.rest_normals
    }

    /// Positions now, camera frame, metres.
    pub fn live(&self) -> &[Point3<f64>] {
        &self.live
    }

    /// Positions now, to be changed.
    pub fn live_mut(&mut self) -> &mut [Point3<f64>] {
        &mut self.live
    }

    /// Local rotation from rest to live.
    pub fn rotations(&self) -> &[Matrix3<f64>] {
        &self.rotations
    }

    /// Local rotations, to be changed.
    pub fn rotations_mut(&mut self) -> &mut [Matrix3<f64>] {
        &mut self.rotations
    }

    /// Frame in which each vertex entered the model.
    pub fn born(&self) -> &[u32] {
        &self.born
    }

    /// Frame in which each vertex was last measured.
    pub fn last_seen(&self) -> &[u32] {
        &self.last_seen
    }

    /// In how many frames each vertex was measured.
    pub fn times_seen(&self) -> &[u32] {
        &self.times_seen
    }

    /// Neighbours on the surface, `i < j`, as [`Self::join`] found them.
    pub fn edges(&self) -> &[[u32; 2]] {
        &self.edges
    }

    /// Colour at rest, where the camera gives one.
    pub fn colours(&self) -> &colour::ColourMap {
        &self.colours
    }

    /// Finds the neighbours anew ([`graph::surface_edges`]), metres: after vertices have come or moved at rest.
    pub fn join(&mut self, spacing: f64) {
        self.edges = graph::surface_edges(self, spacing);
    }

    /// Notes that the vertices with `measured[i]` were measured in a frame.
    pub fn measured(&mut self, measured: &[bool], frame: u32) {
        for i in (0..self.len().min(measured.len())).filter(|i| measured[*i]) {
            self.last_seen[i] = frame;
            self.times_seen[i] += 1;
        }
    }

    /// Moves a vertex at rest.
    pub(crate) fn move_at_rest(&mut self, i: usize, place: Point3<f64>, normal: UnitVector3<f64>) {
        self.rest[i] = place;
        self.rest_normals[i] = normal;
    }

    /// Has the colours of another model from now on.
    pub(crate) fn take_colours_of(&mut self, other: &Self) {
        self.colours.clone_from(&other.colours);
    }

    /// Whether every list has an entry a vertex and every edge two vertices.
    fn is_consistent(&self) -> bool {
        let count = self.len();
        let lengths = [
            self.ids.len(),
            self.rest_normals.len(),
            self.live.len(),
            self.rotations.len(),
            self.born.len(),
            self.last_seen.len(),
            self.times_seen.len(),
        ];
        let inside = |edge: &[u32; 2]| edge.iter().all(|v| (*v as usize) < count);
        lengths.iter().all(|n| *n == count) && self.edges.iter().all(inside)
    }

    /// Adds a vertex first seen in `frame`.
    pub fn push(&mut self, vertex: NewVertex, frame: u32) {
        self.ids.push(self.next_id);
        self.next_id += 1;
        self.rest.push(vertex.rest);
        self.rest_normals.push(vertex.rest_normal);
        self.live.push(vertex.live);
        self.rotations.push(vertex.rotation);
        self.born.push(frame);
        self.last_seen.push(frame);
        self.times_seen.push(1);
    }

    /// Current normal of vertex `i`: its rest normal, rotated.
    pub fn live_normal(&self, i: usize) -> UnitVector3<f64> {
        UnitVector3::new_normalize(self.rotations[i] * self.rest_normals[i].into_inner())
    }

    /// Current normals of all vertices.
    pub fn live_normals(&self) -> Vec<UnitVector3<f64>> {
        (0..self.len()).map(|i| self.live_normal(i)).collect()
    }

    /// Keeps the vertices with `keep[i]` and removes the others, also those beyond the end of `keep`; returns the old index of every vertex kept.
    /// Edges are renumbered, and those of removed vertices are dropped.
    pub fn retain(&mut self, keep: &[bool]) -> Vec<u32> {
        let stays: Vec<u32> = (0..self.len())
            .filter(|&i| keep.get(i) == Some(&true))
            .map(|i| i as u32)
            .collect();
        let mut index = vec![u32::MAX; self.len()];
        for (new, &old) in stays.iter().enumerate() {
            index[old as usize] = new as u32;
        }
        pick(&mut self.ids, &stays);
        pick(&mut self.rest, &stays);
        pick(&mut self.rest_normals, &stays);
        pick(&mut self.live, &stays);
        pick(&mut self.rotations, &stays);
        pick(&mut self.born, &stays);
        pick(&mut self.last_seen, &stays);
        pick(&mut self.times_seen, &stays);
        self.edges = self
            .edges
            .iter()
            .map(|[a, b]| [index[*a as usize], index[*b as usize]])
            .filter(|[a, b]| *a != u32::MAX && *b != u32::MAX)
            .collect();
        stays
    }

    /// A model with other vertices that inherits identities, history and cuts. For each vertex: the index of the old vertex of the same material, if any
    /// (ascending, new ones last), and the frame in which surface was first seen there.
    pub(crate) fn inherited(
        &self,
        vertices: &[(NewVertex, Option<usize>, u32)],
        frame: u32,
    ) -> Self {
        let mut heir = Self {
            cuts: self.cuts.clone(),
            colours: self.colours.clone(),
            next_id: self.next_id,
            ..Self::default()
        };
        for (vertex, from, first_seen) in vertices {
            heir.push(*vertex, frame);
            if let Some(born) = heir.born.last_mut() {
                *born = *first_seen;
            }
            if let (Some(from), Some(at)) = (*from, heir.len().checked_sub(1)) {
                heir.next_id -= 1;
                heir.ids[at] = self.ids[from];
                heir.born[at] = self.born[from];
                heir.last_seen[at] = self.last_seen[from];
                heir.times_seen[at] = self.times_seen[from];
            }
        }
        heir
    }

    /// Gives all vertices but those of the first frame identities that `other` has never used.
    pub(crate) fn rename_after(&mut self, other: &Self) {
        let first = self.born.iter().take_while(|b| **b == 0).count();
        let shift = other.next_id;
        for id in &mut self.ids[first..] {
            *id += shift;
        }
        self.next_id += shift;
    }

    /// Mean of the live positions, or the origin when empty.
    pub fn live_centre(&self) -> Point3<f64> {
        let sum: Vector3<f64> = self.live.iter().map(|p| p.coords).sum();
        Point3::from(sum / self.len().max(1) as f64)
    }
}

/// Keeps the entries of `values` at the indices `stays`, in that order.
fn pick<T: Copy>(values: &mut Vec<T>, stays: &[u32]) {
    *values = stays.iter().map(|&i| values[i as usize]).collect();
}
