/* Reads frames on USART1 of an STM32F405 and answers each with d and delta on USART2. How to build it: ../README.md.
 *
 * An answer is one line, "sequence id:d:delta ...", centimetres and degrees, one group for each channel with a
 * signal. "lost" is sent once after two seconds without a good frame.
 */
#include "../arva_frame.h"

#ifndef CLOCK_HZ
#define CLOCK_HZ 16000000u /* the internal oscillator, which runs after a reset */
#endif
#define BAUD 115200u
#define LOST_MS 2000u
#define REGISTER(address) (*(volatile uint32_t *)(address))

#define RCC_AHB1ENR REGISTER(0x40023830)
#define RCC_APB1ENR REGISTER(0x40023840)
#define RCC_APB2ENR REGISTER(0x40023844)
#define GPIOA_MODER REGISTER(0x40020000)
#define GPIOA_AFRL REGISTER(0x40020020)
#define GPIOA_AFRH REGISTER(0x40020024)
#define USART1_SR REGISTER(0x40011000)
#define USART1_DR REGISTER(0x40011004)
#define USART1_BRR REGISTER(0x40011008)
#define USART1_CR1 REGISTER(0x4001100C)
#define USART2_SR REGISTER(0x40004400)
#define USART2_DR REGISTER(0x40004404)
#define USART2_BRR REGISTER(0x40004408)
#define USART2_CR1 REGISTER(0x4000440C)
#define SYSTICK_CTRL REGISTER(0xE000E010)
#define SYSTICK_LOAD REGISTER(0xE000E014)
#define NVIC_ISER1 REGISTER(0xE000E104)

enum { RXNE = 1 << 5, TXE = 1 << 7 };                             /* USART_SR */
enum { RE = 1 << 2, TE = 1 << 3, RXNEIE = 1 << 5, UE = 1 << 13 }; /* USART_CR1 */
enum { USART1_IRQ = 37 };

static volatile uint32_t now_ms;
static volatile uint8_t ring[256]; /* bytes that have come; the numbers below wrap as it does */
static volatile uint8_t written;

static void on_systick(void) { now_ms++; }

static void on_usart1(void)
{
    if (USART1_SR & RXNE) {
        ring[written] = (uint8_t)USART1_DR;
        written++;
    }
}

static void put(char c)
{
    while (!(USART2_SR & TXE)) {
    }
    USART2_DR = (uint8_t)c;
}

static void say(const char *text)
{
    while (*text) {
        put(*text++);
    }
}

static void say_number(int value)
{
    char digits[8];
    int n = 0;
    if (value < 0) {
        put('-');
        value = -value;
    }
    do {
        digits[n++] = (char)('0' + value % 10);
        value /= 10;
    } while (value);
    while (n) {
        put(digits[--n]);
    }
}

static void on_frame(void *context, const arva_frame *frame)
{
    (void)context;
    say_number(frame->sequence);
    for (const arva_channel *c = frame->channels; c < frame->channels + frame->n; c++) {
        if (arva_valid(c)) {
            put(' ');
            say_number(c->id);
            put(':');
            say_number(c->d_cm);
            put(':');
            say_number(c->delta_deg);
        }
    }
    say("\r\n");
}

int main(void)
{
    static arva_decoder decoder;
    RCC_AHB1ENR |= 1u << 0;  /* port A */
    RCC_APB1ENR |= 1u << 17; /* USART2 */
    RCC_APB2ENR |= 1u << 4;  /* USART1 */
    GPIOA_MODER = (GPIOA_MODER & ~0x3C0030u) | 0x280020u; /* the pins PA2, PA9 and PA10 are ... */
    GPIOA_AFRL = (GPIOA_AFRL & ~0xF00u) | 0x700u;         /* ... USART2's TX, ... */
    GPIOA_AFRH = (GPIOA_AFRH & ~0xFF0u) | 0x770u;         /* ... USART1's TX and RX */
    USART1_BRR = USART2_BRR = (CLOCK_HZ + BAUD / 2) / BAUD;
    USART1_CR1 = UE | RE | RXNEIE;
    USART2_CR1 = UE | TE;
    NVIC_ISER1 = 1u << (USART1_IRQ - 32);
    SYSTICK_LOAD = CLOCK_HZ / 1000u - 1u;
    SYSTICK_CTRL = 7; /* the core's clock, an interrupt, on */
    arva_decoder_init(&decoder, on_frame, 0);
    say("ready\r\n");
    int lost = 1;
    for (uint8_t at = 0;;) {
        while (at != written) {
            arva_decoder_push(&decoder, ring[at], now_ms);
            at++;
        }
        arva_decoder_feed(&decoder, 0, 0, now_ms); /* the time alone, for a frame behind a false head */
        const int silent = arva_decoder_age_ms(&decoder, now_ms) > LOST_MS;
        if (silent && !lost) {
            say("lost\r\n");
        }
        lost = silent;
        __asm__ volatile("wfi"); /* until a byte or the next millisecond */
    }
}

/* The first words of an STM32F405: its stack and its entry points. */

void on_reset(void);
extern uint32_t stack_top, data_at, data_start, data_end, bss_start, bss_end;

void on_reset(void)
{
    const uint32_t *from = &data_at;
    for (uint32_t *to = &data_start; to < &data_end;) {
        *to++ = *from++;
    }
    for (uint32_t *to = &bss_start; to < &bss_end;) {
        *to++ = 0;
    }
    main();
}

static void on_fault(void)
{
    for (;;) {
    }
}

typedef void (*handler)(void);

__attribute__((section(".vectors"), used)) static const struct {
    uint32_t *stack;
    handler system[15];
    handler irq[USART1_IRQ + 1];
} vectors = {
    &stack_top,
    {on_reset, on_fault, on_fault, on_fault, on_fault, on_fault, [14] = on_systick},
    {[USART1_IRQ] = on_usart1},
};
