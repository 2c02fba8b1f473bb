"""What a person watches while the robot moves."""
