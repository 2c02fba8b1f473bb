"""The simulator: worlds, sensors, vehicles and the stand-ins at the real seams."""
