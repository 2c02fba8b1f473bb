// Pins and motors of a simulated robot behind USART2; never used on the chip itself (see clock_emulated).
//
// Both frames: start byte, little-endian payload, CRC-16/MCRF4XX over the payload. sim/firmware/plant_wire.py
// is the other end. They are short and no more than needed: QEMU passes bytes on one by one, and dearly.
#include <string.h>

#include "board.h"
#include "clock.h"
#include "land_counter.h"
#include "land_mavlink.h"
#include "registers.h"
#include "usart.h"

#define BAUD 921600u
#define PINS_START 0x95u
#define DRIVE_START 0x96u
#define STALE_MS 100u
#define DRIVE_PERIOD_MS 8u  // unless the brake changes

typedef struct __attribute__((packed)) {
    uint32_t time_ms;  // of the plant's clock
    int32_t left_ticks, right_ticks;
    uint16_t battery_10mv;
    int16_t current_10ma, left_10ma, right_10ma;
    uint8_t flags;  // wheel load, rotors possible, driver fault, emergency stop
} pins_frame;

typedef struct __attribute__((packed)) {
    int16_t left_duty, right_duty;  // in 1/10000
    uint8_t braked;
} drive_frame;

#define PINS_BYTES (1 + sizeof(pins_frame) + 2)

static uint8_t buffer[PINS_BYTES];
static size_t used;
static land_inputs latest = {.rotors_possible = true};
static land_time heard;
static int32_t offset_ms;  // controller's time minus the plant's: the least delay seen

void plant_init(void) {
    clock_to(&RCC_APB1ENR, RCC_APB1_USART2);
    clock_to(&RCC_APB2ENR, RCC_APB2_USART1);
    usart_init(USART_PLANT, APB1_HZ, BAUD);
}

static void take(const pins_frame *f, uint32_t now_ms) {
    const int32_t delay_ms = land_ahead(now_ms, f->time_ms);
    if (!heard.set || delay_ms < offset_ms) {
        offset_ms = delay_ms;
    }
    uint32_t sampled_ms = f->time_ms + (uint32_t)offset_ms;
    if (heard.set && land_ahead(sampled_ms, latest.sampled_ms) < 0) {
        sampled_ms = latest.sampled_ms;  // a smaller delay was found; time does not go back for it
    }
    heard = land_time_at(now_ms);
    latest = (land_inputs){
        .battery_v = (float)f->battery_10mv * 0.01f,
        .current_a = (float)f->current_10ma * 0.01f,
        .left_a = (float)f->left_10ma * 0.01f,
        .right_a = (float)f->right_10ma * 0.01f,
        .left_ticks = f->left_ticks,
        .right_ticks = f->right_ticks,
        .sampled_ms = sampled_ms,
        .wheel_load = (f->flags & 1u) != 0,
        .rotors_possible = (f->flags & 2u) != 0,
        .driver_fault = (f->flags & 4u) != 0,
        .estop_pressed = (f->flags & 8u) != 0,
    };
}

static void push(uint8_t byte, uint32_t now_ms) {
    if (used == 0 && byte != PINS_START) {
        return;
    }
    buffer[used++] = byte;
    if (used < PINS_BYTES) {
        return;
    }
    used = 0;
    const uint16_t crc = crc_calculate(buffer + 1, sizeof(pins_frame));
    if (buffer[PINS_BYTES - 2] == (crc & 0xFF) && buffer[PINS_BYTES - 1] == crc >> 8) {
        pins_frame f;
        memcpy(&f, buffer + 1, sizeof f);
        take(&f, now_ms);
    }
}

bool plant_sample(land_inputs *in, uint32_t now_ms) {
    uint8_t bytes[256];
    for (size_t n; (n = usart_read(USART_PLANT, bytes, sizeof bytes)) > 0;) {
        for (size_t i = 0; i < n; i++) {
            push(bytes[i], now_ms);
        }
    }
    *in = latest;
    if (heard.set && now_ms - heard.ms <= STALE_MS) {
        return true;
    }
    in->wheel_load = false;  // nothing is known of the robot any more
    in->rotors_possible = true;
    in->sampled_ms = now_ms;
    return false;
}

void plant_drive(const land_outputs *out, uint32_t now_ms) {
    static land_time said;
    static bool braked;
    if (said.set && out->braked == braked && land_ahead(now_ms, said.ms) < (int32_t)DRIVE_PERIOD_MS) {
        return;
    }
    said = land_time_at(now_ms);
    braked = out->braked;
    const drive_frame f = {
        .left_duty = (int16_t)(out->left_duty * 10000.0f),
        .right_duty = (int16_t)(out->right_duty * 10000.0f),
        .braked = out->braked,
    };
    uint8_t bytes[1 + sizeof f + 2] = {DRIVE_START};
    const uint16_t crc = crc_calculate((const uint8_t *)&f, sizeof f);
    memcpy(bytes + 1, &f, sizeof f);
    bytes[1 + sizeof f] = (uint8_t)crc;
    bytes[2 + sizeof f] = (uint8_t)(crc >> 8);
    if (usart_room(USART_PLANT) >= sizeof bytes) {
        usart_write(USART_PLANT, bytes, sizeof bytes);
    }
}
