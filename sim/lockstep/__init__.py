"""A whole flight on a simulated clock: the flight's own code, the simulator's own physics, no links."""
