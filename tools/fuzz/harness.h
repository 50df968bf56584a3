/* What frames.c and messages.c share: how what is not so ends the run, the script in an input, and the main of a harness
 * that is compiled without libFuzzer. */
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define REQUIRE(truth) ((truth) ? (void)0 : fail(#truth, __FILE__, __LINE__))

static uint64_t delivered_in_all;

static void fail(const char *what, const char *file, int line)
{
    fprintf(stderr, "%s:%d: not so: %s\n", file, line, what);
    abort();
}

static void *exactly(size_t size)
{
    void *memory = malloc(size);
    REQUIRE(memory != NULL || size == 0);
    return memory;
}

/* Four bytes: when it begins. Then, again and again: the size of a chunk, the pause before it, the chunk. Sizes
 * 240...255 stand for what a harness makes good, numbered from 0; `special` is -1 for any other chunk. */
struct script {
    const uint8_t *data;
    size_t size, at;
    uint64_t now_ms;
    int special;
    uint8_t *chunk; /* in memory of exactly its size; whoever asked for it frees it */
    size_t chunk_size;
};

static struct script begin(const uint8_t *data, size_t size)
{
    struct script s = {data, size, 4, 0, -1, NULL, 0};
    for (size_t k = 0; k < 4; k++) {
        s.now_ms |= (uint64_t)data[k] << 8 * k;
    }
    return s;
}

static int next(struct script *s, size_t (*special_size)(int special))
{
    if (s->at + 2 > s->size) {
        return 0;
    }
    const unsigned head = s->data[s->at], pause = s->data[s->at + 1];
    s->at += 2;
    s->now_ms += pause < 225 ? pause / 2 : (uint64_t)1 << (pause - 225); /* at most 2^30: 12 days */
    s->special = (int)head < 240 ? -1 : (int)head - 240;
    const size_t wanted = s->special < 0 ? head : special_size(s->special), left = s->size - s->at;
    s->chunk_size = wanted < left ? wanted : left;
    s->chunk = (uint8_t *)exactly(s->chunk_size);
    if (s->chunk_size > 0) {
        memcpy(s->chunk, s->data + s->at, s->chunk_size);
    }
    s->at += s->chunk_size;
    return 1;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#ifdef FUZZ_BY_ITSELF
static uint64_t state;

static uint32_t below(uint32_t limit)
{
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(state >> 33) % limit;
}

int main(int argc, char **argv)
{
    enum { MOST = 4096 };
    static uint8_t seeds[512][MOST], input[MOST];
    static size_t sizes[512];
    REQUIRE(argc > 3 && argc - 3 <= 512);
    const uint32_t files = (uint32_t)argc - 3;
    state = strtoull(argv[2], NULL, 10);
    for (uint32_t k = 0; k < files; k++) {
        FILE *file = fopen(argv[3 + k], "rb");
        REQUIRE(file != NULL);
        sizes[k] = fread(seeds[k], 1, MOST, file);
        fclose(file);
        LLVMFuzzerTestOneInput(seeds[k], sizes[k]);
    }
    for (unsigned long run = strtoul(argv[1], NULL, 10); run > 0; run--) {
        const uint32_t one = below(files), other = below(files);
        const size_t head = below((uint32_t)sizes[one] + 1), from = below((uint32_t)sizes[other] + 1);
        size_t size = sizes[other] - from;
        size = size < MOST - head ? size : MOST - head;
        memcpy(input, seeds[one], head);
        memcpy(input + head, seeds[other] + from, size);
        size += head;
        for (uint32_t edits = below(6); edits > 0 && size > 0; edits--) {
            input[below((uint32_t)size)] = (uint8_t)below(256);
        }
        LLVMFuzzerTestOneInput(input, size);
    }
    printf("%lu delivered, nothing found\n", (unsigned long)delivered_in_all);
    return 0;
}
#endif
