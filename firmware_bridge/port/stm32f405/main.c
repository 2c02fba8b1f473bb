// The firmware's loop: hear, sample, decide, drive, tell; sleep until the next interrupt.
#include "board.h"
#include "clock.h"
#include "fault.h"
#include "keep.h"
#include "land_controller.h"
#include "land_report.h"
#include "registers.h"
#include "stack.h"
#include "usart.h"
#include "watchdog.h"

#define BAUD 460800u
#define STEP_US 4000u
#define LATE_US 40000u  // further behind, missed steps are let go

extern volatile uint32_t systick_count;

static land_controller controller;

// The chip's unique number in hexadecimal; QEMU's chip has none.
static void serial_number(char *out) {
    static const char digits[] = "0123456789ABCDEF";
    for (uint32_t i = 0; i < LAND_SERIAL_BYTES; i++) {
        const uint32_t word = clock_emulated() ? 0x51454D55u : UNIQUE_ID[i / 8];
        out[i] = digits[word >> (28 - 4 * (i % 8)) & 0xF];
    }
}

static void hear(uint32_t now_ms) {
    uint8_t bytes[128];
    size_t n;
    do {
        n = usart_read(USART_LINK, bytes, sizeof bytes);
        land_receive(&controller, bytes, n, now_ms);
    } while (n > 0);
}

static void tell(void) {
    uint8_t bytes[64];
    size_t room;
    while ((room = usart_room(USART_LINK)) > 0) {
        const size_t n = land_link_take(&controller.link, bytes, room < sizeof bytes ? room : sizeof bytes);
        if (n == 0) {
            return;
        }
        usart_write(USART_LINK, bytes, n);
    }
}

static void step(uint32_t now_ms) {
    land_inputs in;
    if (board_sample(&in, now_ms)) {
        land_checkin_report(&controller.checkin, LAND_PART_BOARD);
    }
    const land_outputs out = land_step(&controller, &in, now_ms);
    board_drive(&out, now_ms);
    keep_save(&controller);
}

int main(void) {
    const clock_source source = clock_init();
    char serial[LAND_SERIAL_BYTES];
    serial_number(serial);
    board_init();
    land_boot boot = {.serial = serial};
    keep_load(&boot);
    land_init(&controller, &boot);
    usart_init(USART_LINK, APB2_HZ, BAUD);
    if (source == CLOCK_INTERNAL) {
        land_report_log(&controller, LAND_SEVERITY_WARNING, "crystal did not start: clock is 1 % off");
    }
    watchdog_start();
    uint64_t due_us = clock_us();
    uint32_t ticks = systick_count;
    for (;;) {
        __asm volatile("wfi");
        if (!stack_holds()) {
            fault_stop();
        }
        const uint64_t now_us = clock_us();
        const uint32_t now_ms = (uint32_t)(now_us / 1000u);
        if (ticks != systick_count) {
            ticks = systick_count;
            land_checkin_report(&controller.checkin, LAND_PART_TICK);
        }
        hear(now_ms);
        if (now_us >= due_us) {
            due_us = now_us - due_us > LATE_US ? now_us + STEP_US : due_us + STEP_US;
            step(now_ms);
        }
        tell();
        if (land_checkin_complete(&controller.checkin)) {
            watchdog_feed();
        }
    }
}
