// Pins, encoders and motors: those of the chip, or under QEMU a plant behind the second serial port.
#pragma once

#include "land_types.h"

void board_init(void);

// Read everything; true if it is fresh.
bool board_sample(land_inputs *in, uint32_t now_ms);

void board_drive(const land_outputs *out, uint32_t now_ms);

// Short the motors; for the fault handler, so nothing here may wait.
void board_brake(void);

// Each of the two in its own file.
void pins_init(void);
bool pins_sample(land_inputs *in, uint32_t now_ms);
void pins_drive(const land_outputs *out);
void plant_init(void);
bool plant_sample(land_inputs *in, uint32_t now_ms);
void plant_drive(const land_outputs *out, uint32_t now_ms);
