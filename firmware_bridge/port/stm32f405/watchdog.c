#include "watchdog.h"

#include "registers.h"

#define RELOAD 800u  // of 32 kHz / 4: 100 ms, five times as long as the slowest part takes to report

void watchdog_start(void) {
    IWDG_KR = 0x5555;
    IWDG_PR = 0;
    IWDG_RLR = RELOAD;
    IWDG_KR = 0xCCCC;
    watchdog_feed();
}

void watchdog_feed(void) {
    IWDG_KR = 0xAAAA;
}
