"""The benchmark's iPlanner: network, fear rule and path follower of Yang et al. (RSS 2023), on land only."""
