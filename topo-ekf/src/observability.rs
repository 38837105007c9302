//! What the last frame determines.
//!
//! ```text
//! structural   rank(HᵀR⁻¹H + w L) = Q − (components without a seen vertex)
//! graded       vertex i is determined within τ  ⇔  (Λ⁻¹)_ii ≤ τ²
//! ```
//! The structural statement is exact for any positive weights and costs a union-find; it tells which vertices have an estimate at all. The graded one
//! tells how accurate it is. (The rank of the observability matrix with the neighbour-coupled dynamics tells neither: on symmetric graphs it
//! misses antisymmetric modes, and its singular values fall off exponentially with the distance.)

/// Which vertices the last frame and the shape prior determine together.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Observability {
    /// Whether the vertex was measured in the last step.
    pub seen: Vec<bool>,
    /// Whether the vertex is connected with a measured one, so that its position is determined.
    pub determined: Vec<bool>,
    /// Number of determined directions divided by three: vertices minus components without observations.
    pub rank: usize,
    /// Connected components of the graph.
    pub components: usize,
    /// Components without a measured vertex.
    pub blind_components: usize,
}

impl Observability {
    pub(crate) fn new(seen: &[bool], component: &[u32], components: usize) -> Self {
        let mut lit = vec![false; components];
        for (&s, &c) in seen.iter().zip(component) {
            lit[c as usize] |= s;
        }
        let blind_components = lit.iter().filter(|l| !**l).count();
        Self {
            seen: seen.to_vec(),
            determined: component.iter().map(|&c| lit[c as usize]).collect(),
            rank: seen.len() - blind_components,
            components,
            blind_components,
        }
    }
}
