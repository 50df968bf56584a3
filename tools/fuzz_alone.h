/* The main of a harness that is compiled without libFuzzer. It needs REQUIRE and counts delivered_in_all. */
#ifdef FUZZ_BY_ITSELF
/* Without libFuzzer: `PROGRAM RUNS SEED FILE...` runs each file, then RUNS damaged and spliced copies of them. */
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
