//! Effect of grips on every vertex: the field they command, the remaining free motion, and the map of their coverage.
//!
//! With `C = K⁻¹`, `Φ` the rows of the identity at the grips and `G = ΦCΦᵀ`:
//!
//! ```text
//! field       u = C Φᵀ G⁻¹ v                  most probable motion if the grips move with v
//! projector   P = I − C Φᵀ G⁻¹ Φ = Z(ZᵀKZ)⁻¹ZᵀK     ΦP = 0,  P² = P,  rank P = n − g
//! map         1 − [Z(ZᵀKZ)⁻¹Zᵀ]_ii / C_ii  =  Σ_k (C w_k)_i² / C_ii      w_k orthonormal in G
//! ```
//!
//! `P` is the projection onto the null space of `Φ` along the commanded motions, orthogonal in the metric of `K`. The mean of the map
//! with weights `S_ii C_ii` is the coverage.

use nalgebra::{DMatrix, Vector3};

use crate::null_space::REPEATED;
use crate::{Coverage, Error};

impl Coverage {
    /// Velocity of every vertex if the grips move with the given velocities: the most probable field.
    /// With unit velocities these are the `J_i v̂` of [`crate::speed_limit`].
    ///
    /// # Errors
    /// A vertex that is not a candidate, or given twice.
    ///
    /// # Complexity
    /// `O(g³ + g n)`.
    ///
    /// ```
    /// # use grip_planner::nalgebra::{Point3, Vector3};
    /// # use grip_planner::{Coverage, CoverageOptions, Model, Plane, Stiffness};
    /// # let points = [0.0, 0.1, 0.2].map(|x| Point3::new(x, 0.0, 0.05));
    /// # let up = Vector3::z_axis();
    /// # let model = Model {
    /// #     points: &points,
    /// #     normals: &[up; 3],
    /// #     areas: &[1e-4; 3],
    /// #     edges: &[],
    /// #     boundary: &[false; 3],
    /// #     visible: &[true; 3],
    /// #     hidden: &[],
    /// # };
    /// # let table = Plane { normal: up, offset: 0.0 };
    /// // Vertices 0 and 1 are joined by a spring as stiff as their anchors; vertex 2 is apart.
    /// let mut stiffness = Stiffness::membrane(&model, &table, &CoverageOptions::default())?;
    /// let anchor = stiffness.anchors()[0];
    /// stiffness.couple([0, 1], anchor)?;
    ///
    /// // Pulled at vertex 0, vertex 1 moves half as far and vertex 2 stays.
    /// let coverage = Coverage::with_stiffness(&stiffness, &[1.0; 3], &[0])?;
    /// let field = coverage.field(&[(0, Vector3::x())])?;
    /// for (velocity, expected) in field.iter().zip([1.0, 0.5, 0.0]) {
    ///     assert!((velocity.x - expected).abs() < 1e-12);
    ///     assert!(velocity.y.abs() < 1e-12 && velocity.z.abs() < 1e-12);
    /// }
    /// # Ok::<(), grip_planner::Error>(())
    /// ```
    pub fn field(&self, grips: &[(u32, Vector3<f64>)]) -> Result<Vec<Vector3<f64>>, Error> {
        let vertices: Vec<u32> = grips.iter().map(|g| g.0).collect();
        let columns = self.distinct(&vertices)?;
        let velocity = DMatrix::from_fn(columns.len(), 3, |i, k| grips[i].1[k]);
        let multipliers = DMatrix::from_fn(columns.len(), columns.len(), |i, j| {
            self.gram[(columns[i], columns[j])]
        })
        .cholesky()
        .ok_or(Error::NotPositiveDefinite)?
        .solve(&velocity);
        let mut field = vec![Vector3::zeros(); self.size];
        for (k, &c) in columns.iter().enumerate() {
            let pull = Vector3::new(
                multipliers[(k, 0)],
                multipliers[(k, 1)],
                multipliers[(k, 2)],
            );
            for (u, &share) in field.iter_mut().zip(self.covariance(c)) {
                *u += pull * share;
            }
        }
        Ok(field)
    }

    /// The part of a motion of all vertices that remains if the grips are fixed: its projection `P u` onto the null space
    /// of the grips.
    ///
    /// # Errors
    /// A motion without exactly one entry for each vertex, a vertex that is not a candidate, or given twice.
    pub fn free_motion(
        &self,
        grips: &[u32],
        motion: &[Vector3<f64>],
    ) -> Result<Vec<Vector3<f64>>, Error> {
        if motion.len() != self.size {
            return Err(Error::LengthMismatch {
                what: "motions",
                count: motion.len(),
                points: self.size,
            });
        }
        self.distinct(grips)?;
        let held: Vec<_> = grips.iter().map(|&g| (g, motion[g as usize])).collect();
        let commanded = self.field(&held)?;
        Ok(motion.iter().zip(&commanded).map(|(u, c)| u - c).collect())
    }

    /// The share of each vertex's motion that the grips command, between 0 and 1, as a map of the coverage. Repeated grips are ignored.
    ///
    /// # Errors
    /// A vertex that is not a candidate.
    ///
    /// # Complexity
    /// `O(g² n)`.
    pub fn map(&self, grips: &[u32]) -> Result<Vec<f64>, Error> {
        let mut orthonormal: Vec<Vec<f64>> = Vec::with_capacity(grips.len());
        let mut map = vec![0.0; self.size];
        for &grip in grips {
            let mut own = self.covariance(self.column(grip)?).to_vec();
            for w in &orthonormal {
                // The entry at the grip itself is its product with w in the metric G.
                let overlap = w[grip as usize];
                own.iter_mut().zip(w).for_each(|(o, x)| *o -= overlap * x);
            }
            let left = own[grip as usize];
            if left <= REPEATED * self.variance[grip as usize] {
                continue;
            }
            let scale = 1.0 / left.sqrt();
            for x in &mut own {
                *x *= scale;
            }
            map.iter_mut().zip(&own).for_each(|(m, x)| *m += x * x);
            orthonormal.push(own);
        }
        for (m, c) in map.iter_mut().zip(&self.variance) {
            *m = (*m / c).clamp(0.0, 1.0);
        }
        Ok(map)
    }

    /// The column of the covariance of a candidate.
    fn covariance(&self, column: usize) -> &[f64] {
        &self.columns[column * self.size..(column + 1) * self.size]
    }

    fn distinct(&self, vertices: &[u32]) -> Result<Vec<usize>, Error> {
        let columns = vertices
            .iter()
            .map(|&v| self.column(v))
            .collect::<Result<Vec<_>, _>>()?;
        match (0..columns.len()).find(|&k| columns[..k].contains(&columns[k])) {
            Some(k) => Err(Error::RepeatedGrip {
                vertex: vertices[k],
            }),
            None => Ok(columns),
        }
    }
}
