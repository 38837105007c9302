"""A PSM by rclpy, with the topics, types and qualities of service of a dVRK. It moves along its shaft only.

Words on its standard input make things happen: fault, error, silent, speak, tool, notool, teleop, quit.
Options: --best-effort (periodic topics), --wrong-type (measured_cp is a TransformStamped), --volatile (operating_state is not latched).
"""
import sys
import threading

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from crtk_msgs.msg import OperatingState, StringStamped
from geometry_msgs.msg import PoseStamped, TransformStamped, TwistStamped
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, Empty, String

flags = set(sys.argv[1:])
rclpy.init()
node = rclpy.create_node("robot")
reliability = ReliabilityPolicy.BEST_EFFORT if "--best-effort" in flags else ReliabilityPolicy.RELIABLE
periodic = QoSProfile(depth=100, reliability=reliability)
latched = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
command = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)


def publisher(kind, topic, qos):
    return node.create_publisher(kind, f"/PSM1/{topic}", qos)


pose_type = TransformStamped if "--wrong-type" in flags else PoseStamped
measured_cp = publisher(pose_type, "measured_cp", periodic)
setpoint_cp = publisher(PoseStamped, "setpoint_cp", periodic)
local_cp = publisher(PoseStamped, "local/measured_cp", periodic)
measured_cv = publisher(TwistStamped, "measured_cv", periodic)
measured_js = publisher(JointState, "measured_js", periodic)
jaw_js = publisher(JointState, "jaw/measured_js", periodic)
jaw_setpoint = publisher(JointState, "jaw/setpoint_js", periodic)
operating_state = publisher(OperatingState, "operating_state", command if "--volatile" in flags else latched)
errors = publisher(String, "error", latched)
warnings = publisher(String, "warning", latched)
tool_type = publisher(String, "tool_type", latched)
clutch = publisher(Joy, "arm_clutch", latched)
teleop = node.create_publisher(Bool, "/console/teleop/enabled", latched)


class Arm:
    state, homed, busy_until, next_step = "DISABLED", False, None, None
    z, jaw, tool, silent = -0.1135, 0.0, True, False


arm = Arm()


def now():
    return node.get_clock().now().nanoseconds * 1e-9


def publish_state():
    homed = arm.homed and arm.tool
    message = OperatingState(state=arm.state, is_homed=homed, is_busy=arm.busy_until is not None)
    message.header.stamp = node.get_clock().now().to_msg()
    operating_state.publish(message)


def busy(seconds, then):
    arm.busy_until, arm.next_step = now() + seconds, then
    publish_state()


def powered():
    arm.state = "ENABLED"


def is_homed():
    arm.homed = True


def on_command(message):
    word = message.string
    if word == "enable" and arm.state in ("DISABLED", "FAULT"):
        arm.state = "DISABLED"
        busy(0.3, powered)
    elif word == "home" and arm.state == "ENABLED":
        busy(0.3, is_homed)
    elif word == "disable":
        arm.state = "DISABLED"
        publish_state()
    elif word != "enable":
        warnings.publish(String(data=f'PSM1: command "{word}" is not supported in state "{arm.state}"'))


def ready(name):
    if arm.state == "ENABLED" and arm.tool:
        return True
    warnings.publish(String(data=f"PSM1: {name}, arm not ready"))
    return False


def on_servo(message):
    if ready("servo_cp"):
        arm.z = message.pose.position.z


def on_move(message):
    if ready("move_cp"):
        goal = message.pose.position.z

        def arrive():
            arm.z = goal

        busy(0.5, arrive)


def on_jaw(message):
    if ready("jaw/servo_jp"):
        arm.jaw = message.position[0]


def subscribe(kind, topic, callback):
    node.create_subscription(kind, f"/PSM1/{topic}", callback, command)


subscribe(StringStamped, "state_command", on_command)
subscribe(PoseStamped, "servo_cp", on_servo)
subscribe(PoseStamped, "move_cp", on_move)
subscribe(JointState, "jaw/servo_jp", on_jaw)
subscribe(Empty, "hold", lambda _: print("hold", flush=True))


def tick():
    if arm.busy_until is not None and now() >= arm.busy_until:
        arm.busy_until = None
        arm.next_step()
        publish_state()
    if arm.silent:
        return
    valid = arm.state != "DISABLED"
    stamp = node.get_clock().now().to_msg() if valid else PoseStamped().header.stamp
    pose = PoseStamped()
    pose.header.stamp, pose.header.frame_id = stamp, "PSM1_base"
    # R = [[0, 1, 0], [1, 0, 0], [0, 0, -1]]: a half turn about (1, 1, 0).
    half = 0.5 ** 0.5
    pose.pose.orientation.x, pose.pose.orientation.y, pose.pose.orientation.w = half, half, 0.0
    pose.pose.position.z = arm.z
    measured_cp.publish(TransformStamped() if pose_type is TransformStamped else pose)
    setpoint_cp.publish(pose)
    local_cp.publish(pose)
    twist = TwistStamped()
    twist.header.stamp = stamp
    measured_cv.publish(twist)
    joints = JointState(name=["yaw", "pitch", "insertion", "roll", "wrist_pitch", "wrist_yaw"])
    joints.header.stamp = stamp
    joints.position = [0.0, 0.0, 0.0065 - arm.z, 0.0, 0.0, 0.0]
    measured_js.publish(joints)
    jaw = JointState(name=["jaw"], position=[arm.jaw])
    jaw.header.stamp = stamp
    jaw_js.publish(jaw)
    jaw_setpoint.publish(jaw)


def listen():
    for line in sys.stdin:
        word = line.strip()
        if word == "fault":
            errors.publish(String(data="PSM1: received [PSM1_PID: tracking error]"))
            arm.state = "FAULT"
            publish_state()
        elif word == "error":
            errors.publish(String(data="PSM1: something of the past"))
        elif word in ("silent", "speak"):
            arm.silent = word == "silent"
        elif word in ("tool", "notool"):
            arm.tool = word == "tool"
            tool_type.publish(String(data="LARGE_NEEDLE_DRIVER:420006" if arm.tool else ""))
            publish_state()
        elif word == "teleop":
            teleop.publish(Bool(data=True))
        print(f"done {word}", flush=True)


publish_state()
tool_type.publish(String(data="LARGE_NEEDLE_DRIVER:420006"))
clutch.publish(Joy(buttons=[0]))
node.create_timer(0.01, tick)
threading.Thread(target=listen, daemon=True).start()
print("ready", flush=True)
rclpy.spin(node)
