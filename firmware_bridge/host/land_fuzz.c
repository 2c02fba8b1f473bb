// Bad bytes for the controller, many and fast: `land_fuzz MODE COUNT SEED`, one JSON line when it is done.
//
//   bytes   COUNT bytes: noise, cut and damaged frames between good commands
//   errors  COUNT commands over a wire with a bit error rate of 1e-3
//   bursts  COUNT bursts of noise, each followed by commands at 50 Hz
//
// Every command says the same speed for the same sequence number, so that one that was not said is noticed.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "land_controller.h"

#define BIT_ERROR_RATE 1e-3
#define COMMAND_PERIOD_MS 20u
#define RECENT 64u  // commands whose sequence may still be accepted

static land_controller controller;
static uint64_t random_state;
static uint32_t now_ms = 1000;
static uint16_t sequence;
static uint8_t frame_sequence;
static uint64_t fed, accepted, wrong, moved_without;

static uint64_t draw(void) {  // xorshift64*, Vigna 2016
    random_state ^= random_state >> 12;
    random_state ^= random_state << 25;
    random_state ^= random_state >> 27;
    return random_state * 0x2545F4914F6CDD1Du;
}

static uint32_t below(uint32_t limit) {
    return (uint32_t)((draw() >> 32) * limit >> 32);
}

static double unit(void) {
    return ((double)(draw() >> 11) + 0.5) * 0x1p-53;
}

static int16_t speed_of(uint16_t n) {
    return (int16_t)(n * 37u % 900u + 1u);
}

static int16_t turn_of(uint16_t n) {
    return (int16_t)(n * 91u % 1700u);
}

static size_t frame_of(uint8_t *out, uint32_t message, const void *payload, uint8_t length) {
    const uint8_t header[LAND_FRAME_HEADER] = {
        LAND_FRAME_START, length, 0, 0, frame_sequence++, LAND_SYSTEM, LAND_COMPUTER,
        (uint8_t)message, (uint8_t)(message >> 8), (uint8_t)(message >> 16),
    };
    memcpy(out, header, sizeof header);
    memcpy(out + sizeof header, payload, length);
    uint16_t crc = crc_calculate(out + 1, (uint16_t)(sizeof header - 1 + length));
    crc_accumulate(mavlink_get_msg_entry(message)->crc_extra, &crc);
    out[sizeof header + length] = (uint8_t)crc;
    out[sizeof header + length + 1] = (uint8_t)(crc >> 8);
    return sizeof header + length + LAND_FRAME_CRC;
}

static size_t velocity(uint8_t *out, bool engaged) {
    sequence++;
    const mavlink_land_velocity_t m = {
        .session = controller.gate.session,
        .deadline_ms = now_ms + 200,
        .v = engaged ? speed_of(sequence) : 0,
        .w = engaged ? turn_of(sequence) : 0,
        .cmd_seq = sequence,
        .flags = engaged ? LAND_FLAG_ENGAGED : 0,
    };
    return frame_of(out, MAVLINK_MSG_ID_LAND_VELOCITY, &m, MAVLINK_MSG_ID_LAND_VELOCITY_LEN);
}

static size_t heartbeat(uint8_t *out) {
    const mavlink_land_heartbeat_t m = {.session = controller.gate.session, .engaged = 1};
    return frame_of(out, MAVLINK_MSG_ID_LAND_HEARTBEAT, &m, MAVLINK_MSG_ID_LAND_HEARTBEAT_LEN);
}

static size_t hello(uint8_t *out) {
    const mavlink_land_hello_t m = {.nonce = 1, .dialect_hash = LAND_DIALECT_HASH, .protocol = LAND_PROTOCOL_HERE};
    return frame_of(out, MAVLINK_MSG_ID_LAND_HELLO, &m, MAVLINK_MSG_ID_LAND_HELLO_LEN);
}

static void feed(const uint8_t *bytes, size_t length) {
    const land_time before = controller.gate.accepted;
    const uint16_t last = controller.gate.sequence;
    land_receive(&controller, bytes, length, now_ms);
    fed += length;
    const land_gate *g = &controller.gate;
    if (!g->accepted.set || (before.set && g->sequence == last && g->accepted.ms == before.ms)) {
        return;
    }
    accepted++;
    const bool said = (uint16_t)(sequence - g->sequence) < RECENT;
    const bool same = g->engaged ? g->v_mmps == speed_of(g->sequence) && g->w_mradps == turn_of(g->sequence)
                                 : g->v_mmps == 0 && g->w_mradps == 0;
    wrong += !said || !same;
}

static void pass(uint32_t ms) {
    const land_inputs in = {
        .battery_v = 18.5f,
        .sampled_ms = now_ms + ms,
        .wheel_load = true,
        .left_ticks = (int32_t)(2 * now_ms),
        .right_ticks = (int32_t)(2 * now_ms),
    };
    uint8_t out[256];
    now_ms += ms;
    const land_outputs o = land_step(&controller, &in, now_ms);
    const bool late = land_ahead(now_ms, controller.gate.accepted.ms) > LAND_COMMAND_MS;
    moved_without += !o.braked && (!controller.gate.engaged || late);
    while (land_link_take(&controller.link, out, sizeof out) > 0) {
    }
}

static void good(size_t (*make)(uint8_t *)) {
    uint8_t frame[LAND_FRAME_MAX];
    feed(frame, make(frame));
}

static void engage(void) {
    uint8_t frame[LAND_FRAME_MAX];
    good(hello);
    feed(frame, velocity(frame, false));
    good(heartbeat);
    pass(4);
}

static size_t noise(uint8_t *out, size_t most) {
    const size_t length = 1 + below((uint32_t)most);
    const uint32_t kind = below(4);
    for (size_t i = 0; i < length; i++) {
        const uint32_t luck = below(8);
        out[i] = (uint8_t)draw();
        if (kind == 1 && luck == 0) {
            out[i] = (uint8_t)LAND_FRAME_START;  // many false beginnings
        } else if (kind == 2) {
            out[i] = luck < 2 ? 0xFE : 0;
        }
    }
    if (kind == 3 && length > LAND_FRAME_HEADER) {  // the longest message's header and little behind it
        const uint8_t header[LAND_FRAME_HEADER] = {
            LAND_FRAME_START, MAVLINK_MSG_ID_LAND_LOG_LEN, 0, 0, 0, LAND_SYSTEM, LAND_COMPUTER,
            (uint8_t)MAVLINK_MSG_ID_LAND_LOG, (uint8_t)(MAVLINK_MSG_ID_LAND_LOG >> 8), 0,
        };
        memcpy(out + length - LAND_FRAME_HEADER, header, sizeof header);
    }
    return length;
}

static void fuzz_bytes(uint64_t count) {
    uint8_t bytes[512];
    while (fed < count) {
        const uint32_t kind = below(8);
        size_t length = kind < 4 ? noise(bytes, 300) : velocity(bytes, true);
        if (kind == 4) {
            length = 1 + below((uint32_t)length);  // cut
        } else if (kind == 5) {
            bytes[below((uint32_t)length)] ^= (uint8_t)(1 + below(255));  // damaged
        } else if (kind == 6) {
            good(heartbeat);
        }
        feed(bytes, length);
        if (!controller.gate.engaged && below(20) == 0) {
            good(heartbeat);
            feed(bytes, velocity(bytes, false));
        }
        pass(1 + below(10));
    }
}

static void bit_errors(uint64_t count) {
    uint8_t frame[LAND_FRAME_MAX];
    for (uint64_t k = 0; k < count; k++) {
        if (k % 5 == 0) {
            good(heartbeat);
        }
        const size_t length = velocity(frame, !(k % 50 == 0));
        const uint32_t bits = (uint32_t)(8 * length);
        uint32_t bit = (uint32_t)(log(unit()) / log(1.0 - BIT_ERROR_RATE));
        while (bit < bits) {
            frame[bit / 8] ^= (uint8_t)(1u << bit % 8);
            bit += 1 + (uint32_t)(log(unit()) / log(1.0 - BIT_ERROR_RATE));
        }
        feed(frame, length);
        pass(COMMAND_PERIOD_MS);
    }
}

// Returns the most commands that one burst cost.
static uint32_t bursts(uint64_t count) {
    uint8_t bytes[512];
    uint32_t worst = 0;
    for (uint64_t k = 0; k < count; k++) {
        good(heartbeat);
        feed(bytes, noise(bytes, 300));
        pass(COMMAND_PERIOD_MS / 2);
        uint32_t lost = 0;
        for (int i = 0; i < 4; i++) {
            const size_t length = velocity(bytes, false);
            feed(bytes, length);
            pass(COMMAND_PERIOD_MS);
            lost += controller.gate.sequence != sequence;
        }
        worst = lost > worst ? lost : worst;
    }
    return worst;
}

int main(int argc, char **argv) {
    if (argc != 4) {
        fputs("land_fuzz bytes|errors|bursts COUNT SEED\n", stderr);
        return 2;
    }
    const uint64_t count = strtoull(argv[2], NULL, 10);
    random_state = strtoull(argv[3], NULL, 10) * 2 + 1;
    const land_boot boot = {.boot_count = 1, .serial = "46555A5A0000000000000000"};
    land_init(&controller, &boot);
    engage();
    uint32_t lost = 0;
    if (strcmp(argv[1], "bytes") == 0) {
        fuzz_bytes(count);
    } else if (strcmp(argv[1], "errors") == 0) {
        bit_errors(count);
    } else {
        lost = bursts(count);
    }
    printf(
        "{\"mode\": \"%s\", \"bytes\": %llu, \"accepted\": %llu, \"wrong\": %llu, \"moved_without\": %llu, "
        "\"lost_after_burst\": %u, \"bad_crc\": %u}\n",
        argv[1], (unsigned long long)fed, (unsigned long long)accepted, (unsigned long long)wrong,
        (unsigned long long)moved_without, lost, controller.framer.bad_crc);
    return wrong != 0 || moved_without != 0 || lost > 1;
}
