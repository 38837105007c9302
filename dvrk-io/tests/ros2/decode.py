"""Decodes a cloud in CDR with rosbags and numpy into N x 3 doubles, as often as it is told: prints milliseconds a time, and a sum."""
import sys
import time

import numpy as np
from rosbags.typesys import Stores, get_typestore

store = get_typestore(Stores.ROS2_JAZZY)
raw = open(sys.argv[1], "rb").read()
times = []
for _ in range(int(sys.argv[2])):
    start = time.perf_counter()
    cloud = store.deserialize_cdr(raw, "sensor_msgs/msg/PointCloud2")
    offsets = [next(f.offset for f in cloud.fields if f.name == name) for name in "xyz"]
    kind = np.dtype({"names": ["x", "y", "z"], "formats": ["<f4"] * 3, "offsets": offsets, "itemsize": cloud.point_step})
    table = cloud.data.view(kind)
    points = np.stack([table[name] for name in "xyz"], axis=1).astype(np.float64)
    times.append(1e3 * (time.perf_counter() - start))
print(f"{sorted(times)[len(times) // 2]:.4f} {points.sum():.6e}")
