"""A stand-in for PX4 with the module in it, compiled and driven from Python: a clock, ports, topics, a shell."""

import ctypes
import re
from pathlib import Path

import firmware_proto

FOLDER = Path(firmware_proto.__file__).parent / "px4"
MODULE = FOLDER / "src" / "modules" / "arva_receiver"
README = (FOLDER / "README.md").read_text(encoding="utf-8")
SIZE = 58
ROW = re.compile(r"^\| (?:(\d)k \+ )?(\d+) \| (\w+) \|", re.MULTILINE)
LAYOUT = {name: (int(step or 0), int(offset)) for step, offset, name in ROW.findall(README)}


def message_of(topic):
    name = "".join(word.capitalize() for word in topic.split("_"))
    return (FOLDER / "msg" / f"{name}.msg").read_text(encoding="utf-8")


MESSAGE = message_of("arva_reading")
HEADERS = """containers/LockGuard.hpp drivers/drv_hrt.h parameters/param.h px4_platform_common/Serial.hpp
    px4_platform_common/cli.h
    px4_platform_common/getopt.h px4_platform_common/log.h px4_platform_common/module.h systemlib/mavlink_log.h
    px4_platform_common/px4_work_queue/ScheduledWorkItem.hpp uORB/Publication.hpp uORB/topics/arva_reading.h
    uORB/topics/debug_array.h uORB/topics/arva_answer.h uORB/topics/arva_pulses.h"""

# What the module uses of PX4: a clock, a port that may be unplugged, a work item, topics. int32_t is long,
# as it is on a board.
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
#ifdef __arm__
#define PTHREAD_MUTEX_INITIALIZER 0
#else
typedef long board_int32_t;
#define int32_t board_int32_t
#endif
#define __EXPORT
#define MODULE_NAME "arva_receiver"
#define ORB_ID(topic) 0
#define PRINT_MODULE_DESCRIPTION(text)
#define PRINT_MODULE_USAGE_NAME(...)
#define PRINT_MODULE_USAGE_COMMAND(...)
#define PRINT_MODULE_USAGE_COMMAND_DESCR(...)
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
ARVA_READING
static hrt_abstime now_us = 1000000;
static int plugged = 0, baud = 0;  // plugged: how often, 0 when it is not
static bool fails = false;         // an unplugged port says so, others are silent
static std::string line, said;
static std::vector<debug_array_s> published;
static std::vector<arva_reading_s> readings;
static std::vector<arva_answer_s> answers;
static std::vector<arva_pulses_s> pulses;
static std::string sent;
static void (*interrupt)() = nullptr;  // what happens in the middle of the next line of the shell's
static int advertised = 0;
template <typename... Args> void say(const char *level, const char *format, Args... args)
{
	char text[200] = "";
	snprintf(text, sizeof(text), format, args...);
	said += std::string(level) + " " + text + "\n";
	if (interrupt != nullptr && *level == 'I') {
		void (*const happens)() = interrupt;
		interrupt = nullptr;
		happens();
	}
}
inline hrt_abstime hrt_absolute_time() { return now_us; }
inline hrt_abstime hrt_elapsed_time(const hrt_abstime *then) { return now_us - *then; }
inline int param_find(const char *name) { return strcmp(name, "SENS_ARVA_BAUD") == 0 ? 1 : 0; }
inline int param_get(int handle, int32_t *value) { *value = handle ? 57600 : 0; return 0; }
inline int px4_get_parameter_value(const char *text, int &value) { value = atoi(text); return value ? 0 : -1; }
inline int px4_getopt(int argc, char **argv, const char *options, int *index, const char **argument)
{
	if (*index + 1 >= argc) { return EOF; }
	*argument = argv[*index + 1];
	*index += 2;
	const char option = argv[*index - 2][1];
	return strchr(options, option) ? option : '?';
}
static int held = 0;
struct LockGuard {
	explicit LockGuard(pthread_mutex_t &) { if (held++) { abort(); } }
	~LockGuard() { held--; }
};
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
	ssize_t write(const void *bytes, size_t size) { sent.append((const char *)bytes, size); return (ssize_t)size; }
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
	void advertise() { advertised++; }
	void publish(const debug_array_s &message) { published.push_back(message); }
	void publish(const arva_reading_s &message) { readings.push_back(message); }
	void publish(const arva_answer_s &message) { answers.push_back(message); }
	void publish(const arva_pulses_s &message) { pulses.push_back(message); }
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
	static bool is_running() { return _object.object != nullptr; }
	static T *get_instance() { return _object.object; }
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
void run_in_next_line() { interrupt = []() { px4::scheduled->Run(); }; }
size_t count() { return published.size(); }
const void *at(size_t k) { return &published[k]; }
size_t readings_count() { return readings.size(); }
const void *reading_at(size_t k) { return &readings[k]; }
size_t answers_count() { return answers.size(); }
const void *answer_at(size_t k) { return &answers[k]; }
size_t pulses_count() { return pulses.size(); }
const void *pulses_at(size_t k) { return &pulses[k]; }
size_t take_sent(char *to) { const size_t size = sent.copy(to, 4096); sent.clear(); return size; }
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


TYPES = {
    "uint8": ctypes.c_uint8,
    "bool": ctypes.c_bool,
    "char": ctypes.c_char,
    "int16": ctypes.c_int16,
    "uint16": ctypes.c_uint16,
    "int32": ctypes.c_long,  # as the stand-in has it
    "float32": ctypes.c_float,
    "uint32": ctypes.c_uint32,
    "uint64": ctypes.c_uint64,
}
FIELD = re.compile(r"^(\w+?)(?:\[(\d+)\])? (\w+)(?: = (\d+))?\s*(?:#.*)?$", re.MULTILINE)


def constants_of(message):
    return {name: (kind, int(number)) for kind, _, name, number in FIELD.findall(message) if number}


def fields_of(message):
    """Widest first, as PX4's generator has them."""
    lines = [line for line in FIELD.findall(message) if not line[3]]
    return sorted(lines, key=lambda line: -ctypes.sizeof(TYPES[line[0]]))


CONSTANTS = {name: number for name, (_, number) in constants_of(MESSAGE).items()}


def c_struct():
    """What PX4's generator makes of the messages."""
    structs = []
    for topic in ("arva_reading", "arva_answer", "arva_pulses"):
        message = message_of(topic)
        constants = "".join(
            f"static constexpr {kind}_t {name} = {number};\n" for name, (kind, number) in constants_of(message).items()
        )
        c_type = {"bool": "bool", "char": "char", "float32": "float"}
        fields = "".join(
            f"{c_type.get(kind, kind + '_t')} {name}{f'[{count}]' if count else ''};\n"
            for kind, count, name, _ in fields_of(message)
        )
        structs.append(f"struct {topic}_s {{\n{constants}{fields}}};")
    return "\n".join(structs)


def ctypes_fields(topic):
    return tuple(
        (name, TYPES[kind] * int(count) if count else TYPES[kind])
        for kind, count, name, _ in fields_of(message_of(topic))
    )


class ArvaReading(ctypes.Structure):
    _fields_ = ctypes_fields("arva_reading")


class ArvaAnswer(ctypes.Structure):
    _fields_ = ctypes_fields("arva_answer")


class ArvaPulses(ctypes.Structure):
    _fields_ = ctypes_fields("arva_pulses")


class DebugArray(ctypes.Structure):
    _fields_ = (
        ("timestamp", ctypes.c_uint64),
        ("data", ctypes.c_float * SIZE),
        ("id", ctypes.c_uint16),
        ("name", ctypes.c_char * 10),
    )


class Px4:
    """A PX4 of its own: the library is loaded anew, from a copy."""

    def __init__(self, binary, folder):
        path = folder / "px4.so"
        path.write_bytes(binary.read_bytes())
        self.library = ctypes.CDLL(str(path))
        self.library.at.restype = ctypes.POINTER(DebugArray)
        self.library.at.argtypes = (ctypes.c_size_t,)
        self.library.reading_at.restype = ctypes.POINTER(ArvaReading)
        self.library.reading_at.argtypes = (ctypes.c_size_t,)
        for name, kind in (("answer_at", ArvaAnswer), ("pulses_at", ArvaPulses)):
            getattr(self.library, name).restype = ctypes.POINTER(kind)
            getattr(self.library, name).argtypes = (ctypes.c_size_t,)
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

    def give(self, raw, ms):
        """Bytes come to the port, and so much time passes."""
        self.receive(raw)
        self.run(ms)

    def said(self):
        return self.library.text().decode().splitlines()

    @property
    def published(self):
        return [self.library.at(k).contents for k in range(self.library.count())]

    @property
    def readings(self):
        return [self.library.reading_at(k).contents for k in range(self.library.readings_count())]

    @property
    def sequences(self):
        return [int(message.data[LAYOUT["sequence"][1]]) for message in self.published]

    @property
    def answers(self):
        return [self.library.answer_at(k).contents for k in range(self.library.answers_count())]

    @property
    def pulses(self):
        return [self.library.pulses_at(k).contents for k in range(self.library.pulses_count())]

    def sent(self):
        """What was written to the port since the last call."""
        out = ctypes.create_string_buffer(4096)
        size = self.library.take_sent(out)
        return out.raw[:size]
