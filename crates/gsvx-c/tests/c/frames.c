/* frames SEQUENCE: writes the means, rotations, log-scales, opacity logits and SH coefficients of each frame to standard
 * output, frame after frame. Calls that fail keep what is held. */
#include "file.h"
#include "gsvx.h"

static gsvx_message why;

static void expect(gsvx_status got, gsvx_status wanted, int line) {
    if (got == wanted) return;
    fprintf(stderr, "line %d: status %d, not %d: %s\n", line, (int)got, (int)wanted, why.text);
    exit(1);
}

#define EXPECT(call, status) expect(call, GSVX_STATUS_##status, __LINE__)

int main(int count, char **arguments) {
    size_t size = 0;
    unsigned char *file = count == 2 ? read_file(arguments[1], &size) : NULL;
    if (file == NULL) return 2;
    gsvx_stream *stream, *small;
    gsvx_options options = {0, 4, 3};
    gsvx_frame frame = {1, 0, 0, 0};
    EXPECT(gsvx_open(NULL, &stream, &why), OK);
    for (uint64_t number = 0; number < frame.frames; number++) {
        EXPECT(gsvx_decode_frame(stream, file, size, number, &frame, &why), OK);
        for (uint32_t array = GSVX_ARRAY_MEANS; array <= GSVX_ARRAY_SH; array++) {
            size_t bytes = (size_t)frame.gaussians * gsvx_stride(array, frame.sh_degree);
            unsigned char *out = malloc(bytes);
            if (out == NULL) return 1;
            EXPECT(gsvx_copy(stream, array, out, bytes, &why), OK);
            fwrite(out, 1, bytes, stdout);
            free(out);
        }
    }
    EXPECT(gsvx_open(&options, &small, &why), OK);
    EXPECT(gsvx_decode_frame(small, file, size, 0, &frame, &why), LIMIT);
    EXPECT(gsvx_decode_frame(stream, file, size, frame.frames, &frame, &why), ARGUMENT);
    EXPECT(gsvx_decode_frame(stream, file, size, 0, NULL, &why), ARGUMENT);
    EXPECT(gsvx_decode_frame(small, file, size - 1, frame.frames - 1, &frame, &why), TRUNCATED);
    EXPECT(gsvx_decode_frame(stream, file, 7, 0, &frame, &why), TRUNCATED);
    EXPECT(gsvx_decode_frame(stream, NULL, 0, 0, &frame, &why), NOT_GSVX);
    EXPECT(gsvx_give(stream, 0, file, size, &why), VERSION);
    float opacity;
    EXPECT(gsvx_copy(stream, GSVX_ARRAY_OPACITY_LOGITS, &opacity, sizeof opacity, &why), BUFFER);
    EXPECT(gsvx_copy(small, GSVX_ARRAY_OPACITY_LOGITS, &opacity, sizeof opacity, &why), ARGUMENT);
    file[size - 1] ^= 1;
    EXPECT(gsvx_decode_frame(small, file, size, frame.frames - 1, &frame, &why), DAMAGED);
    file[8] = 1;
    EXPECT(gsvx_decode_frame(stream, file, size, 0, &frame, &why), VERSION);
    gsvx_close(stream);
    gsvx_close(small);
    free(file);
    return 0;
}
