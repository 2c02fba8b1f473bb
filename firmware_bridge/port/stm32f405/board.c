#include "board.h"

#include "clock.h"

void board_init(void) {
    clock_emulated() ? plant_init() : pins_init();
}

bool board_sample(land_inputs *in, uint32_t now_ms) {
    return clock_emulated() ? plant_sample(in, now_ms) : pins_sample(in, now_ms);
}

void board_drive(const land_outputs *out, uint32_t now_ms) {
    clock_emulated() ? plant_drive(out, now_ms) : pins_drive(out);
}

void board_brake(void) {
    if (!clock_emulated()) {
        const land_outputs brake = {0.0f, 0.0f, true};
        pins_drive(&brake);
    }
}
