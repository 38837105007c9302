//! The field over time: nodes keep where they stood at rest and where they stand now, and frames are composed at the nodes.
//!
//! ```text
//! y_i = x_i + u_i                          live position of node i
//! advance by motion v:    u_i ← u_i + v_i
//! f then g:               u_i ← u_i + g(y_i)          so that  (f then g)(x) = f(x) + g(x + f(x))  at every node
//! inverse:                nodes y_i, displacements −u_i
//! ```
//!
//! Composing at the nodes instead of chaining fields point by point keeps the cost of an evaluation the same after a thousand
//! frames, and makes the field a matter of where the nodes stand and not of the way they came: when they come home, so does all that lies
//! between them.

use nalgebra::{Point3, Vector3};

use crate::error::{Error, check_coordinates, check_length};
use crate::field::Field;

impl Field {
    /// Where the nodes stand now: `x_i + u_i`, in the order given.
    pub fn live_nodes(&self) -> Vec<Point3<f64>> {
        let moved = self.nodes().iter().zip(&self.displacements);
        moved.map(|(x, u)| x + u).collect()
    }

    /// The field from the same rest, after the nodes have moved on by `motion`, which is measured from where they stand now.
    ///
    /// # Errors
    /// `motion` of another length than the nodes, or not finite.
    ///
    /// ```
    /// use gpwrm::{Field, FieldOptions, nalgebra::{Point3, Vector3}};
    /// let nodes: Vec<_> = (0..25).map(|k| Point3::new(f64::from(k % 5), f64::from(k / 5), 0.0)).collect();
    /// let still = Field::new(&nodes, &[Vector3::zeros(); 25], &FieldOptions::default())?;
    /// let later = still.advance(&[Vector3::x(); 25])?.advance(&[Vector3::y(); 25])?;
    /// let p = Point3::new(2.2, 1.7, 0.4);
    /// assert!((later.displacement(&p) - Vector3::new(1.0, 1.0, 0.0)).norm() < 1e-12);
    /// # Ok::<(), gpwrm::Error>(())
    /// ```
    pub fn advance(&self, motion: &[Vector3<f64>]) -> Result<Self, Error> {
        check_length("motions", self.nodes().len(), motion.len())?;
        check_coordinates("motion", motion.iter())?;
        let total: Vec<Vector3<f64>> = self
            .displacements
            .iter()
            .zip(motion)
            .map(|(u, v)| u + v)
            .collect();
        Self::new(self.nodes(), &total, &self.options)
    }

    /// This field and then `next`, whose rest is where this one ends; the nodes are those of this field.
    ///
    /// # Errors
    /// A node moved beyond the coordinate bound.
    ///
    /// # Complexity
    /// One evaluation of `next` per node, and building a field.
    pub fn then(&self, next: &Self) -> Result<Self, Error> {
        self.advance(&next.displacements(&self.live_nodes()))
    }

    /// The field from live to rest: every node stands at `x + u` and moves by `−u`.
    ///
    /// The two are inverse to each other at the nodes to the accuracy of the fit and between them to that of interpolation; for rigid
    /// motions exactly.
    ///
    /// # Errors
    /// A node whose moved position exceeds the coordinate bound.
    pub fn inverse(&self) -> Result<Self, Error> {
        let back: Vec<Vector3<f64>> = self.displacements.iter().map(|u| -u).collect();
        Self::new(&self.live_nodes(), &back, &self.options)
    }
}
