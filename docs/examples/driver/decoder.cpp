// Print the readings of an ARVA receiver, one JSON line for each frame and channel.
// g++ -I firmware_proto/c decoder.cpp firmware_proto/c/arva_frame.c -o decoder
#include "arva_frame.h"

#include <cstdio>
#include <cstdlib>
#include <fcntl.h>
#include <poll.h>
#include <time.h>
#include <unistd.h>

static void print(void *, const arva_frame *frame)
{
    for (int k = 0; k < frame->n; k++) {
        const arva_channel &c = frame->channels[k];
        std::printf("{\"seq\": %d, \"slot\": %d, \"id\": %d, \"zone\": %d, \"d_cm\": %d, \"delta_deg\": %d}\n",
                    frame->sequence, k + 1, c.id, c.zone, c.d_cm, c.delta_deg);
    }
    std::fflush(stdout);
}

int main()
{
    const char *name = std::getenv("ARVA_PORT");
    const int port = name ? open(name, O_RDWR | O_NOCTTY) : STDIN_FILENO;
    arva_decoder decoder;
    arva_decoder_init(&decoder, print, nullptr);
    for (uint8_t bytes[4096];;) {
        pollfd line = {port, POLLIN, 0};
        const ssize_t size = poll(&line, 1, 50) > 0 ? read(port, bytes, sizeof bytes) : 0;
        timespec now;
        clock_gettime(CLOCK_MONOTONIC, &now);
        const auto now_ms = static_cast<uint32_t>(now.tv_sec * 1000 + now.tv_nsec / 1000000);
        arva_decoder_feed(&decoder, bytes, size > 0 ? static_cast<size_t>(size) : 0, now_ms);
        if (size < 0 || (size == 0 && line.revents != 0)) {
            return 0; // the input has ended
        }
    }
}
