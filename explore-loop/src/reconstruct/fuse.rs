//! Re-fusion: computes the rest shape from all keyframes.
//!
//! ```text
//! samples   every point of every keyframe, moved to rest; weight facing² · (first view 10, at rest 3) · (boundary of a view 0.2)
//! vertex    start at the heaviest free sample; along its normal, the window of ± 2.5 mm that holds most weight: mean position, mean
//!           normal; three iterations. Rejected where another vertex of the sheet is near, or in front or behind
//! evidence  a vertex through which keyframes see, or that lies outside of their outline, is removed; so are small pieces; a keyframe that
//!           contradicts more than a tenth of what it shows was tracked wrongly, and is dropped
//! ```
//! The densest window is used instead of the mean: a view that was tracked wrongly makes a second peak and does not shift the first. A vertex of the
//! same material as an old one inherits its identity and history.

use super::ReconstructOptions;
use super::fill::Columns;
use super::keyframe::Keyframe;
use super::matching::Posed;
use super::track::{Track, cell_tree, to_rest};
use crate::canonical::closed_surface::{ClosedSurfaceOptions, closed_surface};
use crate::canonical::{NewVertex, graph, tangent};
use crate::cell::Plane;
use crate::visibility::{behind_arm, facing};
use nalgebra::{Point3, UnitVector3, Vector3};
use std::collections::BTreeMap;

/// Weights of a sample.
const FIRST: f64 = 10.0;
const AT_REST: f64 = 3.0;
const RIM: f64 = 0.2;
/// Least facing of a sample, and its largest distance outside of the lattice, in cells.
const FACING: f64 = 0.25;
const OUTSIDE: f64 = 0.3;
/// Half the height of the window, metres.
const WINDOW: f64 = 0.0025;
/// Most samples used for one vertex.
const SAMPLES: usize = 160;
/// Fewest keyframes of a vertex, unless its weight is at least [`SURE`].
const KEYFRAMES: u32 = 2;
const SURE: f64 = 3.0;
/// Largest depth of a vertex below the table, metres.
const SUNK: f64 = 0.004;
/// Evidence below which a vertex is removed.
const REFUTED: f64 = -1.5;
/// Share of what a keyframe shows of the model that it may contradict. More means that the body was not where it was tracked: such a keyframe would remove
/// surface that is there. The test below has the share where nothing is wrong.
const MISTRACKED: f64 = 0.1;

/// A point of a keyframe, moved to rest.
struct Sample {
    place: Point3<f64>,
    normal: UnitVector3<f64>,
    weight: f64,
    keyframe: usize,
}

/// A vertex of the fused shape.
#[derive(Clone, Copy)]
struct Fused {
    place: Point3<f64>,
    normal: UnitVector3<f64>,
    /// Weight of its samples.
    weight: f64,
}

/// Fuses the rest shape of a track: first with the tracked poses, and in every further round with poses fitted to the new shape.
pub(crate) fn refuse(track: &mut Track, table: &Plane, options: &ReconstructOptions) {
    for round in 0..options.fusion_rounds {
        if round > 0 {
            track.refit_keyframes(options);
        }
        if !refuse_once(track, table, options) {
            break;
        }
    }
    track.renew_contact(options.spacing);
    track.lift_out();
}

/// One round; false when the result has too few vertices.
fn refuse_once(track: &mut Track, table: &Plane, options: &ReconstructOptions) -> bool {
    let spacing = options.spacing;
    track.keyframes.extend(track.body.lattice());
    let samples = samples(track);
    let fused = fuse(&samples, table, spacing);
    if fused.len() < super::view::FEWEST {
        return false;
    }
    adopt(track, &fused, spacing);
    let keep = supported(track, spacing);
    track.retain(&keep);
    track.settle_edges(spacing);
    track.pose();
    let wall_points = ClosedSurfaceOptions::new(spacing).wall_points;
    refill(track, options, wall_points);
    true
}

/// Divides the material of the body wherever a crease says that two parts touch, also if nobody has seen them apart yet: joined fingers could not be
/// pulled apart in the model while they come apart in the world. The next fusion joins again what did not move apart.
pub(crate) fn divide(track: &mut Track, options: &ReconstructOptions) {
    refill(track, options, 0);
}

/// Fills the lattice anew from the closed surface through the fused vertices, if there is one. Parts that touch are divided at contacts with at least so many
/// points of walls, or pairs of vertices that have moved apart.
fn refill(track: &mut Track, options: &ReconstructOptions, wall_points: usize) {
    let weights = vec![1.0; track.model.len()];
    let drawing = ClosedSurfaceOptions::new(options.spacing)
        .with_wall_points(wall_points)
        .with_parted(track.model.parted());
    let (points, normals) = (track.model.rest(), track.model.rest_normals());
    let Ok(surface) = closed_surface(points, normals, &weights, &drawing) else {
        return;
    };
    let columns = Columns::of_mesh(&surface.vertices, &surface.triangles, track.body.lattice());
    track.refill(&columns, 1.0, options.material, &surface.contacts);
    track.walls = surface.contacts;
}

/// All points of all keyframes, moved to rest.
fn samples(track: &Track) -> Vec<Sample> {
    let lattice = track.body.lattice();
    let mut samples = Vec::new();
    for (k, keyframe) in track.keyframes.all().iter().enumerate() {
        let first = keyframe.frame == 0;
        let trust = match (first, keyframe.at_rest) {
            (true, _) => FIRST,
            (_, true) => AT_REST,
            _ => 1.0,
        };
        let cells = cell_tree(lattice, &keyframe.pose.live);
        let view = &keyframe.view;
        let eye = view.eye();
        for (i, point) in view.points.iter().enumerate() {
            let turned = facing(point, &view.normals[i], &eye);
            if turned < FACING {
                continue;
            }
            let Some(at) = to_rest(lattice, &keyframe.pose, point, cells.as_ref())
                .filter(|at| at.outside <= OUTSIDE)
            else {
                continue;
            };
            let normal = at.gradient.transpose() * view.normals[i].into_inner();
            samples.push(Sample {
                place: at.position,
                normal: UnitVector3::new_normalize(normal),
                weight: turned * turned * trust * if view.rim[i] { RIM } else { 1.0 },
                keyframe: k,
            });
        }
    }
    samples
}

/// Vertices about one spacing apart from the samples, heaviest first.
fn fuse(samples: &[Sample], table: &Plane, spacing: f64) -> Vec<Fused> {
    let places: Vec<Point3<f64>> = samples.iter().map(|s| s.place).collect();
    let Some(tree) = graph::tree(&places) else {
        return Vec::new();
    };
    let mut order: Vec<usize> = (0..samples.len()).collect();
    order.sort_by(|a, b| {
        let heavier = samples[*b].weight.total_cmp(&samples[*a].weight);
        heavier.then(a.cmp(b))
    });
    let mut shape = Shape::new(spacing);
    for start in order {
        let sample = &samples[start];
        if shape.clashes(&sample.place, &sample.normal) {
            continue;
        }
        let Some((vertex, keyframes)) = peak(sample, samples, &tree, spacing) else {
            continue;
        };
        let unsure = keyframes < KEYFRAMES && vertex.weight < SURE;
        let clashes = shape.clashes(&vertex.place, &vertex.normal);
        if clashes || unsure || table.height(&vertex.place) < -SUNK {
            continue;
        }
        shape.add(vertex);
    }
    shape.vertices
}

/// The heaviest window along the normal, after three iterations, and the number of its keyframes.
fn peak(
    start: &Sample,
    samples: &[Sample],
    tree: &graph::Tree,
    spacing: f64,
) -> Option<(Fused, u32)> {
    let mut vertex = Fused {
        place: start.place,
        normal: start.normal,
        weight: 0.0,
    };
    let mut keyframes = 0_u64;
    for _ in 0..3 {
        let near: Vec<(f64, &Sample)> = graph::near(tree, &vertex.place, 2.2 * spacing, SAMPLES)
            .into_iter()
            .map(|(j, _)| &samples[j])
            .filter(|s| s.normal.dot(&vertex.normal) > 0.5)
            .filter_map(|s| {
                let offset = s.place - vertex.place;
                let beside = tangent::aside(&vertex.normal, &offset) < 0.9 * spacing;
                beside.then(|| (vertex.normal.dot(&offset), s))
            })
            .collect();
        let mut best = (0.0, 0.0);
        for (height, _) in &near {
            let within = near.iter().filter(|n| (n.0 - height).abs() < WINDOW);
            let weight: f64 = within.map(|n| n.1.weight).sum();
            if weight > best.0 {
                best = (weight, *height);
            }
        }
        let (mut height, mut normal) = (0.0, Vector3::zeros());
        (vertex.weight, keyframes) = (0.0, 0);
        for (h, s) in near.iter().filter(|n| (n.0 - best.1).abs() < WINDOW) {
            height += h * s.weight;
            normal += s.normal.into_inner() * s.weight;
            vertex.weight += s.weight;
            keyframes |= 1 << (s.keyframe % 64);
        }
        if vertex.weight <= 0.0 {
            return None;
        }
        vertex.place += vertex.normal.into_inner() * (height / vertex.weight);
        vertex.normal = UnitVector3::try_new(normal, 1e-9)?;
    }
    Some((vertex, keyframes.count_ones()))
}

/// The vertices so far, in bins of three spacings.
struct Shape {
    spacing: f64,
    vertices: Vec<Fused>,
    bins: BTreeMap<[i32; 3], Vec<usize>>,
}

impl Shape {
    fn new(spacing: f64) -> Self {
        Self {
            spacing,
            vertices: Vec::new(),
            bins: BTreeMap::new(),
        }
    }

    fn bin(&self, p: &Point3<f64>) -> [i32; 3] {
        [p.x, p.y, p.z].map(|x| (x / (3.0 * self.spacing)).floor() as i32)
    }

    fn add(&mut self, vertex: Fused) {
        let bin = self.bin(&vertex.place);
        self.bins.entry(bin).or_default().push(self.vertices.len());
        self.vertices.push(vertex);
    }

    /// Whether a vertex of the same sheet is near, or directly in front or behind.
    fn clashes(&self, place: &Point3<f64>, normal: &UnitVector3<f64>) -> bool {
        let eps = self.spacing;
        let [x, y, z] = self.bin(place);
        let offsets = (0..27).map(|k| [x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1]);
        offsets
            .filter_map(|bin| self.bins.get(&bin))
            .flatten()
            .any(|&j| {
                let other = &self.vertices[j];
                let agree = other.normal.dot(normal);
                let offset = other.place - place;
                agree > 0.2
                    && (offset.norm() < 0.85 * eps
                        || (agree > 0.5
                            && tangent::aside(normal, &offset) < 0.75 * eps
                            && normal.dot(&offset).abs() < 3.0 * eps))
            })
    }
}

/// Puts the fused vertices into the model; each inherits identity and history from the nearest old vertex of its sheet.
fn adopt(track: &mut Track, fused: &[Fused], spacing: f64) {
    let old = std::mem::take(&mut track.model);
    let tree = graph::tree(old.rest());
    let heir = |vertex: &Fused| -> Option<usize> {
        let near = graph::near(tree.as_ref()?, &vertex.place, 0.6 * spacing, 8);
        let same = |i: usize| old.rest_normals()[i].dot(&vertex.normal) > 0.3;
        near.into_iter().map(|(i, _)| i).find(|i| same(*i))
    };
    let mut taken = vec![false; old.len()];
    let mut heirs: Vec<(usize, Option<usize>)> = Vec::with_capacity(fused.len());
    for (k, vertex) in fused.iter().enumerate() {
        let from = heir(vertex).filter(|&i| !std::mem::replace(&mut taken[i], true));
        heirs.push((k, from));
    }
    // Identities ascend along the model: inheriting vertices in the old order, then the new ones.
    heirs.sort_by_key(|(k, from)| (from.map_or(usize::MAX, |i| i), *k));
    // Known surface is not new because its vertices have moved.
    let first_seen = |vertex: &Fused| -> u32 {
        let near = tree.as_ref().map_or_else(Vec::new, |tree| {
            graph::near(tree, &vertex.place, 1.5 * spacing, 12)
        });
        let same = |i: &usize| old.rest_normals()[*i].dot(&vertex.normal) > 0.3;
        let known = near.into_iter().map(|(i, _)| i).find(same);
        known.map_or(track.frame(), |i| old.born()[i])
    };
    let order: Vec<(NewVertex, Option<usize>, u32)> = heirs
        .into_iter()
        .map(|(k, from)| {
            let vertex = NewVertex {
                rest: fused[k].place,
                rest_normal: fused[k].normal,
                live: fused[k].place,
                rotation: nalgebra::Matrix3::identity(),
            };
            (vertex, from, first_seen(&fused[k]))
        })
        .collect();
    track.model = old.inherited(&order, track.frame());
    track.embeddings = (0..track.model.len())
        .map(|i| {
            let (rest, normal) = (track.model.rest()[i], track.model.rest_normals()[i]);
            track.embed(&rest, &normal)
        })
        .collect();
    track.seen = vec![false; track.model.len()];
}

/// Which vertices are consistent with the keyframes, without small pieces. Keyframes that contradict the model as a whole are dropped.
fn supported(track: &mut Track, spacing: f64) -> Vec<bool> {
    let mut total = vec![0.0_f64; track.model.len()];
    let evidence: Vec<Vec<f64>> = track
        .keyframes
        .all()
        .iter()
        .map(|keyframe| evidence(track, keyframe, spacing))
        .collect();
    let trusted: Vec<bool> = std::iter::zip(track.keyframes.all(), &evidence)
        .map(|(keyframe, evidence)| keyframe.frame == 0 || contradicts(evidence) <= MISTRACKED)
        .collect();
    for (evidence, _) in evidence
        .iter()
        .zip(&trusted)
        .filter(|(_, trusted)| **trusted)
    {
        for (total, evidence) in total.iter_mut().zip(evidence) {
            *total += evidence;
        }
    }
    track.keyframes.retain(&trusted);
    let pieces = pieces(track, spacing);
    let most = pieces.sizes.iter().copied().max().unwrap_or(0);
    (0..track.model.len())
        .map(|i| total[i] > REFUTED && pieces.sizes[pieces.of[i]] * 8 > most)
        .collect()
}

/// The share of the vertices of which a keyframe shows something that it contradicts.
fn contradicts(evidence: &[f64]) -> f64 {
    let count = |sign: f64| evidence.iter().filter(|e| **e * sign > 0.0).count();
    let (against, agreeing) = (count(-1.0), count(1.0));
    against as f64 / (against + agreeing).max(1) as f64
}

/// The evidence of a keyframe for every vertex: 1 where it is seen at its position, −1 where it is seen through or outside of the outline.
fn evidence(track: &Track, keyframe: &Keyframe, spacing: f64) -> Vec<f64> {
    let lattice = track.body.lattice();
    let mut pose = keyframe.pose.clone();
    pose.extend(lattice);
    let posed = Posed::new(&track.model, &track.embeddings, lattice, &pose);
    let depth = &keyframe.view.depth;
    let eye = depth.eye();
    let of = |(at, normal)| {
        let hidden_by_arm = || {
            let holds =
                |a: &crate::cell::ArmState| behind_arm(at, &eye, &a.camera_from_tip, 3.0 * spacing);
            keyframe.arms.iter().any(holds)
        };
        match depth.behind(at) {
            Some(d) if -d > 1.5 * spacing => -1.0,
            Some(d) if d.abs() < 0.6 * spacing && facing(at, normal, &eye) > 0.3 => 1.0,
            None if !hidden_by_arm() && depth.nearest_seen(at, 0.012).is_none() => -1.0,
            _ => 0.0,
        }
    };
    posed.points.iter().zip(&posed.normals).map(of).collect()
}

/// Connected components of the surface.
struct Pieces {
    of: Vec<usize>,
    sizes: Vec<usize>,
}

fn pieces(track: &Track, spacing: f64) -> Pieces {
    let edges = graph::surface_edges(&track.model, spacing);
    let neighbours = graph::adjacency(track.model.len(), &edges);
    let mut of = vec![usize::MAX; track.model.len()];
    let mut sizes = Vec::new();
    for start in 0..of.len() {
        if of[start] != usize::MAX {
            continue;
        }
        let (mut stack, mut size) = (vec![start], 0);
        of[start] = sizes.len();
        while let Some(i) = stack.pop() {
            size += 1;
            for &j in &neighbours[i] {
                if of[j as usize] == usize::MAX {
                    of[j as usize] = sizes.len();
                    stack.push(j as usize);
                }
            }
        }
        sizes.push(size);
    }
    Pieces { of, sizes }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::cell::{ArmState, Observation};
    use crate::reconstruct::Reconstructor;
    use nalgebra::{Isometry3, Translation3, UnitQuaternion};

    const AXES: Vector3<f64> = Vector3::new(0.06, 0.045, 0.03);
    const TABLE: f64 = 0.5;

    /// What a camera at the origin sees of an ellipsoid that two arms have rolled along the table.
    fn seen(degrees: f64, held: bool) -> Observation {
        let angle = degrees.to_radians();
        let height = (AXES.z * angle.cos()).hypot(AXES.y * angle.sin());
        let pose = Isometry3::from_parts(
            Translation3::new(0.0, 0.0, TABLE - height),
            UnitQuaternion::from_axis_angle(&Vector3::x_axis(), angle),
        );
        let golden = std::f64::consts::PI * (3.0 - 5_f64.sqrt());
        let points = (0..6000).filter_map(|k| {
            let z = 1.0 - (2.0 * f64::from(k) + 1.0) / 6000.0;
            let (sin, cos) = (golden * f64::from(k)).sin_cos();
            let across = (1.0 - z * z).sqrt();
            let on_ball = Vector3::new(across * cos, across * sin, z);
            let normal = UnitVector3::new_normalize(pose * on_ball.component_div(&AXES));
            let point = pose * Point3::from(on_ball.component_mul(&AXES));
            (facing(&point, &normal, &Point3::origin()) > 0.1).then_some(point)
        });
        let arm = |side: f64| ArmState {
            camera_from_tip: pose * Isometry3::translation(side * 0.93 * AXES.x, 0.0, 0.0),
            jaw: if held { 0.0 } else { 0.8 },
            holding: held,
            moving: held,
        };
        Observation {
            stamp: 0.0,
            camera: None,
            points: points.collect(),
            colours: None,
            features: None,
            arms: vec![arm(1.0), arm(-1.0)],
        }
    }

    /// A body that was not where it was tracked in one keyframe: its surface must not be lost for it.
    #[test]
    fn a_keyframe_that_was_tracked_wrongly_is_dropped() {
        let table = Plane {
            normal: -Vector3::z_axis(),
            offset: TABLE,
        };
        let options = ReconstructOptions::new(0.005).with_keyframe_motion(0.004);
        let fused = |fault: bool| {
            let mut reconstructor = Reconstructor::new(options.clone()).unwrap();
            for frame in 0..40 {
                let turned = f64::from((frame - 6).clamp(0, 30));
                let observation = seen(2.0 * turned, frame >= 4);
                reconstructor.process(&observation, &table).unwrap();
            }
            let track = reconstructor.track.as_mut().unwrap();
            let before = track.keyframes.all().len();
            assert!(before >= 5, "{before} keyframes");
            if fault {
                for keyframe in track.keyframes.all_mut().iter_mut().skip(before - 2) {
                    for node in &mut keyframe.pose.live {
                        node.y += 0.02;
                    }
                }
            }
            refuse(track, &table, &options);
            let shares = track.keyframes.all().iter();
            let worst = shares
                .map(|keyframe| contradicts(&evidence(track, keyframe, options.spacing)))
                .fold(0.0, f64::max);
            assert!(worst < 0.05 * MISTRACKED, "{worst}");
            (before - track.keyframes.all().len(), track.model.len())
        };
        let (dropped, whole) = fused(false);
        assert_eq!(dropped, 0);
        let (dropped, kept) = fused(true);
        assert_eq!(dropped, 2);
        assert!(
            kept as f64 > 0.9 * whole as f64,
            "{kept} of {whole} vertices"
        );
    }
}
