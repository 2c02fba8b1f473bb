// The controller as a library on this computer: what tests need beside the core's own functions.
#include <stdlib.h>
#include <string.h>

#include "land_controller.h"

land_controller *land_host_boot(uint32_t boot_count, bool estop, uint8_t reset_cause, const char *serial);
void land_host_reset(land_controller *c, uint8_t reset_cause);
void land_host_free(land_controller *c);
size_t land_host_take(land_controller *c, uint8_t *out, size_t room);
void land_host_step(land_controller *c, const land_inputs *inputs, uint32_t now_ms, land_outputs *out);
bool land_host_would_move(const bool *holds);
void land_host_wheel(
    const land_controller *c, land_wheel *w, float target_mps, float measured_mps, float current_a, float dt_s);
bool land_host_feeds_watchdog(land_controller *c, uint32_t parts);
bool land_host_keeps(const land_controller *c, int index, float value);

land_controller *land_host_boot(uint32_t boot_count, bool estop, uint8_t reset_cause, const char *serial) {
    land_controller *c = malloc(sizeof *c);
    if (c != NULL) {
        const land_boot boot = {boot_count, estop, reset_cause, serial, NULL};
        land_init(c, &boot);
    }
    return c;
}

// What a reset leaves: boot count, emergency stop, parameters.
void land_host_reset(land_controller *c, uint8_t reset_cause) {
    const land_params kept = c->params;
    char serial[LAND_SERIAL_BYTES];
    memcpy(serial, c->serial, sizeof serial);
    const land_boot boot = {c->gate.boot_count + 1, c->gate.estop, reset_cause, serial, &kept};
    land_init(c, &boot);
}

void land_host_free(land_controller *c) {
    free(c);
}

size_t land_host_take(land_controller *c, uint8_t *out, size_t room) {
    return land_link_take(&c->link, out, room);
}

void land_host_step(land_controller *c, const land_inputs *inputs, uint32_t now_ms, land_outputs *out) {
    *out = land_step(c, inputs, now_ms);
}

// Whether a gate moves for which these conditions hold: session, engaged, command, no emergency stop, no air
// lock, load, rotors off, no latched fault.
bool land_host_would_move(const bool *holds) {
    const land_gate g = {
        .session = holds[0],
        .engaged = holds[1],
        .moving = holds[2],
        .estop = !holds[3],
        .air_lock = !holds[4],
        .wheel_load = holds[5],
        .rotors = !holds[6],
        .faults = holds[7] ? 0 : LAND_FAULT_WHEEL_STALL,
    };
    return land_gate_may_move(&g);
}

// One wheel by itself, with the controller's parameters.
void land_host_wheel(
    const land_controller *c, land_wheel *w, float target_mps, float measured_mps, float current_a, float dt_s) {
    land_wheel_step(w, target_mps, measured_mps, current_a, &c->params, dt_s);
}

// Report these parts and ask whether the watchdog may be fed.
bool land_host_feeds_watchdog(land_controller *c, uint32_t parts) {
    land_checkin_report(&c->checkin, (land_part)parts);
    return land_checkin_complete(&c->checkin);
}

// Whether a copy of the parameters with one value changed counts as sound.
bool land_host_keeps(const land_controller *c, int index, float value) {
    land_params kept = c->params;
    ((float *)&kept)[index] = value;
    return land_params_sound(&kept);
}
