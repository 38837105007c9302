"""Writes the same session through the `mcap` and `rosbags` packages, with every compression: write.py FOLDER."""

import sys
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

store = get_typestore(Stores.ROS2_KILTED)
t = store.types
FRAMES = 20


def header(k):
    time = t["builtin_interfaces/msg/Time"](sec=k // 10, nanosec=k % 10 * 100_000_000)
    return t["std_msgs/msg/Header"](stamp=time, frame_id="camera")


def messages():
    """(topic, type, time, message); frame k has 500 + k points at (i/8, k, 1)."""
    for k in range(FRAMES):
        time = k * 100_000_000
        count = 500 + k
        xyz = np.zeros((count, 3), dtype=np.float32)
        xyz[:, 0] = np.arange(count) / 8
        xyz[:, 1] = k
        xyz[:, 2] = 1
        field = t["sensor_msgs/msg/PointField"]
        fields = [field(name=n, offset=4 * i, datatype=7, count=1) for i, n in enumerate("xyz")]
        cloud = t["sensor_msgs/msg/PointCloud2"](
            header=header(k), height=1, width=count, fields=fields, is_bigendian=False,
            point_step=12, row_step=12 * count, data=np.frombuffer(xyz.tobytes(), dtype=np.uint8), is_dense=True)
        yield "/cell/points", "sensor_msgs/msg/PointCloud2", time, cloud
        pose = t["geometry_msgs/msg/Pose"](
            position=t["geometry_msgs/msg/Point"](x=0.5, y=float(k), z=0.25),
            orientation=t["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0))
        yield "/PSM1/measured_cp", "geometry_msgs/msg/PoseStamped", time, t["geometry_msgs/msg/PoseStamped"](
            header=header(k), pose=pose)
    yield "/cell/table", "shape_msgs/msg/Plane", 0, t["shape_msgs/msg/Plane"](
        coef=np.array([0.0, 0.0, -1.0, 1.5]))


def definition(name):
    return store.generate_msgdef(name, ros_version=2)[0]


def write_mcap(path, compression):
    with open(path, "wb") as file:
        # Small chunks: several of them, each with several messages.
        writer = McapWriter(file, chunk_size=20_000, compression=compression)
        writer.start(profile="ros2", library="peer")
        channels = {}
        for topic, kind, time, message in messages():
            if topic not in channels:
                schema = writer.register_schema(name=kind, encoding="ros2msg", data=definition(kind).encode())
                channels[topic] = writer.register_channel(topic=topic, message_encoding="cdr", schema_id=schema)
            data = bytes(store.serialize_cdr(message, kind))
            writer.add_message(channels[topic], log_time=time, publish_time=time, data=data)
        writer.finish()


def write_bag(path, mode):
    bag = BagWriter(path, version=9, storage_plugin=StoragePlugin.MCAP)
    if mode != CompressionMode.NONE:
        bag.set_compression(mode, CompressionFormat.ZSTD)
    with bag as writer:
        connections = {}
        for topic, kind, time, message in messages():
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], time, store.serialize_cdr(message, kind))


folder = Path(sys.argv[1])
for name, compression in [("none", CompressionType.NONE), ("lz4", CompressionType.LZ4), ("zstd", CompressionType.ZSTD)]:
    write_mcap(folder / f"mcap_{name}.mcap", compression)
write_bag(folder / "bag_none", CompressionMode.NONE)
write_bag(folder / "bag_zstd", CompressionMode.STORAGE)
# Each message in a compression of its own: not MCAP any more.
write_bag(folder / "bag_message", CompressionMode.MESSAGE)
