//! Recording and replay: a session is an MCAP file with ROS 2 messages.
//!
//! | topic | type | content |
//! |---|---|---|
//! | `/cell/points` | sensor_msgs/PointCloud2 | segmented cloud of the object, one message a frame |
//! | `/cell/camera` | geometry_msgs/PoseStamped | pose of a camera that moves |
//! | `/cell/table` | shape_msgs/Plane | a·x + d ≥ 0 on the free side of the table |
//! | `/PSM1/measured_cp` … | geometry_msgs/PoseStamped | tip pose of an arm |
//! | `/PSM1/jaw/measured_js` … | sensor_msgs/JointState | jaw angle of an arm, 0 = closed |
//! | `/truth/points` | sensor_msgs/PointCloud2 | true positions of the material points, in simulations |
//!
//! Everything is in the frame of the camera, in metres and radians. If the camera moves, its clouds are in its frame at their time, and
//! arms, table and truth are in the fixed frame of its poses. Each cloud makes a [`Frame`], which has the sample of each arm that is
//! closest in time, if that lies within the tolerance ([`SessionReader::tolerance`]). An arm without pose in a frame was not measured then;
//! simulations publish poses only while the arm holds.
//!
//! Unsegmented data of a camera, clouds or depth images of everything in view, are read by [`SessionReader::scans`]:
//!
//! | topic | type | content |
//! |---|---|---|
//! | `/camera/camera/depth/image_rect_raw` | sensor_msgs/Image | depth, 16UC1 or 32FC1 |
//! | `/camera/camera/depth/camera_info` | sensor_msgs/CameraInfo | camera parameters of these images |
//! | `/PSM1/measured_js` … | sensor_msgs/JointState | joint values of an arm |
//! | `/PSM1/jaw/measured_js`, `/PSM1/jaw/setpoint_js` … | sensor_msgs/JointState | measured and commanded jaw angle |
//!
//! **The ground truth is not part of a session.** It is read by the separate function [`read_truth`], so that code that is
//! given frames has no access to it.

mod chunk;
mod compression;
mod container;
mod fields;
mod frame;
mod frames;
mod index;
mod reader;
mod scan;
mod scans;
mod schema;
mod skipped;
mod source;
mod topic;
mod walk;
mod writer;

pub use compression::Compression;
pub use frame::{ArmSample, Frame, RecordedScan, Session, TopicCount, Truth, TruthFrame};
pub use frames::Frames;
pub use reader::{SessionReader, read_truth, read_truth_from_bytes};
pub use scans::Scans;
pub use skipped::{Skip, Skipped};
pub use topic::Role;
pub(crate) use topic::check_arm_name;
pub use writer::{SessionWriter, WriterOptions};
