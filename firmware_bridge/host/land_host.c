// The controller as a library on this computer: what tests need beside the core's own functions.
#include <stdlib.h>

#include "land_controller.h"

land_controller *land_host_boot(uint32_t boot_count, bool estop, uint8_t reset_cause, const char *serial);
void land_host_free(land_controller *c);
size_t land_host_take(land_controller *c, uint8_t *out, size_t room);
void land_host_step(land_controller *c, const land_inputs *inputs, uint32_t now_ms, land_outputs *out);
bool land_host_may_move(const land_controller *c);
bool land_host_estop(const land_controller *c);
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

void land_host_free(land_controller *c) {
    free(c);
}

size_t land_host_take(land_controller *c, uint8_t *out, size_t room) {
    return land_link_take(&c->link, out, room);
}

void land_host_step(land_controller *c, const land_inputs *inputs, uint32_t now_ms, land_outputs *out) {
    *out = land_step(c, inputs, now_ms);
}

bool land_host_may_move(const land_controller *c) {
    return land_gate_may_move(&c->gate);
}

// What a port keeps over a reset.
bool land_host_estop(const land_controller *c) {
    return c->gate.estop;
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
