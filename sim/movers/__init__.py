"""People and boxes that walk to and fro across the robot's likely way.

What a benchmark with movers is to tell is whether the robot gives way, so the rules are these:

- A mover does not give way to a robot that moves: up to 1.5 m/s it is the robot that must not be in its way.
  From the end of its track, where it stands for some seconds, it does not set out close to the robot, as
  long as its patience lasts. At an end that leaves the robot no room to pass it turns round at once.
- A person stops short of a robot that stands (it takes half a second to see that it does), waits, and turns
  back, as people do: they do not walk into a thing that stands there. Otherwise a robot that has done all it
  can would be hit for as long as it waits.
- A box (a trolley, a machine) does not look. It goes on until it touches, then backs off.
- Nobody is pushed and nothing passes through: who has touched the robot stops there and turns back.

A touch is the robot's contact unless the robot has stood still for the last second; then it is recorded
apart, as struck while standing. That is passive safety: should there be a collision, the robot is at rest
(Bouraine, Fraichard and Salhi, Autonomous Robots 32, 2012). Of the robot's contacts with movers those are
told apart in which the mover had been out of the camera's view for a second: it is for the robot to look, but
no depth image could have shown them. Movers do not meet each other: their tracks keep apart.
"""
