#include "clock.h"

#include "registers.h"

#define CRYSTAL_MHZ 8u
#define INTERNAL_MHZ 16u
#define CRYSTAL_TRIES 200000u  // some 100 ms at 16 MHz

static bool emulated;

bool clock_emulated(void) {
    return emulated;
}

// PLL to 168 MHz: divide to 1 MHz, multiply by 336, divide by 2; buses at 168, 42 and 84 MHz.
static void pll(uint32_t source_mhz, bool crystal) {
    FLASH_ACR = 5u | 7u << 8;  // five wait states at 168 MHz, caches and prefetch on
    RCC_PLLCFGR = source_mhz | 336u << 6 | 0u << 16 | (crystal ? 1u << 22 : 0u) | 7u << 24;
    RCC_CR |= RCC_CR_PLLON;
    while (!(RCC_CR & RCC_CR_PLLRDY)) {
    }
    RCC_CFGR = 5u << 10 | 4u << 13 | 2u;
    while ((RCC_CFGR >> 2 & 3u) != 2u) {
    }
}

static bool crystal_starts(void) {
    RCC_CR |= RCC_CR_HSEON;
    for (uint32_t i = 0; i < CRYSTAL_TRIES; i++) {
        if (RCC_CR & RCC_CR_HSERDY) {
            return true;
        }
    }
    return false;
}

clock_source clock_init(void) {
    emulated = !(RCC_CR & RCC_CR_HSIRDY);  // silicon runs on this oscillator when it gets here
    clock_source source = CLOCK_EMULATED;
    if (!emulated) {
        const bool crystal = crystal_starts();
        pll(crystal ? CRYSTAL_MHZ : INTERNAL_MHZ, crystal);
        source = crystal ? CLOCK_CRYSTAL : CLOCK_INTERNAL;
    }
    clock_to(&RCC_APB1ENR, RCC_APB1_TIM2);
    TIM2->PSC = emulated ? 999u : 83u;  // from 1 GHz, or from 84 MHz, to 1 MHz
    TIM2->ARR = UINT32_MAX;
    TIM2->EGR = TIM_EGR_UG;
    TIM2->CR1 = TIM_CR1_CEN;
    SYSTICK_LOAD = 168000u - 1;
    SYSTICK_VAL = 0;
    SYSTICK_CTRL = 7u;  // processor clock, interrupt, on
    return source;
}

uint64_t clock_us(void) {
    static uint64_t total_us;
    static uint32_t last_us;
    const uint32_t now_us = TIM2->CNT;
    total_us += now_us - last_us;
    last_us = now_us;
    return total_us;
}
