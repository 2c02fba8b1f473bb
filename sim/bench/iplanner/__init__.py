"""The benchmark's iPlanner: network, fear rule and path follower of Yang et al. (RSS 2023), on land only.

The network is the authors' layer structure at a quarter of their widths and half their image's sides
(320x180, 1.47 M parameters): at the published size it has 53.33 M (213 MB) and takes 124 ms a frame on one
core, so that no comparison at a common planning rate would be left. Loss and weights of its terms are the
published ones; data, camera and robot are ours. Its configuration is `iplanner-320` of
`labr_autonomy.gkpn.networks.presets`; it was trained before the data of today (README, "Training"), by what
the recipe `iplanner` does.
"""
