//! Constraints on the pose: no point of the surface and no foot below the table, and the inequalities of the frame.
//!
//! The algebra is in `project`; here the constraints are converted to rows, and the result to the report.

use nalgebra::{Matrix3, Vector3};

use super::{BodyFilter, Setting};
use crate::body::elastic::{Elastic, Solved};
use crate::body::frame::{BodyFrame, BodyReport};
use crate::body::lattice::Embedding;
use crate::body::options::Table;
use crate::body::project::{DEPTH, FEASIBLE, Half, deepest, project, shift};
use crate::body::row::BodyInequality;
use crate::{Error, Status};

impl BodyFilter {
    /// Moves the body to the nearest pose that satisfies the constraints of the frame, in the metric of the elastic energy, for use after surface was
    /// added since the last [`Self::step`]. Nothing else changes: no time passes.
    ///
    /// # Errors
    /// As [`Self::step`].
    ///
    /// # Complexity
    /// One step and one projection.
    ///
    /// ```
    /// use topo_ekf::Status;
    /// use topo_ekf::body::{BodyFrame, BodyInequality};
    /// # use topo_ekf::Plane;
    /// # use topo_ekf::body::{BodyFilter, BodyOptions, Embedding, Lattice};
    /// # use topo_ekf::nalgebra::{Point3, Rotation3, Vector3};
    /// # let mut lattice = Lattice::new(0.016, Point3::origin(), Rotation3::identity());
    /// # for x in 0..4 {
    /// #     lattice.ensure([x, 0, 0]);
    /// # }
    /// # let table = Plane { normal: Vector3::z_axis(), offset: 0.0 };
    /// # let mut body = BodyFilter::new(lattice, table, &BodyOptions::default())?;
    /// // A point on the upper face of a body at rest has to be 2 mm higher.
    /// let at = Embedding::new(3, [0.5, 0.5, 1.0]);
    /// let higher = body.pose().position(body.lattice(), &at).z + 0.002;
    /// let own = [BodyInequality { terms: vec![(at, Vector3::z())], bound: higher }];
    /// let report = body.project(&BodyFrame::new(&[], &[]).with_inequalities(&own))?;
    /// assert_eq!(report.status, Status::Constrained);
    /// assert!((body.pose().position(body.lattice(), &at).z - higher).abs() < 2e-6);
    /// # Ok::<(), topo_ekf::Error>(())
    /// ```
    pub fn project(&mut self, frame: &BodyFrame<'_>) -> Result<BodyReport, Error> {
        self.check(frame)?;
        let before = self.state.clone();
        let setting = Setting {
            frame,
            before: &before.pose.live,
            expected: &before.pose.live,
            expected_weight: self.options.motion_sigma.powi(-2),
        };
        self.all_or_nothing(|body, elastic| {
            // One step, for its normal equations only.
            let (_, solved) = body.advance(elastic, &setting, Vec::new(), 1.0)?;
            body.state.pose = before.pose.clone();
            let mut report = BodyReport {
                solves: 1,
                ..BodyReport::default()
            };
            body.constrain(elastic, &solved, frame, &mut report)?;
            body.state.raised.clone_from(&before.raised);
            let moved = body.state.pose.live.iter().zip(&before.pose.live);
            let sum: f64 = moved.map(|(now, then)| (now - then).norm()).sum();
            report.moved = sum / before.pose.live.len() as f64;
            Ok((report, solved))
        })
    }

    /// Projects the pose onto the constraints.
    pub(super) fn constrain(
        &mut self,
        elastic: &mut Elastic,
        solved: &Solved,
        frame: &BodyFrame<'_>,
        report: &mut BodyReport,
    ) -> Result<(), Error> {
        let contact = self.options.contact_sigma.powi(-2);
        let halves = self.halves(frame, elastic.frame());
        let pressed = self.touching(frame).map(|at| {
            let here = self.state.pose.position(&self.lattice, at);
            (-self.table.height(&here)).max(0.0)
        });
        let borne = contact * pressed.sum::<f64>();
        let table = self.options.table != Table::Absent;
        report.table_force = if table { borne } else { 0.0 };
        let pose = &self.state.pose;
        let held = self.grip_rows(frame.grips, pose);
        let pulls =
            held.map(|row| (row.target - pose.position(&self.lattice, &row.at)) * row.weight);
        report.grip_force = pulls.sum();
        report.violation = [deepest(&halves); 2];
        self.state.raised.fill(Vector3::zeros());
        if report.violation[0] <= DEPTH {
            return Ok(());
        }
        let projected = project(elastic, solved, &halves)?;
        let before = self.state.pose.live.clone();
        shift(&mut self.state.pose.live, &projected.moves, elastic.frame());
        self.state.pose.fit_turns(&self.lattice);
        let moved = self.state.pose.live.iter().zip(&before);
        self.state.raised = moved.map(|(now, then)| now - then).collect();
        report.pushing = projected.pushing;
        report.violation[1] = deepest(&self.halves(frame, elastic.frame()));
        report.status = if report.violation[1] <= FEASIBLE {
            Status::Constrained
        } else {
            Status::Infeasible
        };
        Ok(())
    }

    /// Every constraint as a row.
    fn halves(&self, frame: &BodyFrame<'_>, unknowns: &Matrix3<f64>) -> Vec<Half> {
        let (lattice, pose) = (&self.lattice, &self.state.pose);
        let kept_up = self.options.table == Table::Constraint;
        let above = self.touching(frame).filter(|_| kept_up);
        let above = above.map(|at| Half::above(lattice, pose, at, &self.table));
        let own = (0u32..).zip(frame.inequalities);
        let own = own.map(|(k, row): (u32, &BodyInequality)| {
            Half::of(lattice, pose, row, unknowns, u32::MAX - k)
        });
        above.chain(own).collect()
    }

    /// Points that the table supports.
    pub(super) fn touching<'a>(
        &'a self,
        frame: &'a BodyFrame<'_>,
    ) -> impl Iterator<Item = &'a Embedding> {
        frame.surface.iter().chain(self.feet.iter().map(|f| &f.at))
    }
}
