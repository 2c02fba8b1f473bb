"""The air channel: MAVLink through MAVSDK. The only room that knows NED and FRD."""
