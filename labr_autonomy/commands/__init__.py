"""Commands of `labr-mission` that are more than a few lines. Only click is imported at the top of each."""
