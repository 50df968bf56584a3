/* See arva_frame.h. C99, clean as C++; needs memcpy, memmove and memset and nothing else. */
#include "arva_frame.h"

#include <string.h>

#define SYNC_0 0xA4
#define SYNC_1 0x57
#define VERSION 1
#define MARKED 0x80u
#define HEAD_BYTES 7u    /* up to n */
#define CHANNEL_BYTES 6u /* id, zone, d, delta */
#define CRC_BYTES 2u
#define BYTES(n) (HEAD_BYTES + CHANNEL_BYTES * (n) + CRC_BYTES)
#define LENGTH(n) (3u + CHANNEL_BYTES * (n))

typedef char the_state_is_small[sizeof(arva_decoder) <= 300 ? 1 : -1];

uint16_t arva_crc(const uint8_t *bytes, size_t size)
{
    uint32_t crc = 0xFFFF;
    for (size_t k = 0; k < size; k++) {
        uint32_t x = crc ^ bytes[k];
        x = (x ^ x << 4) & 0xFF;
        crc = crc >> 8 ^ x << 8 ^ x << 3 ^ x >> 4;
    }
    return (uint16_t)crc;
}

static uint16_t get_uint16(const uint8_t *from)
{
    return (uint16_t)(from[0] | (unsigned)from[1] << 8);
}

static int16_t get_int16(const uint8_t *from)
{
    const int32_t value = get_uint16(from);
    return (int16_t)(value < 0x8000 ? value : value - 0x10000);
}

static void put_uint16(uint8_t *to, uint16_t value)
{
    to[0] = (uint8_t)(value & 0xFF);
    to[1] = (uint8_t)(value >> 8);
}

/* The bytes that a candidate needs, by its first `size` (> 0) ones; 0 if they make it a false one. */
static size_t needs(const uint8_t *bytes, size_t size)
{
    if (bytes[0] != SYNC_0 || (size > 1 && bytes[1] != SYNC_1) || (size > 2 && bytes[2] != VERSION)) {
        return 0;
    }
    if (size > 3 && (bytes[3] < LENGTH(1) || bytes[3] > LENGTH(ARVA_MAX_CHANNELS) || bytes[3] % CHANNEL_BYTES != 3)) {
        return 0;
    }
    if (size < HEAD_BYTES) {
        return HEAD_BYTES;
    }
    return bytes[3] == LENGTH(bytes[6]) ? BYTES(bytes[6]) : 0;
}

/* The number of frames lost between two good ones, by sequence numbers; none after a restart of the receiver. */
static uint32_t missing(uint8_t before, uint8_t sequence)
{
    const uint32_t gap = sequence == before ? 0 : (uint8_t)(sequence - before - 1);
    return sequence < ARVA_RESTART && gap > ARVA_RESTART ? 0 : gap;
}

/* Count the good frame in `bytes`, whose last byte came at `came_ms`, and deliver it. */
static void deliver(arva_decoder *decoder, const uint8_t *bytes, uint32_t came_ms)
{
    if (decoder->counting) {
        decoder->lost += missing(decoder->sequence, bytes[4]);
    }
    decoder->good++;
    decoder->heard = decoder->counting = 1;
    decoder->sequence = bytes[4];
    decoder->frame_ms = came_ms;
    if (decoder->on_frame == NULL) {
        return;
    }
    arva_frame frame;
    frame.sequence = bytes[4];
    frame.status = bytes[5];
    frame.n = bytes[6];
    bytes += HEAD_BYTES;
    for (size_t k = 0; k < ARVA_MAX_CHANNELS; k++) {
        static const arva_channel nothing = {ARVA_NO_ID, ARVA_OUTER, 0, ARVA_NO_SIGNAL, ARVA_NO_SIGNAL};
        arva_channel *channel = &frame.channels[k];
        if (k >= frame.n) {
            *channel = nothing;
            continue;
        }
        channel->id = bytes[0];
        channel->zone = (uint8_t)(bytes[1] & ~MARKED);
        channel->marked = bytes[1] >= MARKED;
        channel->d_cm = get_int16(bytes + 2);
        channel->delta_deg = get_int16(bytes + 4);
        bytes += CHANNEL_BYTES;
    }
    decoder->on_frame(decoder->context, &frame);
}

/* Deliver and count all in bytes[at...size). Returns the start of the incomplete candidate, or `size`. `came`: time
 * of each byte, NULL if all came now. */
static size_t scan(arva_decoder *decoder, const uint8_t *bytes, const uint8_t *came, size_t at, size_t size)
{
    while (at < size) {
        const uint8_t *head = bytes + at;
        const size_t need = needs(head, size - at);
        if (need > size - at) {
            break;
        }
        if (need > 0) {
            const size_t body = need - CRC_BYTES; /* sync included */
            if (arva_crc(head + 2, body - 2) == get_uint16(head + body)) {
                const uint32_t now_ms = decoder->now_ms;
                at += need;
                deliver(decoder, head, came ? now_ms - (uint8_t)(now_ms - came[at - 1]) : now_ms);
                continue;
            }
            decoder->bad_crc++;
        }
        decoder->dropped++;
        at++;
    }
    return at;
}

/* Scan the held bytes from `at` on, and release the settled ones. */
static void settle(arva_decoder *decoder, size_t at)
{
    at = scan(decoder, decoder->held, decoder->came, at, decoder->count);
    if (at > 0) {
        decoder->count = (uint8_t)(decoder->count - at);
        memmove(decoder->held, decoder->held + at, decoder->count);
        memmove(decoder->came, decoder->came + at, decoder->count);
    }
}

/* Drop the candidates that are incomplete 100 ms after their first byte. Held bytes were younger in the last call, so
 * eight bits of time are enough. */
static void tell_time(arva_decoder *decoder, uint32_t now_ms)
{
    const uint32_t passed = now_ms - decoder->now_ms;
    while (decoder->count > 0 && passed + (uint8_t)(decoder->now_ms - decoder->came[0]) >= ARVA_PAUSE_MS) {
        decoder->dropped++;
        settle(decoder, 1);
    }
    decoder->now_ms = now_ms;
    if (now_ms - decoder->frame_ms > INT32_MAX) {
        decoder->frame_ms = now_ms - INT32_MAX; /* an age that wrapped would seem fresh */
    }
}

static void hold(arva_decoder *decoder, const uint8_t *bytes, size_t size)
{
    memcpy(decoder->held + decoder->count, bytes, size);
    memset(decoder->came + decoder->count, (int)(decoder->now_ms & 0xFF), size);
    decoder->count = (uint8_t)(decoder->count + size);
}

void arva_decoder_init(arva_decoder *decoder, arva_on_frame on_frame, void *context)
{
    memset(decoder, 0, sizeof *decoder);
    decoder->on_frame = on_frame;
    decoder->context = context;
}

size_t arva_decoder_feed(arva_decoder *decoder, const uint8_t *bytes, size_t size, uint32_t now_ms)
{
    const uint32_t before = decoder->good;
    size_t at = 0;
    tell_time(decoder, now_ms);
    while (decoder->count > 0 && at < size) { /* a candidate began in an earlier call */
        const size_t missing = needs(decoder->held, decoder->count) - decoder->count;
        const size_t more = missing < size - at ? missing : size - at;
        hold(decoder, bytes + at, more);
        at += more;
        settle(decoder, 0);
        if (decoder->count <= at) { /* all held bytes came in this call: continue there */
            at -= decoder->count;
            decoder->count = 0;
        }
    }
    if (at < size) {
        at = scan(decoder, bytes, NULL, at, size);
        hold(decoder, bytes + at, size - at);
    }
    return decoder->good - before;
}

size_t arva_decoder_push(arva_decoder *decoder, uint8_t byte, uint32_t now_ms)
{
    return arva_decoder_feed(decoder, &byte, 1, now_ms);
}

void arva_decoder_count_anew(arva_decoder *decoder)
{
    decoder->counting = 0;
}

uint32_t arva_decoder_age_ms(const arva_decoder *decoder, uint32_t now_ms)
{
    return decoder->heard ? now_ms - decoder->frame_ms : ARVA_NEVER;
}

size_t arva_encode(const arva_frame *frame, uint8_t *out, size_t capacity)
{
    const size_t n = frame->n;
    if (n < 1 || n > ARVA_MAX_CHANNELS || capacity < BYTES(n)) {
        return 0;
    }
    for (size_t k = 0; k < n; k++) {
        if (frame->channels[k].zone > ARVA_INNER) {
            return 0;
        }
    }
    const uint8_t head[HEAD_BYTES] = {
        SYNC_0, SYNC_1, VERSION, (uint8_t)LENGTH(n), frame->sequence, frame->status, frame->n,
    };
    memcpy(out, head, sizeof head);
    uint8_t *to = out + HEAD_BYTES;
    for (size_t k = 0; k < n; k++, to += CHANNEL_BYTES) {
        const arva_channel *channel = &frame->channels[k];
        to[0] = channel->id;
        to[1] = (uint8_t)(channel->zone | (channel->marked ? MARKED : 0));
        put_uint16(to + 2, (uint16_t)channel->d_cm);
        put_uint16(to + 4, (uint16_t)channel->delta_deg);
    }
    put_uint16(to, arva_crc(out + 2, (size_t)(to - out) - 2));
    return BYTES(n);
}
