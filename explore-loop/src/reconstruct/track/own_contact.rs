//! Self-contact: surface triangles are recomputed when the surface has changed, and contacts are constrained in every frame.

use super::Track;
use crate::canonical::surface::triangulate;
use topo_ekf::body::{BodyInequality, SelfContact};

/// The surface when it was last triangulated.
#[derive(Default, serde::Serialize, serde::Deserialize)]
pub(super) struct OwnContact {
    triangles: Vec<[u32; 3]>,
    /// Its number of vertices.
    vertices: usize,
    #[serde(skip)]
    contact: Option<SelfContact>,
}

impl OwnContact {
    /// Whether the triangles belong to a model with this number of vertices.
    pub fn is_of(&self, vertices: usize) -> bool {
        let corners = || self.triangles.iter().flatten();
        self.vertices <= vertices && corners().all(|k| (*k as usize) < self.vertices)
    }
}

impl Track {
    /// Triangulates the present surface.
    pub fn renew_contact(&mut self, spacing: f64) {
        let model = &self.model;
        self.own_contact = OwnContact {
            triangles: triangulate(model.rest(), model.rest_normals(), spacing),
            vertices: model.len(),
            contact: None,
        };
    }

    /// The constraints that keep the surface from passing through itself in the next frame.
    pub(super) fn own_contacts(&mut self, separation: Option<f64>) -> Vec<BodyInequality> {
        let own = &mut self.own_contact;
        let Some(separation) = separation else {
            return Vec::new();
        };
        if own.triangles.is_empty() {
            return Vec::new();
        }
        if own.contact.is_none() {
            let rest = &self.model.rest()[..own.vertices];
            own.contact = SelfContact::new(&own.triangles, rest, separation).ok();
        }
        let contact = own.contact.as_mut();
        let rows = contact.and_then(|c| c.inequalities(self.model.live(), &self.embeddings).ok());
        rows.unwrap_or_default()
    }
}
