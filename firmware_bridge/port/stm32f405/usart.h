// Serial ports: interrupts fill and empty rings, the main loop sees only the rings.
#pragma once

#include <stddef.h>
#include <stdint.h>

typedef enum {
    USART_LINK,   // USART1, to the computer
    USART_PLANT,  // USART2, to the simulated wheels under QEMU
    USART_COUNT,
} usart_port;

void usart_init(usart_port port, uint32_t bus_hz, uint32_t baud);

// Take up to `room` received bytes.
size_t usart_read(usart_port port, uint8_t *out, size_t room);

// Bytes that can be given to `usart_write` now.
size_t usart_room(usart_port port);

// Hand over at most `usart_room` bytes.
void usart_write(usart_port port, const uint8_t *bytes, size_t length);

void usart1_interrupt(void);
void usart2_interrupt(void);
