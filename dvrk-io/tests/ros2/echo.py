"""Sends back on /out/NAME what comes on /in/NAME, through the type support of rclpy, for every type that is used."""
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from crtk_msgs.msg import OperatingState, StringStamped
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from sensor_msgs.msg import CameraInfo, Image, JointState, Joy, PointCloud2
from std_msgs.msg import Bool, Empty, Float64, String

rclpy.init()
node = rclpy.create_node("echo")
qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
kept = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
for kind in [PoseStamped, TwistStamped, WrenchStamped, JointState, Joy, String, Bool, Empty, Float64, PointCloud2, Image,
             CameraInfo, OperatingState, StringStamped]:
    out = node.create_publisher(kind, f"/out/{kind.__name__}", kept)
    node.create_subscription(kind, f"/in/{kind.__name__}", out.publish, qos)
print("ready", flush=True)
rclpy.spin(node)
