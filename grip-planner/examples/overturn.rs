//! Plans the turn of a half-seen body and prints the paths of the tips.
//!
//! `cargo run --release -p grip-planner --example overturn`

#[path = "../tests/fixture/mod.rs"]
mod fixture;

use std::io::Write;
use std::process::ExitCode;

use grip_planner::{Action, Plan, PlanOptions, missing_vector_area, plan, turns};
use mesh_io::program::{self, Failure, Output};
use serde_json::{Value, json};

/// Plans the turn of a half-seen body and prints the paths of the tips
#[derive(Debug, clap::Parser)]
#[command(name = "overturn", after_help = "Example: overturn --json")]
struct Arguments {
    #[command(flatten)]
    output: Output,
}

fn main() -> ExitCode {
    program::run(overturn)
}

fn overturn(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let mut words = arguments.output.words();
    let body = fixture::usual(4000);
    let arms = fixture::arms(3);
    let (model, scene) = (body.model(), fixture::scene(&arms));
    writeln!(
        words,
        "{} vertices, missing vector area {:.4?} m²",
        model.points.len(),
        missing_vector_area(&model).as_slice()
    )?;
    for t in turns(&model, &scene, 0.0)? {
        writeln!(
            words,
            "turn about {:.2?}: lift {:.2?}, span {:.3} m, {:.0}°, gain {:.2}",
            t.axis.as_slice(),
            t.lifted.as_slice(),
            t.span,
            t.angle.to_degrees(),
            t.gain
        )?;
    }
    let start = std::time::Instant::now();
    let plan = plan(&model, &scene, Action::TurnOver, &PlanOptions::default())?;
    writeln!(
        words,
        "planned in {:.1} ms after {} rejected sets",
        1e3 * start.elapsed().as_secs_f64(),
        plan.refused.len()
    )?;
    for r in &plan.refused {
        writeln!(
            words,
            "  refused {:?} {:.3}: {}",
            r.vertices, r.score, r.reason
        )?;
    }
    writeln!(
        words,
        "coverage {:.3}, score {:.3}, {:.1} s to the grips, {:.1} s motion, {:.1} s home; at most {:.3} m/s",
        plan.coverage,
        plan.score,
        plan.reach.duration,
        plan.motion.duration,
        plan.withdraw.duration,
        plan.speed_limit
    )?;
    for (grip, path) in plan.grips.iter().zip(&plan.motion.arms) {
        writeln!(
            words,
            "arm {} ({}) holds vertex {} until {:.1} s",
            grip.arm, grip.role, grip.vertex, path.release
        )?;
        for k in path.keyframes.iter().step_by(6) {
            let tip = k.camera_from_tip.translation.vector;
            let z = k.camera_from_tip.rotation * grip_planner::nalgebra::Vector3::z();
            writeln!(
                words,
                "  {:5.2} s  tip {:7.3} {:7.3} {:7.3}   approach {:5.2} {:5.2} {:5.2}",
                k.time, tip.x, tip.y, tip.z, z.x, z.y, z.z
            )?;
        }
    }
    arguments.output.object(&object(&plan))?;
    Ok(ExitCode::SUCCESS)
}

fn object(plan: &Plan) -> Value {
    let arms = plan
        .grips
        .iter()
        .zip(&plan.motion.arms)
        .map(|(grip, path)| {
            let tips = path.keyframes.iter().map(|k| {
                let tip = k.camera_from_tip.translation.vector;
                json!([k.time, tip.x, tip.y, tip.z])
            });
            json!({
                "arm": grip.arm,
                "vertex": grip.vertex,
                "release_s": path.release,
                "tip_s_m": tips.collect::<Vec<_>>(),
            })
        });
    json!({
        "coverage": plan.coverage,
        "score": plan.score,
        "refused": plan.refused.len(),
        "reach_s": plan.reach.duration,
        "motion_s": plan.motion.duration,
        "withdraw_s": plan.withdraw.duration,
        "speed_limit_m_s": plan.speed_limit,
        "arms": arms.collect::<Vec<_>>(),
    })
}
