//! Motions of the whole space, each scaled by one number, so that truth is known on and off the surface.

use nalgebra::{Point3, Rotation3, Vector3};

/// Half the size of the objects, in m.
const HALF: f64 = 0.075;

/// How the object moves. Every motion also turns and shifts it a little.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// The long axis becomes an arc.
    Bend,
    /// A soft pull of 28 mm width on top.
    Pinch,
    /// About the long axis.
    Twist,
    /// Along the long axis, volume kept.
    Stretch,
    /// A hinge of 50 mm.
    Fold,
    /// Bent, pulled and turned at once.
    Combo,
    /// Nothing moves, not even a little.
    Rest,
}

impl Motion {
    /// Where `p` goes at amplitude `t`; 0 is rest.
    pub fn apply(self, p: &Point3<f64>, t: f64) -> Point3<f64> {
        let moved = match self {
            Self::Bend => curve(p, |x| t * x / HALF),
            Self::Pinch => pinch(p, t),
            Self::Twist => Rotation3::from_axis_angle(&Vector3::x_axis(), t * p.x / HALF) * p,
            Self::Stretch => {
                let across = (1.0 + t).powf(-0.5);
                Point3::new(p.x * (1.0 + t), p.y * across, p.z * across)
            }
            Self::Fold => curve(p, |x| {
                let s = ((x + 0.015) / 0.05).clamp(0.0, 1.0);
                t * s * s * (3.0 - 2.0 * s)
            }),
            Self::Combo => {
                let lifted = pinch(&curve(p, |x| 0.6 * t * x / HALF), 0.5 * t);
                Rotation3::from_scaled_axis(Vector3::new(0.2, 0.3, 0.5) * t) * lifted
            }
            Self::Rest => return *p,
        };
        let turn = Rotation3::from_scaled_axis(Vector3::new(0.05, 0.08, 0.12) * t);
        turn * moved + Vector3::new(0.004, -0.006, 0.005) * t
    }

    /// The amplitude at which the farthest of `points` moves by `size`, by bisection.
    pub fn amplitude(self, points: &[Point3<f64>], size: f64) -> f64 {
        let largest = |t: f64| {
            let moved = points.iter().map(|p| (self.apply(p, t) - p).norm());
            moved.fold(0.0, f64::max)
        };
        let (mut low, mut high) = (0.0, 1.2);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if largest(middle) < size {
                low = middle;
            } else {
                high = middle;
            }
        }
        low
    }
}

/// The x axis laid along the curve in the xz plane that has slope `angle(x)`; sections stay flat and normal to it.
fn curve(p: &Point3<f64>, angle: impl Fn(f64) -> f64) -> Point3<f64> {
    const STEPS: usize = 32;
    let h = p.x / STEPS as f64;
    let (mut x, mut z) = (0.0, 0.0);
    for k in 0..STEPS {
        let slope = angle((k as f64 + 0.5) * h);
        x += h * slope.cos();
        z += h * slope.sin();
    }
    let slope = angle(p.x);
    Point3::new(x - p.z * slope.sin(), p.y, z + p.z * slope.cos())
}

fn pinch(p: &Point3<f64>, t: f64) -> Point3<f64> {
    let near = (p - Point3::new(0.02, 0.01, 0.045)).norm_squared() / (2.0 * 0.028 * 0.028);
    p + Vector3::new(0.3, 0.2, 0.93) * (HALF * t * (-near).exp())
}
