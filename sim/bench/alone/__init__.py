"""A planning network alone in the loop: its key points as a spline, and nothing that could save it.

As in the paper's Table I: no map of obstacles, no refiner, no way round and no recovery; what a network is
worth by itself, and what its loss cannot tell. Pilot, hand-over, limits and physics are the flight's own.
"""
