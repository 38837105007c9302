//! How many handles a closed surface has, and how many it may have.
//!
//! The Betti numbers of a closed orientable surface of genus `g` are `(1, 2g, 1)`, and its Euler number is `2 − 2g`. A ball has no handle, a ring
//! has one. The object is unknown, so any genus is accepted unless one is requested; faults of the reconstruction are told from real handles as follows:
//!
//! | fault | criterion |
//! |---|---|
//! | a bridge or a tunnel of noise | it is narrow: handles shorter around than six spacings are cut from the mesh |
//! | pinholes, a second sheet | the complex and the mesh, which are computed in different ways, have different numbers of handles |
//! | two parts that touch | the neck where they touch has a crease ([`Handles::crease`]), whereas a real handle is smooth: the mesh is separated there |

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Least mean crease around a contact, rad: between the 10° of a ring and the 50° of round parts that touch.
pub const CONTACT: f64 = 0.5;

/// How many handles the surface is expected to have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Genus {
    /// Any number.
    #[default]
    Any,
    /// This number: 0 for a ball, 1 for a ring.
    Exactly(usize),
}

impl Genus {
    /// Whether a surface may have this number of handles.
    pub fn allows(self, handles: usize) -> bool {
        match self {
            Self::Any => true,
            Self::Exactly(expected) => handles == expected,
        }
    }

    /// The genus of the closed orientable surface with these Betti numbers, if there is one.
    pub fn of_betti([b0, b1, b2]: [usize; 3]) -> Option<usize> {
        ([b0, b2] == [1, 1] && b1.is_multiple_of(2)).then_some(b1 / 2)
    }
}

impl std::fmt::Display for Genus {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Any => write!(f, "any genus"),
            Self::Exactly(genus) => write!(f, "genus {genus}"),
        }
    }
}

/// The handles of the closed surface.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct Handles {
    /// Their number.
    pub count: usize,
    /// The largest mean angle, rad, by which the surface is folded inward along a loop around one of them; 0 without handles. Two round parts that touch
    /// give about 50°; around a real handle the surface bends inward on one side and outward on the other.
    pub crease: f64,
    /// That loop at rest, m, in order; empty without handles.
    pub creased_along: Vec<Point3<f64>>,
}

impl Handles {
    /// The middle of the most creased loop at rest, m; `None` without handles.
    pub fn creased_at(&self) -> Option<Point3<f64>> {
        let sum: Vector3<f64> = self.creased_along.iter().map(|p| p.coords).sum();
        let count = self.creased_along.len();
        (count > 0).then(|| Point3::from(sum / count as f64))
    }

    /// Vector area of that loop at rest, m²; it points from one part to the other where two parts touch.
    pub fn creased_area(&self) -> Vector3<f64> {
        let along = &self.creased_along;
        let next = along.iter().cycle().skip(1);
        let twice: Vector3<f64> = along
            .iter()
            .zip(next)
            .map(|(p, q)| p.coords.cross(&q.coords))
            .sum();
        twice / 2.0
    }
}
