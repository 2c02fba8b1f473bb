"""From depth images to maps: the frame slot, the rolling map and its distance fields."""
