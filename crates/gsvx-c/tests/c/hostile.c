/* hostile: decodes broken streams from standard input, each behind its length in 4 bytes. Prints how many were decoded as
 * whole ones, the numbers of those that failed within the library, and a digest of all scenes, with and without salvage.
 * Wrong arguments are errors too. */
#include <stdio.h>
#include <stdlib.h>

#include "gsvx.h"

static gsvx_message why;

static void expect(gsvx_status got, gsvx_status wanted, int line) {
    if (got == wanted) return;
    fprintf(stderr, "line %d: status %d, not %d\n", line, (int)got, (int)wanted);
    exit(1);
}

#define EXPECT(call, status) expect(call, GSVX_STATUS_##status, __LINE__)

static uint32_t join(uint32_t digest, uint32_t number) { return (digest << 5 | digest >> 27) ^ number; }

/* CRC-32, as in zlib, of bytes behind those before. */
static uint32_t crc32(uint32_t crc, const unsigned char *bytes, size_t size) {
    static uint32_t table[256];
    if (table[1] == 0) {
        for (uint32_t i = 0; i < 256; i++) {
            table[i] = i;
            for (int bit = 0; bit < 8; bit++) table[i] = table[i] >> 1 ^ (table[i] & 1 ? 0xedb88320u : 0);
        }
    }
    crc = ~crc;
    for (size_t i = 0; i < size; i++) crc = table[(crc ^ bytes[i]) & 255] ^ crc >> 8;
    return ~crc;
}

/* Takes all arrays of the chunk that is held. `crcs` has those of the arrays that are stored. */
static void take(gsvx_stream *stream, uint64_t gaussians, uint32_t degree, uint32_t crcs[5]) {
    for (uint32_t array = 0; array <= GSVX_ARRAY_PACKED_SH3B; array++) {
        size_t size = (size_t)gaussians * gsvx_stride(array, degree);
        unsigned char *out = malloc(size + 1);
        if (out == NULL) exit(1);
        EXPECT(gsvx_copy(stream, array, out, size, &why), OK);
        if (array <= GSVX_ARRAY_SH) crcs[array] = crc32(crcs[array], out, size);
        free(out);
    }
}

/* Decodes what a chunk has of its layers: all of them, or with salvage those that are good. */
static gsvx_status decode_chunk(gsvx_stream *stream, uint64_t chunk, uint32_t degree, int salvage, uint32_t crcs[5]) {
    gsvx_chunk entry;
    uint64_t gaussians = 0;
    gsvx_status status = gsvx_get_chunk(stream, chunk, &entry, &why), first = GSVX_STATUS_OK;
    if (status != GSVX_STATUS_OK || entry.level > 0) return status;
    for (uint32_t layers = entry.layers; layers > 0; layers--) {
        status = gsvx_decode(stream, chunk, layers, &gaussians, &why);
        if (status == GSVX_STATUS_OK) {
            if (gaussians != entry.gaussians) exit(1);
            if (first == GSVX_STATUS_OK || salvage) take(stream, gaussians, degree, crcs);
            break;
        }
        if (why.text[0] == 0) exit(1);
        if (first == GSVX_STATUS_OK) first = status;
        /* Nothing is held. */
        unsigned char byte = 0;
        EXPECT(gsvx_copy(stream, GSVX_ARRAY_MEANS, &byte, 1, &why), ARGUMENT);
    }
    return salvage && first != GSVX_STATUS_INTERNAL ? GSVX_STATUS_OK : first;
}

/* Decodes the finest level. `digest` gets that of the scene, 0 if the stream is refused. */
static gsvx_status decode_all(const unsigned char *bytes, size_t size, int salvage, uint32_t *digest) {
    gsvx_stream *stream = NULL;
    gsvx_info info;
    gsvx_range range;
    gsvx_options options = {0};
    *digest = 0;
    EXPECT(gsvx_open(NULL, &stream, &why), OK);
    gsvx_status status = gsvx_give(stream, 0, bytes, size, &why);
    EXPECT(gsvx_needs(stream, 0, 0, &range, NULL), OK);
    if (range.begin > range.end || (status != GSVX_STATUS_OK && range.begin != 0)) exit(1);
    if (status == GSVX_STATUS_OK) status = gsvx_get_info(stream, &info, &why);
    gsvx_close(stream);
    if (status != GSVX_STATUS_OK) return status;
    /* A whole stream is refused that has more than this. */
    uint64_t have = info.bytes < size ? info.bytes : size;
    options.max_gaussians = (1024 * have + (64 << 20)) / (4 * (11 + 3 * (info.sh_degree + 1) * (info.sh_degree + 1)));
    if (info.gaussians > options.max_gaussians) return GSVX_STATUS_LIMIT;
    EXPECT(gsvx_open(&options, &stream, &why), OK);
    EXPECT(gsvx_give(stream, 0, bytes, size, &why), OK);
    uint32_t crcs[5] = {0};
    for (uint64_t chunk = 0; status == GSVX_STATUS_OK && chunk < info.chunks; chunk++)
        status = decode_chunk(stream, chunk, info.sh_degree, salvage, crcs);
    gsvx_close(stream);
    if (status != GSVX_STATUS_OK) return status;
    *digest = 1;
    for (int i = 0; i < 5; i++) *digest = join(*digest, crcs[i]);
    return status;
}

/* Calls that no program should make. */
static void misuse(void) {
    gsvx_stream *stream = NULL;
    gsvx_options options = {9, 0, 0}, half = {0, 2, 0};
    gsvx_range range;
    gsvx_chunk entry;
    float out[4];
    EXPECT(gsvx_open(&options, &stream, &why), ARGUMENT);
    if (stream != NULL) exit(1);
    EXPECT(gsvx_open(&half, &stream, &why), ARGUMENT);
    EXPECT(gsvx_open(NULL, NULL, &why), ARGUMENT);
    EXPECT(gsvx_open(NULL, &stream, NULL), OK);
    EXPECT(gsvx_give(stream, 0, NULL, 0, NULL), OK);
    EXPECT(gsvx_give(stream, 0, NULL, 1, NULL), ARGUMENT);
    EXPECT(gsvx_give(stream, UINT64_MAX, (const uint8_t *)"x", 1, NULL), ARGUMENT);
    EXPECT(gsvx_give(stream, 0, (const uint8_t *)"no stream at all", 16, NULL), NOT_GSVX);
    EXPECT(gsvx_give(NULL, 0, NULL, 0, NULL), ARGUMENT);
    EXPECT(gsvx_needs(stream, 7, 9, &range, NULL), OK);
    EXPECT(gsvx_needs(stream, 7, 9, NULL, NULL), ARGUMENT);
    EXPECT(gsvx_get_chunk(stream, 7, &entry, NULL), TRUNCATED);
    EXPECT(gsvx_decode(stream, 0, 1, NULL, NULL), TRUNCATED);
    EXPECT(gsvx_forget(stream, 0, NULL), TRUNCATED);
    EXPECT(gsvx_copy(stream, GSVX_ARRAY_MEANS, out, sizeof out, NULL), ARGUMENT);
    EXPECT(gsvx_copy(stream, 99, out, sizeof out, NULL), ARGUMENT);
    EXPECT(gsvx_copy(stream, GSVX_ARRAY_MEANS, NULL, 1, NULL), ARGUMENT);
    EXPECT(gsvx_copy(stream, GSVX_ARRAY_MEANS, out, SIZE_MAX, NULL), ARGUMENT);
    gsvx_close(stream);
    gsvx_close(NULL);
    if (gsvx_stride(GSVX_ARRAY_SH, 4) != 0 || gsvx_stride(99, 0) != 0) exit(1);
}

int main(void) {
    unsigned streams = 0, accepted = 0, failed = 0;
    uint32_t scenes = 0;
    unsigned char length[4];
    misuse();
    printf("{\"failed\": [");
    for (; fread(length, 1, 4, stdin) == 4; streams++) {
        size_t size = length[0] | length[1] << 8 | length[2] << 16 | (size_t)length[3] << 24;
        unsigned char *bytes = malloc(size + 1);
        if (bytes == NULL || fread(bytes, 1, size, stdin) != size) return 1;
        for (int salvage = 0; salvage < 2; salvage++) {
            uint32_t digest;
            gsvx_status status = decode_all(bytes, size, salvage, &digest);
            accepted += status == GSVX_STATUS_OK && !salvage;
            if (status == GSVX_STATUS_INTERNAL) printf("%s%u", failed++ ? ", " : "", streams);
            scenes = join(scenes, digest);
        }
        free(bytes);
    }
    printf("], \"streams\": %u, \"accepted\": %u, \"scenes\": %u}\n", streams, accepted, scenes);
    return 0;
}
