//! Tracks the hidden surface of a soft object: sparse Kalman filter over a surface graph, with table and self-intersection constraints
