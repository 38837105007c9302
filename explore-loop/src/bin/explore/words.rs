//! Text for a plan.

use grip_planner::Plan;

/// A plan in one line.
pub fn of_plan(plan: &Plan) -> String {
    let arms: Vec<String> = plan
        .grips
        .iter()
        .map(|g| format!("arm {} at vertex {}", g.arm, g.vertex))
        .collect();
    let action = match (plan.turn.is_some(), plan.across.is_some()) {
        (true, true) => "turn over and stretch",
        (false, _) => "stretch",
        (true, false) => "turn over",
    };
    format!(
        "{action}: {}; coverage {:.2}, score {:.2}, at most {:.0} mm/s, {:.1} s",
        arms.join(", "),
        plan.coverage,
        plan.score,
        1e3 * plan.speed_limit,
        plan.motion.duration
    )
}
