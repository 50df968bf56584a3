/* Prints the readings of a receiver: cc -std=c99 example_main.c arva_frame.c -o example && ./example /dev/ttyUSB0 */
#define _DEFAULT_SOURCE
#include "arva_frame.h"
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

static void on_frame(void *context, const arva_frame *frame)
{
    printf("%s, frame %d:", (const char *)context, frame->sequence);
    for (const arva_channel *c = frame->channels; c < frame->channels + frame->n; c++) {
        arva_valid(c) ? printf(" [%d: %d cm, %d deg]", c->id, c->d_cm, c->delta_deg) : printf(" -");
    }
    puts("");
    fflush(stdout);
}

int main(int argc, char **argv)
{
    struct termios mode;
    const int port = argc == 2 ? open(argv[1], O_RDONLY | O_NOCTTY | O_NONBLOCK) : -1;
    if (port < 0 || tcgetattr(port, &mode) != 0) {
        fputs("usage: example PORT, a serial port\n", stderr);
        return 1;
    }
    cfmakeraw(&mode);
    cfsetspeed(&mode, B115200);
    tcsetattr(port, TCSANOW, &mode);
    arva_decoder decoder;
    arva_decoder_init(&decoder, on_frame, argv[1]);
    for (uint8_t bytes[64];;) {
        struct timespec now;
        struct pollfd line = {port, POLLIN, 0};
        const ssize_t size = poll(&line, 1, 100) > 0 ? read(port, bytes, sizeof bytes) : 0;
        if (size < 0 || (size == 0 && line.revents != 0)) {
            return 0; /* unplugged */
        }
        clock_gettime(CLOCK_MONOTONIC, &now);
        const uint32_t now_ms = (uint32_t)now.tv_sec * 1000u + (uint32_t)now.tv_nsec / 1000000u;
        arva_decoder_feed(&decoder, bytes, (size_t)size, now_ms);
    }
}
