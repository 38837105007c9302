"""Reads a session that dvrk-io wrote through `mcap` and `rosbags`: read.py FILE.mcap COMPRESSION. Prints one line a
message (topic, time, and a number that depends on all of it), first as `mcap` reads it, then as `rosbags` does."""

import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np
from mcap.reader import NonSeekingReader, make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

path, compression = Path(sys.argv[1]), sys.argv[2]
store = get_typestore(Stores.ROS2_KILTED)

METADATA = """rosbag2_bagfile_information:
  version: 5
  storage_identifier: mcap
  duration: {nanoseconds: 1}
  starting_time: {nanoseconds_since_epoch: 0}
  message_count: MESSAGES
  topics_with_message_count:
TOPICS  compression_format: ''
  compression_mode: ''
  relative_file_paths: [session.mcap]
  files: []
"""

TOPIC = """    - topic_metadata: {name: %s, type: %s, serialization_format: cdr, offered_qos_profiles: ''}
      message_count: %d
"""


def number(kind, message):
    if kind.endswith("PointCloud2"):
        values = np.frombuffer(message.data.tobytes(), dtype=np.float32).astype(np.float64)
        assert message.width * 3 == len(values)
    elif kind.endswith("PoseStamped"):
        p, q = message.pose.position, message.pose.orientation
        values = np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w])
    elif kind.endswith("JointState"):
        values = np.array(message.position)
    else:
        values = np.array(message.coef)
    return float((values * np.arange(1, len(values) + 1)).sum())


with open(path, "rb") as file:
    summary = make_reader(file).get_summary()
    chunks = summary.chunk_indexes
    assert chunks and {chunk.compression for chunk in chunks} == {compression}, chunks
    assert summary.statistics.message_count == sum(summary.statistics.channel_message_counts.values())
    assert summary.statistics.chunk_count == len(chunks)

rows = {}
for name, reader in [("seeking", make_reader), ("streaming", NonSeekingReader)]:
    with open(path, "rb") as file:
        lines = []
        for schema, channel, message in reader(file, validate_crcs=True).iter_messages(log_time_order=False):
            value = number(schema.name, store.deserialize_cdr(message.data, schema.name))
            lines.append(f"{channel.topic} {message.log_time} {value!r}")
        rows[name] = sorted(lines)
assert rows["seeking"] == rows["streaming"]
assert len(rows["seeking"]) == summary.statistics.message_count
print("\n".join(rows["seeking"]))
print("rosbags")

with tempfile.TemporaryDirectory() as folder:
    shutil.copy(path, Path(folder) / "session.mcap")
    channels = summary.channels.values()
    counts = summary.statistics.channel_message_counts
    topics = "".join(TOPIC % (c.topic, summary.schemas[c.schema_id].name, counts[c.id]) for c in channels)
    metadata = METADATA.replace("TOPICS", topics).replace("MESSAGES", str(sum(counts.values())))
    (Path(folder) / "metadata.yaml").write_text(metadata)
    with AnyReader([Path(folder)]) as reader:
        lines = []
        for connection, time, data in reader.messages():
            value = number(connection.msgtype, reader.deserialize(data, connection.msgtype))
            lines.append(f"{connection.topic} {time} {value!r}")
print("\n".join(sorted(lines)))
