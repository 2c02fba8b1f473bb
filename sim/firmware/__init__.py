"""The land controller's own firmware in an emulated STM32, in place of its twin."""
