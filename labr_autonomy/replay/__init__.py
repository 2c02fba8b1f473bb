"""A recorded flight, decided upon again and compared."""
