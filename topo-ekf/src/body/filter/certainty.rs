//! Uncertainty of the positions of embedded points after the last step: see `variance` for the algebra.

use nalgebra::Matrix3;

use super::BodyFilter;
use crate::Error;
use crate::body::elastic::{Acting, Elastic, Solved};
use crate::body::lattice::Embedding;
use crate::body::variance::{BodyObservability, covariances};

impl BodyFilter {
    /// Covariances, m², of embedded points under the information of the last step: elasticity, rows, grips, contact and expected positions,
    /// linearised with fixed rotations of the cells. Before the first step, and after pieces were separated or joined, they are those of a frame without data.
    ///
    /// # Errors
    /// Points in cells that did not exist in the last step.
    ///
    /// # Complexity
    /// Half a solve for each coordinate of the nodes around the points, a few cells at a time.
    ///
    /// ```
    /// use topo_ekf::body::{BodyFrame, Row};
    /// # use topo_ekf::Plane;
    /// # use topo_ekf::body::{BodyFilter, BodyOptions, Embedding, Lattice, Table};
    /// # use topo_ekf::nalgebra::{Point3, Rotation3, Vector3};
    /// # let mut lattice = Lattice::new(0.016, Point3::origin(), Rotation3::identity());
    /// # for x in 0..4 {
    /// #     lattice.ensure([x, 0, 0]);
    /// # }
    /// # let table = Plane { normal: Vector3::z_axis(), offset: 0.0 };
    /// # let mut body = BodyFilter::new(lattice, table, &BodyOptions::default().with_table(Table::Absent))?;
    /// // The height of one point is measured to 0.1 mm, and nothing else.
    /// let at = Embedding::new(0, [0.5, 0.5, 1.0]);
    /// let target = body.pose().position(body.lattice(), &at);
    /// let row = Row::along(at, target, Vector3::z_axis(), 1e8);
    /// body.step(&BodyFrame::new(&[], &[at]), &mut |_, _, _| vec![row], &mut |_, _| {})?;
    /// let covariance = body.covariances(&[at])?[0];
    /// assert!(covariance[(2, 2)] < 1.001e-8);
    /// assert!(covariance[(0, 0)] > 1e-6 && covariance[(1, 1)] > 1e-6); // more than a millimetre
    /// # Ok::<(), topo_ekf::Error>(())
    /// ```
    pub fn covariances(&self, points: &[Embedding]) -> Result<Vec<Matrix3<f64>>, Error> {
        let fresh;
        let (elastic, solved) = if let Some((elastic, solved)) = &self.last {
            (elastic, solved)
        } else {
            fresh = self.unseen()?;
            (&fresh.0, &fresh.1)
        };
        for (index, at) in points.iter().enumerate() {
            self.lattice.check_embedding("point", index, at)?;
            if at.cell as usize >= elastic.cells() {
                return Err(Error::CellOutOfRange {
                    what: "point",
                    index,
                    cell: at.cell,
                    cells: elastic.cells(),
                });
            }
        }
        covariances(elastic, solved, &self.lattice, points)
    }

    /// Standard deviations of embedded points, m: the root mean of the variances of the three coordinates in [`Self::covariances`].
    ///
    /// # Errors
    /// As [`Self::covariances`].
    pub fn marginal_sigmas(&self, points: &[Embedding]) -> Result<Vec<f64>, Error> {
        let covariances = self.covariances(points)?;
        Ok(covariances
            .iter()
            .map(|c| (c.trace() / 3.0).sqrt())
            .collect())
    }

    /// Which embedded points are known within `threshold` metres. Hidden points are determined by elasticity and expected positions, so every point has
    /// an estimate; this tells how accurate it is.
    ///
    /// # Errors
    /// As [`Self::covariances`]; a threshold that is not positive.
    ///
    /// ```
    /// use topo_ekf::body::{BodyFrame, Row};
    /// # use topo_ekf::Plane;
    /// # use topo_ekf::body::{BodyFilter, BodyOptions, Embedding, Lattice, Table};
    /// # use topo_ekf::nalgebra::{Point3, Rotation3, Vector3};
    /// # let mut lattice = Lattice::new(0.016, Point3::origin(), Rotation3::identity());
    /// # for x in 0..4 {
    /// #     lattice.ensure([x, 0, 0]);
    /// # }
    /// # let table = Plane { normal: Vector3::z_axis(), offset: 0.0 };
    /// # let mut body = BodyFilter::new(lattice, table, &BodyOptions::default().with_table(Table::Absent))?;
    /// // One end of a bar is measured to 0.1 mm; the other end may turn about it.
    /// let (end, other) = (Embedding::new(0, [0.0, 0.5, 0.5]), Embedding::new(3, [1.0, 0.5, 0.5]));
    /// let row = Row::point(end, body.pose().position(body.lattice(), &end), 1e8);
    /// body.step(&BodyFrame::new(&[], &[end, other]), &mut |_, _, _| vec![row], &mut |_, _| {})?;
    /// let found = body.observability(&[end, other], 1e-3)?;
    /// assert_eq!(found.determined, [true, false]);
    /// # Ok::<(), topo_ekf::Error>(())
    /// ```
    pub fn observability(
        &self,
        points: &[Embedding],
        threshold: f64,
    ) -> Result<BodyObservability, Error> {
        if !(threshold > 0.0 && threshold.is_finite()) {
            return Err(Error::Value {
                what: "threshold",
                index: 0,
                value: threshold,
                must: "positive and finite",
            });
        }
        let sigmas = self.marginal_sigmas(points)?;
        Ok(BodyObservability::new(sigmas, threshold))
    }

    /// Normal equations of the present body without observations and grips.
    fn unseen(&self) -> Result<(Elastic, Solved), Error> {
        let mut elastic = self.new_elastic()?;
        let acting = Acting {
            stiffness: self.options.stiffness,
            rows: &[],
            expected: &self.state.pose.live,
            expected_weight: self.options.motion_sigma.powi(-2),
            forces: &[],
        };
        let (solved, _) = elastic.assemble(&self.lattice, &self.state.pose, &acting)?;
        Ok((elastic, solved))
    }
}
