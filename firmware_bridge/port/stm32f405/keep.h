// What outlives a reset, in RAM that nothing clears: boot count, emergency stop, parameters.
#pragma once

#include "land_controller.h"

// Fill `boot` from what was kept, or with a first boot's values after a loss of power. What was damaged though
// the power stayed on counts as an emergency stop.
void keep_load(land_boot *boot);

// Remember what changed.
void keep_save(const land_controller *c);

// The processor faulted; the next boot says so.
void keep_note_fault(void);
