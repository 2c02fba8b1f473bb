#include "land_gate.h"

#include <math.h>

#include "land_faults.h"

#define CLEARED_BY_COMMAND \
    ((uint16_t)(LAND_FAULT_COMMAND_TIMEOUT | LAND_FAULT_COMMAND_REFUSED | LAND_FAULT_HEARTBEAT_LOST))

static void clear_faults(land_gate *g, unsigned which) {
    g->faults = (uint16_t)(g->faults & ~which);
}

static void set_faults(land_gate *g, unsigned which) {
    g->faults = (uint16_t)(g->faults | which);
}

// One word into a 32-bit number that differs from its neighbours (multiplicative hash).
static uint32_t mix(uint32_t h, uint32_t word) {
    h = (h ^ word) * 0x9E3779B1u;
    return h ^ h >> 15;
}

static uint32_t not_zero(uint32_t h) {
    return h != 0 ? h : 1;
}

// Stop, and ask for a disengaged command before the next engaged one.
static void disengage(land_gate *g) {
    g->engaged = g->neutral_seen = g->moving = false;
}

static bool alive(const land_gate *g, uint32_t now_ms) {
    return g->heartbeat.set && land_young(now_ms, g->heartbeat.ms, LAND_HEARTBEAT_MS);
}

void land_gate_init(land_gate *g, uint32_t boot_count, bool estop) {
    g->boot_count = boot_count;
    g->estop = estop;
    g->rotors = true;  // unknown until the first tick: assume the worse
    g->drive.braked = true;
}

bool land_gate_session_is(const land_gate *g, uint32_t session) {
    return g->session != 0 && session == g->session;
}

void land_gate_hello(land_gate *g, uint32_t nonce, uint16_t protocol, uint32_t dialect_hash, uint32_t now_ms) {
    if (protocol != LAND_PROTOCOL_HERE || dialect_hash != LAND_DIALECT_HASH) {
        disengage(g);
        g->session = g->nonce = 0;
        return;
    }
    if (g->session != 0 && g->nonce == nonce) {
        return;  // the same computer repeats itself
    }
    disengage(g);
    g->nonce = nonce;
    g->session = not_zero(mix(mix(mix(0x811C9DC5u, nonce), g->boot_count), g->sessions));
    g->sessions++;
    g->sequence_seen = false;
    g->heartbeat = land_time_at(now_ms);
    g->token = 0;
    clear_faults(g, CLEARED_BY_COMMAND);
    g->last_result = LAND_RESULT_OK;
}

void land_gate_heartbeat(land_gate *g, uint32_t session, bool engaged, uint32_t now_ms) {
    if (!land_gate_session_is(g, session)) {
        return;
    }
    g->heartbeat = land_time_at(now_ms);
    if (!engaged) {  // this word counts at once, the word that it is engaged does not
        g->engaged = g->moving = false;
    }
}

// The order matters where several hold: what is wrong with the command, then what is wrong with the robot.
static uint8_t judge(const land_gate *g, const land_command *c, const land_params *p, uint32_t now_ms) {
    const int32_t left_ms = land_ahead(c->deadline_ms, now_ms);
    const bool asks_motion = c->v_mmps != 0 || c->w_mradps != 0;
    if (g->sequence_seen && land_ahead16(c->sequence, g->sequence) <= 0) {
        return LAND_RESULT_SEQUENCE;
    }
    if (left_ms <= 0 || left_ms > LAND_COMMAND_MS + LAND_DEADLINE_SLACK_MS) {
        return LAND_RESULT_LATE;
    }
    if (!land_params_allow(p, c->v_mmps, c->w_mradps)) {
        return LAND_RESULT_RANGE;
    }
    if (c->engaged && g->estop) {
        return LAND_RESULT_ESTOP;
    }
    if (c->engaged && !g->neutral_seen) {
        return LAND_RESULT_ENGAGE;
    }
    if (c->engaged && !alive(g, now_ms)) {
        return LAND_RESULT_HEARTBEAT;
    }
    if (!asks_motion) {
        return LAND_RESULT_OK;  // standing is always fine
    }
    if (!c->engaged) {
        return LAND_RESULT_ENGAGE;
    }
    if (c->air_lock) {
        return LAND_RESULT_AIR;
    }
    if (!g->wheel_load) {
        return LAND_RESULT_LOAD;
    }
    return g->rotors ? LAND_RESULT_ROTORS : LAND_RESULT_OK;
}

uint8_t land_gate_velocity(land_gate *g, const land_command *c, const land_params *p, uint32_t now_ms) {
    if (!land_gate_session_is(g, c->session)) {
        return g->last_result = LAND_RESULT_SESSION;
    }
    if (c->air_lock) {
        g->air_lock = true;  // a restriction is believed even in a command that is refused
    }
    if (!c->engaged) {
        g->engaged = g->moving = false;  // and so is this one
    }
    g->last_result = judge(g, c, p, now_ms);
    if (g->last_result != LAND_RESULT_OK) {
        set_faults(g, LAND_FAULT_COMMAND_REFUSED);
        return g->last_result;
    }
    clear_faults(g, CLEARED_BY_COMMAND);
    if (!c->engaged) {
        clear_faults(g, LAND_FAULTS_LATCHED);
        g->neutral_seen = true;
    }
    g->sequence_seen = true;
    g->sequence = c->sequence;
    g->accepted = land_time_at(now_ms);
    g->deadline_ms = c->deadline_ms;
    g->air_lock = c->air_lock;
    g->engaged = g->moving = c->engaged;
    g->v_mmps = c->v_mmps;
    g->w_mradps = c->w_mradps;
    return LAND_RESULT_OK;
}

void land_gate_estop(land_gate *g) {
    disengage(g);
    g->estop = true;
    g->token = 0;
}

// Called in each period: a token of weeks ago must not look young when the counter wraps.
static void age_token(land_gate *g, uint32_t now_ms) {
    if (!land_young(now_ms, g->token_ms, LAND_TOKEN_MS)) {
        g->token = 0;
    }
}

// The same for the last command: its stamp is carried along, at the age that telemetry can tell.
static void age_command(land_gate *g, uint32_t now_ms) {
    if (!land_young(now_ms, g->accepted.ms, LAND_AGE_MAX_MS)) {
        g->accepted.ms = now_ms - LAND_AGE_MAX_MS;
    }
}

uint8_t land_gate_release(
    land_gate *g, uint32_t session, uint8_t step, uint32_t token, uint32_t now_ms, uint32_t *token_out) {
    *token_out = 0;
    if (!land_gate_session_is(g, session)) {
        return LAND_RESULT_SESSION;
    }
    age_token(g, now_ms);
    if (step == 1 && g->estop) {
        if (g->token == 0) {  // a repeated question gets the same answer
            g->token = not_zero(mix(mix(0x811C9DC5u, g->session), now_ms));
            g->token_ms = now_ms;
        }
        *token_out = g->token;
        return LAND_RESULT_OK;
    }
    const bool ends = step == 2 && g->estop && g->token != 0 && token == g->token;
    g->token = 0;  // a wrong token spends the right one
    if (!ends) {
        return LAND_RESULT_UNKNOWN;
    }
    disengage(g);
    g->estop = false;
    return LAND_RESULT_OK;
}

// Heartbeat and command watchdogs.
static void watch_computer(land_gate *g, uint32_t now_ms) {
    if (g->session != 0 && !alive(g, now_ms)) {
        if (g->engaged) {
            set_faults(g, LAND_FAULT_HEARTBEAT_LOST);
        }
        disengage(g);
        g->heartbeat = land_time_none();  // an hour-old stamp must not look fresh when the counter wraps
    }
    if (g->moving && (!land_young(now_ms, g->accepted.ms, LAND_COMMAND_MS) ||
                      land_ahead(g->deadline_ms, now_ms) < 0)) {
        g->moving = false;
        set_faults(g, LAND_FAULT_COMMAND_TIMEOUT);
    }
}

bool land_gate_may_move(const land_gate *g) {
    return g->session != 0 && g->engaged && g->moving && !g->estop && !g->air_lock && g->wheel_load &&
           !g->rotors && (g->faults & LAND_FAULTS_LATCHED) == 0;
}

static float ramp(float now, float target, float step) {
    return now + fmaxf(-step, fminf(step, target - now));
}

// Ramp towards the command, or brake at once.
static land_drive drive(const land_gate *g, const land_params *p, float dt_s) {
    if (!land_gate_may_move(g)) {
        return (land_drive){0.0f, 0.0f, true};
    }
    const float v = (float)g->v_mmps * 1e-3f, half = (float)g->w_mradps * 1e-3f * p->track * 0.5f;
    const float step = p->acceleration * dt_s;
    return (land_drive){
        ramp(g->drive.left_mps, v - half, step),
        ramp(g->drive.right_mps, v + half, step),
        false,
    };
}

void land_gate_tick(land_gate *g, const land_inputs *in, const land_params *p, uint32_t now_ms, float dt_s) {
    land_measure_add(&g->measure, in->sampled_ms, in->left_ticks, in->right_ticks, p->ticks_per_m);
    g->wheel_load = in->wheel_load;
    g->rotors = in->rotors_possible;
    if (in->estop_pressed) {
        land_gate_estop(g);
    }
    age_token(g, now_ms);
    age_command(g, now_ms);
    watch_computer(g, now_ms);
    const uint16_t latched = land_faults_watch(g, in, p, now_ms);
    if (latched != 0) {
        set_faults(g, latched);
        disengage(g);
    }
    clear_faults(g, LAND_FAULT_BATTERY_LOW | LAND_FAULT_ESTOP);
    set_faults(g, (in->battery_v < p->battery_low ? LAND_FAULT_BATTERY_LOW : 0u) |
                      (g->estop ? LAND_FAULT_ESTOP : 0u));
    g->drive = drive(g, p, dt_s);
}

uint8_t land_gate_mode(const land_gate *g) {
    if (g->estop) {
        return LAND_MODE_ESTOP;
    }
    if (g->session == 0) {
        return LAND_MODE_WAITING;
    }
    if (g->air_lock) {
        return LAND_MODE_AIR;
    }
    return g->engaged ? LAND_MODE_ENGAGED : LAND_MODE_IDLE;
}

uint8_t land_gate_status(const land_gate *g) {
    return (uint8_t)((g->engaged ? LAND_STATUS_ENGAGED : 0) | (g->wheel_load ? LAND_STATUS_WHEEL_LOAD : 0) |
                     (g->rotors ? LAND_STATUS_ROTORS : 0) | (g->air_lock ? LAND_STATUS_AIR_LOCK : 0) |
                     (g->drive.braked ? LAND_STATUS_BRAKED : 0));
}
