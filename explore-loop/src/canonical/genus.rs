//! How many handles a closed surface has, and how many it may have.
//!
//! The Betti numbers of a closed orientable surface of genus `g` are `(1, 2g, 1)`, and its Euler number is `2 − 2g`. A ball has no handle, a ring
//! has one. What is explored is unknown, so any genus is accepted unless one is asked for; a fault of the reconstruction is told from a handle
//! of the object by three things:
//!
//! | fault | what tells it |
//! |---|---|
//! | a bridge or a tunnel of noise | it is narrow: handles shorter around than six spacings are cut from the mesh |
//! | pinholes, a second sheet | complex and mesh, which are drawn in different ways, do not count alike |
//! | two parts that touch | around the neck where they touch runs a crease ([`Handles::crease`]): a handle is smooth there; the mesh is parted there |

use serde::{Deserialize, Serialize};

/// Mean crease around a handle from which on it is a contact, rad: between the 10° of a ring and the 50° of round parts that touch.
pub const CONTACT: f64 = 0.5;

/// How many handles the surface is expected to have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Genus {
    /// As many as it turns out to have.
    #[default]
    Any,
    /// So many: 0 for a ball, 1 for a ring.
    Exactly(usize),
}

impl Genus {
    /// Whether a surface may have so many handles.
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

/// The handles of a drawn surface.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Handles {
    /// How many.
    pub count: usize,
    /// The largest mean angle, rad, by which the surface is folded inward along a loop around one of them; 0 without handles. Two round parts that touch
    /// make some 50°; around a handle the surface bends inward on one side and outward on the other.
    pub crease: f64,
}
