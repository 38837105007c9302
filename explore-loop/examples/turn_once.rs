//! Two arms grip an object on one side, turn it over once, and release it; the session is recorded with ground truth.
//!
//! ```text
//! cargo run --release -p explore-loop --example turn_once -- cap cap.mcap --seed 1
//! cargo run --release --bin explore -- replay cap.mcap
//! ```
//! Nothing is planned: the same script turns every scene over, independently of the reconstruction, so that two reconstructions can be
//! compared on the same frames.
#![allow(clippy::cast_sign_loss, reason = "pixels are clamped from 0")]

use std::f64::consts::PI;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use dvrk_io::session::SessionWriter;
use explore_loop::cell::sim::{Scene, SimCell, SimOptions, Truth};
use explore_loop::cell::{Cell, Observation};
use mesh_io::program::{self, Failure as Error, Output, not_negative, positive};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Unit, UnitQuaternion, Vector3};
use serde_json::json;

/// Distance of each grip from the middle, in half lengths of the object.
const SPREAD: f64 = 0.45;
/// Rotation at which the tips stop rotating, so that the shafts stay above the table.
const LAST_TURN_DEG: f64 = 140.0;
/// Smallest height of the tips, metres: the part in a jaw is up to 9 mm to either side of it.
const LOWEST: f64 = 0.012;
/// Number of straight pieces of the half circle.
const STEPS: u32 = 60;
/// Number of frames observed before and after the grips, with the arms away.
const LOOK: usize = 10;
/// Number of frames for the released object to come to rest.
const REST: usize = 15;

/// Grips an object on one side, turns it over once, releases it, and records the session with ground truth
#[derive(Debug, clap::Parser)]
#[command(
    name = "turn_once",
    after_help = "Example: turn_once cap cap.mcap --seed 1
then:    explore replay cap.mcap"
)]
struct Arguments {
    /// Name of a built-in scene
    scene: String,
    /// The recording
    #[arg(value_name = "SESSION.mcap")]
    session: PathBuf,
    /// Seed of the noise
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Speed of the tips, m/s
    #[arg(long, value_name = "M_S", default_value_t = 0.03, value_parser = positive)]
    speed: f64,
    /// Standard deviation of the depth noise, mm
    #[arg(long, value_name = "MM", default_value_t = 0.5, value_parser = not_negative)]
    noise: f64,
    /// Radius of the arc of the grips, in half widths of the object
    #[arg(long, value_name = "HALF_WIDTHS", default_value_t = 1.4, value_parser = positive)]
    arc: f64,
    /// Folder for a picture (PPM) every second
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
    #[command(flatten)]
    output: Output,
}

fn main() -> ExitCode {
    program::run(run)
}

fn run(arguments: &Arguments) -> Result<ExitCode, Error> {
    let mut words = arguments.output.words();
    let mut options = SimOptions::new(Scene::named(&arguments.scene)?);
    options.seed = arguments.seed;
    options.camera.noise = 1e-3 * arguments.noise;
    let start = std::time::Instant::now();
    let (cell, truth) = SimCell::new(&options)?;
    writeln!(
        words,
        "{} tetrahedra, {} vertices, built and settled in {:.1} s",
        cell.tetrahedra(),
        truth.live().len(),
        start.elapsed().as_secs_f64()
    )?;
    let volume = cell.volume();
    let mut session = SessionWriter::create(&arguments.session)?;
    let table = cell.info().table;
    session.table(0.0, &table.normal, table.offset)?;
    let mut turn = Turn {
        cell,
        seen: vec![false; truth.live().len()],
        truth,
        session,
        pictures: arguments.pictures.clone(),
        frames: 0,
    };
    turn.watch(LOOK)?;
    let before = turn.share();
    writeln!(words, "seen before: {:.1} %", 100.0 * before)?;
    turn.turn_over(arguments.speed, arguments.arc)?;
    turn.watch(LOOK)?;
    let (after, kept) = (turn.share(), turn.cell.volume() / volume);
    let turned = turned_deg(&turn.truth);
    let frame = start.elapsed().as_secs_f64() / turn.frames as f64;
    let frames = turn.frames;
    turn.session.finish()?;
    writeln!(
        words,
        "seen after:  {:.1} %\nturned by:   {turned:.0} deg\nvolume kept: {:.1} %\n{frames} frames, {frame:.2} s each",
        100.0 * after,
        100.0 * kept
    )?;
    arguments.output.object(&json!({
        "session": arguments.session,
        "seen_before": before,
        "seen_after": after,
        "turned_deg": turned,
        "volume_kept": kept,
        "frames": frames,
        "frame_s": frame,
    }))?;
    Ok(ExitCode::SUCCESS)
}

struct Turn {
    cell: SimCell,
    truth: Truth,
    session: SessionWriter,
    seen: Vec<bool>,
    pictures: Option<PathBuf>,
    frames: usize,
}

impl Turn {
    /// Grips the long side that faces the third arm, swings it over the far side, and lays it down beyond.
    ///
    /// The tips follow a half circle about a line on the table, `arc` half widths beyond the grips, and rotate with it
    /// until the shafts would nearly point up from below; for the rest of the way they only descend.
    fn turn_over(&mut self, speed: f64, arc: f64) -> Result<(), Error> {
        let table = self.cell.info().table;
        let up = table.normal.into_inner();
        let object = Footprint::of(&self.truth.live(), up);
        let starts = self.reach(&object)?;
        for arm in 0..2 {
            self.cell.close_jaw(arm)?;
        }
        let grip = nalgebra::center(
            &starts[0].translation.vector.into(),
            &starts[1].translation.vector.into(),
        );
        let pivot = grip - up * table.height(&grip) - object.side * (arc * object.half_width);
        let axis = Unit::new_normalize(object.side.cross(&up));
        for step in 1..=STEPS {
            let angle = PI * f64::from(step) / f64::from(STEPS);
            let turn = UnitQuaternion::from_axis_angle(&axis, angle);
            let held =
                UnitQuaternion::from_axis_angle(&axis, angle.min(LAST_TURN_DEG.to_radians()));
            for (arm, start) in starts.iter().enumerate() {
                let mut to = pivot + turn * (Point3::from(start.translation.vector) - pivot);
                to += up * (LOWEST - table.height(&to)).max(0.0);
                let to = Isometry3::from_parts(to.into(), held * start.rotation);
                self.cell.move_arm(arm, to, speed)?;
            }
            self.wait()?;
        }
        self.watch(5)?;
        self.let_go(up)
    }

    /// Opens the jaws, retreats, rises and returns home, recording all frames.
    fn let_go(&mut self, up: Vector3<f64>) -> Result<(), Error> {
        let last = self.watch(1)?;
        for arm in 0..2 {
            self.cell.open_jaw(arm)?;
        }
        self.watch(REST)?;
        for (back, rise) in [(0.03, 0.005), (0.03, 0.06)] {
            for arm in 0..2 {
                let mut clear = last.arms[arm].camera_from_tip;
                clear.translation.vector += up * rise - clear.rotation * Vector3::z() * back;
                self.cell.move_arm(arm, clear, 0.1)?;
            }
            self.wait()?;
        }
        for arm in 0..2 {
            let home = self.cell.info().arms[arm].camera_from_home;
            self.cell.move_arm(arm, home, 0.2)?;
        }
        self.wait()
    }

    /// Moves two open jaws over the rim, from the side and a little from above; returns the poses of the tips.
    fn reach(&mut self, object: &Footprint) -> Result<Vec<Isometry3<f64>>, Error> {
        let table = self.cell.info().table;
        let up = table.normal.into_inner();
        let approach = -(object.side * 2.0 + up);
        let rotation = UnitQuaternion::face_towards(&approach, &up);
        let spread = object.long * (SPREAD * object.half_length);
        let mut tips = Vec::new();
        for (arm, along) in [spread, -spread].into_iter().enumerate() {
            let edge = object.rim(&self.truth.live(), along);
            let grip = edge - object.side * 0.004 + up * (0.008 - table.height(&edge)).max(0.0);
            let tip = Isometry3::from_parts(grip.into(), rotation);
            let ready =
                Isometry3::from_parts((grip + object.side * 0.05 + up * 0.03).into(), rotation);
            self.cell.move_arm(arm, ready, 0.2)?;
            self.wait()?;
            self.cell.move_arm(arm, tip, 0.05)?;
            tips.push(tip);
        }
        self.wait()?;
        Ok(tips)
    }

    fn wait(&mut self) -> Result<(), Error> {
        while self.watch(1)?.arms.iter().any(|a| a.moving) {}
        Ok(())
    }

    /// Records some frames and returns the last.
    fn watch(&mut self, frames: usize) -> Result<Observation, Error> {
        let mut last = self.look()?;
        for _ in 1..frames {
            last = self.look()?;
        }
        Ok(last)
    }

    fn look(&mut self) -> Result<Observation, Error> {
        let observation = self.cell.observe()?;
        self.frames += 1;
        let live = self.truth.live();
        mark_seen(&mut self.seen, &live, &observation.points);
        self.session
            .points(observation.stamp, &observation.points)?;
        for (info, arm) in self.cell.info().arms.iter().zip(&observation.arms) {
            self.session
                .pose(observation.stamp, &info.name, &arm.camera_from_tip)?;
            self.session.jaw(observation.stamp, &info.name, arm.jaw)?;
        }
        self.session.truth(observation.stamp, &live)?;
        if let (1, Some(directory)) = (self.frames % 10, &self.pictures) {
            let name = format!("turn_{:03}.ppm", self.frames / 10);
            picture(&directory.join(name), &self.truth, &observation)?;
        }
        Ok(observation)
    }

    /// Share of the vertices that were seen; they are evenly spread.
    fn share(&self) -> f64 {
        self.seen.iter().filter(|&&s| s).count() as f64 / self.seen.len() as f64
    }
}

/// The object seen from above.
struct Footprint {
    centre: Point3<f64>,
    /// Direction of the longer side, toward the first arm (+x).
    long: Vector3<f64>,
    /// Direction across it, toward the third arm (−y).
    side: Vector3<f64>,
    half_length: f64,
    half_width: f64,
}

impl Footprint {
    fn of(live: &[Point3<f64>], up: Vector3<f64>) -> Self {
        let centre = Point3::from(mean(live));
        let mut spread = Matrix3::zeros();
        for p in live {
            let d = (p - centre) - up * (p - centre).dot(&up);
            spread += d * d.transpose();
        }
        let angle = 0.5 * (2.0 * spread[(0, 1)]).atan2(spread[(0, 0)] - spread[(1, 1)]);
        let mut long = Vector3::new(angle.cos(), angle.sin(), 0.0);
        long *= long.x.signum();
        let mut side = up.cross(&long);
        side *= -side.y.signum();
        let half = |d: Vector3<f64>| {
            live.iter()
                .map(|p| (p - centre).dot(&d).abs())
                .fold(0.0, f64::max)
        };
        Self {
            centre,
            long,
            side,
            half_length: half(long),
            half_width: half(side),
        }
    }

    /// The vertex farthest out on the side, near `centre + along`.
    fn rim(&self, live: &[Point3<f64>], along: Vector3<f64>) -> Point3<f64> {
        let near = live
            .iter()
            .filter(|p| (**p - self.centre - along).dot(&self.long).abs() < 0.008);
        let outward = |p: &Point3<f64>| (p - self.centre).dot(&self.side);
        near.max_by(|a, b| outward(a).total_cmp(&outward(b)))
            .copied()
            .unwrap_or(self.centre)
    }
}

fn mean(points: &[Point3<f64>]) -> Vector3<f64> {
    points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64
}

/// A vertex counts as seen when a camera point lies within 3 mm.
fn mark_seen(seen: &mut [bool], live: &[Point3<f64>], points: &[Point3<f64>]) {
    let key = |p: &Point3<f64>| {
        [
            (p.x / 0.003).floor() as i64,
            (p.y / 0.003).floor() as i64,
            (p.z / 0.003).floor() as i64,
        ]
    };
    let mut cells = std::collections::HashMap::<[i64; 3], Vec<Point3<f64>>>::new();
    for p in points {
        cells.entry(key(p)).or_default().push(*p);
    }
    for (flag, p) in seen.iter_mut().zip(live).filter(|(flag, _)| !**flag) {
        let [x, y, z] = key(p);
        *flag = (-1..=1).any(|i| {
            (-1..=1).any(|j| {
                (-1..=1).any(|k| {
                    cells
                        .get(&[x + i, y + j, z + k])
                        .is_some_and(|c| c.iter().any(|q| (q - p).norm() < 0.003))
                })
            })
        });
    }
}

/// Angle of the best rigid motion from rest to live.
fn turned_deg(truth: &Truth) -> f64 {
    let (rest, live) = (truth.rest().vertices, truth.live());
    let (a, b) = (mean(&rest), mean(&live));
    let covariance = rest.iter().zip(&live).fold(Matrix3::zeros(), |m, (r, l)| {
        m + (l.coords - b) * (r.coords - a).transpose()
    });
    Rotation3::from_matrix(&covariance).angle().to_degrees()
}

/// The object from the camera (above) and from the side (below), with the arms: green where they hold.
fn picture(path: &Path, truth: &Truth, observation: &Observation) -> Result<(), Error> {
    let mut image = Image {
        pixels: vec![[245; 3]; Image::WIDTH * Image::HEIGHT],
        depth: vec![f64::INFINITY; Image::WIDTH * Image::HEIGHT],
    };
    // One pixel per millimetre.
    let above = |p: &Point3<f64>| Point3::new(280.0 + 1000.0 * p.x, 210.0 + 1000.0 * p.y, p.z);
    let aside =
        |p: &Point3<f64>| Point3::new(280.0 + 1000.0 * p.x, 660.0 - 1000.0 * (0.55 - p.z), -p.y);
    let (live, views) = (
        truth.live(),
        [&above as &dyn Fn(&Point3<f64>) -> Point3<f64>, &aside],
    );
    for view in views {
        for t in truth.triangles() {
            let [a, b, c] = t.map(|v| live[v]);
            let light = 0.25
                + 0.75
                    * (b - a)
                        .cross(&(c - a))
                        .normalize()
                        .dot(&Vector3::new(-0.4, -0.5, -0.77))
                        .max(0.0);
            image.triangle(
                [a, b, c].map(|p| view(&p)),
                [190.0, 70.0, 60.0].map(|c| (c * light) as u8),
            );
        }
        for arm in &observation.arms {
            let colour = if arm.holding {
                [20, 140, 30]
            } else {
                [30, 30, 160]
            };
            for k in 0..60 {
                let at =
                    view(&(arm.camera_from_tip * Point3::new(0.0, 0.0, -0.001 * f64::from(k))));
                image.triangle(
                    [
                        at,
                        at + Vector3::new(3.0, 0.0, 0.0),
                        at + Vector3::new(0.0, 3.0, 0.0),
                    ]
                    .map(|p| Point3::new(p.x, p.y, -1.0)),
                    colour,
                );
            }
        }
    }
    let table = [
        Point3::new(0.0, 660.0, 9.0),
        Point3::new(2.0 * 560.0, 660.0, 9.0),
        Point3::new(0.0, 662.0, 9.0),
    ];
    image.triangle(table, [90; 3]);
    let mut file = format!("P6 {} {} 255\n", Image::WIDTH, Image::HEIGHT).into_bytes();
    file.extend(image.pixels.iter().flatten());
    std::fs::write(path, file)?;
    Ok(())
}

struct Image {
    pixels: Vec<[u8; 3]>,
    depth: Vec<f64>,
}

impl Image {
    const WIDTH: usize = 560;
    const HEIGHT: usize = 700;

    fn triangle(&mut self, c: [Point3<f64>; 3], colour: [u8; 3]) {
        let side = |a: usize, b: usize, p: Point3<f64>| (c[b] - c[a]).xy().perp(&(p - c[a]).xy());
        let area = side(0, 1, c[2]);
        let low = c[0].inf(&c[1]).inf(&c[2]);
        let high = c[0].sup(&c[1]).sup(&c[2]);
        for y in low.y.max(0.0) as usize..=(high.y.max(0.0) as usize).min(Self::HEIGHT - 1) {
            for x in low.x.max(0.0) as usize..=(high.x.max(0.0) as usize).min(Self::WIDTH - 1) {
                let p = Point3::new(x as f64 + 0.5, y as f64 + 0.5, 0.0);
                let w = [
                    side(1, 2, p) / area,
                    side(2, 0, p) / area,
                    side(0, 1, p) / area,
                ];
                let z = w[0] * c[0].z + w[1] * c[1].z + w[2] * c[2].z;
                let at = y * Self::WIDTH + x;
                if w.iter().all(|&w| w >= 0.0) && z < self.depth[at] {
                    self.depth[at] = z;
                    self.pixels[at] = colour;
                }
            }
        }
    }
}
