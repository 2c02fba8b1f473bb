"""The ground channel: wheel speeds out, wheel odometry and the land controller's state in."""
