"""How the planning networks learn: from shards of views to a weights' folder. Needs the `train` extra.

`views` holds the data, `truth` tells how far a place is from what hinders, `cost` and `iplanner_cost` judge
paths by it, `teacher` finds the paths that cost least, `step` and `train` are the loop, `figures` and
`calibration` say how good a network is and how much its mu can be trusted, `export` writes it out.
"""
