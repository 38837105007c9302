//! Surfaces that more than one example samples, with how many points.

use cech_complex::manifolds::Manifold;

/// Round ones without rim or junction.
pub const ROUND: [(Manifold, usize); 3] = [
    (Manifold::Sphere { radius: 1.0 }, 800),
    (
        Manifold::Ellipsoid {
            axes: [1.0, 0.8, 0.6],
        },
        800,
    ),
    (
        Manifold::Torus {
            major: 1.0,
            minor: 0.4,
        },
        1000,
    ),
];
