/* Messages of version 2 of an ARVA receiver (457 kHz), beside the frames of arva_frame.h: commands of a host, their
 * answers, and measurements of the antennas. Layout and meaning: ../PROTOCOL.md.
 *
 *     static void on_message(void *context, const arva_message *message)
 *     {
 *         arva_answer answer;
 *         if (arva_answer_get(message, &answer) && arva_command_answered(&request, &answer)) { ... }
 *     }
 *
 *     arva_message_decoder decoder;                       fed with the same bytes as an arva_decoder, if both are needed
 *     arva_message_decoder_init(&decoder, ARVA_WANT_ANSWERS, on_message, NULL);
 *     arva_message_decoder_feed(&decoder, bytes, size, now_ms);
 *
 *     const int32_t id = 3;
 *     size = arva_command_send(&request, ARVA_DO_MARK, &id, 1, now_ms, out, sizeof out);      and write `out` to the port
 *
 * Nothing is allocated and no clock is read. A decoder belongs to one task or one interrupt.
 */
#ifndef ARVA_MESSAGE_H
#define ARVA_MESSAGE_H

#include "arva_frame.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ARVA_MAX_MESSAGE_BYTES 255
#define ARVA_MAX_VALUES 4
#define ARVA_MAX_TEXT 32
#define ARVA_MAX_COMMAND_BYTES (10 + 4 * ARVA_MAX_VALUES)
#define ARVA_MAX_ANSWER_BYTES (12 + 4 * ARVA_MAX_VALUES + ARVA_MAX_TEXT)
#define ARVA_ANSWER_MS 1000u /* a host sends a command again after this time */
#define ARVA_NO_CARRIER INT16_MIN
#define ARVA_NO_LEVEL INT16_MIN
#define ARVA_NO_AGE UINT16_MAX

enum { ARVA_OVERLAP = 16, ARVA_NOT_SEARCHING = 32 }; /* further bits of the status */
enum { ARVA_VECTORS = 1, ARVA_LEVELS = 2, ARVA_COMMAND = 16, ARVA_ANSWER = 17 };                            /* kinds */
enum { ARVA_WANT_VECTORS = 1, ARVA_WANT_LEVELS = 2, ARVA_WANT_COMMANDS = 4, ARVA_WANT_ANSWERS = 8, ARVA_WANT_ALL = 15 };
enum { ARVA_DO_IDENTIFY = 1, ARVA_DO_MARK, ARVA_DO_UNMARK, ARVA_DO_SELECT }; /* codes of commands */
enum { ARVA_DO_RESTART = 5, ARVA_DO_CHANNELS, ARVA_DO_SCAN, ARVA_DO_SEARCH };
enum { ARVA_DONE = 0, ARVA_REFUSED, ARVA_UNKNOWN, ARVA_BUSY }; /* results */

/* A good message, without its mask: `body` has `size` bytes and is valid until on_message returns. */
typedef struct {
    uint8_t kind;
    uint8_t size;
    const uint8_t *body;
} arva_message;

typedef struct {
    uint8_t number;
    uint8_t code; /* ARVA_DO_IDENTIFY ..., or another */
    uint8_t count; /* of values */
    int32_t values[ARVA_MAX_VALUES];
} arva_command;

typedef struct {
    uint8_t number;
    uint8_t code;
    uint8_t result; /* ARVA_DONE ... */
    uint8_t count;
    int32_t values[ARVA_MAX_VALUES];
    char text[ARVA_MAX_TEXT + 1]; /* printable ASCII, ends with 0 */
} arva_answer;

typedef struct {
    uint8_t id; /* transmitter, 0...254, or ARVA_NO_ID */
    uint8_t zone;
    uint8_t marked;
    int32_t x, y, z;      /* signed amplitudes, 0.01 nA/m; their signs are relative to each other. ARVA_VECTORS only */
    uint16_t period;      /* 0.1 ms, 0 if unknown. ARVA_VECTORS only */
    int16_t carrier;      /* offset from 457 kHz, 0.1 Hz, or ARVA_NO_CARRIER. ARVA_VECTORS only */
    int16_t level;        /* 0.01 dB of the receiver's full scale, or ARVA_NO_LEVEL. ARVA_LEVELS only */
    uint16_t age_ms;      /* from the end of the pulse to time_ms, or ARVA_NO_AGE if there was none */
} arva_pulse;

/* The measurements for the frame of the same number, which follows directly. */
typedef struct {
    uint8_t sequence;
    uint8_t status;
    uint8_t n;        /* channels, 1...ARVA_MAX_CHANNELS */
    uint32_t time_ms; /* the receiver's clock, which wraps */
} arva_measured;

/* Gets a good message. It must not feed the same decoder. */
typedef void (*arva_on_message)(void *context, const arva_message *message);

typedef struct {
    uint32_t good;    /* messages delivered. This and the next two may be read, and wrap */
    uint32_t bad_crc; /* candidates whose CRC failed */
    uint32_t dropped; /* bytes in no wanted message, also those of frames */
    /* private from here on */
    arva_on_message on_message;
    void *context;
    uint32_t now_ms;                      /* of the last call */
    uint8_t held[ARVA_MAX_MESSAGE_BYTES]; /* the incomplete candidate, and the bytes after it */
    uint8_t came[ARVA_MAX_MESSAGE_BYTES]; /* arrival of each byte: ms, the low eight bits */
    uint8_t count;                        /* number of bytes held */
    uint8_t want;
} arva_message_decoder;

/* `want`: ARVA_WANT_..., added up; other kinds are dropped bytes. `on_message` may be NULL: then they are counted. */
void arva_message_decoder_init(arva_message_decoder *decoder, uint8_t want, arva_on_message on_message, void *context);

/* Like arva_decoder_feed. Returns the number of messages delivered. */
size_t arva_message_decoder_feed(arva_message_decoder *decoder, const uint8_t *bytes, size_t size, uint32_t now_ms);

/* Read the content of a message; 0 if it is of another kind. */
int arva_command_get(const arva_message *message, arva_command *command);
int arva_answer_get(const arva_message *message, arva_answer *answer);
int arva_measured_get(const arva_message *message, arva_measured *measured);

/* Channel k of ARVA_VECTORS or ARVA_LEVELS; 0 if there is none. */
int arva_pulse_get(const arva_message *message, size_t k, arva_pulse *pulse);

/* Write a command or an answer. Returns its size; 0, and nothing written, if a field or `capacity` does not fit. */
size_t arva_command_encode(const arva_command *command, uint8_t *out, size_t capacity);
size_t arva_answer_encode(const arva_answer *answer, uint8_t *out, size_t capacity);

/* A host's request, one at a time. All zeros is a valid start. */
typedef struct {
    arva_command command; /* the last one sent */
    uint32_t sent_ms;
    uint8_t waiting; /* for its answer */
} arva_request;

/* Begin a request: write the command with the next number to `out`. Returns its size, or 0 like arva_command_encode. */
size_t arva_command_send(arva_request *request, uint8_t code, const int32_t *values, uint8_t count, uint32_t now_ms,
                         uint8_t *out, size_t capacity);

/* Write the command again if its answer is late by ARVA_ANSWER_MS; 0 if it need not be sent. Not for ARVA_DO_RESTART. */
size_t arva_command_again(arva_request *request, uint32_t now_ms, uint8_t *out, size_t capacity);

/* Return true if this is the answer to the request, which then ends. */
int arva_command_answered(arva_request *request, const arva_answer *answer);

#ifdef __cplusplus
}
#endif

#endif
