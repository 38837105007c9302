//! The input of a frame: measured vertices, planes that nothing may pass, the surface for self-contact.

use nalgebra::{Point3, UnitVector3, Vector3};

use crate::Error;
use crate::graph::{FARTHEST, check_vertex, usable_point};
use crate::options::usable_sigma;

/// A vertex measured at a position, with the same standard deviation in every direction.
///
/// Registered positions have a sigma of about half the spacing of the camera's points; a grip, whose position is known from
/// the arm's kinematics, a few tenths of a millimetre.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Observation {
    /// The vertex.
    pub vertex: u32,
    /// Its measured position.
    pub position: Point3<f64>,
    /// Standard deviation of each coordinate, m.
    pub sigma: f64,
}

/// The half-space `normal · x + offset ≥ 0` that every vertex stays in.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
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

/// A linear inequality of the caller, `Σ_v a_v · x_v ≥ bound`, over a few vertices.
///
/// Satisfied to 1e-6 times the largest `‖a_v‖`: with unit vectors, to a micrometre.
///
/// ```
/// use topo_ekf::{Filter, Frame, Inequality, Observation, Options, Status, nalgebra::{Point3, Vector3}};
/// # let rest: Vec<_> = (0..10).map(|k| Point3::new(0.005 * f64::from(k), 0.0, 0.0)).collect();
/// # let edges: Vec<_> = (1..10).map(|k| [k - 1, k]).collect();
/// // A chain of ten vertices, 5 mm apart.
/// let mut filter = Filter::new(&rest, &edges, &Options::default())?;
/// let seen: Vec<_> = (0..6).map(|k: u32| Observation { vertex: k, position: rest[k as usize], sigma: 5e-4 }).collect();
/// // The hidden end is at least 4 mm higher than the seen one: z₉ − z₀ ≥ 4 mm.
/// let own = [Inequality { terms: vec![(9, Vector3::z()), (0, -Vector3::z())], bound: 4e-3 }];
/// let report = filter.step(&Frame::new(&seen).with_inequalities(&own))?;
/// assert_eq!(report.status, Status::Constrained);
/// let higher = filter.live()[9].z - filter.live()[0].z;
/// assert!(higher > 4e-3 - 1e-6 && higher < 4.1e-3);
/// # Ok::<(), topo_ekf::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Inequality {
    /// Vertices with their coefficient vectors `a_v`; a vertex that occurs twice counts with the sum.
    pub terms: Vec<(u32, Vector3<f64>)>,
    /// Lower bound, metres times the unit of the coefficients.
    pub bound: f64,
}

/// The input of a step.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// Measured vertices; a vertex may be measured more than once.
    pub observations: &'a [Observation],
    /// Planes that no vertex may pass, such as the table.
    pub planes: &'a [Plane],
    /// Triangles of the surface, for self-contact; may be empty.
    pub triangles: &'a [[u32; 3]],
    /// Linear inequalities of the caller; may be empty.
    pub inequalities: &'a [Inequality],
    /// Frame periods since the last step, a factor on the process noise: 1 when no frame was dropped.
    pub dt_frames: f64,
}

impl<'a> Frame<'a> {
    /// A frame with observations only, one period after the last.
    pub fn new(observations: &'a [Observation]) -> Self {
        Self {
            observations,
            planes: &[],
            triangles: &[],
            inequalities: &[],
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
    ///
    /// ```
    /// use topo_ekf::{Filter, Frame, Observation, Options, nalgebra::{Point3, Vector3}};
    /// // A small triangle 2 mm above a large one.
    /// let rest = [[0.0, 0.0, 0.0], [0.02, 0.0, 0.0], [0.0, 0.02, 0.0], [0.004, 0.004, 0.002], [0.008, 0.004, 0.002], [0.004, 0.008, 0.002]].map(Point3::from);
    /// let edges = [[0, 1], [1, 2], [0, 2], [3, 4], [4, 5], [3, 5]];
    /// let mut filter = Filter::new(&rest, &edges, &Options::default())?;
    /// // It is measured 1 mm below the large one, through which it cannot have passed.
    /// let fall = |k: usize| Vector3::new(0.0, 0.0, if k < 3 { 0.0 } else { -0.003 });
    /// let seen: Vec<_> = (0..6).map(|k: usize| Observation { vertex: k as u32, position: rest[k] + fall(k), sigma: 5e-4 }).collect();
    /// let report = filter.step(&Frame::new(&seen).with_triangles(&[[0, 1, 2], [3, 4, 5]]))?;
    /// assert!(report.contact_depth[0] > 0.001 && report.contact_depth[1] <= 1e-6);
    /// assert!(filter.live()[3].z > filter.live()[0].z);
    /// # Ok::<(), topo_ekf::Error>(())
    /// ```
    #[must_use]
    pub fn with_triangles(mut self, triangles: &'a [[u32; 3]]) -> Self {
        self.triangles = triangles;
        self
    }

    /// Adds linear inequalities.
    #[must_use]
    pub fn with_inequalities(mut self, inequalities: &'a [Inequality]) -> Self {
        self.inequalities = inequalities;
        self
    }

    /// Sets the frame periods since the last step.
    #[must_use]
    pub fn with_dt_frames(mut self, dt_frames: f64) -> Self {
        self.dt_frames = dt_frames;
        self
    }

    /// Rejects input that is invalid for a filter with this many vertices.
    pub(crate) fn check(&self, vertices: usize) -> Result<(), Error> {
        for (index, o) in self.observations.iter().enumerate() {
            o.check(index, vertices)?;
        }
        for (index, p) in self.planes.iter().enumerate() {
            p.check(index)?;
        }
        for (index, row) in self.inequalities.iter().enumerate() {
            row.check(index, vertices)?;
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

impl Observation {
    fn check(&self, index: usize, vertices: usize) -> Result<(), Error> {
        check_vertex("observation", index, self.vertex, vertices)?;
        if !usable_point(&self.position) {
            return Err(Error::NonFinitePoint {
                what: "observation",
                index,
                value: self.position.coords.into(),
            });
        }
        if !usable_sigma(self.sigma) {
            let must = "between 1e-9 and 1e3";
            return Err(Error::Value {
                what: "sigma of observation",
                index,
                value: self.sigma,
                must,
            });
        }
        Ok(())
    }
}

impl Plane {
    fn check(&self, index: usize) -> Result<(), Error> {
        let unit = (self.normal.norm() - 1.0).abs() < 1e-6;
        // Written so that NaN is rejected too.
        if unit && self.offset.abs() <= FARTHEST {
            return Ok(());
        }
        Err(Error::Plane {
            index,
            normal: self.normal.into_inner().into(),
            offset: self.offset,
        })
    }
}

impl Inequality {
    fn check(&self, index: usize, vertices: usize) -> Result<(), Error> {
        check_inequality(index, &self.terms, self.bound, |&vertex| {
            check_vertex("inequality", index, vertex, vertices)
        })
    }

    /// `max ‖a_v‖`.
    pub(crate) fn largest(&self) -> f64 {
        largest(&self.terms)
    }
}

/// `max ‖a‖` over the coefficients of an inequality.
pub(crate) fn largest<T>(terms: &[(T, Vector3<f64>)]) -> f64 {
    terms.iter().map(|(_, a)| a.norm()).fold(0.0, f64::max)
}

/// Refuses an inequality with a term that `check_term` refuses, or with numbers that have no meaning.
pub(crate) fn check_inequality<T>(
    index: usize,
    terms: &[(T, Vector3<f64>)],
    bound: f64,
    check_term: impl Fn(&T) -> Result<(), Error>,
) -> Result<(), Error> {
    for (term, a) in terms {
        check_term(term)?;
        if !usable_point(&Point3::from(*a)) {
            return Err(Error::NonFinitePoint {
                what: "coefficient of inequality",
                index,
                value: (*a).into(),
            });
        }
    }
    let largest = largest(terms);
    if largest < 1e-9 {
        return Err(Error::Value {
            what: "largest coefficient of inequality",
            index,
            value: largest,
            must: "at least 1e-9",
        });
    }
    // A range, so that NaN is refused too.
    if !(-FARTHEST..=FARTHEST).contains(&bound) {
        return Err(Error::Value {
            what: "bound of inequality",
            index,
            value: bound,
            must: "finite, at most 1e9 in size",
        });
    }
    Ok(())
}

/// The observations gathered by vertex: `r_i = Σ 1/σ²` and the weighted mean position.
pub(crate) struct Seen {
    /// `r_i`, zero for vertices that are not seen.
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
            // Running weighted mean; a first observation is taken exactly, without the rounding of a full step.
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
