"""A CRTK client by rclpy: enables, homes, reads and moves an arm with the messages of a dVRK, and checks what comes back."""
import sys
import time

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from crtk_msgs.msg import OperatingState, StringStamped
from geometry_msgs.msg import PoseStamped, TwistStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Empty, String

dialect = sys.argv[1]
text = String if dialect == "robot" else StringStamped
rclpy.init()
node = rclpy.create_node("client")
latched = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
reliable = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
last, stamps, said, goals = {}, [], [], []


def keep(topic):
    def callback(message):
        last[topic] = message
        if topic == "measured_cp":
            stamps.append(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)
    return callback


for kind, topic, qos in [
        (PoseStamped, "measured_cp", reliable), (PoseStamped, "setpoint_cp", reliable), (PoseStamped, "local/measured_cp", reliable),
        (TwistStamped, "measured_cv", reliable), (JointState, "measured_js", reliable), (JointState, "setpoint_js", reliable),
        (JointState, "jaw/measured_js", reliable), (JointState, "jaw/setpoint_js", reliable),
        (OperatingState, "operating_state", latched), (String, "tool_type", latched)]:
    node.create_subscription(kind, f"/PSM1/{topic}", keep(topic), qos)
for topic in ("error", "warning"):
    node.create_subscription(text, f"/PSM1/{topic}", lambda m: said.append(getattr(m, "data", None) or m.string), reliable)
node.create_subscription(Bool, "/PSM1/goal_reached", lambda m: goals.append(m.data), reliable)
state_command = node.create_publisher(StringStamped, "/PSM1/state_command", reliable)
servo_cp = node.create_publisher(PoseStamped, "/PSM1/servo_cp", reliable)
move_cp = node.create_publisher(PoseStamped, "/PSM1/move_cp", reliable)
jaw_servo = node.create_publisher(JointState, "/PSM1/jaw/servo_jp", reliable)
jaw_move = node.create_publisher(JointState, "/PSM1/jaw/move_jp", reliable)
hold = node.create_publisher(Empty, "/PSM1/hold", reliable)


def spin(seconds):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.005)


def wait(what, condition, seconds=10.0):
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            sys.exit(f"{what}: not within {seconds} s; state {last.get('operating_state')}, said {said}")
        rclpy.spin_once(node, timeout_sec=0.02)


def state():
    return last["operating_state"]


wait("streams", lambda: len(last) == 10)
wait("listeners", lambda: all(p.get_subscription_count() for p in (state_command, servo_cp, move_cp, jaw_servo, jaw_move, hold)))
if dialect == "robot":
    assert state().state == "DISABLED" and last["measured_cp"].header.stamp.sec == 0, "not measured before it is powered"
    state_command.publish(StringStamped(string="home"))
    wait("warning", lambda: any("not supported" in word for word in said))
    state_command.publish(StringStamped(string="enable"))
    wait("enable", lambda: state().state == "ENABLED" and not state().is_busy)
    state_command.publish(StringStamped(string="home"))
wait("home", lambda: state().is_homed and not state().is_busy)
assert last["tool_type"].data.startswith("LARGE_NEEDLE_DRIVER")
spin(0.3)
assert last["measured_js"].name == ["yaw", "pitch", "insertion", "roll", "wrist_pitch", "wrist_yaw"]
assert abs(last["measured_js"].position[2] - 0.12) < 1e-9
start = last["setpoint_cp"]
expected = -0.1135 if dialect == "robot" else -0.1237
assert abs(start.pose.position.z - expected) < 1e-9, start

# A stream of set-points, 1 mm in each, with the jaw.
for k in range(1, 21):
    goal = PoseStamped(pose=start.pose)
    goal.pose.position.x = 0.001 * k
    servo_cp.publish(goal)
    jaw_servo.publish(JointState(position=[0.02 * k]))
    spin(0.01)
spin(0.2)
assert abs(last["measured_cp"].pose.position.x - 0.02) < 1e-9, last["measured_cp"]
assert abs(last["jaw/measured_js"].position[0] - 0.4) < 1e-9

# A trajectory: busy rises and falls, the goal is reached.
goals.clear()
goal.pose.position.x = 0.0
goal.pose.position.y = 0.03
move_cp.publish(goal)
wait("busy", lambda: state().is_busy, 3.0)
wait("goal", lambda: goals == [True] and not state().is_busy)
spin(0.1)
assert abs(last["measured_cp"].pose.position.y - 0.03) < 1e-9 and abs(last["measured_cp"].pose.position.x) < 1e-9

# Held in the middle of the next one.
goals.clear()
goal.pose.position.y = -0.03
move_cp.publish(goal)
wait("busy", lambda: state().is_busy, 3.0)
spin(0.2)
hold.publish(Empty())
wait("hold", lambda: goals == [False] and not state().is_busy, 3.0)
jaw_move.publish(JointState(position=[0.0]))
wait("jaw", lambda: abs(last["jaw/measured_js"].position[0]) < 1e-9, 3.0)

# The rhythm of the robot, by its own stamps: this program may be late.
stamps.clear()
spin(1.0)
gaps = sorted(b - a for a, b in zip(stamps, stamps[1:]))
gap = gaps[len(gaps) // 2]
assert 0.008 <= gap <= 0.0125, f"{1e3 * gap:.1f} ms between two poses"
print(f"homed, moved and read: {1 / gap:.0f} poses/s")
