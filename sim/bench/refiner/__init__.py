"""Random problems for the refiner, and an independent judge of what it answers."""
