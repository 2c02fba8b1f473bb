"""A look-alike of ArduCopter in GUIDED without GPS, by the recorded flight `ap_ev` of ArduCopter 4.7.

Kept from the recording: its mode numbers and base modes, heartbeats at once after a change of mode, FAILED
with a text after it for an arming that its checks refuse, silence on an unknown parameter, parameters as
plain floats, DENIED with a text for a message that it does not send, the origin that it wants before it fuses
poses, 4 s of spinning up before it leaves the floor, LAND and disarming by itself, SIM_STATE on request.
"""

from sim.autopilot.copter.vehicle import Copter

__all__ = ["Copter"]
