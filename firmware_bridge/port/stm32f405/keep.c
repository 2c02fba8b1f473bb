#include "keep.h"

#include <string.h>

#include "clock.h"
#include "registers.h"

#define MAGIC 0x4C414252u

typedef struct {
    uint32_t magic;
    uint32_t boot_count;
    uint32_t estop;
    uint32_t faulted;
    land_params params;
    uint32_t crc;  // over all before it
} keep;

extern keep keep_begin;
_Static_assert(sizeof(keep) <= 256, "the linker script keeps 256 bytes");

static uint32_t crc_of(const keep *k) {
    return crc_calculate((const uint8_t *)k, offsetof(keep, crc));
}

static void store(const keep *k) {
    keep_begin = *k;
    keep_begin.crc = crc_of(k);
}

static uint8_t reset_cause(bool faulted) {
    const uint32_t flags = clock_emulated() ? 0 : RCC_CSR;
    if (!clock_emulated()) {
        RCC_CSR |= RCC_CSR_RMVF;
    }
    if (faulted) {
        return LAND_RESET_FAULT;
    }
    if (flags & RCC_CSR_IWDGRSTF) {
        return LAND_RESET_WATCHDOG;
    }
    return flags & RCC_CSR_SFTRSTF ? LAND_RESET_SOFTWARE : LAND_RESET_POWER;
}

void keep_load(land_boot *boot) {
    keep k = keep_begin;
    const bool damaged = k.magic != MAGIC || k.crc != crc_of(&k) || !land_params_sound(&k.params);
    if (damaged) {
        memset(&k, 0, sizeof k);
        k.magic = MAGIC;
        k.params = land_params_default();
    }
    k.boot_count++;
    boot->reset_cause = reset_cause(k.faulted != 0);
    k.faulted = 0;
    if (damaged && boot->reset_cause != LAND_RESET_POWER) {
        k.estop = 1;  // whether it was latched is not known any more
    }
    store(&k);
    boot->boot_count = k.boot_count;
    boot->estop = k.estop != 0;
    boot->params = &keep_begin.params;
}

void keep_save(const land_controller *c) {
    if (keep_begin.estop == c->gate.estop &&
        memcmp(&keep_begin.params, &c->params, sizeof c->params) == 0) {
        return;
    }
    keep k = keep_begin;
    k.estop = c->gate.estop;
    k.params = c->params;
    store(&k);
}

void keep_note_fault(void) {
    keep k = keep_begin;
    k.faulted = 1;
    store(&k);
}
