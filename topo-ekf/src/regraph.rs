//! Changes of the graph of a running filter: vertices added, removed, or joined differently.

use nalgebra::{Point3, Rotation3};

use crate::Error;
use crate::contact::Surface;
use crate::filter::Filter;
use crate::graph::{Graph, check_points, check_vertex};
use crate::problem::Warm;
use crate::rotation::clean;
use crate::shape_prior::fit_rotations;
use crate::system::System;

impl Filter {
    /// Replaces the graph: vertices added, removed, joined differently, or with other rest positions.
    ///
    /// `keep[i]` is the old vertex that new vertex `i` continues; it inherits the information and, unless given in `rotations`,
    /// the rotation. Other vertices get [`Options::initial_sigma`](crate::Options::initial_sigma) and the rotation that fits their edges.
    ///
    /// # Errors
    /// Lists of different lengths, invalid points or rotations, indices out of range; the filter is then unchanged.
    ///
    /// # Complexity
    /// As [`Filter::new`].
    ///
    /// ```
    /// use topo_ekf::{Filter, Frame, Observation, Options, nalgebra::Point3};
    /// let rest: Vec<_> = (0..4).map(|k| Point3::new(0.005 * f64::from(k), 0.0, 0.0)).collect();
    /// let mut filter = Filter::new(&rest[..3], &[[0, 1], [1, 2]], &Options::default())?;
    /// let seen = |k: u32| Observation { vertex: k, position: rest[k as usize], sigma: 5e-4 };
    /// filter.step(&Frame::new(&[seen(0), seen(1), seen(2)]))?;
    /// let known = filter.information()[2];
    /// // A fourth vertex is found at the end: the others keep what is known of them.
    /// filter.set_graph(&rest, &rest, None, &[[0, 1], [1, 2], [2, 3]], &[Some(0), Some(1), Some(2), None])?;
    /// assert_eq!(filter.information()[2], known);
    /// assert!(filter.live().len() == 4 && filter.information()[3] < known);
    /// # Ok::<(), topo_ekf::Error>(())
    /// ```
    pub fn set_graph(
        &mut self,
        rest: &[Point3<f64>],
        live: &[Point3<f64>],
        rotations: Option<&[Rotation3<f64>]>,
        edges: &[[u32; 2]],
        keep: &[Option<u32>],
    ) -> Result<(), Error> {
        let graph = Graph::new(rest, edges)?;
        let expected = rest.len();
        for (what, found) in [
            ("live", live.len()),
            ("keep", keep.len()),
            (
                "rotations",
                rotations.map_or(expected, <[Rotation3<f64>]>::len),
            ),
        ] {
            if found != expected {
                return Err(Error::Length {
                    what,
                    found,
                    expected,
                });
            }
        }
        check_points("live", live)?;
        for (index, old) in keep.iter().enumerate() {
            if let &Some(old) = old {
                check_vertex("keep", index, old, self.rest.len())?;
            }
        }
        let rotations = match rotations {
            Some(given) => checked_rotations(given)?,
            None => self.continued_rotations(&graph, live, keep),
        };
        let system = System::new(rest, edges)?;
        let new = self.options.initial_sigma.powi(-2);
        self.information = keep
            .iter()
            .map(|k| k.map_or(new, |k| self.information[k as usize]))
            .collect();
        self.seen = keep
            .iter()
            .map(|k| k.is_some_and(|k| self.seen[k as usize]))
            .collect();
        // Active sets are only a warm start of the next projection, so dropping them is safe.
        self.warm = Warm::default();
        self.surface = Surface::default();
        self.last = None;
        // The evidence of a kept vertex keeps its offset from the live position.
        self.evidence = keep
            .iter()
            .zip(live)
            .map(|(k, p)| {
                k.map_or(*p, |k| {
                    p + (self.evidence[k as usize] - self.live[k as usize])
                })
            })
            .collect();
        self.estimate = live.to_vec();
        self.rest = rest.to_vec();
        self.live = live.to_vec();
        self.rotations = rotations;
        self.graph = graph;
        self.system = system;
        Ok(())
    }

    /// Rotations of kept vertices; new ones start from the mean of their kept neighbours, which is also the prior of a fit.
    fn continued_rotations(
        &self,
        graph: &Graph,
        live: &[Point3<f64>],
        keep: &[Option<u32>],
    ) -> Vec<Rotation3<f64>> {
        let mut known: Vec<Option<Rotation3<f64>>> = keep
            .iter()
            .map(|k| k.map(|k| self.rotations[k as usize]))
            .collect();
        let weights = vec![1.0; graph.edges.len()];
        // Outward from the kept vertices, ring by ring; vertices that are never reached start unrotated.
        loop {
            let mut sums = vec![None; live.len()];
            for &[i, j] in &graph.edges {
                for (to, from) in [(i as usize, j as usize), (j as usize, i as usize)] {
                    if let (None, Some(r)) = (known[to], known[from]) {
                        *sums[to].get_or_insert_with(nalgebra::Matrix3::zeros) += r.matrix();
                    }
                }
            }
            let mut spread = false;
            for (k, sum) in known.iter_mut().zip(sums) {
                if let Some(sum) = sum {
                    *k = Some(crate::rotation::nearest_rotation(
                        &sum,
                        &Rotation3::identity(),
                    ));
                    spread = true;
                }
            }
            if !spread {
                break;
            }
        }
        let guess: Vec<_> = known.into_iter().map(Option::unwrap_or_default).collect();
        let fitted = fit_rotations(
            graph,
            &weights,
            live,
            &guess,
            &guess,
            self.options.rotation_memory,
        );
        keep.iter()
            .zip(guess)
            .zip(fitted)
            .map(|((k, g), f)| if k.is_some() { g } else { clean(&f) })
            .collect()
    }
}

fn checked_rotations(given: &[Rotation3<f64>]) -> Result<Vec<Rotation3<f64>>, Error> {
    for (index, r) in given.iter().enumerate() {
        let defect = (r.matrix().tr_mul(r.matrix()) - nalgebra::Matrix3::identity()).norm();
        // Written so that NaN is rejected too.
        if !(defect < 1e-6 && r.matrix().determinant() > 0.0) {
            return Err(Error::NotARotation { index });
        }
    }
    Ok(given.iter().map(clean).collect())
}
