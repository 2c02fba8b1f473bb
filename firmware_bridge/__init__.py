"""The wire to the land controller (STM32): dialect, framing, link and serial port."""
