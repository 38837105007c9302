//! Plans the turn of a half seen body and prints the way of the tips.
//!
//! `cargo run --release -p grip-planner --example overturn`
#![allow(clippy::print_stdout, reason = "an example shows what it found")]

#[path = "../tests/fixture/mod.rs"]
mod fixture;

use grip_planner::{Action, PlanOptions, missing_vector_area, plan, turns};

fn main() -> Result<(), grip_planner::Refusal> {
    let body = fixture::usual(4000);
    let arms = fixture::arms(3);
    let (model, scene) = (body.model(), fixture::scene(&arms));
    println!(
        "{} vertices, missing vector area {:.4?} m²",
        model.points.len(),
        missing_vector_area(&model).as_slice()
    );
    for t in turns(&model, &scene, 0.0)? {
        println!(
            "turn about {:.2?}: lift {:.2?}, span {:.3} m, {:.0}°, gain {:.2}",
            t.axis.as_slice(),
            t.lifted.as_slice(),
            t.span,
            t.angle.to_degrees(),
            t.gain
        );
    }
    let start = std::time::Instant::now();
    let plan = plan(&model, &scene, Action::TurnOver, &PlanOptions::default())?;
    println!(
        "planned in {:.1} ms after {} refusals",
        1e3 * start.elapsed().as_secs_f64(),
        plan.refused.len()
    );
    for r in &plan.refused {
        println!("  refused {:?} {:.3}: {}", r.vertices, r.score, r.reason);
    }
    println!(
        "coverage {:.3}, score {:.3}, {:.1} s to the grips, {:.1} s, {:.1} s home; at most {:.3} m/s",
        plan.coverage,
        plan.score,
        plan.reach.duration,
        plan.motion.duration,
        plan.withdraw.duration,
        plan.speed_limit
    );
    for (grip, path) in plan.grips.iter().zip(&plan.motion.arms) {
        println!(
            "arm {} ({:?}) holds vertex {} until {:.1} s",
            grip.arm, grip.role, grip.vertex, path.release
        );
        for k in path.keyframes.iter().step_by(6) {
            let tip = k.camera_from_tip.translation.vector;
            let z = k.camera_from_tip.rotation * grip_planner::nalgebra::Vector3::z();
            println!(
                "  {:5.2} s  tip {:7.3} {:7.3} {:7.3}   approach {:5.2} {:5.2} {:5.2}",
                k.time, tip.x, tip.y, tip.z, z.x, z.y, z.z
            );
        }
    }
    Ok(())
}
