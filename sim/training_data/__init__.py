"""Training data for GKPN: walks through worlds, what the robot sees and knows on them, goals, and the truth.

`build` makes one scene, `folder` many; `labr_autonomy.gkpn.shards` is the format on disk.
"""
