//! What a frame brings: measured vertices, planes that nothing passes, the surface for self-intersection.

use nalgebra::{Point3, UnitVector3};

use crate::Error;
use crate::graph::{check_vertex, usable_point};
use crate::options::usable_sigma;

/// A vertex measured at a position, with the same standard deviation in every direction.
///
/// Registered positions have a sigma of about half the spacing of the camera's points; a grip, whose place is known by
/// the arm's kinematics, a few tenths of a millimetre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// The vertex.
    pub vertex: u32,
    /// Where it was seen.
    pub position: Point3<f64>,
    /// Standard deviation of each coordinate, m.
    pub sigma: f64,
}

/// The half-space `normal · x + offset ≥ 0` that every vertex stays in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Unit normal, pointing to the free side.
    pub normal: UnitVector3<f64>,
    /// Distance of the origin from the plane, positive on the free side, m.
    pub offset: f64,
}

impl Plane {
    /// Height of a point over the plane.
    pub fn height(&self, p: &Point3<f64>) -> f64 {
        self.normal.dot(&p.coords) + self.offset
    }
}

/// Everything one step is given.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// Measured vertices; a vertex may be measured more than once.
    pub observations: &'a [Observation],
    /// Planes that no vertex passes: the table.
    pub planes: &'a [Plane],
    /// Triangles of the surface, for self-intersection; may be empty.
    pub triangles: &'a [[u32; 3]],
    /// Frame periods since the last step: scales the process noise. 1 when no frame was dropped.
    pub dt_frames: f64,
}

impl<'a> Frame<'a> {
    /// A frame with observations only, one period after the last.
    pub fn new(observations: &'a [Observation]) -> Self {
        Self {
            observations,
            planes: &[],
            triangles: &[],
            dt_frames: 1.0,
        }
    }

    /// Adds planes.
    #[must_use]
    pub fn with_planes(mut self, planes: &'a [Plane]) -> Self {
        self.planes = planes;
        self
    }

    /// Adds the triangles of the surface.
    #[must_use]
    pub fn with_triangles(mut self, triangles: &'a [[u32; 3]]) -> Self {
        self.triangles = triangles;
        self
    }

    /// Refuses anything that has no meaning for a filter of this many vertices.
    pub(crate) fn check(&self, vertices: usize) -> Result<(), Error> {
        for (index, o) in self.observations.iter().enumerate() {
            check_vertex("observation", index, o.vertex, vertices)?;
            if !usable_point(&o.position) {
                return Err(Error::NonFinitePoint {
                    what: "observation",
                    index,
                    value: o.position.coords.into(),
                });
            }
            if !usable_sigma(o.sigma) {
                let must = "between 1e-9 and 1e3";
                return Err(Error::Value {
                    what: "sigma of observation",
                    index,
                    value: o.sigma,
                    must,
                });
            }
        }
        for (index, p) in self.planes.iter().enumerate() {
            let unit = (p.normal.norm() - 1.0).abs() < 1e-6;
            if !unit || !p.offset.is_finite() {
                return Err(Error::Plane {
                    index,
                    normal: p.normal.into_inner().into(),
                    offset: p.offset,
                });
            }
        }
        for (index, t) in self.triangles.iter().enumerate() {
            for &vertex in t {
                check_vertex("triangle", index, vertex, vertices)?;
            }
        }
        if !(0.0..=1e6).contains(&self.dt_frames) {
            let must = "between 0 and 1e6";
            return Err(Error::Value {
                what: "dt_frames",
                index: 0,
                value: self.dt_frames,
                must,
            });
        }
        Ok(())
    }
}

/// The observations gathered by vertex: `r_i = Σ 1/σ²` and the weighted mean position.
pub(crate) struct Seen {
    /// `r_i`, zero for what is not seen.
    pub information: Vec<f64>,
    /// Weighted mean; the given default where nothing is seen.
    pub position: Vec<Point3<f64>>,
}

impl Seen {
    pub fn gather(observations: &[Observation], default: &[Point3<f64>]) -> Self {
        let mut information = vec![0.0; default.len()];
        let mut position = default.to_vec();
        for o in observations {
            let i = o.vertex as usize;
            let r = 1.0 / (o.sigma * o.sigma);
            // Running weighted mean; a first observation is taken as it is, without the rounding of a full step.
            position[i] = if information[i] > 0.0 {
                position[i] + (o.position - position[i]) * (r / (information[i] + r))
            } else {
                o.position
            };
            information[i] += r;
        }
        Self {
            information,
            position,
        }
    }
}
