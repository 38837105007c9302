//! How the model becomes the surface that is written, measured and drawn.

use explore_loop::canonical::topology::Topology;
use explore_loop::canonical::{CanonicalModel, graph, surface};
use explore_loop::measure::{
    Comparison, MeasureError, Measurer, MeshMeasures, Sampling, Surface, compare,
};
use explore_loop::mesh::{self, Mesh, Property};
use explore_loop::nalgebra::{Point3, UnitVector3};
use explore_loop::reconstruct::RestSurface;
use explore_loop::report::html::{self, AgainstTruth};

/// The mesh that is written, measured and drawn.
///
/// Every vertex carries values from the nearest vertex of the model that faces the same way: `support`, the distance to it, m; `first_seen`, the frame
/// in which it was added to the model; `confidence`, 0 to 1, from how often it was seen and how near it is.
pub struct FinalMesh {
    pub further: Vec<(&'static str, Vec<f64>)>,
    pub vertices: Vec<Point3<f64>>,
    normals: Vec<UnitVector3<f64>>,
    pub triangles: Vec<[u32; 3]>,
    /// Red, green and blue of each vertex, where the camera has colours; grey where none is known.
    colours: Option<Vec<[u8; 3]>>,
}

/// Options with the unit and the frame in the header of every mesh.
pub fn in_metres() -> mesh::Options<'static> {
    mesh::Options::default().with_comment("metres, frame of the first observation")
}

/// A surface with its normals.
pub fn oriented(
    vertices: &[Point3<f64>],
    normals: &[UnitVector3<f64>],
    triangles: &[[u32; 3]],
) -> Result<Mesh, mesh::Error> {
    let normals = normals.iter().map(|n| n.into_inner()).collect();
    Mesh::new(vertices.to_vec())?
        .with_normals(normals)?
        .with_triangles(triangles.to_vec())
}

impl FinalMesh {
    /// The mesh in the form of the files.
    pub fn written(&self) -> Result<Mesh, mesh::Error> {
        let mut mesh = oriented(&self.vertices, &self.normals, &self.triangles)?;
        if let Some(colours) = &self.colours {
            mesh = mesh.with_colours(colours.clone())?;
        }
        self.further.iter().try_fold(mesh, |mesh, (name, values)| {
            mesh.with_property(Property::new(name, values.clone()))
        })
    }

    /// The surface of a model at rest by which its topology was judged; where there is none, a local triangulation of its vertices.
    pub fn of(model: &CanonicalModel, topology: &Topology, spacing: f64) -> Self {
        let mut mesh = Self::uncoloured(model, topology, spacing);
        let places = mesh.vertices.iter().zip(&mesh.normals);
        let colour = |(p, n): (&Point3<f64>, &UnitVector3<f64>)| {
            model.colours().at(p, n, spacing).unwrap_or([128; 3])
        };
        mesh.colours = (!model.colours().is_empty()).then(|| places.map(colour).collect());
        mesh
    }

    /// The surface that a reconstruction extracts itself.
    pub fn as_drawn(model: &CanonicalModel, own: RestSurface, spacing: f64) -> Self {
        let (nearest, distance) = nearest_facing(model, &own, spacing);
        Self {
            further: known(model, &nearest, &distance, spacing),
            vertices: own.vertices,
            normals: own.normals,
            triangles: own.triangles,
            colours: None,
        }
    }

    fn uncoloured(model: &CanonicalModel, topology: &Topology, spacing: f64) -> Self {
        match &topology.surface {
            Some(surface) => Self {
                further: known(model, &surface.nearest, &surface.distance, spacing),
                vertices: surface.vertices.clone(),
                normals: surface.normals.clone(),
                triangles: surface.triangles.clone(),
                colours: None,
            },
            None => Self {
                further: Vec::new(),
                vertices: model.rest().to_vec(),
                normals: model.rest_normals().to_vec(),
                triangles: surface::triangulate(model.rest(), model.rest_normals(), spacing),
                colours: None,
            },
        }
    }

    /// Measures the mesh against `points`, the observations it was fused from.
    pub fn measure(
        &self,
        points: &[Point3<f64>],
        spacing: f64,
        truth: Option<&Surface>,
    ) -> Result<MeshMeasures, MeasureError> {
        MeshMeasures::of(
            &self.vertices,
            &self.triangles,
            points,
            spacing,
            truth,
            Sampling::default(),
        )
    }

    /// The mesh as the report shows it, with the distance to the truth where that is known.
    pub fn page(&self, truth: Option<&Surface>) -> html::Mesh {
        let known = self.further.iter().map(|(name, values)| {
            let (name, unit, scale) = match *name {
                "support" => ("distance to the nearest measurement", "mm", 1e3),
                "first_seen" => ("first seen", "s", 1.0),
                name => (name, "", 1.0),
            };
            html::Quantity {
                name,
                unit,
                values: values.iter().map(|v| scale * v).collect(),
            }
        });
        let distance = |surface: &Surface| html::Quantity {
            name: "distance to the truth",
            unit: "mm",
            values: self
                .vertices
                .iter()
                .map(|v| 1e3 * surface.distance(v))
                .collect(),
        };
        let mut quantities: Vec<html::Quantity> = known.chain(truth.map(distance)).collect();
        // The quantity that readers look for first comes first.
        quantities.sort_by_key(|q| q.name != "first seen");
        html::Mesh {
            vertices: self.vertices.clone(),
            triangles: self.triangles.clone(),
            quantities,
            colours: self.colours.clone(),
        }
    }

    /// Compares the mesh and the points of the model with the truth.
    pub fn against(
        &self,
        measurer: Option<&Measurer>,
        model: &CanonicalModel,
        spacing: f64,
    ) -> AgainstTruth {
        let Some(measurer) = measurer else {
            return AgainstTruth::default();
        };
        // A mesh without an area is compared with nothing.
        let surface = Surface::new(&self.vertices, &self.triangles).ok();
        let compared = surface.map(|s| compare(&s, measurer.surface(), Sampling::default()));
        AgainstTruth {
            shape: Some(measurer.shape(model, spacing)),
            accuracy: compared.as_ref().map(Comparison::accuracy),
            completeness: compared.as_ref().map(Comparison::completeness),
        }
    }
}

/// For every vertex of a surface the nearest vertex of the model that does not face away from it, `u32::MAX` if there is none within four spacings, and
/// its distance.
fn nearest_facing(
    model: &CanonicalModel,
    surface: &RestSurface,
    spacing: f64,
) -> (Vec<u32>, Vec<f64>) {
    let tree = graph::tree(model.rest());
    let places = surface.vertices.iter().zip(&surface.normals);
    let found = places.map(|(p, n)| {
        let near = tree
            .as_ref()
            .map_or_else(Vec::new, |tree| graph::near(tree, p, 4.0 * spacing, 24));
        let facing = |(i, _): &(usize, f64)| model.rest_normals()[*i].dot(n) > 0.0;
        near.into_iter()
            .find(facing)
            .map_or((u32::MAX, f64::INFINITY), |(i, d)| (i as u32, d))
    });
    found.unzip()
}

/// Number of frames after which a vertex counts as well observed.
const OFTEN: f64 = 10.0;

/// The values of the vertices of the surface, from the model.
fn known(
    model: &CanonicalModel,
    nearest: &[u32],
    distance: &[f64],
    spacing: f64,
) -> Vec<(&'static str, Vec<f64>)> {
    let at = |v: &u32| (*v as usize) < model.len();
    let born = |v: &u32| {
        if at(v) {
            f64::from(model.born()[*v as usize])
        } else {
            f64::NAN
        }
    };
    let trust = |(v, distance): (&u32, &f64)| {
        if !at(v) {
            return 0.0;
        }
        let times = f64::from(model.times_seen()[*v as usize]);
        (times / (times + OFTEN)) * (-(distance / spacing).powi(2)).exp()
    };
    vec![
        ("support", distance.to_vec()),
        ("first_seen", nearest.iter().map(born).collect()),
        (
            "confidence",
            nearest.iter().zip(distance).map(trust).collect(),
        ),
    ]
}
