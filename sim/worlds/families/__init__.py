"""Generated worlds after the paper's four test sites. Same family, seed, size and difficulty: same world.

A family returns a `Layout`: structure that is always there, and furnishings, each of which is left out when
it would stand in a place that a mission keeps free.
"""
