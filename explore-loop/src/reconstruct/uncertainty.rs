//! Uncertainty of the present position of every vertex: standard deviations of the body filter, `σ = √(tr cov x / 3)`.

use super::Reconstructor;
use super::track::Track;
use topo_ekf::body::Embedding;

impl Reconstructor {
    /// Standard deviation of the present position of every vertex, m; infinite where the last frame does not determine it. `None` before the first frame.
    ///
    /// # Complexity
    /// That of [`topo_ekf::body::BodyFilter::marginal_sigmas`]: about as long as a frame.
    pub fn uncertainty(&self) -> Option<Vec<f64>> {
        self.track.as_ref().map(Track::sigmas)
    }
}

impl Track {
    /// Vertices that the last frame added may lie in cells that have no covariance yet.
    fn sigmas(&self) -> Vec<f64> {
        let unknown = vec![f64::INFINITY; self.embeddings.len()];
        let cells = match self.body.marginal_sigmas(&self.embeddings) {
            Ok(sigmas) => return sigmas,
            Err(topo_ekf::Error::CellOutOfRange { cells, .. }) => cells,
            Err(_) => return unknown,
        };
        let stepped: Vec<usize> = (0..self.embeddings.len())
            .filter(|&i| (self.embeddings[i].cell as usize) < cells)
            .collect();
        let places: Vec<Embedding> = stepped.iter().map(|&i| self.embeddings[i]).collect();
        let mut sigmas = unknown;
        for (i, sigma) in stepped
            .into_iter()
            .zip(self.body.marginal_sigmas(&places).unwrap_or_default())
        {
            sigmas[i] = sigma;
        }
        sigmas
    }
}
