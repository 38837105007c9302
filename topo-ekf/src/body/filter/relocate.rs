//! A body that was lost and has been found elsewhere.
//!
//! ```text
//! x ← R x + t,    Q_c ← R Q_c,    d ← 0
//! ```
//! with `(R, t)` the motion, `Q_c` the turns of the cells and `d` the displacement of the last frame.

use nalgebra::{Isometry3, Vector3};

use super::BodyFilter;

impl BodyFilter {
    /// Moves the deformed body by a rigid motion, at rest afterwards: it was lost and has been found elsewhere.
    ///
    /// ```
    /// # use topo_ekf::Plane;
    /// # use topo_ekf::body::{BodyFilter, BodyOptions, Embedding, Lattice};
    /// use topo_ekf::nalgebra::{Isometry3, Point3, Rotation3, Vector3};
    /// # let mut lattice = Lattice::new(0.016, Point3::origin(), Rotation3::identity());
    /// # for x in 0..4 {
    /// #     lattice.ensure([x, 0, 0]);
    /// # }
    /// # let table = Plane { normal: Vector3::z_axis(), offset: 0.0 };
    /// // A row of four cells.
    /// let mut body = BodyFilter::new(lattice, table, &BodyOptions::default())?;
    /// let at = Embedding::new(3, [0.5, 0.2, 1.0]);
    /// let lost = body.pose().position(body.lattice(), &at);
    /// let motion = Isometry3::new(Vector3::new(0.1, 0.0, 0.2), Vector3::new(0.0, 0.5, 1.0));
    /// body.relocate(&motion);
    /// let found = body.pose().position(body.lattice(), &at);
    /// assert!((found - motion * lost).norm() < 1e-12);
    /// assert!(body.energy() < 1e-9); // it was moved, not deformed
    /// # Ok::<(), topo_ekf::Error>(())
    /// ```
    pub fn relocate(&mut self, found_from_lost: &Isometry3<f64>) {
        let turn = found_from_lost.rotation.to_rotation_matrix();
        for place in &mut self.state.pose.live {
            *place = found_from_lost * *place;
        }
        for own in &mut self.state.pose.turns {
            *own = turn * *own;
        }
        self.state.displacement.fill(Vector3::zeros());
        self.state.raised.fill(Vector3::zeros());
        self.state.falling = 0;
        self.last = None;
    }
}
