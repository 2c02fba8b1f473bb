"""A look-alike of PX4 in the GPS-denied case, speaking MAVLink over UDP.

It answers as the recordings of PX4's 1.18 branch do. NED and FRD throughout, as on the wire.
"""

from sim.autopilot.link import AutopilotStandIn

__all__ = ["AutopilotStandIn"]
