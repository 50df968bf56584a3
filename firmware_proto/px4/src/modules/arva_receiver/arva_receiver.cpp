#include "arva_receiver.hpp"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <parameters/param.h>
#include <px4_platform_common/cli.h>
#include <px4_platform_common/getopt.h>
#include <px4_platform_common/log.h>
#include <systemlib/mavlink_log.h>

static_assert(ARVA_MAX_CHANNELS == sizeof(arva_reading_s::id), "channels");
static_assert(ARVA_ARRAY_SIZE == debug_array_s::ARRAY_SIZE && (int)ARVA_ARRAY_END == ARVA_ARRAY_SIZE, "layout");

static_assert(ARVA_MAX_VALUES == sizeof(arva_answer_s::values) / sizeof(arva_answer_s::values[0]), "values");
static_assert(ARVA_MAX_TEXT + 1 == sizeof(arva_answer_s::text), "text");

static const char *const COMMANDS[] = {"identify", "mark", "unmark", "select", "restart", "channels", "scan", "search"};
static constexpr uint8_t COMMAND_COUNT = sizeof(COMMANDS) / sizeof(COMMANDS[0]);

ArvaReceiver::ArvaReceiver(const char *port, uint32_t baudrate) :
	ScheduledWorkItem(MODULE_NAME, px4::serial_port_to_wq(port))
{
	strncpy(_port, port, sizeof(_port) - 1);
	_serial.setBaudrate(baudrate);
	arva_decoder_init(&_decoder, [](void *self, const arva_frame * frame) {
		static_cast<ArvaReceiver *>(self)->take(*frame);
	}, this);
	arva_message_decoder_init(&_messages, ARVA_WANT_VECTORS | ARVA_WANT_LEVELS | ARVA_WANT_ANSWERS,
	[](void *self, const arva_message * message) {
		static_cast<ArvaReceiver *>(self)->take(*message);
	}, this);
}

void ArvaReceiver::start()
{
	_arva_reading_pub.advertise(); // early, because the logger searches for new topics rarely
	_arva_answer_pub.advertise();
	_arva_pulses_pub.advertise();
	_debug_array_pub.advertise();
	ScheduleOnInterval(INTERVAL);
}

void ArvaReceiver::Run()
{
	if (should_exit()) {
		ScheduleClear();
		exit_and_cleanup();
		return;
	}

	LockGuard guard{_mutex};

	if (_at == _count) {
		_at = 0;
		_count = open_port() ? read_port() : 0;
	}

	// one frame a pass: debug_array has no queue, and a subscriber would only see the last of several
	const uint32_t now_ms = hrt_absolute_time() / 1000;
	arva_message_decoder_feed(&_messages, nullptr, 0, now_ms);
	size_t frames = arva_decoder_feed(&_decoder, nullptr, 0, now_ms);

	while (frames == 0 && _at < _count) {
		arva_message_decoder_feed(&_messages, &_bytes[_at], 1, now_ms);
		frames = arva_decoder_push(&_decoder, _bytes[_at++], now_ms);
	}

	write_command(now_ms);
	watch();
}

bool ArvaReceiver::open_port()
{
	const hrt_abstime now = hrt_absolute_time();

	if (_serial.isOpen() || now < _next_open) {
		return _serial.isOpen();
	}

	_next_open = now + REOPEN;

	if (!_serial.setPort(_port)) { // no such port
		return false;
	}

	if (!_serial.open()) {
		_serial.close(); // after an open that failed half-way
		return false;
	}

	_serial.flush(); // bytes that came while the port was not read
	arva_decoder_count_anew(&_decoder);
	_byte_time = now;
	return true;
}

/* An unplugged port gives an error, or is silent until it is opened again. */
size_t ArvaReceiver::read_port()
{
	errno = 0;
	const ssize_t count = _serial.read(_bytes, sizeof(_bytes));

	if (count > 0) {
		_byte_time = hrt_absolute_time();
		return count;
	}

	if ((count < 0 && errno != EAGAIN) || hrt_elapsed_time(&_byte_time) > SILENCE) {
		_serial.close();
	}

	return 0;
}

uint32_t ArvaReceiver::age_ms(hrt_abstime now) const
{
	const uint32_t age = arva_decoder_age_ms(&_decoder, now / 1000);
	return age == ARVA_NEVER ? (now - _started) / 1000 : age;
}

void ArvaReceiver::watch()
{
	if (_lost || age_ms(hrt_absolute_time()) <= SILENCE / 1000) {
		return;
	}

	_lost = true;
	const uint32_t dropped = _decoder.dropped - _dropped;

	if (dropped > 0) {
		mavlink_log_warning(&_mavlink_log_pub, "ARVA: no frames, only %" PRIu32 " bytes: baud rate?", dropped);

	} else if (_decoder.good > 0) {
		mavlink_log_warning(&_mavlink_log_pub, "ARVA: receiver lost");

	} else {
		mavlink_log_warning(&_mavlink_log_pub, "ARVA: no receiver");
	}
}

void ArvaReceiver::take(const arva_frame &frame)
{
	if (_lost || _decoder.good == 1) {
		mavlink_log_info(&_mavlink_log_pub, "ARVA: receiver found, channels: %u", frame.n);
		_lost = false;
	}

	_frame = frame;
	_dropped = _decoder.dropped;
	publish(frame);
}

void ArvaReceiver::publish(const arva_frame &frame)
{
	arva_reading_s reading{};
	reading.timestamp = hrt_absolute_time();
	reading.sequence = frame.sequence;
	reading.status = frame.status;
	reading.n = frame.n;

	for (unsigned k = 0; k < ARVA_MAX_CHANNELS; k++) {
		const arva_channel &channel = frame.channels[k];
		reading.id[k] = channel.id;
		reading.zone[k] = channel.zone;
		reading.marked[k] = channel.marked != 0;
		reading.d_cm[k] = channel.d_cm;
		reading.delta_deg[k] = channel.delta_deg;
	}

	reading.lost = _decoder.lost;
	reading.bad_crc = _decoder.bad_crc;
	reading.dropped = _decoder.dropped;
	_arva_reading_pub.publish(reading);

	debug_array_s debug_array{};
	debug_array.timestamp = reading.timestamp;
	debug_array.id = ARVA_ARRAY_ID;
	strncpy(debug_array.name, ARVA_ARRAY_NAME, sizeof(debug_array.name) - 1);
	arva_array_pack(&frame, &_decoder, debug_array.data);
	_debug_array_pub.publish(debug_array);
}

bool ArvaReceiver::send(uint8_t code, const int32_t *values, uint8_t count)
{
	LockGuard guard{_mutex};

	if (_request.waiting) {
		return false;
	}

	const uint32_t now_ms = hrt_absolute_time() / 1000;
	_out_count = arva_command_send(&_request, code, values, count, now_ms, _out, sizeof(_out));
	_tries = 0;
	return _out_count > 0;
}

/* Write the waiting command, and repeat it if its answer is late, at most TRIES times. */
void ArvaReceiver::write_command(uint32_t now_ms)
{
	if (!_request.waiting) {
		return;
	}

	const bool late = now_ms - _request.sent_ms >= ARVA_ANSWER_MS;

	if (late && (_tries >= TRIES || _request.command.code == ARVA_DO_RESTART)) {
		arva_answer none{};
		none.code = _request.command.code;
		none.result = arva_answer_s::RESULT_NO_ANSWER;
		_request.waiting = 0;
		end_command(none);
		return;
	}

	if (late) {
		_out_count = arva_command_again(&_request, now_ms, _out, sizeof(_out));
	}

	if (_out_count > 0) {
		_tries++;

		if (_serial.isOpen()) {
			_serial.write(_out, _out_count);
		}

		_out_count = 0;
	}
}

void ArvaReceiver::take(const arva_message &message)
{
	arva_answer answer;
	arva_measured measured;

	if (arva_answer_get(&message, &answer)) {
		if (arva_command_answered(&_request, &answer)) {
			end_command(answer);
		}

	} else if (arva_measured_get(&message, &measured)) {
		publish(message, measured);
	}
}

void ArvaReceiver::end_command(const arva_answer &answer)
{
	static const char *const results[] = {"done", "refused", "unknown", "busy"};
	const char *result = answer.result <= ARVA_BUSY ? results[answer.result] : "no answer";
	const uint8_t code = answer.code;
	mavlink_log_info(&_mavlink_log_pub, "ARVA: %s: %s %s", code >= 1 && code <= COMMAND_COUNT ? COMMANDS[code - 1] : "command",
			 result, answer.text);
	arva_answer_s message{};
	message.timestamp = hrt_absolute_time();
	message.code = code;
	message.result = answer.result;
	message.count = answer.count;
	memcpy(message.text, answer.text, sizeof(message.text));

	for (unsigned k = 0; k < ARVA_MAX_VALUES; k++) {
		message.values[k] = answer.values[k];
	}

	_arva_answer_pub.publish(message);
}

void ArvaReceiver::publish(const arva_message &message, const arva_measured &measured)
{
	arva_pulses_s pulses{};
	pulses.timestamp = hrt_absolute_time();
	pulses.sequence = measured.sequence;
	pulses.status = measured.status;
	pulses.n = measured.n;
	pulses.time_ms = measured.time_ms;

	for (unsigned k = 0; k < ARVA_MAX_CHANNELS; k++) {
		arva_pulse pulse{};
		pulse.id = ARVA_NO_ID;
		pulse.carrier = ARVA_NO_CARRIER;
		pulse.level = ARVA_NO_LEVEL;
		pulse.age_ms = ARVA_NO_AGE;
		arva_pulse_get(&message, k, &pulse);
		const bool is_vector = message.kind == ARVA_VECTORS && pulse.age_ms != ARVA_NO_AGE;
		pulses.id[k] = pulse.id;
		pulses.zone[k] = pulse.zone;
		pulses.marked[k] = pulse.marked != 0;
		pulses.x_na_m[k] = is_vector ? 0.01f * pulse.x : NAN;
		pulses.y_na_m[k] = is_vector ? 0.01f * pulse.y : NAN;
		pulses.z_na_m[k] = is_vector ? 0.01f * pulse.z : NAN;
		pulses.period_s[k] = pulse.period > 0 ? 1e-4f * pulse.period : NAN;
		pulses.carrier_hz[k] = pulse.carrier != ARVA_NO_CARRIER ? 0.1f * pulse.carrier : NAN;
		pulses.level_dbfs[k] = pulse.level != ARVA_NO_LEVEL ? 0.01f * pulse.level : NAN;
		pulses.age_ms[k] = pulse.age_ms;
	}

	_arva_pulses_pub.publish(pulses);
}

ArvaReceiver::Status ArvaReceiver::status()
{
	LockGuard guard{_mutex};
	return {_serial.getBaudrate(), _serial.isOpen(), _lost, _decoder.good, _decoder.lost, _decoder.bad_crc,
		_decoder.dropped, age_ms(hrt_absolute_time()), _frame};
}

/* Printing is slow: the work queue does not wait for it. */
int ArvaReceiver::print_status()
{
	const Status now = status();
	PX4_INFO("port %s at %" PRIu32 " baud: %s", _port, now.baudrate, now.open ? "open" : "not there");
	PX4_INFO("receiver: %s", now.good == 0 ? "not found yet" : now.silent ? "lost" : "found");
	PX4_INFO("frames: %" PRIu32 " good, %" PRIu32 " lost, %" PRIu32 " with a wrong CRC; bytes in none: %" PRIu32,
		 now.good, now.lost, now.bad_crc, now.dropped);

	if (now.good > 0) {
		PX4_INFO("last frame: %" PRIu32 " ms ago, sequence %u, status 0x%02x, channels %u",
			 now.age_ms, now.frame.sequence, now.frame.status, now.frame.n);
	}

	for (unsigned k = 0; k < now.frame.n; k++) {
		const arva_channel &channel = now.frame.channels[k];

		if (arva_valid(&channel)) {
			PX4_INFO("channel %u: transmitter %u, zone %u%s, %d cm, %d degrees", k + 1, channel.id, channel.zone,
				 channel.marked ? " (marked)" : "", channel.d_cm, channel.delta_deg);

		} else {
			PX4_INFO("channel %u: no signal", k + 1);
		}
	}

	return 0;
}

int ArvaReceiver::task_spawn(int argc, char *argv[])
{
	const char *port = nullptr;
	int32_t configured = 115200; // long on a flight controller, which param_get and px4_get_parameter_value distinguish
	param_get(param_find("SENS_ARVA_BAUD"), &configured);
	int baudrate = configured;

	int option_index = 1;
	const char *option_arg = nullptr;
	int option;

	while ((option = px4_getopt(argc, argv, "d:b:", &option_index, &option_arg)) != EOF) {
		if (option == 'd') {
			port = option_arg;

		} else if (option != 'b' || px4_get_parameter_value(option_arg, baudrate) != 0) {
			print_usage("unrecognized option");
			return PX4_ERROR;
		}
	}

	if (port == nullptr || strlen(port) >= PORT_LENGTH || baudrate <= 0) {
		print_usage("needs a port, of 31 characters at most, and a baud rate");
		return PX4_ERROR;
	}

	ArvaReceiver *instance = new ArvaReceiver(port, baudrate);

	if (instance == nullptr) {
		PX4_ERR("alloc failed");
		return PX4_ERROR;
	}

	_object.store(instance);
	_task_id = task_id_is_work_queue;
	instance->start();
	return PX4_OK;
}

int ArvaReceiver::custom_command(int argc, char *argv[])
{
	if (argc < 2 || strcmp(argv[0], "command") != 0) {
		return print_usage("unknown command");
	}

	uint8_t code = 0;
	int32_t values[ARVA_MAX_VALUES] {};
	const int count = argc - 2;

	while (code < COMMAND_COUNT && strcmp(argv[1], COMMANDS[code]) != 0) {
		code++;
	}

	if (code == COMMAND_COUNT || count > ARVA_MAX_VALUES) {
		return print_usage("no such command of a receiver");
	}

	for (int k = 0; k < count; k++) {
		char *end = nullptr;
		values[k] = strtol(argv[2 + k], &end, 10);

		if (end == argv[2 + k] || *end != 0) {
			return print_usage("values are whole numbers");
		}
	}

	if (!is_running()) {
		PX4_ERR("not running");
		return PX4_ERROR;
	}

	if (!get_instance()->send(code + 1, values, count)) {
		PX4_ERR("the command before still waits for its answer");
		return PX4_ERROR;
	}

	return PX4_OK; // the answer comes as a message
}

int ArvaReceiver::print_usage(const char *reason)
{
	if (reason != nullptr) {
		PX4_WARN("%s", reason);
	}

	PRINT_MODULE_DESCRIPTION(
		R"DESCR_STR(
### Description
Reads an ARVA receiver (457 kHz) on a serial port.
Publishes each frame as arva_reading and debug_array, what was measured as arva_pulses, answers as arva_answer.

### Examples
$ arva_receiver start -d /dev/ttyS3
$ arva_receiver command mark 3
)DESCR_STR");

	PRINT_MODULE_USAGE_NAME("arva_receiver", "driver");
	PRINT_MODULE_USAGE_COMMAND("start");
	PRINT_MODULE_USAGE_PARAM_STRING('d', nullptr, "<file:dev>", "Serial port", false);
	PRINT_MODULE_USAGE_PARAM_INT('b', 115200, 9600, 921600, "Baud rate (or p:<param_name>; default SENS_ARVA_BAUD)", true);
	PRINT_MODULE_USAGE_COMMAND_DESCR("command", "Send a command to the receiver, with its values: identify, mark, unmark, select, restart, channels, scan, search");
	PRINT_MODULE_USAGE_DEFAULT_COMMANDS();
	return 0;
}

extern "C" __EXPORT int arva_receiver_main(int argc, char *argv[])
{
	return ArvaReceiver::main(argc, argv);
}
