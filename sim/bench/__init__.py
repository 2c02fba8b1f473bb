"""Benchmarks of navigation: tasks, methods, runs, tables and pictures."""
