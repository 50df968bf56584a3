/* See arva_message.h. C99, clean as C++; needs arva_frame.c for the CRC, and memcpy, memmove and memset. */
#include "arva_message.h"

#include <string.h>

#define SYNC_0 0xA4
#define SYNC_1 0x57
#define VERSION 2
#define MARKED 0x80u
#define HEAD_BYTES 6u /* up to the kind */
#define CRC_BYTES 2u
#define MEASURED_BYTES 7u
#define VECTOR_BYTES 15u
#define LEVEL_BYTES 6u
#define MAX_EXPONENT 16

static uint16_t get_uint16(const uint8_t *from)
{
    return (uint16_t)(from[0] | (unsigned)from[1] << 8);
}

static int16_t get_int16(const uint8_t *from)
{
    const int32_t value = get_uint16(from);
    return (int16_t)(value < 0x8000 ? value : value - 0x10000);
}

static uint32_t get_uint32(const uint8_t *from)
{
    return get_uint16(from) | (uint32_t)get_uint16(from + 2) << 16;
}

static int32_t get_int32(const uint8_t *from)
{
    const uint32_t value = get_uint32(from);
    return value <= INT32_MAX ? (int32_t)value : -(int32_t)(UINT32_MAX - value) - 1;
}

static void put_int32(uint8_t *to, int32_t value)
{
    for (size_t k = 0; k < 4; k++) {
        to[k] = (uint8_t)((uint32_t)value >> 8 * k);
    }
}

static uint8_t wanted(uint8_t kind)
{
    switch (kind) {
    case ARVA_VECTORS:
        return ARVA_WANT_VECTORS;
    case ARVA_LEVELS:
        return ARVA_WANT_LEVELS;
    case ARVA_COMMAND:
        return ARVA_WANT_COMMANDS;
    case ARVA_ANSWER:
        return ARVA_WANT_ANSWERS;
    default:
        return 0;
    }
}

static int is_list(size_t size, size_t head, size_t each, size_t least, size_t most)
{
    return size >= head + each * least && size <= head + each * most && (size - head) % each == 0;
}

/* Return true if a body of this kind can have this size. */
static int fits(uint8_t kind, size_t size)
{
    switch (kind) {
    case ARVA_VECTORS:
        return is_list(size, MEASURED_BYTES, VECTOR_BYTES, 1, ARVA_MAX_CHANNELS);
    case ARVA_LEVELS:
        return is_list(size, MEASURED_BYTES, LEVEL_BYTES, 1, ARVA_MAX_CHANNELS);
    case ARVA_COMMAND:
        return is_list(size, 2, 4, 0, ARVA_MAX_VALUES);
    default:
        return size >= 4 && size <= 4 + 4 * ARVA_MAX_VALUES + ARVA_MAX_TEXT;
    }
}

static int is_text(const uint8_t *text, size_t size)
{
    for (size_t k = 0; k < size; k++) {
        if (text[k] < ' ' || text[k] > '~' || text[k] == '$' || text[k] == '*' || text[k] == ',') {
            return 0;
        }
    }
    return size <= ARVA_MAX_TEXT;
}

/* Return true if a body with a correct CRC is valid. */
static int makes_sense(const arva_message *message)
{
    const uint8_t *body = message->body;
    if (message->kind == ARVA_ANSWER) {
        const size_t end = 4u + 4u * body[3];
        return body[2] <= ARVA_BUSY && body[3] <= ARVA_MAX_VALUES && end <= message->size &&
               is_text(body + end, message->size - end);
    }
    if (message->kind == ARVA_VECTORS) {
        for (size_t at = MEASURED_BYTES; at < message->size; at += VECTOR_BYTES) {
            if (body[at + 2] > MAX_EXPONENT) {
                return 0;
            }
        }
        return message->size == MEASURED_BYTES + VECTOR_BYTES * body[2];
    }
    return message->kind != ARVA_LEVELS || message->size == MEASURED_BYTES + LEVEL_BYTES * body[2];
}

/* The bytes that the candidate needs, by its head; 0 if it is a false one. */
static size_t needs(const arva_message_decoder *decoder)
{
    const uint8_t *bytes = decoder->held;
    const size_t count = decoder->count;
    if (bytes[0] != SYNC_0 || (count > 1 && bytes[1] != SYNC_1) || (count > 2 && bytes[2] != VERSION)) {
        return 0;
    }
    if (count < HEAD_BYTES) {
        return HEAD_BYTES;
    }
    const uint8_t kind = bytes[5] ^ bytes[4];
    return (wanted(kind) & decoder->want) && bytes[3] >= 2 && fits(kind, bytes[3] - 2u) ? bytes[3] + 6u : 0;
}

static void let_go(arva_message_decoder *decoder, size_t size)
{
    decoder->count = (uint8_t)(decoder->count - size);
    memmove(decoder->held, decoder->held + size, decoder->count);
    memmove(decoder->came, decoder->came + size, decoder->count);
}

static void unmask(uint8_t *bytes, size_t size, uint8_t mask)
{
    for (size_t k = 0; k < size; k++) {
        bytes[k] ^= mask;
    }
}

/* Deliver the complete candidate of `size` bytes; 0 if it is a false one. */
static int deliver(arva_message_decoder *decoder, size_t size)
{
    uint8_t *bytes = decoder->held;
    if (arva_crc(bytes + 2, size - 2 - CRC_BYTES) != get_uint16(bytes + size - CRC_BYTES)) {
        decoder->bad_crc++;
        return 0;
    }
    const uint8_t mask = bytes[4];
    const size_t body = size - HEAD_BYTES - CRC_BYTES;
    const arva_message message = {(uint8_t)(bytes[5] ^ mask), (uint8_t)body, bytes + HEAD_BYTES};
    unmask(bytes + HEAD_BYTES, body, mask);
    if (!makes_sense(&message)) {
        unmask(bytes + HEAD_BYTES, body, mask);
        return 0;
    }
    decoder->good++;
    if (decoder->on_message != NULL) {
        decoder->on_message(decoder->context, &message);
    }
    return 1;
}

static void refuse(arva_message_decoder *decoder)
{
    decoder->dropped++;
    let_go(decoder, 1);
}

/* Judge the held bytes up to an incomplete candidate. */
static void settle(arva_message_decoder *decoder)
{
    while (decoder->count > 0) {
        const size_t need = needs(decoder);
        if (need > decoder->count) {
            return;
        }
        if (need > 0 && deliver(decoder, need)) {
            let_go(decoder, need);
        } else {
            refuse(decoder);
        }
    }
}

void arva_message_decoder_init(arva_message_decoder *decoder, uint8_t want, arva_on_message on_message, void *context)
{
    memset(decoder, 0, sizeof *decoder);
    decoder->want = want;
    decoder->on_message = on_message;
    decoder->context = context;
}

size_t arva_message_decoder_feed(arva_message_decoder *decoder, const uint8_t *bytes, size_t size, uint32_t now_ms)
{
    const uint32_t before = decoder->good;
    const uint32_t passed = now_ms - decoder->now_ms;
    while (decoder->count > 0 && passed + (uint8_t)(decoder->now_ms - decoder->came[0]) >= ARVA_PAUSE_MS) {
        refuse(decoder);
        settle(decoder);
    }
    decoder->now_ms = now_ms;
    for (size_t k = 0; k < size; k++) {
        if (decoder->count == 0 && bytes[k] != SYNC_0) {
            decoder->dropped++;
            continue;
        }
        decoder->held[decoder->count] = bytes[k];
        decoder->came[decoder->count] = (uint8_t)now_ms;
        decoder->count++;
        settle(decoder);
    }
    return decoder->good - before;
}

static uint8_t get_values(const uint8_t *from, size_t count, int32_t *values)
{
    for (size_t k = 0; k < ARVA_MAX_VALUES; k++) {
        values[k] = k < count ? get_int32(from + 4 * k) : 0;
    }
    return (uint8_t)count;
}

int arva_command_get(const arva_message *message, arva_command *command)
{
    if (message->kind != ARVA_COMMAND) {
        return 0;
    }
    command->number = message->body[0];
    command->code = message->body[1];
    command->count = get_values(message->body + 2, message->size / 4u, command->values);
    return 1;
}

int arva_answer_get(const arva_message *message, arva_answer *answer)
{
    if (message->kind != ARVA_ANSWER) {
        return 0;
    }
    const uint8_t *body = message->body;
    const size_t end = 4u + 4u * body[3];
    memset(answer, 0, sizeof *answer);
    answer->number = body[0];
    answer->code = body[1];
    answer->result = body[2];
    answer->count = get_values(body + 4, body[3], answer->values);
    memcpy(answer->text, body + end, message->size - end);
    return 1;
}

int arva_measured_get(const arva_message *message, arva_measured *measured)
{
    if (message->kind != ARVA_VECTORS && message->kind != ARVA_LEVELS) {
        return 0;
    }
    measured->sequence = message->body[0];
    measured->status = message->body[1];
    measured->n = message->body[2];
    measured->time_ms = get_uint32(message->body + 3);
    return 1;
}

int arva_pulse_get(const arva_message *message, size_t k, arva_pulse *pulse)
{
    arva_measured measured;
    if (!arva_measured_get(message, &measured) || k >= measured.n) {
        return 0;
    }
    const int is_vector = message->kind == ARVA_VECTORS;
    const uint8_t *from = message->body + MEASURED_BYTES + (is_vector ? VECTOR_BYTES : LEVEL_BYTES) * k;
    memset(pulse, 0, sizeof *pulse);
    pulse->id = from[0];
    pulse->zone = (uint8_t)(from[1] & ~MARKED);
    pulse->marked = from[1] >= MARKED;
    if (is_vector) {
        const int32_t scale = (int32_t)1 << from[2];
        pulse->x = get_int16(from + 3) * scale;
        pulse->y = get_int16(from + 5) * scale;
        pulse->z = get_int16(from + 7) * scale;
        pulse->period = get_uint16(from + 9);
        pulse->carrier = get_int16(from + 11);
        pulse->level = ARVA_NO_LEVEL;
        pulse->age_ms = get_uint16(from + 13);
    } else {
        pulse->carrier = ARVA_NO_CARRIER;
        pulse->level = get_int16(from + 2);
        pulse->age_ms = get_uint16(from + 4);
    }
    return 1;
}

/* Write a message of `size` bytes from kind to the end of its body, which are at `plain`. */
static size_t seal(const uint8_t *plain, size_t size, uint8_t *out, size_t capacity)
{
    const size_t whole = size + 5u + CRC_BYTES;
    if (capacity < whole) {
        return 0;
    }
    uint8_t mask = 0;
    for (size_t k = 0; k < size; k++) { /* the lowest mask with which no byte is the first of a head */
        if ((plain[k] ^ mask) == SYNC_0) {
            mask++;
            k = (size_t)-1; /* from the beginning */
        }
    }
    out[0] = SYNC_0;
    out[1] = SYNC_1;
    out[2] = VERSION;
    out[3] = (uint8_t)(size + 1u);
    out[4] = mask;
    memcpy(out + 5, plain, size);
    unmask(out + 5, size, mask);
    const uint16_t crc = arva_crc(out + 2, size + 3u);
    out[5u + size] = (uint8_t)(crc & 0xFF);
    out[6u + size] = (uint8_t)(crc >> 8);
    return whole;
}

static size_t put_values(uint8_t *to, const int32_t *values, size_t count)
{
    for (size_t k = 0; k < count; k++) {
        put_int32(to + 4 * k, values[k]);
    }
    return 4 * count;
}

size_t arva_command_encode(const arva_command *command, uint8_t *out, size_t capacity)
{
    if (command->count > ARVA_MAX_VALUES) {
        return 0;
    }
    uint8_t plain[3 + 4 * ARVA_MAX_VALUES] = {ARVA_COMMAND, command->number, command->code};
    return seal(plain, 3u + put_values(plain + 3, command->values, command->count), out, capacity);
}

size_t arva_answer_encode(const arva_answer *answer, uint8_t *out, size_t capacity)
{
    size_t length = 0;
    while (length <= ARVA_MAX_TEXT && answer->text[length] != 0) {
        length++;
    }
    if (answer->count > ARVA_MAX_VALUES || answer->result > ARVA_BUSY ||
        !is_text((const uint8_t *)answer->text, length)) {
        return 0;
    }
    uint8_t plain[5 + 4 * ARVA_MAX_VALUES + ARVA_MAX_TEXT] = {
        ARVA_ANSWER, answer->number, answer->code, answer->result, answer->count,
    };
    const size_t end = 5u + put_values(plain + 5, answer->values, answer->count);
    memcpy(plain + end, answer->text, length);
    return seal(plain, end + length, out, capacity);
}

size_t arva_command_send(arva_request *request, uint8_t code, const int32_t *values, uint8_t count, uint32_t now_ms,
                         uint8_t *out, size_t capacity)
{
    arva_command command;
    if (count > ARVA_MAX_VALUES) {
        return 0;
    }
    memset(&command, 0, sizeof command);
    command.number = (uint8_t)(request->command.number + 1);
    command.code = code;
    command.count = count;
    for (size_t k = 0; k < count; k++) {
        command.values[k] = values[k];
    }
    const size_t size = arva_command_encode(&command, out, capacity);
    if (size > 0) {
        request->command = command;
        request->sent_ms = now_ms;
        request->waiting = 1;
    }
    return size;
}

size_t arva_command_again(arva_request *request, uint32_t now_ms, uint8_t *out, size_t capacity)
{
    if (!request->waiting || request->command.code == ARVA_DO_RESTART || now_ms - request->sent_ms < ARVA_ANSWER_MS) {
        return 0;
    }
    const size_t size = arva_command_encode(&request->command, out, capacity);
    if (size > 0) {
        request->sent_ms = now_ms;
    }
    return size;
}

int arva_command_answered(arva_request *request, const arva_answer *answer)
{
    if (!request->waiting || answer->number != request->command.number || answer->code != request->command.code) {
        return 0;
    }
    request->waiting = 0;
    return 1;
}
