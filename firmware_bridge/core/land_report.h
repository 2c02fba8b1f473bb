// What the controller tells by itself.
#pragma once

#include "land_controller.h"

// Send state and heartbeat if they are due.
void land_report(land_controller *c);
void land_report_identity(land_controller *c, uint32_t nonce);
void land_report_log(land_controller *c, uint8_t severity, const char *text);
