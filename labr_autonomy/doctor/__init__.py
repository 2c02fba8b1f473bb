"""`labr-mission doctor`: everything that must be right before a flight, looked at without moving anything."""
