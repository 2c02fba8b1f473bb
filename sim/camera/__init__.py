"""The depth camera: images of the world from the true pose, with a D435i's flaws."""
