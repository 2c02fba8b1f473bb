#include "usart.h"

#include "registers.h"

#define RX_BYTES 1024u  // 22 ms at 460800 baud
#define TX_BYTES 256u

typedef struct {
    usart_registers *registers;
    uint32_t irq;
    uint8_t rx[RX_BYTES];
    uint8_t tx[TX_BYTES];
    volatile uint32_t rx_in, rx_out, tx_in, tx_out;  // free-running; their difference is what waits
} usart;

static usart ports[USART_COUNT] = {
    [USART_LINK] = {.registers = USART1, .irq = IRQ_USART1},
    [USART_PLANT] = {.registers = USART2, .irq = IRQ_USART2},
};

void usart_init(usart_port port, uint32_t bus_hz, uint32_t baud) {
    usart *u = &ports[port];
    u->registers->BRR = (bus_hz + baud / 2) / baud;
    u->registers->CR1 = USART_CR1_UE | USART_CR1_TE | USART_CR1_RE | USART_CR1_RXNEIE;
    NVIC_ISER(u->irq / 32) = 1u << u->irq % 32;
}

// Put out what the hardware takes at once.
static void drain(usart *u) {
    while (u->tx_out != u->tx_in && u->registers->SR & USART_SR_TXE) {
        u->registers->DR = u->tx[u->tx_out++ % TX_BYTES];
    }
}

static void interrupt(usart *u) {
    while (u->registers->SR & (USART_SR_RXNE | USART_SR_ORE)) {
        const uint8_t byte = (uint8_t)u->registers->DR;  // reading clears both flags
        if (u->rx_in - u->rx_out < RX_BYTES) {
            u->rx[u->rx_in++ % RX_BYTES] = byte;  // else lost; the checksum tells
        }
    }
    if (u->registers->CR1 & USART_CR1_TXEIE) {
        drain(u);
        if (u->tx_out == u->tx_in) {
            u->registers->CR1 &= ~USART_CR1_TXEIE;
        }
    }
}

void usart1_interrupt(void) {
    interrupt(&ports[USART_LINK]);
}

void usart2_interrupt(void) {
    interrupt(&ports[USART_PLANT]);
}

size_t usart_read(usart_port port, uint8_t *out, size_t room) {
    usart *u = &ports[port];
    size_t taken = 0;
    while (taken < room && u->rx_out != u->rx_in) {
        out[taken++] = u->rx[u->rx_out % RX_BYTES];
        u->rx_out++;
    }
    return taken;
}

size_t usart_room(usart_port port) {
    const usart *u = &ports[port];
    return TX_BYTES - (u->tx_in - u->tx_out);
}

void usart_write(usart_port port, const uint8_t *bytes, size_t length) {
    usart *u = &ports[port];
    uint32_t in = u->tx_in;
    for (size_t i = 0; i < length; i++) {
        u->tx[in++ % TX_BYTES] = bytes[i];
    }
    __asm volatile("" ::: "memory");  // the interrupt may take a byte as soon as `tx_in` says that it is there
    u->tx_in = in;
    // QEMU 7.2 raises no interrupt when the transmitter is empty: begin by hand, leave the rest to it.
    __asm volatile("cpsid i" ::: "memory");
    drain(u);
    if (u->tx_out != u->tx_in) {
        u->registers->CR1 |= USART_CR1_TXEIE;
    }
    __asm volatile("cpsie i" ::: "memory");
}
