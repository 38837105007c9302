//! The names of a PSM's topics.

/// Builds the names of one arm.
#[derive(Debug, Clone)]
pub(crate) struct Names(String);

impl Names {
    pub(crate) fn new(arm: &str) -> Self {
        Self(format!("/{arm}"))
    }

    pub(crate) fn of(&self, topic: &str) -> String {
        format!("{}/{topic}", self.0)
    }
}

pub(crate) const OPERATING_STATE: &str = "operating_state";
pub(crate) const STATE_COMMAND: &str = "state_command";
pub(crate) const MEASURED_CP: &str = "measured_cp";
pub(crate) const SETPOINT_CP: &str = "setpoint_cp";
pub(crate) const LOCAL_MEASURED_CP: &str = "local/measured_cp";
pub(crate) const LOCAL_SETPOINT_CP: &str = "local/setpoint_cp";
pub(crate) const MEASURED_CV: &str = "measured_cv";
pub(crate) const MEASURED_JS: &str = "measured_js";
pub(crate) const SETPOINT_JS: &str = "setpoint_js";
pub(crate) const JAW_MEASURED_JS: &str = "jaw/measured_js";
pub(crate) const JAW_SETPOINT_JS: &str = "jaw/setpoint_js";
pub(crate) const SERVO_CP: &str = "servo_cp";
pub(crate) const MOVE_CP: &str = "move_cp";
pub(crate) const JAW_SERVO_JP: &str = "jaw/servo_jp";
pub(crate) const JAW_MOVE_JP: &str = "jaw/move_jp";
pub(crate) const HOLD: &str = "hold";
pub(crate) const ERROR: &str = "error";
pub(crate) const WARNING: &str = "warning";
pub(crate) const STATUS: &str = "status";
/// What simulators call their status.
pub(crate) const INFO: &str = "info";
pub(crate) const GOAL_REACHED: &str = "goal_reached";
pub(crate) const ARM_CLUTCH: &str = "arm_clutch";
pub(crate) const TOOL_TYPE: &str = "tool_type";
/// In the namespace of the console.
pub(crate) const TELEOP_ENABLED: &str = "teleop/enabled";

/// Topics whose publishers can move the arm.
pub(crate) const MOVES_THE_ARM: [&str; 13] = [
    SERVO_CP,
    MOVE_CP,
    JAW_SERVO_JP,
    JAW_MOVE_JP,
    "servo_cr",
    "servo_cs",
    "servo_jp",
    "servo_jr",
    "servo_jf",
    "move_jp",
    "move_jr",
    "jaw/servo_jf",
    "free",
];
