// The independent watchdog: its own oscillator, and nothing stops it once it runs.
#pragma once

void watchdog_start(void);
void watchdog_feed(void);
