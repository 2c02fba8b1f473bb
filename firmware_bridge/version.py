"""Version of the land controller's firmware and of its twin: major, minor, patch."""

FIRMWARE = (1, 1, 0)
