//! Plans where two or three arms grip an object, and how they turn it over.
//! `cargo run --release -p grip-planner --example grips -- --help`.
//!
//! Prints the ranked sets of grips with coverage, poses, and the reason if a set is rejected, and why vertices are not candidates; writes a
//! picture from the camera: coverage by colour, candidates, grips and the paths of the tips.

mod answer;
mod arguments;
mod extent;
mod picture;

use std::process::ExitCode;

use answer::{Answer, Judged};
use arguments::Arguments;
use grip_planner::nalgebra::{Isometry3, UnitQuaternion, UnitVector3, Vector3};
use grip_planner::{
    Arm, GripSet, Model, Plan, PlanOptions, Plane, Ranked, Refusal, Scene, Surface, Workspace,
    agent_box, plan_grips, plan_set,
};
use mesh_io::Load;
use mesh_io::program::{self, Failure};

/// Bodies with diagonals outside this range, m, cannot be held by jaws of centimetres.
const EXTENT: [f64; 2] = [1e-3, 10.0];

fn main() -> ExitCode {
    program::run(grips)
}

fn grips(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let path = &arguments.model;
    let load = Load::default().with_extent(EXTENT);
    let model = arguments.loading.of(load).read(path)?;
    if model.triangles().is_empty() {
        return Err(mesh_io::Error::NoFaces.in_file(path).into());
    }
    let points = model.points();
    let (middle, diagonal) = extent::extent(points);
    let table = arguments.plane.unwrap_or_else(|| extent::floor(points));
    let above = middle + table.normal.as_ref() * (2.5 * diagonal);
    let camera = arguments.camera.unwrap_or(above);
    if table.height(&camera) <= 0.0 {
        return Err("the camera is under the table: see --camera and --plane".into());
    }
    let heights = points.iter().map(|p| table.height(p));
    let lowest = heights.fold(f64::INFINITY, f64::min);
    if lowest < -0.05 * diagonal {
        let (path, depth) = (path.display(), mesh_io::three_digits(-lowest));
        return Err(format!("{path}: extends {depth} m below the table: see --plane").into());
    }
    let surface = Surface::from_mesh(points, model.triangles(), &camera)
        .map_err(|error| format!("{}: {error}", path.display()))?;
    let arms = arms(usize::from(arguments.arms), &surface, &table)?;
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
    let options = PlanOptions::default();
    let ranked = plan_grips(&model, &scene, &options.grips)?;
    let judged = |set: &GripSet| planned(&model, &scene, set, &ranked, &options);
    let sets: Vec<Judged> = ranked.sets.iter().map(judged).collect();
    let best = sets.iter().find_map(|plan| plan.as_ref().ok());
    let svg = picture::draw(&surface, &scene, &ranked, best);
    let out = &arguments.out;
    std::fs::write(out, svg).map_err(|error| format!("{}: {error}", out.display()))?;
    let answer = Answer {
        arguments,
        surface: &surface,
        model: &model,
        ranked: &ranked,
        sets: &sets,
    };
    answer.print(&mut arguments.output.words())?;
    arguments.output.object(&answer.object())?;
    match best {
        Some(_) => Ok(ExitCode::SUCCESS),
        None => Err(format!("{}: every set of grips was rejected", path.display()).into()),
    }
}

/// Arms at both ends of the longer side of the body, and a third behind, with remote centres above the table like those of PSMs.
fn arms(count: usize, surface: &Surface, table: &Plane) -> Result<Vec<Arm>, grip_planner::Error> {
    let outline = agent_box(surface.points(), table)?;
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

/// If the third arm of a set is obstructed, the set is tried without it.
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
