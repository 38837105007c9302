//! Where would two or three arms take hold of this object, and how would they turn it over?
//!
//! ```text
//! cargo run --release -p grip-planner --example grips -- MODEL [--arms 2|3] [--camera X,Y,Z] [--plane A,B,C,D]
//!     [--units m|cm|mm] [--size METRES] [--up x|y|z] [--body N] [--out FILE.svg]
//! ```
//!
//! Prints the ranked sets of grips with coverage, poses, and the reason where a set is refused, and why vertices are no candidates; writes a
//! picture seen from the camera: coverage by colour, candidates, grips and the ways of the tips.
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a program prints"
)]

mod arguments;
mod picture;
mod surface;

use std::path::Path;
use std::process::ExitCode;

use arguments::{Arguments, USAGE};
use grip_planner::nalgebra::{Isometry3, Point3, UnitQuaternion, UnitVector3, Vector3};
use grip_planner::{
    Arm, GripSet, Model, Plan, PlanOptions, Plane, Ranked, Reason, Refusal, Role, Scene, Workspace,
    agent_box, missing_vector_area, plan_grips, plan_set,
};
use surface::{Mesh, Surface};

fn main() -> ExitCode {
    if std::env::args()
        .skip(1)
        .any(|word| word == "--help" || word == "-h")
    {
        println!("{USAGE}");
        return ExitCode::SUCCESS;
    }
    let arguments = match Arguments::parse(std::env::args().skip(1)) {
        Ok(arguments) => arguments,
        Err(complaint) => {
            eprintln!("{complaint}\n{USAGE}");
            return ExitCode::from(2);
        }
    };
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(complaint) => {
            eprintln!("{complaint}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), String> {
    let path = Path::new(&arguments.model);
    let model = arguments.load.read(path).map_err(|e| e.to_string())?;
    if model.triangles().is_empty() {
        return Err(mesh_io::Error::NoFaces.in_file(path).to_string());
    }
    let mesh = Mesh::from(model);
    let (middle, diagonal) = surface::extent(&mesh.points);
    let table = arguments.plane.unwrap_or_else(|| surface::floor(&mesh));
    let above = middle + table.normal.as_ref() * (2.5 * diagonal);
    let camera = arguments.camera.unwrap_or(above);
    if table.height(&camera) <= 0.0 {
        return Err("the camera is under the table".into());
    }
    let lowest = mesh
        .points
        .iter()
        .map(|p| table.height(p))
        .fold(f64::INFINITY, f64::min);
    if lowest < -0.05 * diagonal {
        return Err(format!(
            "the model reaches {:.4} m under the table",
            -lowest
        ));
    }
    let surface = Surface::new(mesh, &camera).map_err(|e| format!("{}: {e}", arguments.model))?;
    let arms = arms(arguments.arms, &surface, &table).map_err(|e| e.to_string())?;
    let scene = Scene {
        table,
        arms: &arms,
        camera,
        jaw_radius: 0.005,
        shaft_length: 0.05,
        jaw_separation: 0.02,
        clearance: 0.003,
    };
    let model = surface.model();
    describe(&arguments.model, &surface, &model);
    let options = PlanOptions::default();
    let ranked = plan_grips(&model, &scene, &options.grips).map_err(|e| e.to_string())?;
    print_candidates(&ranked);
    let best = print_sets(&model, &scene, &ranked, &options);
    let svg = picture::draw(&surface, &scene, &ranked, best.as_ref());
    std::fs::write(&arguments.out, svg).map_err(|e| format!("{}: {e}", arguments.out))?;
    println!("picture: {}", arguments.out);
    match best {
        Some(_) => Ok(()),
        None => Err("every set was refused".into()),
    }
}

/// Arms at both ends of the longer side of the body, a third behind: their remote centres stand over the table like those of PSMs.
fn arms(count: usize, surface: &Surface, table: &Plane) -> Result<Vec<Arm>, grip_planner::Error> {
    let outline = agent_box(&surface.points, table)?;
    let foot = table.foot(&outline.center);
    let [long, short, up] = outline.axes.map(UnitVector3::into_inner);
    let far = 0.2 + outline.half_extents.x;
    let arm = |side: Vector3<f64>| {
        let base = foot + side * far + up * 0.25;
        let apart = foot + side * (0.6 * far) + up * (0.12 + 2.0 * outline.half_extents.z);
        Arm {
            base,
            workspace: Workspace::SphereSector {
                apex: base,
                axis: UnitVector3::new_normalize(foot - base),
                half_angle: 1.2,
                radii: [0.03, 2.0 * far + 0.25],
            },
            home: Isometry3::from_parts(
                apart.into(),
                UnitQuaternion::face_towards(&(foot - base), &up.cross(&side)),
            ),
            max_speed: 0.1,
        }
    };
    Ok([long, -long, -short]
        .into_iter()
        .take(count)
        .map(arm)
        .collect())
}

fn describe(name: &str, surface: &Surface, model: &Model) {
    let m = missing_vector_area(model);
    println!(
        "{name}: {} vertices known, {} of them in view, {:.1} cm² ({:.0} % of the mesh, which is {})",
        surface.points.len(),
        surface.seen(),
        1e4 * surface.area(),
        100.0 * surface.area() / surface.whole_area,
        if surface.closed { "closed" } else { "open" },
    );
    println!(
        "missing vector area {:.1} cm² toward {}",
        1e4 * m.norm(),
        m.try_normalize(0.0)
            .map_or("nowhere".into(), |d| direction(&d))
    );
}

fn print_candidates(ranked: &Ranked) {
    let found = &ranked.candidates;
    println!(
        "{} candidates, {} other vertices looked at:",
        found.accepted.len(),
        found.rejected.len()
    );
    let mut words: Vec<(&str, usize, &(u32, Reason))> = Vec::new();
    for rejected in &found.rejected {
        let word = rejected.1.word();
        match words.iter_mut().find(|w| w.0 == word) {
            Some(entry) => entry.1 += 1,
            None => words.push((word, 1, rejected)),
        }
    }
    for (word, count, (vertex, reason)) in words {
        println!("  {count:5} {word:<12} such as vertex {vertex}: {reason}");
    }
}

/// Every set with its plan or the reason why there is none; gives the first plan.
fn print_sets(
    model: &Model,
    scene: &Scene,
    ranked: &Ranked,
    options: &PlanOptions,
) -> Option<Plan> {
    let mut best = None;
    for (rank, set) in ranked.sets.iter().enumerate() {
        let plan = planned(model, scene, set, ranked, options);
        let verdict = match &plan {
            Ok(plan) => format!(
                "can be done: {:.1} s to the grips, {:.1} s, {:.1} s home, at most {:.0} mm/s",
                plan.reach.duration,
                plan.motion.duration,
                plan.withdraw.duration,
                1e3 * plan.motion.peak_speed()
            ),
            Err(reason) => format!("refused: {reason}"),
        };
        println!(
            "{:3}. score {:.3}, coverage {:.3}, suitability {:.3}, lifts {} by {:.0}°; {verdict}",
            rank + 1,
            set.score,
            set.coverage,
            set.suitability,
            direction(&set.turn.lifted),
            set.turn.angle.to_degrees()
        );
        for grip in &set.grips {
            let pose = &grip.camera_from_tip;
            println!(
                "       arm {} {} vertex {:5} at {} mm, approach {}, jaws {}",
                grip.arm,
                if grip.role == Role::Lift {
                    "lifts"
                } else {
                    "holds"
                },
                grip.vertex,
                millimetres(&grip.tip()),
                direction(&(pose.rotation * Vector3::z())),
                direction(&(pose.rotation * Vector3::y())),
            );
        }
        best = best.or(plan.ok());
    }
    best
}

/// A set whose third arm is in the way can still do without it.
fn planned(
    model: &Model,
    scene: &Scene,
    set: &GripSet,
    ranked: &Ranked,
    options: &PlanOptions,
) -> Result<Plan, Refusal> {
    let plan = |set: &GripSet| plan_set(model, scene, set, &ranked.coverage, options);
    plan(set).or_else(|reason| match set.grips.len() {
        3 => plan(&set.without_support()).map_err(|_| reason),
        _ => Err(reason),
    })
}

fn direction(d: &Vector3<f64>) -> String {
    format!("({:5.2} {:5.2} {:5.2})", d.x, d.y, d.z)
}

fn millimetres(p: &Point3<f64>) -> String {
    format!("({:6.1} {:6.1} {:6.1})", 1e3 * p.x, 1e3 * p.y, 1e3 * p.z)
}
