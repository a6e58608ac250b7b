/* parts STREAM AXES: decodes a stream that arrives in parts, layer after layer. Writes all arrays of each chunk of the
 * finest level to standard output, chunk after chunk. */
#include "file.h"
#include "gsvx.h"

static gsvx_message why;

static void check(gsvx_status status) {
    if (status == GSVX_STATUS_OK) return;
    fprintf(stderr, "status %d: %s\n", (int)status, why.text);
    exit(1);
}

/* Gives what is missing, in two pieces, the second first. */
static void fetch(gsvx_stream *stream, const unsigned char *file, size_t size, uint64_t chunk, uint32_t layers) {
    gsvx_range range;
    for (;;) {
        check(gsvx_needs(stream, chunk, layers, &range, &why));
        if (range.begin == range.end) return;
        size_t begin = (size_t)range.begin, end = range.end < size ? (size_t)range.end : size;
        if (begin >= end) {
            fprintf(stderr, "the stream is truncated\n");
            exit(1);
        }
        size_t middle = begin + (end - begin) / 2;
        check(gsvx_give(stream, middle, file + middle, end - middle, &why));
        check(gsvx_give(stream, begin, file + begin, middle - begin, &why));
    }
}

/* Copies an array to a buffer of just its size, and to one that is a byte too small. */
static void copy(gsvx_stream *stream, uint32_t array, uint64_t count, uint32_t sh_degree) {
    size_t size = (size_t)count * gsvx_stride(array, sh_degree);
    unsigned char *out = malloc(size + 1);
    if (out == NULL) exit(1);
    if (size > 0 && gsvx_copy(stream, array, out, size - 1, &why) != GSVX_STATUS_BUFFER) exit(1);
    check(gsvx_copy(stream, array, out, size, &why));
    fwrite(out, 1, size, stdout);
    free(out);
}

int main(int count, char **arguments) {
    size_t size = 0;
    unsigned char *file = count == 3 ? read_file(arguments[1], &size) : NULL;
    if (file == NULL) return 2;
    gsvx_options options = {0};
    options.axes = (uint32_t)atoi(arguments[2]);
    gsvx_stream *stream;
    gsvx_info info;
    gsvx_chunk entry;
    check(gsvx_open(&options, &stream, &why));
    if (gsvx_get_info(stream, &info, &why) != GSVX_STATUS_TRUNCATED) return 1;
    fetch(stream, file, size, 0, 0);
    check(gsvx_get_info(stream, &info, &why));
    for (uint64_t chunk = 0; chunk < info.chunks; chunk++) {
        check(gsvx_get_chunk(stream, chunk, &entry, &why));
        if (entry.level > 0) continue;
        uint64_t gaussians = 0;
        for (uint32_t layers = 1; layers <= entry.layers; layers++) {
            gsvx_range missing;
            check(gsvx_needs(stream, chunk, layers, &missing, &why));
            gsvx_status early = gsvx_decode(stream, chunk, layers, &gaussians, &why);
            if (early != (missing.begin < missing.end ? GSVX_STATUS_TRUNCATED : GSVX_STATUS_OK)) return 1;
            fetch(stream, file, size, chunk, layers);
            check(gsvx_decode(stream, chunk, layers, &gaussians, &why));
            check(gsvx_forget(stream, chunk, &why));
        }
        if (gaussians != entry.gaussians) return 1;
        for (uint32_t array = GSVX_ARRAY_MEANS; array <= GSVX_ARRAY_PACKED_SH3B; array++)
            copy(stream, array, gaussians, info.sh_degree);
    }
    gsvx_close(stream);
    free(file);
    return 0;
}
