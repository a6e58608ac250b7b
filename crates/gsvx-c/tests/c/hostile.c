/* hostile STREAMS: decodes broken streams, each behind its length in 4 bytes, and prints how many gave an error. Wrong
 * arguments are errors too. */
#include "file.h"
#include "gsvx.h"

static gsvx_message why;

/* Decodes all that a stream has. */
static gsvx_status decode_all(gsvx_stream *stream) {
    gsvx_info info;
    gsvx_status status = gsvx_get_info(stream, &info, &why);
    for (uint64_t chunk = 0; status == GSVX_STATUS_OK && chunk < info.chunks; chunk++) {
        gsvx_chunk entry;
        uint64_t gaussians = 0;
        status = gsvx_get_chunk(stream, chunk, &entry, &why);
        if (status == GSVX_STATUS_OK) status = gsvx_decode(stream, chunk, entry.layers, &gaussians, &why);
        for (uint32_t array = 0; status == GSVX_STATUS_OK && array <= GSVX_ARRAY_PACKED_SH3B; array++) {
            size_t size = (size_t)gaussians * gsvx_stride(array, info.sh_degree);
            void *out = malloc(size + 1);
            if (out == NULL) exit(1);
            status = gsvx_copy(stream, array, out, size, &why);
            free(out);
        }
    }
    return status;
}

static void expect(gsvx_status got, gsvx_status wanted, int line) {
    if (got == wanted) return;
    fprintf(stderr, "line %d: status %d, not %d\n", line, (int)got, (int)wanted);
    exit(1);
}

#define EXPECT(call, status) expect(call, GSVX_STATUS_##status, __LINE__)

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

int main(int count, char **arguments) {
    size_t size = 0, at = 0;
    unsigned char *file = count == 2 ? read_file(arguments[1], &size) : NULL;
    if (file == NULL) return 2;
    unsigned streams = 0, errors = 0;
    misuse();
    while (at < size) {
        size_t length = file[at] | file[at + 1] << 8 | file[at + 2] << 16 | (size_t)file[at + 3] << 24;
        gsvx_stream *stream = NULL;
        if (gsvx_open(NULL, &stream, &why) != GSVX_STATUS_OK) return 1;
        gsvx_status status = gsvx_give(stream, 0, file + at + 4, length, &why);
        gsvx_range range;
        EXPECT(gsvx_needs(stream, 0, 0, &range, NULL), OK);
        if (range.begin > range.end || (status != GSVX_STATUS_OK && range.begin != 0)) return 1;
        if (status == GSVX_STATUS_OK) status = decode_all(stream);
        if (status == GSVX_STATUS_INTERNAL) return 1;
        if (status != GSVX_STATUS_OK && why.text[0] == 0) return 1;
        errors += status != GSVX_STATUS_OK;
        streams += 1;
        gsvx_close(stream);
        at += 4 + length;
    }
    printf("%u of %u\n", errors, streams);
    free(file);
    return 0;
}
