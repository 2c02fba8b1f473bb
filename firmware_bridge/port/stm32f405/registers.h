// The registers of the STM32F405 that this firmware touches (reference manual RM0090, programming manual PM0214).
#pragma once

#include <stdint.h>

#define REGISTER(address) (*(volatile uint32_t *)(uintptr_t)(address))

// Reset and clock control, flash
#define RCC_CR REGISTER(0x40023800)
#define RCC_PLLCFGR REGISTER(0x40023804)
#define RCC_CFGR REGISTER(0x40023808)
#define RCC_AHB1ENR REGISTER(0x40023830)
#define RCC_APB1ENR REGISTER(0x40023840)
#define RCC_APB2ENR REGISTER(0x40023844)
#define RCC_CSR REGISTER(0x40023874)
#define FLASH_ACR REGISTER(0x40023C00)

#define RCC_CR_HSIRDY (1u << 1)
#define RCC_CR_HSEON (1u << 16)
#define RCC_CR_HSERDY (1u << 17)
#define RCC_CR_PLLON (1u << 24)
#define RCC_CR_PLLRDY (1u << 25)
#define RCC_CSR_RMVF (1u << 24)
#define RCC_CSR_SFTRSTF (1u << 28)
#define RCC_CSR_IWDGRSTF (1u << 29)
#define RCC_AHB1_GPIOA (1u << 0)
#define RCC_AHB1_GPIOB (1u << 1)
#define RCC_AHB1_GPIOC (1u << 2)
#define RCC_APB1_TIM2 (1u << 0)
#define RCC_APB1_TIM3 (1u << 1)
#define RCC_APB1_TIM4 (1u << 2)
#define RCC_APB1_USART2 (1u << 17)
#define RCC_APB2_TIM8 (1u << 1)
#define RCC_APB2_USART1 (1u << 4)
#define RCC_APB2_ADC1 (1u << 8)

// Give devices their clock. A device ignores writes in the first cycles of its bus after that (errata sheet
// ES0182, "Delay after an RCC peripheral clock enabling"); reading the register back is long enough.
static inline void clock_to(volatile uint32_t *enable, uint32_t devices) {
    *enable |= devices;
    (void)*enable;
}

// Pins
typedef struct {
    volatile uint32_t MODER, OTYPER, OSPEEDR, PUPDR, IDR, ODR, BSRR, LCKR, AFRL, AFRH;
} gpio_registers;
#define GPIOA ((gpio_registers *)0x40020000)
#define GPIOB ((gpio_registers *)0x40020400)
#define GPIOC ((gpio_registers *)0x40020800)

// Timers
typedef struct {
    volatile uint32_t CR1, CR2, SMCR, DIER, SR, EGR, CCMR1, CCMR2, CCER, CNT, PSC, ARR, RCR, CCR[4], BDTR;
} timer_registers;
#define TIM2 ((timer_registers *)0x40000000)
#define TIM3 ((timer_registers *)0x40000400)
#define TIM4 ((timer_registers *)0x40000800)
#define TIM8 ((timer_registers *)0x40010400)
#define TIM_CR1_CEN 1u
#define TIM_CR1_ARPE (1u << 7)
#define TIM_EGR_UG 1u
#define TIM_BDTR_MOE (1u << 15)

// Serial ports
typedef struct {
    volatile uint32_t SR, DR, BRR, CR1, CR2, CR3;
} usart_registers;
#define USART1 ((usart_registers *)0x40011000)
#define USART2 ((usart_registers *)0x40004400)
#define USART_SR_ORE (1u << 3)
#define USART_SR_RXNE (1u << 5)
#define USART_SR_TXE (1u << 7)
#define USART_CR1_RE (1u << 2)
#define USART_CR1_TE (1u << 3)
#define USART_CR1_RXNEIE (1u << 5)
#define USART_CR1_TXEIE (1u << 7)
#define USART_CR1_UE (1u << 13)

// Analogue inputs
typedef struct {
    volatile uint32_t SR, CR1, CR2, SMPR1, SMPR2, JOFR[4], HTR, LTR, SQR1, SQR2, SQR3, JSQR, JDR[4], DR;
} adc_registers;
#define ADC1 ((adc_registers *)0x40012000)
#define ADC_CCR REGISTER(0x40012304)
#define ADC_SR_JEOC (1u << 2)
#define ADC_CR1_SCAN (1u << 8)
#define ADC_CR2_ADON 1u
#define ADC_CR2_JSWSTART (1u << 22)

// Independent watchdog
#define IWDG_KR REGISTER(0x40003000)
#define IWDG_PR REGISTER(0x40003004)
#define IWDG_RLR REGISTER(0x40003008)

// Core
#define SYSTICK_CTRL REGISTER(0xE000E010)
#define SYSTICK_LOAD REGISTER(0xE000E014)
#define SYSTICK_VAL REGISTER(0xE000E018)
#define NVIC_ISER(n) REGISTER(0xE000E100 + 4 * (n))
#define SCB_VTOR REGISTER(0xE000ED08)
#define SCB_AIRCR REGISTER(0xE000ED0C)
#define SCB_CPACR REGISTER(0xE000ED88)
#define IRQ_USART1 37u
#define IRQ_USART2 38u

// 96 bits that no other chip has
#define UNIQUE_ID ((const volatile uint32_t *)0x1FFF7A10)
