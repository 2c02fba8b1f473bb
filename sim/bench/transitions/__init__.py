"""Hand-overs between wheels and rotors by the hundred, in gusts and on slopes, by the flight's own code.

Each trial stands on an endless slope and drives, stops, lifts off, flies a little, lands and drives on: the
pilot, the hand-over, the estimate, the refiner, the guard, the land controller, the autopilot's stand-in and
the physics are those of a lock-step flight. Camera, map and network are left out unless they are asked for:
on open ground they have little to say and cost most of the time.

JSBSim's own floor is level: a landing body meets it at the height of the slope below its middle, comes to
rest level, and the wheels settle onto the slope from there.
"""
