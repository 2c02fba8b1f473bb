// Time and the processor's clock.
#pragma once

#include <stdbool.h>
#include <stdint.h>

#define APB2_HZ 84000000u  // USART1
#define APB1_HZ 42000000u  // USART2

typedef enum {
    CLOCK_CRYSTAL,
    CLOCK_INTERNAL,  // the crystal did not start: 1 % off, good enough to say so
    CLOCK_EMULATED,
} clock_source;

// 168 MHz, a free-running microsecond counter, and a waker every millisecond.
clock_source clock_init(void);

// True under QEMU, whose chip has no clock control, no pins and no watchdog.
bool clock_emulated(void);

// Since boot; call it more often than once an hour.
uint64_t clock_us(void);
