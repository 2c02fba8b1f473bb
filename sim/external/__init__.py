"""An autopilot that somebody else has started: its flight moves our robot, our rover moves it on the floor.

    executive <-> bridge <-> autopilot (PX4 SITL with SIH or Gazebo, ArduPilot SITL) in its own simulator
                    ^ its ground truth (HIL_STATE_QUATERNION, SIM_STATE, SIMSTATE)
                    v
                  plant: world, camera, wheels, VIO

The autopilot's own simulator stands still while our rover drives, so the two worlds are laid over each other
by an `Alignment` (a turn about the vertical and a shift). While the rotors are off, the rover moves the robot
and the alignment follows it; from arming to disarming the alignment is frozen and the autopilot's truth moves
the robot. The bridge turns every pose, set-point and position that passes by the alignment of the moment, and
adds what the rover's motion does to an accelerometer and a gyroscope: both ends see one robot.
"""
