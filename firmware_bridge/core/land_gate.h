// The gate: whether the wheels may turn, and how fast. Deny by default, integer milliseconds, no I/O.
//
// Motion needs ALL of: an open session, engaged by going through a disengaged command first, a live
// heartbeat, a command accepted at most 200 ms ago and before its deadline, no emergency stop, no air lock,
// the robot's weight on the wheels, no power on the rotors, no latched fault. Everything else is braked.
#pragma once

#include "land_counter.h"
#include "land_mavlink.h"
#include "land_measure.h"
#include "land_params.h"
#include "land_types.h"

#define LAND_COMMAND_MS 200
#define LAND_DEADLINE_SLACK_MS 50  // a deadline further ahead comes from a wrong clock
#define LAND_HEARTBEAT_MS 1000
#define LAND_TOKEN_MS 5000
#define LAND_AGE_MAX_MS 65534  // of a command, in telemetry; 65535 is never

typedef struct {
    uint32_t session;
    uint32_t deadline_ms;
    int16_t v_mmps;
    int16_t w_mradps;
    uint16_t sequence;
    bool engaged;
    bool air_lock;
} land_command;

typedef struct {
    uint32_t boot_count;
    uint32_t nonce;
    uint32_t session;   // 0: none
    uint32_t sessions;  // opened since boot
    land_time heartbeat;
    bool neutral_seen;  // a disengaged command came since engaging was last forbidden
    bool engaged;
    bool air_lock;
    bool estop;
    uint32_t token;
    uint32_t token_ms;
    bool sequence_seen;
    uint16_t sequence;
    land_time accepted;  // when the last command was accepted
    uint32_t deadline_ms;
    bool moving;  // the last accepted command still counts
    int16_t v_mmps;
    int16_t w_mradps;
    uint16_t faults;
    uint8_t last_result;
    bool wheel_load;
    bool rotors;
    land_drive drive;
    land_time stalled;
    land_time runaway;
    land_time overcurrent;
    land_measure measure;
} land_gate;

// Only boot count and emergency stop outlive a reset; `g` is all zero before.
void land_gate_init(land_gate *g, uint32_t boot_count, bool estop);

void land_gate_hello(land_gate *g, uint32_t nonce, uint16_t protocol, uint32_t dialect_hash, uint32_t now_ms);
void land_gate_heartbeat(land_gate *g, uint32_t session, bool engaged, uint32_t now_ms);
// Returns LAND_RESULT; a refused command neither moves the wheels nor feeds the watchdog.
uint8_t land_gate_velocity(land_gate *g, const land_command *c, const land_params *p, uint32_t now_ms);
// Latch the emergency stop, whoever asks.
void land_gate_estop(land_gate *g);
// One of the two steps that end an emergency stop; returns LAND_RESULT and the token of step 1.
uint8_t land_gate_release(
    land_gate *g, uint32_t session, uint8_t step, uint32_t token, uint32_t now_ms, uint32_t *token_out);
// Advance by one period of `dt_s`; `g->drive` is what the wheels may do.
void land_gate_tick(land_gate *g, const land_inputs *in, const land_params *p, uint32_t now_ms, float dt_s);

bool land_gate_session_is(const land_gate *g, uint32_t session);
// All conditions for motion except the age of the command, which `tick` has just checked.
bool land_gate_may_move(const land_gate *g);
uint8_t land_gate_mode(const land_gate *g);
uint8_t land_gate_status(const land_gate *g);
