//! The linear system of one Newton step: all active pieces at one level, forces in balance.
//!
//! ```text
//! min_d  z + ½ dᵀHd   s.t.  g_j + ∇g_j·d = z  (j active)        a_j = ∇g_j − ∇g_0,  c_j = g_0 − g_j
//! ⇔  a_j·d = c_j,   H d + ∇g_0 + Σ λ_j a_j = 0,   λ_0 = 1 − Σ λ_j
//! ```
//!
//! With two, three or four active pieces, which is nearly always the case, the constraints leave a plane, a line or a point for `d`, and cross
//! products solve the system (null-space method). Nearly dependent constraints, and sets of one, five or six pieces, are solved by
//! elimination with a proximal shift of both diagonal blocks, which removes the singularities of parallel normals, repeated
//! pieces and flat optima and leaves the fixed point unchanged.

use nalgebra::{Matrix3, Vector3};

/// A non-degenerate optimum has at most four active pieces; two more allow a degenerate piece to enter before another leaves.
pub(crate) const MAX_ACTIVE: usize = 6;
/// Proximal shift of both blocks. Small enough not to slow Newton down, large enough for pivots well above rounding.
pub(crate) const PROXIMAL: f64 = 1e-12;
/// Squared sine below which constraint rows count as dependent: cross products then have lost half of their digits.
const DEPENDENT: f64 = 1e-8;

/// The system at one point: differences to the first active piece.
pub(crate) struct System<'a> {
    pub(crate) hessian: &'a Matrix3<f64>,
    /// Gradient of the first active piece.
    pub(crate) gradient: Vector3<f64>,
    /// `a_j` of the other active pieces.
    pub(crate) rows: [Vector3<f64>; MAX_ACTIVE - 1],
    /// `c_j`.
    pub(crate) gaps: [f64; MAX_ACTIVE - 1],
    /// Multipliers of the other active pieces at the last point, where the proximal term is centred.
    pub(crate) previous: [f64; MAX_ACTIVE - 1],
    /// Number of other active pieces.
    pub(crate) others: usize,
}

/// A step and the multipliers of the other active pieces.
pub(crate) type Solution = (Vector3<f64>, [f64; MAX_ACTIVE - 1]);

impl System<'_> {
    /// Solves it; `None` if it is singular in spite of the shifts.
    pub(crate) fn solve(&self) -> Option<Solution> {
        let direct = match self.others {
            1 => self.in_plane(),
            2 => self.on_line(),
            3 => self.at_point(),
            _ => None,
        };
        direct.or_else(|| self.eliminate())
    }

    /// The force at step `d` that the multipliers have to balance.
    fn force(&self, d: &Vector3<f64>) -> Vector3<f64> {
        -(self.gradient + self.hessian * d)
    }

    /// One constraint: a 2×2 system in its plane.
    fn in_plane(&self) -> Option<Solution> {
        let a = self.rows[0];
        let squared = a.norm_squared();
        let t = a.cross(&if a.x.abs() < a.y.abs() {
            Vector3::x()
        } else {
            Vector3::y()
        });
        let u = a.cross(&t);
        let particular = a * (self.gaps[0] / squared);
        let force = self.force(&particular);
        let (ht, hu) = (self.hessian * t, self.hessian * u);
        let (tt, tu, uu) = (t.dot(&ht), t.dot(&hu), u.dot(&hu));
        let determinant = tt * uu - tu * tu;
        let (ft, fu) = (t.dot(&force), u.dot(&force));
        // Also false for NaN, when the row is zero.
        let regular = determinant > DEPENDENT * tt * uu;
        if !regular {
            return None;
        }
        let along = (ft * uu - fu * tu) / determinant;
        let across = (fu * tt - ft * tu) / determinant;
        let step = particular + t * along + u * across;
        let mut multipliers = [0.0; MAX_ACTIVE - 1];
        multipliers[0] = a.dot(&self.force(&step)) / squared;
        Some((step, multipliers))
    }

    /// Two constraints: one unknown along their line.
    fn on_line(&self) -> Option<Solution> {
        let [a, b, ..] = self.rows;
        let line = a.cross(&b);
        let squared = line.norm_squared();
        let curvature = line.dot(&(self.hessian * line));
        let regular = squared > DEPENDENT * a.norm_squared() * b.norm_squared() && curvature > 0.0;
        if !regular {
            return None;
        }
        // Dual rows: `a·da = 1`, `b·da = 0`, and the other way round.
        let (da, db) = (b.cross(&line) / squared, line.cross(&a) / squared);
        let particular = da * self.gaps[0] + db * self.gaps[1];
        let step = particular + line * (line.dot(&self.force(&particular)) / curvature);
        let force = self.force(&step);
        let mut multipliers = [0.0; MAX_ACTIVE - 1];
        (multipliers[0], multipliers[1]) = (force.dot(&da), force.dot(&db));
        Some((step, multipliers))
    }

    /// Three constraints: they leave one point.
    fn at_point(&self) -> Option<Solution> {
        let [a, b, c, ..] = self.rows;
        let (bc, ca, ab) = (b.cross(&c), c.cross(&a), a.cross(&b));
        let determinant = a.dot(&bc);
        let squares = a.norm_squared() * b.norm_squared() * c.norm_squared();
        let regular = determinant * determinant > DEPENDENT * squares;
        if !regular {
            return None;
        }
        let (da, db, dc) = (bc / determinant, ca / determinant, ab / determinant);
        let step = da * self.gaps[0] + db * self.gaps[1] + dc * self.gaps[2];
        let force = self.force(&step);
        let mut multipliers = [0.0; MAX_ACTIVE - 1];
        multipliers[..3].copy_from_slice(&[force.dot(&da), force.dot(&db), force.dot(&dc)]);
        Some((step, multipliers))
    }

    /// Gaussian elimination on the shifted system.
    fn eliminate(&self) -> Option<Solution> {
        let size = 3 + self.others;
        let mut rows = [[0.0; UNKNOWNS + 1]; UNKNOWNS];
        for a in 0..3 {
            for b in 0..3 {
                rows[a][b] = self.hessian[(a, b)];
            }
            rows[a][UNKNOWNS] = -self.gradient[a];
        }
        for j in 0..self.others {
            let row = 3 + j;
            for a in 0..3 {
                rows[a][row] = self.rows[j][a];
                rows[row][a] = self.rows[j][a];
            }
            rows[row][row] = -PROXIMAL;
            rows[row][UNKNOWNS] = self.gaps[j] - PROXIMAL * self.previous[j];
        }
        let solution = eliminate(&mut rows, size)?;
        let mut multipliers = [0.0; MAX_ACTIVE - 1];
        multipliers[..self.others].copy_from_slice(&solution[3..size]);
        Some((
            Vector3::new(solution[0], solution[1], solution[2]),
            multipliers,
        ))
    }
}

/// Unknowns of the largest system: the step and all multipliers but the first.
const UNKNOWNS: usize = 3 + MAX_ACTIVE - 1;

/// Gaussian elimination with partial pivoting; the right-hand side is the last column.
fn eliminate(rows: &mut [[f64; UNKNOWNS + 1]; UNKNOWNS], size: usize) -> Option<[f64; UNKNOWNS]> {
    for column in 0..size {
        let mut pivot = column;
        for row in column + 1..size {
            if rows[row][column].abs() > rows[pivot][column].abs() {
                pivot = row;
            }
        }
        rows.swap(column, pivot);
        let top = rows[column];
        if top[column].abs() <= 1e-300 || top[column].is_nan() {
            return None;
        }
        let inverse = 1.0 / top[column];
        for row in &mut rows[column + 1..size] {
            let factor = row[column] * inverse;
            if factor != 0.0 {
                for c in column + 1..size {
                    row[c] -= factor * top[c];
                }
                row[UNKNOWNS] -= factor * top[UNKNOWNS];
            }
        }
    }
    let mut solution = [0.0; UNKNOWNS];
    for row in (0..size).rev() {
        let mut value = rows[row][UNKNOWNS];
        for c in row + 1..size {
            value -= rows[row][c] * solution[c];
        }
        solution[row] = value / rows[row][row];
    }
    Some(solution)
}
