/* A frame as the data of the uORB topic debug_array. Layout: ../../../README.md. */
#ifndef ARVA_ARRAY_H
#define ARVA_ARRAY_H

#include "arva_frame.h"

#define ARVA_ARRAY_NAME "arva"
#define ARVA_ARRAY_ID 457
#define ARVA_ARRAY_SIZE 58
#define ARVA_ARRAY_CHANNELS 13 /* further channels of a frame are left out */

enum { ARVA_ARRAY_D, ARVA_ARRAY_DELTA, ARVA_ARRAY_ID_OF, ARVA_ARRAY_ZONE, ARVA_ARRAY_STRIDE }; /* of channel k: + 4 k */
enum {
	ARVA_ARRAY_N = ARVA_ARRAY_STRIDE * ARVA_ARRAY_CHANNELS,
	ARVA_ARRAY_SEQUENCE,
	ARVA_ARRAY_STATUS,
	ARVA_ARRAY_LOST,
	ARVA_ARRAY_BAD_CRC,
	ARVA_ARRAY_DROPPED,
	ARVA_ARRAY_END
};

/* All values are integers, exact in a float; the counters of `decoder` up to 2^24. */
static inline void arva_array_pack(const arva_frame *frame, const arva_decoder *decoder, float data[ARVA_ARRAY_SIZE])
{
	for (size_t k = 0; k < ARVA_ARRAY_CHANNELS; k++) {
		const arva_channel *channel = &frame->channels[k];
		float *to = data + ARVA_ARRAY_STRIDE * k;
		to[ARVA_ARRAY_D] = channel->d_cm;
		to[ARVA_ARRAY_DELTA] = channel->delta_deg;
		to[ARVA_ARRAY_ID_OF] = channel->id;
		to[ARVA_ARRAY_ZONE] = (float)(channel->zone | (channel->marked ? 0x80 : 0));
	}

	data[ARVA_ARRAY_N] = frame->n;
	data[ARVA_ARRAY_SEQUENCE] = frame->sequence;
	data[ARVA_ARRAY_STATUS] = frame->status;
	data[ARVA_ARRAY_LOST] = (float)decoder->lost;
	data[ARVA_ARRAY_BAD_CRC] = (float)decoder->bad_crc;
	data[ARVA_ARRAY_DROPPED] = (float)decoder->dropped;
}

#endif
