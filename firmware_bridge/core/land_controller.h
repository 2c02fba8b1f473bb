// The whole land controller without its pins: bytes and pin values in, bytes and motor duty out.
//
// A port calls, in this order and at 250 Hz or faster: land_receive with what came from the computer,
// land_step with the pins, and land_link_take until nothing is left.
#pragma once

#include "land_checkin.h"
#include "land_frame.h"
#include "land_gate.h"
#include "land_link.h"
#include "land_wheel.h"

#define LAND_STATE_PERIOD_MS 20
#define LAND_HEARTBEAT_PERIOD_MS 100
#define LAND_STEP_MAX_MS 40  // a late step ramps no further than this
#define LAND_SERIAL_BYTES 24

// What is known when the controller boots.
typedef struct {
    uint32_t boot_count;
    bool estop;  // was latched before the reset
    uint8_t reset_cause;
    const char *serial;        // LAND_SERIAL_BYTES hexadecimal digits
    const land_params *params;  // kept from before the reset; NULL for those flashed
} land_boot;

typedef struct {
    land_gate gate;
    land_params params;
    land_wheel left;
    land_wheel right;
    land_framer framer;
    land_link link;
    land_checkin checkin;
    land_inputs inputs;
    uint32_t now_ms;
    uint32_t stepped_ms;
    bool stepped;
    uint32_t due_state_ms;
    uint32_t due_heartbeat_ms;
    uint8_t reset_cause;
    char serial[LAND_SERIAL_BYTES];
} land_controller;

void land_init(land_controller *c, const land_boot *boot);
void land_receive(land_controller *c, const uint8_t *bytes, size_t length, uint32_t now_ms);
land_outputs land_step(land_controller *c, const land_inputs *inputs, uint32_t now_ms);
