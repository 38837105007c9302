#![allow(missing_docs, clippy::all, clippy::pedantic, clippy::print_stdout, clippy::unwrap_used)]
use gpwrm::{Field, FieldOptions, ShapeFunctions, Support};
use nalgebra::{Point3, Rotation3, Vector3};
fn main() {
    let mut s: u64 = 12345;
    let mut rnd = move || { s = s.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407); ((s >> 11) as f64) / (1u64 << 53) as f64 - 0.5 };
    let mut h: u64 = 0xcbf29ce484222325;
    let mut eat = |x: f64| { h ^= x.to_bits(); h = h.wrapping_mul(0x100000001b3); };
    let mut undet = 0;
    for case in 0..60 {
        let n = 40 + 5 * case;
        let nodes: Vec<Point3<f64>> = (0..n).map(|_| { let (x, y) = (0.1 * rnd(), 0.1 * rnd()); Point3::new(x, y, 0.5 + 4.0 * x * y + 0.0005 * rnd()) }).collect();
        let r = Rotation3::new(Vector3::new(2.0 * rnd(), 2.0 * rnd(), rnd()));
        let u: Vec<Vector3<f64>> = nodes.iter().map(|p| r * (p + Vector3::new(0.01 * (30.0 * p.y).sin(), 0.0, 3.0 * p.x * p.x)) - p + 0.0003 * Vector3::new(rnd(), rnd(), rnd())).collect();
        let support = match case % 3 { 0 => Support::Nearest(16), 1 => Support::Radius(0.04), _ => Support::Nearest(8) };
        let f = Field::new(&nodes, &u, &FieldOptions { support, shrinkage: if case % 2 == 0 { 0.003 } else { 0.01 }, ..Default::default() }).unwrap();
        let back = f.inverse().unwrap();
        for _ in 0..300 {
            let p = Point3::new(0.14 * rnd(), 0.14 * rnd(), 0.5 + 0.06 * rnd());
            for g in [&f, &back] {
                let e = g.evaluate(&p);
                if e.determinacy == gpwrm::Determinacy::Undetermined { undet += 1; }
                e.displacement.iter().chain(e.gradient.iter()).for_each(|&x| eat(x));
                g.displacement(&p).iter().for_each(|&x| eat(x));
            }
        }
        let sf = ShapeFunctions::new(&nodes, 8).unwrap();
        for _ in 0..50 { let p = Point3::new(0.1 * rnd(), 0.1 * rnd(), 0.5); sf.at(&p).iter().for_each(|x| eat(x.1)); }
    }
    println!("{h:016x} undetermined {undet}");
}
