"""How long the robot's links take, measured over the links that a simulated flight uses."""
