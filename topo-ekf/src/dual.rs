//! Forces of the rows: a quadratic programme with bounds, solved without ever forming its matrix.
//!
//! ```text
//! min ½ λᵀ G λ − gᵀ λ   s.t. λ ≥ 0              G = A S⁻¹ Aᵀ + ς I,  g: gaps without forces
//! gradient q = Gλ − g;  free part φ: q where λ > 0;  chopped part β: min(q, 0) where λ = 0
//! ‖β‖ ≤ ‖φ‖:  conjugate gradients among the rows that push;  a step that would make forces negative is cut at zero
//! ‖β‖ > ‖φ‖:  a steepest descent step along β lets further rows push
//! ```
//!
//! This is the modified proportioning with gradient projections (Dostál, *Optimal Quadratic Programming Algorithms*, 2009, ch. 5),
//! with the projected conjugate gradient as expansion step: the cost falls in every step, so it cannot cycle where two
//! sheets watch each other and their rows nearly repeat. A product with `G` is one sparse solve however many rows there are, where
//! a dense `G` costs a solve per row. Among the pushing rows the steps are preconditioned by `A S Aᵀ`, the stiffness
//! that the rows feel with everything else held (lumped preconditioner of domain decomposition).

/// The programme; closures, because the system behind them needs its working memory.
pub(crate) struct Dual<'a> {
    /// Gaps without forces, m.
    pub gaps: &'a [f64],
    /// Softness `ς`: rows that repeat or contradict each other would make `G` singular.
    pub soft: f64,
    /// Gradient entries below this count as zero, m.
    pub tolerance: f64,
    /// Most products with `G`.
    pub allowance: usize,
}

/// Forces, and whether they are optimal within the tolerance.
pub(crate) struct Forces {
    pub values: Vec<f64>,
    pub settled: bool,
    pub products: usize,
}

impl Dual<'_> {
    /// Descends from the forces of `start`. `compliance` multiplies by `A S⁻¹ Aᵀ`, `stiffness` by the preconditioner.
    pub fn solve(
        &self,
        start: Vec<f64>,
        mut compliance: impl FnMut(&[f64]) -> Vec<f64>,
        stiffness: impl Fn(&[f64]) -> Vec<f64>,
    ) -> Forces {
        let mut products = 0;
        let mut multiply = |v: &[f64]| {
            products += 1;
            let mut product = compliance(v);
            for (p, v) in product.iter_mut().zip(v) {
                *p += self.soft * v;
            }
            (product, products)
        };
        let mut state = State::at(start, self.gaps, &mut multiply);
        // Direction and its product, while the set of pushing rows stands.
        let mut previous: Option<(Vec<f64>, Vec<f64>)> = None;
        while state.products < self.allowance && state.defect() > self.tolerance {
            let (free, chopped) = state.split();
            if dot(&chopped, &chopped) > dot(&free, &free) {
                state.step_along(&chopped, &mut multiply);
                previous = None;
                continue;
            }
            let mut direction = stiffness(&free);
            for (d, f) in direction.iter_mut().zip(&state.forces) {
                if *f <= 0.0 {
                    *d = 0.0;
                }
            }
            if let Some((p, gp)) = &previous {
                let share = dot(&direction, gp) / dot(p, gp);
                for (d, p) in direction.iter_mut().zip(p) {
                    *d -= share * p;
                }
            }
            previous = state.conjugate_step(direction, self.gaps, &mut multiply);
        }
        Forces {
            settled: state.defect() <= self.tolerance,
            values: state.forces,
            products: state.products,
        }
    }
}

struct State {
    forces: Vec<f64>,
    gradient: Vec<f64>,
    products: usize,
}

impl State {
    fn at(
        forces: Vec<f64>,
        gaps: &[f64],
        multiply: &mut impl FnMut(&[f64]) -> (Vec<f64>, usize),
    ) -> Self {
        let (mut gradient, products) = multiply(&forces);
        for (q, g) in gradient.iter_mut().zip(gaps) {
            *q -= g;
        }
        Self {
            forces,
            gradient,
            products,
        }
    }

    /// `½ λᵀGλ − gᵀλ = ½ λᵀ(q − g)`.
    fn cost(&self, gaps: &[f64]) -> f64 {
        let terms = self.forces.iter().zip(&self.gradient).zip(gaps);
        0.5 * terms.map(|((f, q), g)| f * (q - g)).sum::<f64>()
    }

    /// Largest gradient entry that a change of the forces could lower.
    fn defect(&self) -> f64 {
        let one = |(f, q): (&f64, &f64)| if *f > 0.0 { q.abs() } else { -q.min(0.0) };
        self.forces
            .iter()
            .zip(&self.gradient)
            .map(one)
            .fold(0.0, f64::max)
    }

    /// Free and chopped part of the gradient.
    fn split(&self) -> (Vec<f64>, Vec<f64>) {
        let pairs = || self.forces.iter().zip(&self.gradient);
        (
            pairs()
                .map(|(f, q)| if *f > 0.0 { *q } else { 0.0 })
                .collect(),
            pairs()
                .map(|(f, q)| if *f > 0.0 { 0.0 } else { q.min(0.0) })
                .collect(),
        )
    }

    /// Steepest descent along the chopped gradient: forces grow from zero.
    fn step_along(&mut self, d: &[f64], multiply: &mut impl FnMut(&[f64]) -> (Vec<f64>, usize)) {
        let (product, products) = multiply(d);
        self.products = products;
        let length = dot(&self.gradient, d) / dot(d, &product);
        self.advance(length, d, &product);
    }

    fn advance(&mut self, length: f64, d: &[f64], product: &[f64]) {
        for ((f, q), (d, p)) in self
            .forces
            .iter_mut()
            .zip(&mut self.gradient)
            .zip(d.iter().zip(product))
        {
            *f -= length * d;
            *q -= length * p;
        }
    }

    /// A conjugate gradient step; where it would make forces negative, the cut one. Returns what the next direction is
    /// made conjugate to, nothing after a cut.
    fn conjugate_step(
        &mut self,
        direction: Vec<f64>,
        gaps: &[f64],
        multiply: &mut impl FnMut(&[f64]) -> (Vec<f64>, usize),
    ) -> Option<(Vec<f64>, Vec<f64>)> {
        let (product, products) = multiply(&direction);
        self.products = products;
        let full = dot(&self.gradient, &direction) / dot(&direction, &product);
        let (room, first) = self.room(&direction);
        if full <= room {
            self.advance(full, &direction, &product);
            return Some((direction, product));
        }
        let cut: Vec<f64> = self
            .forces
            .iter()
            .zip(&direction)
            .map(|(f, d)| (f - full * d).max(0.0))
            .collect();
        let there = Self::at(cut, gaps, multiply);
        if there.cost(gaps) < self.cost(gaps) {
            *self = there;
        } else {
            // Only as far as the first force that vanishes: the cost falls all along the way.
            self.advance(room, &direction, &product);
            self.products = there.products;
            if let Some(first) = first {
                self.forces[first] = 0.0;
            }
            for f in &mut self.forces {
                *f = f.max(0.0);
            }
        }
        None
    }

    /// How far a step may go before the first force vanishes, and which that is.
    fn room(&self, direction: &[f64]) -> (f64, Option<usize>) {
        let mut nearest = (f64::INFINITY, None);
        for (k, (f, d)) in self.forces.iter().zip(direction).enumerate() {
            if *d > 0.0 && f / d < nearest.0 {
                nearest = (f / d, Some(k));
            }
        }
        nearest
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
