"""One pose with covariance out of visual-inertial odometry, the autopilot's IMU and the wheels."""
