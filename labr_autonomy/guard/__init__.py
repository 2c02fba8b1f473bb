"""Pure checks on every set-point and link: limits, fences, ages, the failsafe table."""
