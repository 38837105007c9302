"""Round trips of a pose, 100 a second: `round_trip.py echo` sends back, `round_trip.py ask COUNT` prints milliseconds a trip."""
import sys
import time

import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from geometry_msgs.msg import PoseStamped

rclpy.init()
node = rclpy.create_node(sys.argv[1])
qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
if sys.argv[1] == "echo":
    back = node.create_publisher(PoseStamped, "/back", qos)
    node.create_subscription(PoseStamped, "/there", back.publish, qos)
    print("ready", flush=True)
    rclpy.spin(node)
else:
    there = node.create_publisher(PoseStamped, "/there", qos)
    seen = []
    node.create_subscription(PoseStamped, "/back", lambda m: seen.append((m.header.frame_id, time.perf_counter())), qos)
    while there.get_subscription_count() == 0 or node.count_publishers("/back") == 0:
        rclpy.spin_once(node, timeout_sec=0.05)
    message = PoseStamped()
    trips = []
    for number in range(int(sys.argv[2]) + 50):
        message.header.frame_id = str(number)
        start = time.perf_counter()
        there.publish(message)
        while time.perf_counter() < start + 0.01:
            rclpy.spin_once(node, timeout_sec=max(0.0, start + 0.01 - time.perf_counter()))
        for name, stamp in seen:
            # The first ones are those of two programs that get to know each other.
            if name == str(number) and number >= 50:
                trips.append(1e3 * (stamp - start))
        seen.clear()
    print("\n".join(f"{trip:.4f}" for trip in trips), flush=True)
