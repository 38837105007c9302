"""Clouds of 300,000 points by rclpy: `camera.py write reliable|best_effort`, or `camera.py read COUNT cloud|depth`, which prints a sum of each."""
import sys
import time

import numpy as np
import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image, PointCloud2, PointField

POINTS = 300_000
rclpy.init()
node = rclpy.create_node("camera")


def qos(name):
    return QoSProfile(depth=5, reliability=ReliabilityPolicy[name.upper()])


if sys.argv[1] == "write":
    clouds = node.create_publisher(PointCloud2, "/camera/depth/color/points", qos(sys.argv[2]))
    # As a RealSense lays them out: x, y, z, 4 bytes of nothing, colour.
    table = np.zeros((POINTS, 5), dtype=np.float32)
    table[:, 0] = np.arange(POINTS) / 1024
    table[:, 2] = 0.5
    message = PointCloud2(height=1, width=POINTS, point_step=20, row_step=20 * POINTS, is_dense=True)
    message.fields = [PointField(name=n, offset=o, datatype=PointField.FLOAT32, count=1) for n, o in
                      [("x", 0), ("y", 4), ("z", 8), ("rgb", 16)]]
    message.header.frame_id = "camera_depth_optical_frame"
    number = 0

    def send():
        global number
        number += 1
        table[:, 1] = number
        data = message.data
        message.data = type(data)("B", table.tobytes())
        message.header.stamp = node.get_clock().now().to_msg()
        clouds.publish(message)

    node.create_timer(0.2, send)
    print("ready", flush=True)
    rclpy.spin(node)
else:
    wanted = int(sys.argv[2])
    read = []

    def take(message):
        xyz = np.frombuffer(message.data, dtype=np.float32).reshape(-1, message.point_step // 4)[:, :3]
        read.append(f"{message.width} {xyz.sum(axis=0, dtype=np.float64).tolist()}")

    def take_image(message):
        depths = np.frombuffer(message.data, dtype=np.uint16)
        read.append(f"{message.width} {message.height} {message.encoding} {depths.sum(dtype=np.int64)}")

    if sys.argv[3] == "cloud":
        node.create_subscription(PointCloud2, "/camera/depth/color/points", take, qos("reliable"))
    else:
        node.create_subscription(Image, "/camera/depth/image_rect_raw", take_image, qos("reliable"))
    print("ready", flush=True)
    end = time.monotonic() + 40
    while len(read) < wanted and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
    print("\n".join(read), flush=True)
