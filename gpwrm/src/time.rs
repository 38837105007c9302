//! The field over time: nodes store their rest and live positions, and frames are composed at the nodes.
//!
//! ```text
//! y_i = x_i + u_i                          live position of node i
//! advance by motion v:    u_i ← u_i + v_i
//! f then g:               u_i ← u_i + g(y_i)          so that  (f then g)(x) = f(x) + g(x + f(x))  at every node
//! inverse:                nodes y_i, displacements −u_i
//! ```
//!
//! Composing at the nodes instead of chaining fields point by point keeps the cost of an evaluation constant over a thousand
//! frames, and makes the field independent of the path of the nodes: when they return to rest, so does everything between them.

use nalgebra::{Point3, Vector3};

use crate::error::{Error, check_coordinates, check_length};
use crate::field::{Field, Inherited};
use crate::options::Sample;

impl Field {
    /// The live positions of the nodes: `x_i + u_i`, in the given order.
    pub fn live_nodes(&self) -> Vec<Point3<f64>> {
        let moved = self.nodes().iter().zip(&self.displacements);
        moved.map(|(x, u)| x + u).collect()
    }

    /// The field from the same rest, after the nodes have moved by a further `motion`, relative to their live positions.
    ///
    /// # Errors
    /// `motion` with another length than the nodes, or not finite.
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
        let later = Self::new(self.nodes(), &total, &self.options)?;
        Ok(self.handing_on(later))
    }

    /// `later`, with the uncertainty of the nodes of this field.
    fn handing_on(&self, later: Self) -> Self {
        Self {
            inherited: self.inherited.clone(),
            ..later
        }
    }

    /// This field followed by `next`, whose rest is the live state of this one; the nodes are those of this field. Where `next` is undetermined
    /// or extrapolates, so does the result: a [`Sample`](crate::Sample) of it is as certain as the worse of the two.
    ///
    /// # Errors
    /// A node moved beyond the coordinate bound.
    ///
    /// # Complexity
    /// One evaluation of `next` per node, and building a field.
    ///
    /// ```
    /// use gpwrm::{Field, FieldOptions, nalgebra::{Point3, Vector3}};
    /// let sheet = |first: i32| -> Vec<Point3<f64>> {
    ///     (0..64).map(|k| Point3::new(f64::from(first + k % 8), f64::from(k / 8), 0.0)).collect()
    /// };
    /// let field = |first: i32| Field::new(&sheet(first), &[Vector3::x(); 64], &FieldOptions::default());
    /// // The second frame shows only the part from x = 4 on, which the first has moved to 5.
    /// let both = field(0)?.then(&field(5)?)?;
    /// let [seen, gone] = [6.0, 0.0].map(|x| both.evaluate(&Point3::new(x, 3.0, 0.0)));
    /// assert!(!seen.extrapolated && seen.extrapolation < 1e-9);
    /// assert!(gone.extrapolated && gone.extrapolation > 3.0);
    /// # Ok::<(), gpwrm::Error>(())
    /// ```
    pub fn then(&self, next: &Self) -> Result<Self, Error> {
        let live = self.live_nodes();
        let samples = next.evaluate_all(&live);
        let motion: Vec<Vector3<f64>> = samples.iter().map(|s| s.displacement).collect();
        let known = |(i, s): (usize, &Sample)| {
            let next = Inherited {
                determinacy: s.determinacy,
                extrapolation: s.extrapolation,
                extrapolated: s.extrapolated,
            };
            self.inherited
                .get(i)
                .unwrap_or(&Inherited::GIVEN)
                .and(&next)
        };
        Ok(Self {
            inherited: samples.iter().enumerate().map(known).collect(),
            ..self.advance(&motion)?
        })
    }

    /// The field from live to rest: every node is at `x + u` and moves by `−u`.
    ///
    /// The two are inverse to each other at the nodes to the accuracy of the fit, and between them to that of interpolation; exactly
    /// for rigid motions.
    ///
    /// # Errors
    /// A node whose moved position exceeds the coordinate bound.
    pub fn inverse(&self) -> Result<Self, Error> {
        let back: Vec<Vector3<f64>> = self.displacements.iter().map(|u| -u).collect();
        let inverse = Self::new(&self.live_nodes(), &back, &self.options)?;
        Ok(self.handing_on(inverse))
    }
}
