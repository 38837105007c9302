//! Non-rigid registration of one live point cloud onto the next, by landmarks, features and closest points
