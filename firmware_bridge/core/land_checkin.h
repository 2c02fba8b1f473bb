// The watchdog is fed only when every part of the firmware has reported since it was fed last.
#pragma once

#include <stdbool.h>
#include <stdint.h>

typedef enum {
    LAND_PART_BOARD = 1,      // pins and encoders were read anew
    LAND_PART_RECEIVE = 2,    // what had come from the computer was read
    LAND_PART_CONTROL = 4,    // gate and wheels were stepped
    LAND_PART_TELEMETRY = 8,  // a report was made
    LAND_PART_TICK = 16,      // the periodic interrupt fired
    LAND_PARTS_ALL = 31,
} land_part;

typedef struct {
    uint32_t seen;
} land_checkin;

void land_checkin_report(land_checkin *c, land_part part);

// True if all parts have reported; they have to do so anew afterwards.
bool land_checkin_complete(land_checkin *c);
