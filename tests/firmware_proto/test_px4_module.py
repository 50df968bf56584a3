"""The PX4 module: its array against vectors.json and its README, and what it does on a stand-in for PX4."""

import ctypes
import re
from itertools import pairwise
from pathlib import Path

import pytest
from wire_vectors import VECTORS, by_name

import firmware_proto
from firmware_proto import MID, Channel, Frame, encode
from tools.c_codec import SOURCE, compile_c, compiler

FOLDER = Path(firmware_proto.__file__).parent / "px4"
MODULE = FOLDER / "src" / "modules" / "arva_receiver"
README = (FOLDER / "README.md").read_text(encoding="utf-8")
SIZE, CHANNELS, PASS_MS = 58, 13, 10
FOUR = (Channel(3, 2, 85, 0), Channel(1, MID, 1250, -35), Channel(2, MID, 4020, 17, True), Channel())
ROW = re.compile(r"^\| (?:(\d)k \+ )?(\d+) \| (\w+) \|", re.MULTILINE)
LAYOUT = {name: (int(step or 0), int(offset)) for step, offset, name in ROW.findall(README)}


HEADERS = """drivers/drv_hrt.h parameters/param.h px4_platform_common/Serial.hpp px4_platform_common/cli.h
    px4_platform_common/getopt.h px4_platform_common/log.h px4_platform_common/module.h systemlib/mavlink_log.h
    px4_platform_common/px4_work_queue/ScheduledWorkItem.hpp uORB/Publication.hpp uORB/topics/debug_array.h"""

# What the module uses of PX4: a clock, a port that may be unplugged, a work item, a topic without a queue.
STAND_IN = r"""
#pragma once
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>
#include <sys/types.h>
#define __EXPORT
#define MODULE_NAME "arva_receiver"
#define ORB_ID(topic) 0
#define PRINT_MODULE_DESCRIPTION(text)
#define PRINT_MODULE_USAGE_NAME(...)
#define PRINT_MODULE_USAGE_COMMAND(...)
#define PRINT_MODULE_USAGE_PARAM_STRING(...)
#define PRINT_MODULE_USAGE_PARAM_INT(...)
#define PRINT_MODULE_USAGE_DEFAULT_COMMANDS()
#define PX4_INFO(...) say("I", __VA_ARGS__)
#define PX4_WARN(...) say("W", __VA_ARGS__)
#define PX4_ERR(...) say("E", __VA_ARGS__)
#define mavlink_log_info(advert, ...) say("i", __VA_ARGS__)
#define mavlink_log_warning(advert, ...) say("w", __VA_ARGS__)
enum { PX4_OK = 0, PX4_ERROR = -1 };
typedef uint64_t hrt_abstime;
typedef void *orb_advert_t;
namespace time_literals {
constexpr hrt_abstime operator"" _s(unsigned long long x) { return x * 1000000; }
constexpr hrt_abstime operator"" _ms(unsigned long long x) { return x * 1000; }
}
struct debug_array_s {
	static constexpr int ARRAY_SIZE = 58;
	uint64_t timestamp;
	float data[58];
	uint16_t id;
	char name[10];
};
static hrt_abstime now_us = 1000000;
static int plugged = 0, baud = 0;  // plugged: how often, 0 when it is not
static bool fails = false;         // an unplugged port says so, others are silent
static std::string line, said;
static std::vector<debug_array_s> published;
static bool advertised = false;
template <typename... Args> void say(const char *level, const char *format, Args... args)
{
	char text[200] = "";
	snprintf(text, sizeof(text), format, args...);
	said += std::string(level) + " " + text + "\n";
}
inline hrt_abstime hrt_absolute_time() { return now_us; }
inline hrt_abstime hrt_elapsed_time(const hrt_abstime *then) { return now_us - *then; }
inline int param_find(const char *name) { return strcmp(name, "SENS_ARVA_BAUD") == 0 ? 1 : 0; }
inline int param_get(int handle, int *value) { *value = handle ? 57600 : 0; return 0; }
inline int px4_get_parameter_value(const char *text, int &value) { value = atoi(text); return value ? 0 : -1; }
inline int px4_getopt(int argc, char **argv, const char *options, int *index, const char **argument)
{
	if (*index + 1 >= argc) { return EOF; }
	*argument = argv[*index + 1];
	*index += 2;
	const char option = argv[*index - 2][1];
	return strchr(options, option) ? option : '?';
}
namespace device {
struct Serial {
	int opened = 0;
	bool setPort(const char *) { return plugged > 0; }
	bool setBaudrate(uint32_t rate) { baud = (int)rate; return true; }
	uint32_t getBaudrate() const { return (uint32_t)baud; }
	bool isOpen() const { return opened > 0; }
	bool open() { opened = plugged; return true; }
	bool close() { opened = 0; return true; }
	void flush() { line.clear(); }
	ssize_t read(uint8_t *bytes, size_t size)
	{
		if (opened != plugged || line.empty()) {
			errno = opened != plugged && fails ? EIO : EAGAIN;
			return -1;
		}
		size = line.copy((char *)bytes, size);
		line.erase(0, size);
		return (ssize_t)size;
	}
};
}
namespace px4 {
inline int serial_port_to_wq(const char *) { return 0; }
struct ScheduledWorkItem;
static ScheduledWorkItem *scheduled = nullptr;
static hrt_abstime interval = 0;
struct ScheduledWorkItem {
	ScheduledWorkItem(const char *, int) {}
	virtual ~ScheduledWorkItem() {}
	virtual void Run() = 0;
	void ScheduleOnInterval(hrt_abstime us) { scheduled = this; interval = us; }
	void ScheduleClear() { scheduled = nullptr; }
};
}
namespace uORB {
template <typename T> struct Publication {
	Publication(int) {}
	void advertise() { advertised = true; }
	void publish(const T &message) { published.push_back(message); }
};
}
template <typename T> struct Holder {
	T *object = nullptr;
	void store(T *value) { object = value; }
};
template <typename T> struct ModuleBase {
	static Holder<T> _object;
	static int _task_id;
	static constexpr int task_id_is_work_queue = -2;
	static bool stopping;
	virtual ~ModuleBase() {}
	virtual int print_status() = 0;
	bool should_exit() const { return stopping; }
	static void exit_and_cleanup() { delete _object.object; _object.object = nullptr; stopping = false; }
	static int main(int argc, char **argv)
	{
		const std::string command = argc > 1 ? argv[1] : "";
		if (command == "start") { return T::task_spawn(argc - 1, argv + 1); }
		if (command == "status") { return _object.object->print_status(); }
		if (command == "stop") { stopping = true; return 0; }
		return T::custom_command(argc - 1, argv + 1);
	}
};
template <typename T> Holder<T> ModuleBase<T>::_object;
template <typename T> int ModuleBase<T>::_task_id = -1;
template <typename T> bool ModuleBase<T>::stopping = false;
"""

DRIVER = r"""
#include "arva_receiver.cpp"
extern "C" {
int run(unsigned ms)
{
	for (const hrt_abstime end = now_us + ms * 1000; now_us < end && px4::scheduled;) {
		now_us += px4::interval;
		px4::scheduled->Run();
	}
	return px4::scheduled != nullptr;
}
void receive(const char *bytes, size_t size) { if (plugged) { line.append(bytes, size); } }
void plug(int number, int noisy) { plugged = number; fails = noisy; line.clear(); }
size_t count() { return published.size(); }
const void *at(size_t k) { return &published[k]; }
const char *text() { static std::string out; out.swap(said); said.clear(); return out.c_str(); }
size_t pack(const uint8_t *bytes, size_t size, float *data)
{
	static float *to;
	static arva_decoder decoder;
	to = data;
	arva_decoder_init(&decoder, [](void *, const arva_frame *frame) { arva_array_pack(frame, &decoder, to); }, nullptr);
	return arva_decoder_feed(&decoder, bytes, size, 0);
}
int is_advertised() { return advertised; }
int interval_us() { return (int)px4::interval; }
int baudrate() { return baud; }
}
"""


class DebugArray(ctypes.Structure):
    _fields_ = (
        ("timestamp", ctypes.c_uint64),
        ("data", ctypes.c_float * SIZE),
        ("id", ctypes.c_uint16),
        ("name", ctypes.c_char * 10),
    )


@pytest.fixture(scope="module")
def binary(tmp_path_factory):
    folder = tmp_path_factory.mktemp("px4")
    for name in HEADERS.split():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text('#include "stand_in.hpp"\n')
    (folder / "stand_in.hpp").write_text(STAND_IN)
    (folder / "driver.cpp").write_text(DRIVER)
    codec = compile_c(compiler(), folder / "codec.o", "-std=c99", "-fPIC", "-c", SOURCE)
    command = compiler("g++", "clang++", "c++")
    options = ("-std=c++14", "-Wno-conversion", "-Wno-unused-parameter", "-Wno-format-security", "-fPIC", "-shared")
    include = (f"-I{folder}", f"-I{MODULE}")
    return compile_c(command, folder / "px4.so", *options, *include, folder / "driver.cpp", codec)


class Px4:
    """A PX4 of its own: the library is loaded anew, from a copy."""

    def __init__(self, binary, folder):
        path = folder / "px4.so"
        path.write_bytes(binary.read_bytes())
        self.library = ctypes.CDLL(str(path))
        self.library.at.restype = ctypes.POINTER(DebugArray)
        self.library.at.argtypes = (ctypes.c_size_t,)
        self.library.text.restype = ctypes.c_char_p
        self.library.receive.argtypes = (ctypes.c_char_p, ctypes.c_size_t)
        self.times = 0

    def command(self, *words):
        words = [b"arva_receiver", *(word.encode() for word in words)]
        return self.library.arva_receiver_main(len(words), (ctypes.c_char_p * len(words))(*words))

    def plug(self):
        self.times += 1
        self.library.plug(self.times, 0)

    def unplug(self, noisy=False):
        self.library.plug(0, int(noisy))

    def receive(self, raw):
        self.library.receive(raw, len(raw))

    def run(self, ms):
        return bool(self.library.run(ms))

    def said(self):
        return self.library.text().decode().splitlines()

    @property
    def published(self):
        return [self.library.at(k).contents for k in range(self.library.count())]

    @property
    def sequences(self):
        return [int(message.data[LAYOUT["sequence"][1]]) for message in self.published]


@pytest.fixture
def px4(binary, tmp_path):
    return Px4(binary, tmp_path)


@pytest.fixture
def started(px4):
    px4.plug()
    assert px4.command("start", "-d", "/dev/ttyS3") == 0
    px4.run(PASS_MS)
    return px4


def raw(sequence, channels=FOUR):
    return encode(Frame(sequence % 256, 1, channels))


def value(data, name, k=0):
    step, offset = LAYOUT[name]
    return data[step * k + offset]


@pytest.mark.parametrize("vector", by_name(VECTORS["frames"]))
def test_the_array_is_the_frame_in_the_layout_of_the_readme(px4, vector):
    assert sorted(LAYOUT) == sorted("d delta id zone n sequence status lost bad_crc dropped".split())
    data = (ctypes.c_float * SIZE)(*[0.5] * SIZE)
    bytes_ = bytes.fromhex(vector["hex"])
    assert px4.library.pack(bytes_, len(bytes_), data) == 1
    channels = vector["channels"]
    assert [value(data, name) for name in ("n", "sequence", "status")] == [
        len(channels), vector["sequence"], vector["status"],
    ]  # fmt: skip
    assert [value(data, name) for name in ("lost", "bad_crc", "dropped")] == [0, 0, 0]
    nothing = {"id": None, "zone": 0, "marked": False, "d": -1, "delta": -1}
    for k, c in enumerate((channels + CHANNELS * [nothing])[:CHANNELS]):
        assert value(data, "d", k) == c["d"]
        assert value(data, "delta", k) == c["delta"]
        assert value(data, "id", k) == (255 if c["id"] is None else c["id"])
        assert value(data, "zone", k) == c["zone"] + 128 * c["marked"]


def test_the_build_files_name_what_there_is():
    assert f"modules/{MODULE.name}" in (FOLDER / "src" / "CMakeLists.txt").read_text()
    cmake = (MODULE / "CMakeLists.txt").read_text()
    for name in re.findall(r"[\w./]+\.(?:cpp|c|yaml)\b", cmake):
        assert (MODULE / name).is_file() or (FOLDER.parent / "c" / Path(name).name).is_file()
    assert (MODULE / "../../../../c/arva_frame.c").is_file()
    assert "../../../../c" in cmake


@pytest.mark.parametrize(("hertz", "n"), [(1, 4), (50, 1), (50, 16)])
def test_no_frame_is_lost(started, hertz, n):
    for k in range(6 * hertz):
        data = raw(k, (FOUR * 4)[:n])
        for at in range(0, 105, 53):
            started.receive(data[at : at + 53])
            started.run(PASS_MS)
        started.run(1000 // hertz - 2 * PASS_MS)
    assert started.sequences == [k % 256 for k in range(6 * hertz)]
    assert {(m.id, m.name) for m in started.published} == {(457, b"arva")}
    assert started.said() == [f"i ARVA: receiver found, channels: {n}"]


def test_of_several_frames_at_once_each_is_published_in_a_pass_of_its_own(started):
    assert started.library.is_advertised()  # before the first frame, for the logger
    started.receive(b"".join(raw(k) for k in range(20)))
    started.run(30 * PASS_MS)
    assert started.sequences == list(range(20))
    times = [message.timestamp for message in started.published]
    assert min(b - a for a, b in pairwise(times)) == started.library.interval_us()


def test_counters_are_in_the_array(started):
    broken = bytearray(raw(1))
    broken[-1] ^= 1
    for data in (raw(0), b"x", bytes(broken), raw(5)):
        started.receive(data)
        started.run(100)
    data = started.published[-1].data
    assert (value(data, "lost"), value(data, "bad_crc"), value(data, "dropped")) == (4, 1, 34)


@pytest.mark.parametrize("noisy", [True, False], ids=["error", "silence"])
def test_a_receiver_is_lost_after_two_seconds_and_comes_back(started, noisy):
    started.receive(raw(0))
    started.run(PASS_MS)
    started.unplug(noisy)
    started.said()
    started.run(2000)
    assert started.said() == []
    started.run(PASS_MS)
    assert started.said() == ["w ARVA: receiver lost"]
    started.run(60_000)
    assert started.said() == []
    started.plug()
    started.run(500)
    started.receive(raw(1))
    started.run(PASS_MS)
    assert started.said() == ["i ARVA: receiver found, channels: 4"]
    assert started.sequences == [0, 1]


def test_a_port_that_appears_later_is_opened(px4):
    px4.command("start", "-d", "/dev/ttyS3")
    px4.run(2000 + PASS_MS)
    assert px4.said() == ["w ARVA: no receiver"]
    px4.plug()
    px4.run(500)
    px4.receive(raw(0))
    px4.run(PASS_MS)
    assert px4.sequences == [0]


def test_a_port_that_fails_is_opened_again_within_half_a_second(started):
    started.unplug(noisy=True)
    started.run(PASS_MS)
    started.plug()
    started.run(500)
    started.receive(raw(0))
    started.run(PASS_MS)
    assert started.sequences == [0]


def test_what_waited_in_the_port_is_thrown_away(px4):
    px4.plug()
    px4.receive(raw(0))
    px4.command("start", "-d", "/dev/ttyS3")
    px4.run(100)
    assert px4.sequences == []


def test_bytes_that_are_no_frames_are_said(started):
    for _ in range(20):
        started.receive(b"85,0\r\n")
        started.run(100)
    assert started.said() == ["w ARVA: no frames, only 120 bytes: baud rate?"]


def test_status(started):
    started.receive(raw(7))
    started.run(40)
    started.said()
    started.command("status")
    assert started.said() == [
        "I port /dev/ttyS3 at 57600 baud: open",
        "I receiver: heard",
        "I frames: 1 good, 0 lost, 0 with a wrong CRC; bytes in none: 0",
        "I last frame: 30 ms ago, sequence 7, status 0x01, channels 4",
        "I channel 1: transmitter 3, zone 2, 85 cm, 0 degrees",
        "I channel 2: transmitter 1, zone 1, 1250 cm, -35 degrees",
        "I channel 3: transmitter 2, zone 1 (marked), 4020 cm, 17 degrees",
        "I channel 4: no signal",
    ]


def test_start_and_stop(px4):
    assert px4.command("start") != 0
    assert px4.command("start", "-d", "/dev/" + 27 * "x") != 0
    assert px4.command("start", "-d", "/dev/ttyS3", "-b", "x") != 0
    assert px4.command("start", "-d", "/dev/ttyS3", "-x", "1") != 0
    assert not px4.run(PASS_MS)
    assert px4.command("start", "-d", "/dev/ttyS3", "-b", "19200") == 0
    assert px4.library.baudrate() == 19200
    assert px4.run(PASS_MS)
    px4.command("stop")
    assert not px4.run(PASS_MS)
