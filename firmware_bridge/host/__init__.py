"""The controller's C core as a library on this computer, for tests and benches."""
