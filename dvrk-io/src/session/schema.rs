//! The message definitions stored in a session file, with which any reader can decode it.
//!
//! The encoding `ros2msg` is the text of the `.msg` file, followed by the text of every type it contains, each
//! after a line of `=` and a line `MSG: package/Name`. The type hashes (REP 2016) are those of the same
//! definitions in ROS 2; recorders store them so that `ros2 bag play` can compare them with its own.

use crate::cdr::{JointState, Message, Plane, PointCloud2, PoseStamped};

/// Separates a definition from the next, with the name of the next.
macro_rules! then {
    ($name:literal) => {
        concat!("================================================================================\nMSG: ", $name, "\n")
    };
}

macro_rules! header {
    () => {
        concat!(
            then!("std_msgs/Header"),
            "builtin_interfaces/Time stamp\nstring frame_id\n",
            then!("builtin_interfaces/Time"),
            "int32 sec\nuint32 nanosec\n",
        )
    };
}

const POINT_CLOUD: &str = concat!(
    "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\n",
    "bool is_bigendian\nuint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n",
    header!(),
    then!("sensor_msgs/PointField"),
    "uint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\nuint8 INT32=5\nuint8 UINT32=6\n",
    "uint8 FLOAT32=7\nuint8 FLOAT64=8\nstring name\nuint32 offset\nuint8 datatype\nuint32 count\n",
);

const POSE: &str = concat!(
    "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
    header!(),
    then!("geometry_msgs/Pose"),
    "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    then!("geometry_msgs/Point"),
    "float64 x\nfloat64 y\nfloat64 z\n",
    then!("geometry_msgs/Quaternion"),
    "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
);

const JOINTS: &str = concat!(
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
    header!(),
);

/// Definition and hash of one type.
pub(super) struct Schema {
    pub(super) type_name: &'static str,
    pub(super) definition: &'static str,
    pub(super) hash: &'static str,
}

/// Every type a session contains.
pub(super) const SCHEMAS: [Schema; 4] = [
    Schema {
        type_name: PointCloud2::TYPE,
        definition: POINT_CLOUD,
        hash: "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
    },
    Schema {
        type_name: PoseStamped::TYPE,
        definition: POSE,
        hash: "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
    },
    Schema {
        type_name: JointState::TYPE,
        definition: JOINTS,
        hash: "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    },
    Schema {
        type_name: Plane::TYPE,
        definition: "float64[4] coef\n",
        hash: "RIHS01_dfbfe8314689c850615d4a727af017e9aa86c10e369a606c8c851ef8f16c58c8",
    },
];
