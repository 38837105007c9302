"""Practises on the soft tissue of `explore serve` with rclpy and CRTK messages: homes PSM1, reads it, streams set-points, moves it, uses its
jaw, and looks at a depth image. `practise.py [ARM]`; ROS 2 and crtk_msgs are needed (dvrk-io/tests/ros2/install.sh makes both from PyPI).
"""
import sys
import time

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from crtk_msgs.msg import OperatingState, StringStamped
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import Image, JointState

arm = sys.argv[1] if len(sys.argv) > 1 else "PSM1"
rclpy.init()
node = rclpy.create_node("practise")
latched = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
reliable = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
last = {}


def read(kind, topic, qos=reliable):
    node.create_subscription(kind, topic, lambda message: last.__setitem__(topic, message), qos)
    return lambda: last.get(topic)


state = read(OperatingState, f"/{arm}/operating_state", latched)
measured = read(PoseStamped, f"/{arm}/measured_cp")
setpoint = read(PoseStamped, f"/{arm}/setpoint_cp")
joints = read(JointState, f"/{arm}/measured_js")
jaw = read(JointState, f"/{arm}/jaw/measured_js")
image = read(Image, "/camera/depth/image_rect_raw")
state_command = node.create_publisher(StringStamped, f"/{arm}/state_command", reliable)
servo_cp = node.create_publisher(PoseStamped, f"/{arm}/servo_cp", reliable)
move_cp = node.create_publisher(PoseStamped, f"/{arm}/move_cp", reliable)
jaw_servo = node.create_publisher(JointState, f"/{arm}/jaw/servo_jp", reliable)


def wait(what, condition, seconds=20.0):
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            sys.exit(f"{what}: not within {seconds} s; {state()}")
        rclpy.spin_once(node, timeout_sec=0.02)


def spin(seconds):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.002)


def depth():
    return -measured().pose.position.z


wait("streams", lambda: all((state(), measured(), setpoint(), joints(), jaw())))
wait("listeners", lambda: all(p.get_subscription_count() for p in (state_command, servo_cp, move_cp, jaw_servo)))
for command, done in [("enable", lambda: state().state == "ENABLED"), ("home", lambda: state().is_homed)]:
    state_command.publish(StringStamped(string=command))
    wait(command, lambda: done() and not state().is_busy)
# Poses of an arm without power are not measured: their stamps are 0.
wait("a measured pose", lambda: measured().header.stamp.sec > 0 and setpoint().header.stamp.sec > 0 and joints().header.stamp.sec > 0)
print(f"{arm} is homed, its tip {1e3 * depth():.1f} mm below the remote centre, joints {[round(q, 3) for q in joints().position]}")

start = setpoint().pose
goal = PoseStamped(pose=start)
for k in range(1, 41):
    # 0.5 mm at 100 Hz: 50 mm/s.
    goal.pose.position.z = -0.0005 + goal.pose.position.z
    servo_cp.publish(goal)
    spin(0.01)
reached = goal.pose.position.z
wait("servo_cp", lambda: abs(measured().pose.position.z - reached) < 1e-4)
print(f"20 mm down by servo_cp: {1e3 * depth():.1f} mm")

goal.pose.position.z = reached + 0.02
move_cp.publish(goal)
wait("move_cp", lambda: abs(measured().pose.position.z - goal.pose.position.z) < 1e-4 and not state().is_busy)
print(f"and back by move_cp: {1e3 * depth():.1f} mm")

# Nothing is between the fingers here: the jaw closes as far as it is sent.
jaw_servo.publish(JointState(position=[0.0]))
wait("a closed jaw", lambda: abs(jaw().position[0]) < 1e-3)
jaw_servo.publish(JointState(position=[1.0]))
wait("an open jaw", lambda: abs(jaw().position[0] - 1.0) < 1e-3)
print("the jaw closed and opened")

wait("a depth image", image)
shown = image()
near = min(pixel for pixel in memoryview(bytes(shown.data)).cast("H") if pixel)
print(f"depth image {shown.width} x {shown.height} {shown.encoding} in {shown.header.frame_id}, nearest {near} mm")
