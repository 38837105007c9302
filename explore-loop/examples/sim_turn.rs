//! Two arms take the liver by one long side and turn it over.
//!
//! `cargo run --release --example sim_turn -- [SEED] [SPEED_M_S] [PICTURE_DIR]`
#![allow(missing_docs, clippy::unwrap_used, clippy::print_stdout, reason = "an example: it prints and it may stop")]

use std::path::Path;

use explore_loop::cell::sim::{Scene, SimCell, SimOptions, Truth};
use explore_loop::cell::{Cell, Observation};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

type Error = Box<dyn std::error::Error>;

fn main() -> Result<(), Error> {
    let mut arguments = std::env::args().skip(1);
    let seed = arguments.next().map_or(Ok(0), |s| s.parse())?;
    let speed: f64 = arguments.next().map_or(Ok(0.03), |s| s.parse())?;
    let pictures = arguments.next();
    let mut options = SimOptions::new(Scene::liver()?);
    options.seed = seed;
    if let Ok(n) = std::env::var("TETS") { options.fidelity.tetrahedra = n.parse()?; }
    if let Ok(n) = std::env::var("SUB") { options.fidelity.substeps = n.parse()?; }
    if let Ok(n) = std::env::var("STEP") { options.fidelity.step = n.parse()?; }
    if let Ok(n) = std::env::var("SELF") { options.fidelity.self_contact = n.parse::<u8>()? > 0; }
    if let Ok(n) = std::env::var("YOUNG") { options.material.young = n.parse()?; }

    let start = cpu_seconds();
    let (mut cell, truth) = SimCell::new(&options)?;
    let settled = cpu_seconds();
    let mut turn = Turn { seen: vec![false; truth.live().len()], picture: 0, pictures, frames: 0, slowest: 0.0, cpu: 0.0 };
    println!("{} tetrahedra, {} vertices, built and settled in {:.2} s CPU", cell.tetrahedra(), truth.live().len(), settled - start);
    let volume = cell.volume();
    turn.look(&mut cell, &truth)?;
    println!("seen before: {:.1} %", 100.0 * turn.share(&truth));
    turn.turn_over(&mut cell, &truth, speed)?;
    cell.home()?;
    for _ in 0..10 {
        turn.look(&mut cell, &truth)?;
    }
    println!("seen after:  {:.1} %", 100.0 * turn.share(&truth));
    println!("turned by:   {:.0} deg", turned_deg(&truth));
    println!("volume kept: {:.2} %", 100.0 * cell.volume() / volume);
    println!("CPU:         {:.1} ms a frame of 100 ms, slowest {:.1}", 1000.0 * turn.cpu / turn.frames as f64, 1000.0 * turn.slowest);
    Ok(())
}

struct Turn {
    seen: Vec<bool>,
    pictures: Option<String>,
    picture: usize,
    frames: usize,
    slowest: f64,
    cpu: f64,
}

impl Turn {
    /// Grips the long side that faces the arms best, lifts it along a circle about the far foot, and lays it down beyond.
    fn turn_over(&mut self, cell: &mut SimCell, truth: &Truth, speed: f64) -> Result<(), Error> {
        let live = truth.live();
        let table = cell.info().table;
        let up = table.normal.into_inner();
        let (centre, long, half_long, half_short) = footprint(&live);
        // Grips on the side toward the third arm (−y), so that both arms reach it from left and right.
        let mut side = up.cross(&long).normalize();
        if side.y > 0.0 {
            side = -side;
        }
        let long = if long.x < 0.0 { -long } else { long };
        let spread = 0.45 * half_long;
        let grips: Vec<Point3<f64>> = [spread, -spread].iter().map(|along| rim(&live, &table, centre, long * *along, long, side)).collect();
        for (arm, grip) in grips.iter().enumerate() {
            // Approach horizontally, tilted down: z toward the object, jaws opening along the table normal.
            let approach = -side * 0.9 - up * 0.45;
            let tip = Isometry3::from_parts(Translation3::from(grip.coords), UnitQuaternion::face_towards(&approach, &up));
            let mut ready = tip;
            ready.translation.vector += side * 0.05 + up * 0.03;
            cell.move_arm(arm, ready, 0.2)?;
            self.wait(cell, truth)?;
            cell.move_arm(arm, tip, 0.05)?;
        }
        self.wait(cell, truth)?;
        for arm in 0..2 {
            cell.close_jaw(arm)?;
        }
        // Pivot line: on the table, at the far foot.
        let pull: f64 = std::env::var("PULL").map_or(Ok(0.0), |s| s.parse())?;
        let grip_mid = nalgebra::center(&grips[0], &grips[1]);
        let height = table.height(&grip_mid);
        let pivot = grip_mid - up * height - side * (half_short * std::env::var("RADIUS").map_or(Ok(1.0), |s| s.parse::<f64>())?);
        let starts: Vec<Isometry3<f64>> = cell.observe()?.arms.iter().map(|a| a.camera_from_tip).collect();
        let axis = nalgebra::Unit::new_normalize(side.cross(&up));
        let cap: f64 = std::env::var("CAP").map_or(Ok(140.0), |s| s.parse::<f64>())?.to_radians();
        let radius = (grip_mid - pivot).norm();
        let steps = 60;
        for k in 1..=steps {
            let s = f64::from(k) / f64::from(steps);
            let angle = std::f64::consts::PI * s;
            let turn = Rotation3::from_axis_angle(&axis, angle);
            for arm in 0..2 {
                let start = starts[arm];
                let offset = Point3::from(start.translation.vector) - pivot;
                let mut to = pivot + turn * offset - side * (pull * s);
                let h = table.height(&to);
                if h < 0.006 { to += up * (0.006 - h); }
                let pose = Isometry3::from_parts(Translation3::from(to.coords), UnitQuaternion::from_axis_angle(&axis, angle.min(cap)) * start.rotation);
                cell.move_arm(arm, pose, speed)?;
            }
            self.wait(cell, truth)?;
        }
        println!("radius {:.3} m", radius);
        for _ in 0..5 { self.look(cell, truth)?; }
        for arm in 0..2 {
            cell.open_jaw(arm)?;
        }
        for _ in 0..5 { self.look(cell, truth)?; }
        Ok(())
    }

    fn wait(&mut self, cell: &mut SimCell, truth: &Truth) -> Result<(), Error> {
        while self.look(cell, truth)?.arms.iter().any(|a| a.moving) {}
        Ok(())
    }

    fn look(&mut self, cell: &mut SimCell, truth: &Truth) -> Result<Observation, Error> {
        let start = cpu_seconds();
        let observation = cell.observe()?;
        let cpu = cpu_seconds() - start;
        self.frames += 1;
        self.cpu += cpu;
        self.slowest = self.slowest.max(cpu);
        mark_seen(&mut self.seen, &truth.live(), &observation.points);
        if self.frames % 10 == 1 {
            if let Some(directory) = &self.pictures {
                picture(&Path::new(directory).join(format!("turn_{:03}.ppm", self.picture)), truth, &observation)?;
                self.picture += 1;
            }
        }
        Ok(observation)
    }

    /// Area-free share: the vertices are spread evenly.
    fn share(&self, truth: &Truth) -> f64 {
        self.seen.iter().filter(|&&s| s).count() as f64 / truth.live().len() as f64
    }
}

/// Centre, direction of the long side, half lengths along it and across, of the object seen from above.
fn footprint(live: &[Point3<f64>]) -> (Point3<f64>, Vector3<f64>, f64, f64) {
    let n = live.len() as f64;
    let centre = Point3::from(live.iter().map(|p| p.coords).sum::<Vector3<f64>>() / n);
    let mut spread = Matrix3::zeros();
    for p in live {
        let d = Vector3::new(p.x - centre.x, p.y - centre.y, 0.0);
        spread += d * d.transpose();
    }
    let angle = 0.5 * (2.0 * spread[(0, 1)]).atan2(spread[(0, 0)] - spread[(1, 1)]);
    let long = Vector3::new(angle.cos(), angle.sin(), 0.0);
    let short = Vector3::new(-angle.sin(), angle.cos(), 0.0);
    let half = |d: Vector3<f64>| live.iter().map(|p| (p - centre).dot(&d).abs()).fold(0.0, f64::max);
    (centre, long, half(long), half(short))
}

/// A point just inside the rim on side `side`, near `centre + along`.
fn rim(live: &[Point3<f64>], table: &explore_loop::cell::Plane, centre: Point3<f64>, along: Vector3<f64>, long: Vector3<f64>, side: Vector3<f64>) -> Point3<f64> {
    let near = live.iter().filter(|p| (**p - centre - along).dot(&long).abs() < 0.008);
    let edge = near.max_by(|a, b| (*a - centre).dot(&side).total_cmp(&(*b - centre).dot(&side))).copied().unwrap_or(centre);
    let lift = (0.008 - table.height(&edge)).max(0.0);
    edge - side * 0.004 + table.normal.into_inner() * lift
}

/// A vertex counts as seen when a camera point lies within 3 mm.
fn mark_seen(seen: &mut [bool], live: &[Point3<f64>], points: &[Point3<f64>]) {
    let key = |p: &Point3<f64>| [(p.x / 0.003).floor() as i64, (p.y / 0.003).floor() as i64, (p.z / 0.003).floor() as i64];
    let mut cells = std::collections::HashMap::<[i64; 3], Vec<Point3<f64>>>::new();
    points.iter().for_each(|p| cells.entry(key(p)).or_default().push(*p));
    for (flag, p) in seen.iter_mut().zip(live).filter(|(flag, _)| !**flag) {
        let [x, y, z] = key(p);
        *flag = (-1..=1).any(|i| {
            (-1..=1).any(|j| {
                (-1..=1).any(|k| cells.get(&[x + i, y + j, z + k]).is_some_and(|c| c.iter().any(|q| (q - p).norm() < 0.003)))
            })
        });
    }
}

/// Angle of the best rigid motion from rest to live.
fn turned_deg(truth: &Truth) -> f64 {
    let (rest, live) = (truth.rest().vertices, truth.live());
    let mean = |v: &[Point3<f64>]| v.iter().map(|p| p.coords).sum::<Vector3<f64>>() / v.len() as f64;
    let (a, b) = (mean(&rest), mean(&live));
    let covariance = rest.iter().zip(&live).fold(Matrix3::zeros(), |m, (r, l)| m + (l.coords - b) * (r.coords - a).transpose());
    Rotation3::from_matrix(&covariance).angle().to_degrees()
}

/// The object from the camera and from the side, shaded; where the camera's points lie is green.
fn picture(path: &Path, truth: &Truth, observation: &Observation) -> Result<(), Error> {
    const W: usize = 560;
    const H: usize = 700;
    let mut pixels = vec![[245_u8; 3]; W * H];
    let mut depth = vec![f64::INFINITY; W * H];
    let (live, triangles) = (truth.live(), truth.triangles());
    let view = |p: &Point3<f64>, side: bool| -> (f64, f64, f64) {
        if side { (280.0 + p.x * 1000.0, 660.0 - (0.55 - p.z) * 1000.0, p.y * -1.0) } else { (280.0 + p.x * 1000.0, 210.0 + p.y * 1000.0, p.z) }
    };
    for side in [false, true] {
        for t in &triangles {
            let n = (live[t[1]] - live[t[0]]).cross(&(live[t[2]] - live[t[0]])).normalize();
            let light = n.dot(&Vector3::new(-0.4, -0.5, -0.77)).max(0.0) * 0.75 + 0.25;
            let c = t.map(|v| view(&live[v], side));
            let area = (c[1].0 - c[0].0) * (c[2].1 - c[0].1) - (c[2].0 - c[0].0) * (c[1].1 - c[0].1);
            let low = |f: fn(&(f64, f64, f64)) -> f64| c.iter().map(f).fold(f64::MAX, f64::min).max(0.0) as usize;
            let high = |f: fn(&(f64, f64, f64)) -> f64| c.iter().map(f).fold(0.0, f64::max) as usize;
            for y in low(|p| p.1)..=high(|p| p.1).min(H - 1) {
                for x in low(|p| p.0)..=high(|p| p.0).min(W - 1) {
                    let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
                    let w = |a: usize, b: usize| ((c[b].0 - c[a].0) * (py - c[a].1) - (px - c[a].0) * (c[b].1 - c[a].1)) / area;
                    let (w2, w0, w1) = (w(0, 1), w(1, 2), w(2, 0));
                    let z = w0 * c[0].2 + w1 * c[1].2 + w2 * c[2].2;
                    if w0 >= 0.0 && w1 >= 0.0 && w2 >= 0.0 && z < depth[y * W + x] {
                        depth[y * W + x] = z;
                        pixels[y * W + x] = [(190.0 * light) as u8, (70.0 * light) as u8, (60.0 * light) as u8];
                    }
                }
            }
        }
        for arm in &observation.arms {
            for k in 0..60 {
                let p = arm.camera_from_tip * Point3::new(0.0, 0.0, -0.001 * f64::from(k));
                let (x, y, _) = view(&p, side);
                for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)] {
                    let (x, y) = ((x + dx) as usize, (y + dy) as usize);
                    if x < W && y < H { pixels[y * W + x] = if arm.holding { [20, 140, 30] } else { [30, 30, 160] }; }
                }
            }
        }
        for x in 0..W { pixels[660 * W + x] = [90, 90, 90]; }
    }
    let mut file = format!("P6 {W} {H} 255\n").into_bytes();
    file.extend(pixels.iter().flatten());
    std::fs::write(path, file)?;
    Ok(())
}

/// Processor time of this thread.
fn cpu_seconds() -> f64 {
    let schedule = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    schedule.split(' ').next().and_then(|ns| ns.parse::<f64>().ok()).unwrap_or(0.0) * 1e-9
}
