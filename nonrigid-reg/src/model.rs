//! The source side of a registration: nodes, prior, shape functions and the structure of the equations.
//!
//! All of it depends on the source points and the positions of the landmarks, not on the target, so that a
//! [`Registrar`](crate::Registrar) which follows one model through many frames makes it once.

use gpwrm::ShapeFunctions;
use nalgebra::{Point3, UnitVector3, Vector3};

use crate::boxes::Boxes;
use crate::cloud::{Cloud, denoise};
use crate::each::each;
use crate::error::Error;
use crate::nodes::{Nodes, too_many};
use crate::options::Options;
use crate::prior::Prior;
use crate::system::Structure;

/// Number of nodes that influence a point.
const SHAPE_NODES: usize = 8;

/// The shape functions of a source point or feature: `u(p) = Σ φ_k u_k`.
pub(crate) type Shape = Vec<(usize, f64)>;

/// The source side of a registration.
pub(crate) struct Model {
    points: Vec<Point3<f64>>,
    normals: Vec<UnitVector3<f64>>,
    anchors: Vec<Point3<f64>>,
    spacing: f64,
    functions: ShapeFunctions,
    /// The source points with reduced noise across the surface: these are matched.
    pub clean: Vec<Point3<f64>>,
    pub nodes: Nodes,
    pub prior: Prior,
    pub shapes: Vec<Shape>,
    pub feature_shapes: Vec<Shape>,
    features: Vec<Point3<f64>>,
    pub structure: Structure,
}

impl Model {
    /// From checked input: `anchors` are the landmarks, `features` the source positions of the features.
    pub fn new(
        source: &Cloud,
        anchors: &[Point3<f64>],
        features: &[Point3<f64>],
        options: &Options,
    ) -> Result<Self, Error> {
        let points = source.points;
        let spacing = options.node_spacing;
        let nodes = Nodes::new(points, anchors.iter().copied(), spacing)?;
        let prior = Prior::new(&nodes, options.bending, options.strain * spacing * spacing);
        let boxes = Boxes::new(points);
        let functions = ShapeFunctions::new(&nodes.positions, SHAPE_NODES)
            .map_err(|_| Error::EmptyCloud { cloud: "source" })?;
        let shapes = shapes(&boxes, points, &functions);
        let feature_shapes: Vec<Shape> = features
            .iter()
            .map(|p| descending(functions.at(p)))
            .collect();
        let structure = structure(&nodes, &prior, &shapes, &feature_shapes)?;
        Ok(Self {
            clean: denoise(source, &boxes, options.denoise),
            points: points.to_vec(),
            normals: source.normals.to_vec(),
            anchors: anchors.to_vec(),
            spacing,
            functions,
            nodes,
            prior,
            shapes,
            feature_shapes,
            features: features.to_vec(),
            structure,
        })
    }

    /// Whether this is the model of this source.
    pub fn is_of(&self, source: &Cloud, anchors: &[Point3<f64>], options: &Options) -> bool {
        self.spacing.to_bits() == options.node_spacing.to_bits()
            && self.anchors == anchors
            && self.points == source.points
            && self.normals == source.normals
    }

    /// Replaces the features, which change while the source stays.
    pub fn set_features(&mut self, features: &[Point3<f64>]) -> Result<(), Error> {
        if self.features == features {
            return Ok(());
        }
        let shapes: Vec<Shape> = features
            .iter()
            .map(|p| descending(self.functions.at(p)))
            .collect();
        let known = shapes.iter().all(|shape| self.structure.holds(shape));
        if !known {
            self.structure = structure(&self.nodes, &self.prior, &self.shapes, &shapes)?;
        }
        self.feature_shapes = shapes;
        self.features = features.to_vec();
        Ok(())
    }

    /// `Φ u` of every source point.
    pub fn displacements(&self, u: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        self.shapes.iter().map(|shape| blend(shape, u)).collect()
    }
}

/// The shape functions of every point, box by box: the points of a box are in reach of nearly the same nodes.
fn shapes(boxes: &Boxes, points: &[Point3<f64>], functions: &ShapeFunctions) -> Vec<Shape> {
    let found = each(boxes.len(), |of| {
        let own = boxes.members(of).iter();
        let own: Vec<Point3<f64>> = own.map(|&i| points[i as usize]).collect();
        functions.at_each(&own)
    });
    let mut shapes = vec![Shape::new(); points.len()];
    for (of, found) in found.into_iter().enumerate() {
        for (&i, shape) in boxes.members(of).iter().zip(found) {
            shapes[i as usize] = descending(shape);
        }
    }
    shapes
}

fn structure(
    nodes: &Nodes,
    prior: &Prior,
    shapes: &[Shape],
    features: &[Shape],
) -> Result<Structure, Error> {
    let groups = shapes.iter().chain(features).map(Vec::as_slice);
    let structure = Structure::new(nodes.len(), groups, prior.terms());
    structure.ok_or_else(|| too_many(nodes.len(), &nodes.positions))
}

/// Sorts by descending index, so that every later node of a shape lies in the lower triangle.
fn descending(mut shape: Shape) -> Shape {
    shape.sort_unstable_by_key(|&(k, _)| std::cmp::Reverse(k));
    shape
}

pub(crate) fn blend(shape: &[(usize, f64)], u: &[Vector3<f64>]) -> Vector3<f64> {
    shape.iter().map(|&(k, phi)| phi * u[k]).sum()
}
