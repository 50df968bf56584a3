/* The binary frame of an ARVA receiver (457 kHz): decoder and encoder. Layout, rules, and the meaning of d
 * and delta: ../PROTOCOL.md.
 *
 *     static void on_frame(void *context, const arva_frame *frame) { ... }
 *
 *     arva_decoder decoder;
 *     arva_decoder_init(&decoder, on_frame, NULL);
 *     arva_decoder_push(&decoder, byte, now_ms);          one byte, or
 *     arva_decoder_feed(&decoder, bytes, size, now_ms);   any number, cut anywhere, or
 *     arva_decoder_feed(&decoder, NULL, 0, now_ms);       none: only the time, of a silent line
 *
 * Nothing is allocated and no clock is read. A decoder belongs to one task or one interrupt.
 */
#ifndef ARVA_FRAME_H
#define ARVA_FRAME_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define ARVA_MAX_CHANNELS 16
#define ARVA_MAX_FRAME_BYTES (9 + 6 * ARVA_MAX_CHANNELS)
#define ARVA_PAUSE_MS 100u /* there is no pause of this length inside a frame */
#define ARVA_RESTART 16u   /* a lower number after a gap of more frames: the receiver has restarted */
#define ARVA_NO_ID 255
#define ARVA_NO_SIGNAL (-1)
#define ARVA_NEVER UINT32_MAX

enum { ARVA_SYNTHETIC = 1, ARVA_INTERFERENCE = 2, ARVA_MORE_TRANSMITTERS = 4, ARVA_SELF_TEST_FAULT = 8 }; /* status */
enum { ARVA_OUTER = 0, ARVA_MID = 1, ARVA_INNER = 2 };                                                    /* zone */

typedef struct {
    uint8_t id;        /* transmitter, 0...254, or ARVA_NO_ID */
    uint8_t zone;      /* 0...127; a decoder keeps unknown ones */
    uint8_t marked;    /* 0 or 1 */
    int16_t d_cm;      /* valid only above 0, see arva_valid */
    int16_t delta_deg; /* positive to the right */
} arva_channel;

typedef struct {
    uint8_t sequence;
    uint8_t status; /* as it came, unknown bits included */
    uint8_t n;      /* 1...ARVA_MAX_CHANNELS */
    arva_channel channels[ARVA_MAX_CHANNELS]; /* those from n on have no signal */
} arva_frame;

/* Gets a good frame, which is valid until it returns. It must not push or feed to the same decoder. */
typedef void (*arva_on_frame)(void *context, const arva_frame *frame);

typedef struct {
    uint32_t good;    /* frames delivered. This and the next three may be read, and wrap */
    uint32_t bad_crc; /* candidates whose CRC failed */
    uint32_t dropped; /* bytes in no frame */
    uint32_t lost;    /* frames missing from the sequence; a receiver that restarts has lost none */
    /* private from here on */
    arva_on_frame on_frame;
    void *context;
    uint32_t now_ms;                     /* of the last call */
    uint32_t frame_ms;                   /* time of the last byte of the last good frame */
    uint8_t held[ARVA_MAX_FRAME_BYTES];  /* the incomplete candidate, and the bytes after it */
    uint8_t came[ARVA_MAX_FRAME_BYTES];  /* arrival of each byte: ms, the low eight bits */
    uint8_t count;                       /* number of bytes held */
    uint8_t heard;                       /* there was a good frame */
    uint8_t counting;                    /* compare the next sequence number with the last */
    uint8_t sequence;                    /* of the last good frame */
} arva_decoder;

/* True if the channel receives a transmitter; independent of its id and direction. */
static inline int arva_valid(const arva_channel *channel) { return channel->d_cm > 0; }

/* `on_frame` may be NULL: then frames are only counted. */
void arva_decoder_init(arva_decoder *decoder, arva_on_frame on_frame, void *context);

/* Use bytes that came at `now_ms`, milliseconds of any clock that never goes back and may wrap at 2^32. Each frame that
 * is now complete goes to on_frame, in order, before the call returns: none or one as a rule; six at most for one
 * byte or the time alone, if they were behind a false head. Returns their number. Call at least every 100 ms, if
 * only with the time (`bytes` may be NULL when `size` is 0), so that no frame waits for the next one. */
size_t arva_decoder_push(arva_decoder *decoder, uint8_t byte, uint32_t now_ms);
size_t arva_decoder_feed(arva_decoder *decoder, const uint8_t *bytes, size_t size, uint32_t now_ms);

/* Call after the port was opened again, or bytes were discarded: a gap before the next good frame is no loss. */
void arva_decoder_count_anew(arva_decoder *decoder);

/* Milliseconds since the last byte of the last good frame; ARVA_NEVER before the first. It stops at 2^31 - 1 if feed
 * is called regularly. The link is lost after 2 s (PROTOCOL.md, Timing). */
uint32_t arva_decoder_age_ms(const arva_decoder *decoder, uint32_t now_ms);

/* Write the 9 + 6 n bytes of a frame. Returns their number; 0, and nothing written, if n is not 1...16, a zone not
 * 0...2, or `capacity` too small. */
size_t arva_encode(const arva_frame *frame, uint8_t *out, size_t capacity);

/* CRC-16/MCRF4XX, MAVLink's checksum: "123456789" gives 0x6F91. */
uint16_t arva_crc(const uint8_t *bytes, size_t size);

#ifdef __cplusplus
}
#endif

#endif
