"""The planning networks, chosen by configuration: iPlanner, its two changes apart and together, and ours.

`config` says what a network is made of, `presets` names the ones in use, `planner` puts one together from
`perception` (the image to features O_t) and `planning` (features and a goal to key points).
"""
