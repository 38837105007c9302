//! Why a surface does not count as closed, and the message for it.

use nalgebra::Point3;

/// What keeps a surface from counting as closed.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum Obstacle {
    /// Its persistent Betti numbers are not those of a closed surface, or not of the requested genus.
    Betti([usize; 3]),
    /// The complex and the closed surface have different numbers of handles.
    Handles {
        /// Handles of the complex.
        complex: usize,
        /// Handles of the surface.
        mesh: usize,
    },
    /// Two touching parts were not separated: the surface is creased by this angle, rad, around the neck between them.
    Contact(f64),
    /// A part of it was never seen.
    Bare {
        /// Share of the area.
        share: f64,
        /// Greatest distance of this part from the seen surface, m.
        farthest: f64,
    },
    /// This share of the points lies off it.
    Strays(f64),
    /// This share of it lies on a boundary.
    Boundary(f64),
    /// This share of vector area is missing.
    Missing(f64),
}

/// Two parts that touch and were never seen apart. The surface joins them: whether they are separate is not known.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct Touching {
    /// The middle of the neck between them at rest, camera frame, metres.
    pub at: Point3<f64>,
    /// Mean angle by which the surface is creased around it, rad.
    pub crease: f64,
}

impl std::fmt::Display for Touching {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "parts that touch around {:.3} {:.3} {:.3} m at rest were never seen apart: the surface joins them, with a crease of {:.0}°",
            self.at.x,
            self.at.y,
            self.at.z,
            self.crease.to_degrees()
        )
    }
}

impl std::fmt::Display for Obstacle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let percent = |share: f64| 100.0 * share;
        match self {
            Self::Betti([b0, b1, b2]) => write!(f, "Betti numbers ({b0}, {b1}, {b2})"),
            Self::Handles { complex, mesh } => write!(
                f,
                "the complex of the points has {complex} handles, but the surface through them {mesh}"
            ),
            Self::Contact(angle) => write!(
                f,
                "touching parts were not seen apart: there is a crease of {:.0}° around a handle",
                angle.to_degrees()
            ),
            Self::Bare { share, farthest } => write!(
                f,
                "{:.2} % never seen, up to {:.1} mm from the seen part",
                percent(*share),
                1e3 * farthest
            ),
            Self::Strays(share) => {
                write!(f, "{:.1} % of the points off the surface", percent(*share))
            }
            Self::Boundary(share) => write!(f, "{:.1} % on a boundary", percent(*share)),
            Self::Missing(share) => write!(f, "{:.1} % of vector area missing", percent(*share)),
        }
    }
}
