"""The mission file and the executive that carries it out."""
