/* Any bytes as a script for the C decoder of messages, for a sanitizer to watch: chunks with pauses between them.
 *
 * One decoder is fed them whole and another one byte by byte: both must agree on every call. What comes out is encoded
 * again where there is an encoder, and must come out once more. Each chunk, body and output lies in memory of exactly
 * its size. See c.py. */
#include "arva_message.h"
#include "harness.h"

/* What a decoder delivered: a sum over kind, size and body of every message, and their bytes on the wire. */
struct heard {
    uint64_t sum;
    size_t messages, bytes;
};

static void add(struct heard *heard, const void *data, size_t size)
{
    for (size_t k = 0; k < size; k++) {
        heard->sum = (heard->sum ^ ((const uint8_t *)data)[k]) * 0x100000001B3u;
    }
}

static void on_again(void *context, const arva_message *message)
{
    struct heard *heard = (struct heard *)context;
    add(heard, message->body, message->size);
    heard->messages++;
}

/* A message that was encoded again is one message with the same body. */
static void require_again(const arva_message *message, const uint8_t *raw, size_t size)
{
    struct heard again = {0, 0, 0}, first = {0, 0, 0};
    arva_message_decoder decoder;
    arva_message_decoder_init(&decoder, ARVA_WANT_ALL, on_again, &again);
    REQUIRE(arva_message_decoder_feed(&decoder, raw, size, 7) == 1 && decoder.dropped == 0);
    add(&first, message->body, message->size);
    REQUIRE(first.sum == again.sum);
    for (size_t k = 1; k + 2 < size; k++) {
        REQUIRE(raw[k] != 0xA4);
    }
}

static void on_message(void *context, const arva_message *given)
{
    struct heard *heard = (struct heard *)context;
    uint8_t *body = (uint8_t *)exactly(given->size);
    memcpy(body, given->body, given->size);
    const arva_message tight = {given->kind, given->size, body};
    const arva_message *message = &tight;
    const size_t size = message->size + 8u;
    uint8_t *out = (uint8_t *)exactly(size);
    arva_command command;
    arva_answer answer;
    arva_measured measured;
    arva_pulse pulse;
    const int is_command = arva_command_get(message, &command), is_answer = arva_answer_get(message, &answer);
    const int is_measured = arva_measured_get(message, &measured);
    REQUIRE(is_command + is_answer + is_measured == 1);
    if (is_command) {
        REQUIRE(arva_command_encode(&command, out, size - 1) == 0);
        REQUIRE(arva_command_encode(&command, out, size) == size);
        require_again(message, out, size);
    } else if (is_answer) {
        REQUIRE(strlen(answer.text) <= ARVA_MAX_TEXT && answer.result <= ARVA_BUSY);
        REQUIRE(arva_answer_encode(&answer, out, size - 1) == 0);
        REQUIRE(arva_answer_encode(&answer, out, size) == size);
        require_again(message, out, size);
    } else {
        REQUIRE(measured.n >= 1 && measured.n <= ARVA_MAX_CHANNELS);
        for (size_t k = 0; k < measured.n; k++) {
            REQUIRE(arva_pulse_get(message, k, &pulse) && pulse.marked <= 1 && pulse.zone <= 127);
        }
        REQUIRE(!arva_pulse_get(message, measured.n, &pulse));
    }
    add(heard, &message->kind, 1);
    add(heard, body, message->size);
    heard->messages++;
    heard->bytes += size;
    free(out);
    free(body);
}

static size_t special_size(int special)
{
    (void)special;
    return 60;
}

/* What no mutation hits upon: head and CRC round the rest, of a size that the kind can have. */
static void make_good(uint8_t *bytes, size_t room, unsigned kind)
{
    static const uint8_t kinds[] = {ARVA_VECTORS, ARVA_LEVELS, ARVA_COMMAND, ARVA_ANSWER};
    const size_t bodies[] = {7u + 15u * (1 + kind / 4 % 3), 7u + 6u * (1 + kind / 4 % 3), 2u + 4u * (kind / 4), 4u + kind};
    const size_t body = bodies[kind % 4], size = body + 8u;
    if (size > room) {
        return;
    }
    const uint8_t mask = bytes[4];
    bytes[0] = 0xA4;
    bytes[1] = 0x57;
    bytes[2] = 2;
    bytes[3] = (uint8_t)(body + 2);
    bytes[5] = kinds[kind % 4] ^ mask;
    if (kind % 4 < 2) {
        bytes[8] = (uint8_t)(1 + kind / 4 % 3) ^ mask; /* channels */
    } else if (kind % 4 == 3) {
        bytes[8] = (bytes[8] & 3) ^ mask; /* result */
        bytes[9] = mask;                  /* no values */
    }
    const uint16_t crc = arva_crc(bytes + 2, size - 4);
    bytes[size - 2] = (uint8_t)(crc & 0xFF);
    bytes[size - 1] = (uint8_t)(crc >> 8);
}

/* A request from any bytes: what it writes fits, and only its own answer ends it. */
static void request_from(const uint8_t *data, size_t size)
{
    arva_request request;
    arva_answer answer;
    int32_t values[ARVA_MAX_VALUES + 1] = {1, -1, INT32_MIN, INT32_MAX, 0};
    memset(&request, 0, sizeof request);
    memset(&answer, 0, sizeof answer);
    memcpy(&request.command, data, size < sizeof request.command ? size : sizeof request.command);
    memcpy(&answer, data, size < sizeof answer ? size : sizeof answer);
    const size_t room = size % 64;
    uint8_t *out = (uint8_t *)exactly(room);
    const uint8_t count = (uint8_t)(size % (ARVA_MAX_VALUES + 2));
    REQUIRE(arva_answer_encode(&answer, out, room) <= room);
    REQUIRE(arva_command_encode(&request.command, out, room) <= room);
    const size_t wrote = arva_command_send(&request, (uint8_t)size, values, count, 5, out, room);
    REQUIRE(wrote == 0 || (count <= ARVA_MAX_VALUES && wrote == 10u + 4u * count && request.waiting));
    if (wrote > 0) {
        REQUIRE(arva_command_again(&request, 5 + ARVA_ANSWER_MS - 1, out, room) == 0);
        REQUIRE(arva_command_again(&request, 5 + ARVA_ANSWER_MS, out, room) == (request.command.code == 5 ? 0 : wrote));
        const int same = answer.number == request.command.number && answer.code == request.command.code;
        REQUIRE(arva_command_answered(&request, &answer) == same && request.waiting == !same);
    }
    free(out);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size < 4) {
        return 0;
    }
    struct heard of_whole = {0, 0, 0}, of_single = {0, 0, 0};
    arva_message_decoder *whole = (arva_message_decoder *)exactly(sizeof *whole);
    arva_message_decoder *single = (arva_message_decoder *)exactly(sizeof *single);
    arva_message_decoder_init(whole, ARVA_WANT_ALL, on_message, &of_whole);
    arva_message_decoder_init(single, ARVA_WANT_ALL, on_message, &of_single);
    uint64_t fed = 0;
    struct script s = begin(data, size);
    while (next(&s, special_size)) {
        const uint32_t now_ms = (uint32_t)s.now_ms;
        if (s.special >= 0) {
            make_good(s.chunk, s.chunk_size, (unsigned)s.special);
        }
        fed += s.chunk_size;
        const size_t before = of_whole.messages;
        const size_t count = arva_message_decoder_feed(whole, s.chunk_size > 0 ? s.chunk : NULL, s.chunk_size, now_ms);
        REQUIRE(count == of_whole.messages - before);
        arva_message_decoder_feed(single, NULL, 0, now_ms);
        for (size_t k = 0; k < s.chunk_size; k++) {
            arva_message_decoder_feed(single, s.chunk + k, 1, now_ms);
        }
        free(s.chunk);
        REQUIRE(of_whole.sum == of_single.sum && of_whole.messages == of_single.messages);
        REQUIRE(whole->good == of_whole.messages && single->good == whole->good);
        REQUIRE(whole->bad_crc == single->bad_crc && whole->dropped == single->dropped && whole->count == single->count);
        REQUIRE(whole->dropped + whole->count + of_whole.bytes == fed); /* every byte is counted once */
    }
    request_from(data, size);
    delivered_in_all += of_whole.messages;
    free(single);
    free(whole);
    return 0;
}
