/* Any bytes as a script for the C codec, for a sanitizer to watch: chunks with pauses between them.
 *
 * The decoder is fed them whole and, a second one, byte by byte; a third decoder, below, keeps every byte with its
 * time and applies the rules of PROTOCOL.md one after the other. All three must agree on every call. Each chunk lies
 * in memory of exactly its size, and so does what arva_encode writes. See c.py. */
#include "arva_frame.h"
#include "harness.h"

/* The rules, plainly. */
struct plain {
    uint8_t held[ARVA_MAX_FRAME_BYTES];
    uint64_t came[ARVA_MAX_FRAME_BYTES];
    size_t count;
    uint32_t good, bad_crc, dropped;
    uint64_t last_ms;
    uint8_t *out; /* the bytes of every frame */
    size_t out_size;
};

static void forget(struct plain *p, size_t n)
{
    memmove(p->held, p->held + n, p->count - n);
    memmove(p->came, p->came + n, (p->count - n) * sizeof p->came[0]);
    p->count -= n;
}

static uint16_t crc_by_bits(const uint8_t *bytes, size_t size)
{
    unsigned crc = 0xFFFF;
    for (size_t k = 0; k < size; k++) {
        crc ^= bytes[k];
        for (int bit = 0; bit < 8; bit++) {
            crc = crc & 1 ? crc >> 1 ^ 0x8408 : crc >> 1;
        }
    }
    return (uint16_t)crc;
}

enum verdict { REFUSED, BAD_CRC, NOT_WHOLE, GOOD };

static enum verdict judge(const struct plain *p)
{
    static const uint8_t start[] = {0xA4, 0x57, 1};
    const uint8_t *b = p->held;
    for (size_t k = 0; k < 3 && k < p->count; k++) {
        if (b[k] != start[k]) {
            return REFUSED;
        }
    }
    if (p->count > 3) {
        int right = 0;
        for (int n = 1; n <= 16; n++) {
            right |= b[3] == 3 + 6 * n;
        }
        if (!right) {
            return REFUSED;
        }
    }
    if (p->count > 6 && b[6] != (b[3] - 3) / 6) {
        return REFUSED;
    }
    if (p->count < 7 || p->count < 9u + 6u * b[6]) {
        return NOT_WHOLE;
    }
    const size_t size = 9u + 6u * b[6];
    return crc_by_bits(b + 2, size - 4) == (b[size - 2] | b[size - 1] << 8) ? GOOD : BAD_CRC;
}

static void settle(struct plain *p, uint64_t now_ms)
{
    while (p->count > 0) {
        const enum verdict verdict = judge(p);
        if (verdict == NOT_WHOLE && now_ms - p->came[0] < 100) {
            return;
        }
        if (verdict == GOOD) {
            const size_t size = 9u + 6u * p->held[6];
            memcpy(p->out + p->out_size, p->held, size);
            p->out_size += size;
            p->last_ms = p->came[size - 1];
            p->good++;
            forget(p, size);
            continue;
        }
        p->bad_crc += verdict == BAD_CRC;
        p->dropped++;
        forget(p, 1);
    }
}

static void plain_feed(struct plain *p, const uint8_t *bytes, size_t size, uint64_t now_ms)
{
    settle(p, now_ms);
    for (size_t k = 0; k < size; k++) {
        REQUIRE(p->count < ARVA_MAX_FRAME_BYTES);
        p->held[p->count] = bytes[k];
        p->came[p->count] = now_ms;
        p->count++;
        settle(p, now_ms);
    }
}

/* What a decoder delivered, as bytes again. */
struct heard {
    uint8_t *out;
    size_t out_size, frames;
};

static void on_frame(void *context, const arva_frame *frame)
{
    struct heard *heard = (struct heard *)context;
    arva_frame known = *frame;
    uint8_t zones[ARVA_MAX_CHANNELS];
    REQUIRE(frame->n >= 1 && frame->n <= ARVA_MAX_CHANNELS);
    const size_t size = 9u + 6u * frame->n;
    for (size_t k = 0; k < ARVA_MAX_CHANNELS; k++) {
        zones[k] = known.channels[k].zone;
        REQUIRE(known.channels[k].marked <= 1 && zones[k] <= 127);
        REQUIRE(k < frame->n || !arva_valid(&known.channels[k]));
        known.channels[k].zone = 0;
    }
    uint8_t *tight = (uint8_t *)exactly(size);
    uint8_t *less = (uint8_t *)exactly(size - 1);
    REQUIRE(arva_encode(&known, tight, size) == size && arva_encode(&known, less, size - 1) == 0);
    for (size_t k = 0; k < frame->n; k++) {
        tight[8 + 6 * k] = (uint8_t)(tight[8 + 6 * k] | zones[k]);
    }
    const uint16_t crc = crc_by_bits(tight + 2, size - 4);
    REQUIRE(arva_crc(tight + 2, size - 4) == crc);
    memcpy(heard->out + heard->out_size, tight, size - 2);
    heard->out[heard->out_size + size - 2] = (uint8_t)(crc & 0xFF);
    heard->out[heard->out_size + size - 1] = (uint8_t)(crc >> 8);
    heard->out_size += size;
    heard->frames++;
    free(less);
    free(tight);
}

static void require_same(const arva_decoder *d, const struct heard *heard, const struct plain *p, uint64_t now_ms)
{
    REQUIRE(heard->frames == p->good && heard->out_size == p->out_size);
    REQUIRE(memcmp(heard->out, p->out, p->out_size) == 0);
    REQUIRE(d->good == p->good && d->bad_crc == p->bad_crc && d->dropped == p->dropped);
    REQUIRE(d->count == p->count && memcmp(d->held, p->held, p->count) == 0);
    const uint64_t age = now_ms - p->last_ms;
    REQUIRE(arva_decoder_age_ms(d, (uint32_t)now_ms) == (p->good ? age < INT32_MAX ? age : INT32_MAX : ARVA_NEVER));
}

/* Of a frame of 1...16 channels. */
static size_t special_size(int special)
{
    return 15u + 6u * (unsigned)special;
}

/* What no mutation hits upon: a head and a CRC round the rest. */
static void make_good(uint8_t *bytes, size_t n)
{
    const uint8_t head[] = {0xA4, 0x57, 1, (uint8_t)(3 + 6 * n)};
    memcpy(bytes, head, sizeof head);
    bytes[6] = (uint8_t)n;
    const uint16_t crc = crc_by_bits(bytes + 2, 5 + 6 * n);
    bytes[7 + 6 * n] = (uint8_t)(crc & 0xFF);
    bytes[8 + 6 * n] = (uint8_t)(crc >> 8);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size < 4) {
        return 0;
    }
    struct plain *plain = (struct plain *)calloc(1, sizeof *plain);
    arva_decoder *whole = (arva_decoder *)exactly(sizeof *whole);
    arva_decoder *single = (arva_decoder *)exactly(sizeof *single);
    REQUIRE(plain != NULL);
    struct heard of_whole = {(uint8_t *)exactly(size), 0, 0};
    struct heard of_single = {(uint8_t *)exactly(size), 0, 0};
    plain->out = (uint8_t *)exactly(size);
    arva_decoder_init(whole, on_frame, &of_whole);
    arva_decoder_init(single, on_frame, &of_single);
    struct script s = begin(data, size);
    while (next(&s, special_size)) {
        const uint32_t now_ms = (uint32_t)s.now_ms;
        if (s.special >= 0 && s.chunk_size == special_size(s.special)) {
            make_good(s.chunk, (size_t)s.special + 1);
        }
        arva_decoder_feed(whole, s.chunk_size > 0 ? s.chunk : NULL, s.chunk_size, now_ms);
        arva_decoder_feed(single, NULL, 0, now_ms);
        for (size_t k = 0; k < s.chunk_size; k++) {
            arva_decoder_push(single, s.chunk[k], now_ms);
        }
        plain_feed(plain, s.chunk, s.chunk_size, s.now_ms);
        free(s.chunk);
        require_same(whole, &of_whole, plain, s.now_ms);
        require_same(single, &of_single, plain, s.now_ms);
        REQUIRE(whole->lost == single->lost);
    }
    arva_frame any;
    memset(&any, 0, sizeof any);
    memcpy(&any, data, size < sizeof any ? size : sizeof any);
    const size_t room = size % 256;
    uint8_t *out = (uint8_t *)exactly(room);
    const size_t wrote = arva_encode(&any, out, room);
    REQUIRE(wrote == 0 || (wrote == 9u + 6u * any.n && wrote <= room));
    free(out);
    delivered_in_all += plain->good;
    free(plain->out);
    free(of_whole.out);
    free(of_single.out);
    free(single);
    free(whole);
    free(plain);
    return 0;
}
