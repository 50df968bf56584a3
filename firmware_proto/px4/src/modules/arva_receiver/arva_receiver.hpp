/* Reads an ARVA receiver (457 kHz) on a serial port and publishes its frames. See ../../../README.md. */
#pragma once

#include <pthread.h>

#include <containers/LockGuard.hpp>
#include <drivers/drv_hrt.h>
#include <px4_platform_common/Serial.hpp>
#include <px4_platform_common/module.h>
#include <px4_platform_common/px4_work_queue/ScheduledWorkItem.hpp>
#include <uORB/Publication.hpp>
#include <uORB/topics/arva_answer.h>
#include <uORB/topics/arva_pulses.h>
#include <uORB/topics/arva_reading.h>
#include <uORB/topics/debug_array.h>

#include "arva_array.h"
#include "arva_message.h"

using namespace time_literals;

class ArvaReceiver : public ModuleBase<ArvaReceiver>, public px4::ScheduledWorkItem
{
public:
	ArvaReceiver(const char *port, uint32_t baudrate);

	static int task_spawn(int argc, char *argv[]);
	static int custom_command(int argc, char *argv[]);
	static int print_usage(const char *reason = nullptr);

	void start();
	int print_status() override;
	bool send(uint8_t code, const int32_t *values, uint8_t count); // false while another command waits for its answer

private:
	static constexpr hrt_abstime INTERVAL = 10_ms;
	static constexpr hrt_abstime SILENCE = 2_s;  // without bytes: open the port again; without a frame: receiver lost
	static constexpr hrt_abstime REOPEN = 500_ms;
	static constexpr size_t MOST_BYTES = 256;    // read in one interval: those of 230400 baud
	static constexpr size_t PORT_LENGTH = 32;    // of device::Serial
	static constexpr uint8_t TRIES = 3;          // of a command

	struct Status {
		uint32_t baudrate;
		bool open;
		bool silent;
		uint32_t good, lost, bad_crc, dropped;
		uint32_t age_ms;
		arva_frame frame; // the last good one
	};

	void Run() override;
	bool open_port();
	size_t read_port();
	void watch();
	Status status();
	void take(const arva_frame &frame);
	void publish(const arva_frame &frame);
	void write_command(uint32_t now_ms);
	void take(const arva_message &message);
	void publish(const arva_message &message, const arva_measured &measured);
	void end_command(const arva_answer &answer);
	uint32_t age_ms(hrt_abstime now) const;      // of the last good frame; before the first, the time since the start

	// Run() is called by the work queue, print_status() by the shell: a lock protects their common data
	pthread_mutex_t _mutex = PTHREAD_MUTEX_INITIALIZER;

	char _port[PORT_LENGTH] {};
	device::Serial _serial{};
	uint8_t _bytes[MOST_BYTES];          // read; those from _at on are not decoded yet
	size_t _count{0};
	size_t _at{0};
	arva_decoder _decoder;
	arva_frame _frame{};                 // the last good one
	arva_message_decoder _messages;      // fed with the same bytes
	arva_request _request{};             // the command that waits for its answer
	uint8_t _out[ARVA_MAX_COMMAND_BYTES];
	size_t _out_count{0};                // bytes of it to be written
	uint8_t _tries{0};

	const hrt_abstime _started{hrt_absolute_time()};
	hrt_abstime _next_open{0};
	hrt_abstime _byte_time{0};           // time of the last byte, or of the opening of the port
	bool _lost{false};                   // and reported
	uint32_t _dropped{0};                // count of bytes at the last good frame

	uORB::Publication<arva_reading_s> _arva_reading_pub{ORB_ID(arva_reading)};
	uORB::Publication<arva_answer_s> _arva_answer_pub{ORB_ID(arva_answer)};
	uORB::Publication<arva_pulses_s> _arva_pulses_pub{ORB_ID(arva_pulses)};
	uORB::Publication<debug_array_s> _debug_array_pub{ORB_ID(debug_array)};
	orb_advert_t _mavlink_log_pub{nullptr};
};
