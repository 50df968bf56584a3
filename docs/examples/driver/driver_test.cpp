// Test a driver in C++ against `arva-hil serve --port tcp`: driver_test CONTROL_PORT FRAMES_PORT
// g++ -I firmware_proto/c driver_test.cpp firmware_proto/c/arva_frame.c -o driver_test
#include "arva_frame.h"

#include <arpa/inet.h>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <sys/socket.h>
#include <unistd.h>

static int connect_to(const char *port)
{
    sockaddr_in there = {};
    there.sin_family = AF_INET;
    there.sin_port = htons(static_cast<uint16_t>(std::atoi(port)));
    there.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const int s = socket(AF_INET, SOCK_STREAM, 0);
    if (connect(s, reinterpret_cast<sockaddr *>(&there), sizeof there) != 0) {
        std::perror("connect");
        std::exit(2);
    }
    return s;
}

static void ask(int control, const std::string &request)
{
    const std::string line = request + "\n";
    std::string answer;
    if (write(control, line.data(), line.size()) > 0) {
        for (char c; read(control, &c, 1) == 1 && c != '\n';) {
            answer += c;
        }
    }
    if (answer.rfind("{\"ok\": true", 0) != 0) {
        std::printf("%s: %s\n", request.c_str(), answer.c_str());
        std::exit(1);
    }
}

static int d_cm; // the driver under test: the distance of the newest frame

static void on_frame(void *, const arva_frame *frame) { d_cm = frame->channels[0].d_cm; }

static void read_frames(int port, arva_decoder *decoder, uint32_t count)
{
    uint8_t bytes[256];
    while (decoder->good < count) {
        const ssize_t size = read(port, bytes, sizeof bytes);
        if (size <= 0) {
            std::exit(1);
        }
        arva_decoder_feed(decoder, bytes, static_cast<size_t>(size), 0);
    }
}

int main(int argc, char **argv)
{
    if (argc != 3) {
        return 2;
    }
    const int port = connect_to(argv[2]), control = connect_to(argv[1]);
    arva_decoder decoder;
    arva_decoder_init(&decoder, on_frame, nullptr);
    ask(control, R"({"do": "place", "north": 15, "east": 5, "down": -2})");
    ask(control, R"({"do": "advance", "seconds": 2})");
    read_frames(port, &decoder, 2);
    const bool near = 400 < d_cm && d_cm < 700;
    ask(control, R"({"do": "inject", "fault": "transmitter_off=1"})");
    ask(control, R"({"do": "advance", "seconds": 2})");
    read_frames(port, &decoder, 4);
    const bool silent = d_cm <= 0;
    std::printf("near: %s, silent: %s\n", near ? "ok" : "FAILED", silent ? "ok" : "FAILED");
    return near && silent ? 0 : 1;
}
