//! odometry
