/* bounds FILE: what the head of a stream says. It reads no more of the file than the head. */
#include <gsvx.h>
#include <stdio.h>

/* Reads what the stream needs until its head is known. */
static gsvx_status read_head(FILE *file, gsvx_stream *stream, gsvx_message *why) {
    static uint8_t bytes[1 << 16];
    gsvx_range range;
    gsvx_status status;
    while ((status = gsvx_needs(stream, 0, 0, &range, why)) == GSVX_STATUS_OK && range.begin < range.end) {
        size_t size = (size_t)(range.end - range.begin);
        if (size > sizeof bytes) size = sizeof bytes;
        if (fseek(file, (long)range.begin, SEEK_SET) != 0) return GSVX_STATUS_TRUNCATED;
        size = fread(bytes, 1, size, file);
        if (size == 0) return GSVX_STATUS_TRUNCATED;
        if ((status = gsvx_give(stream, range.begin, bytes, size, why)) != GSVX_STATUS_OK) return status;
    }
    return status;
}

int main(int count, char **arguments) {
    FILE *file = count == 2 ? fopen(arguments[1], "rb") : NULL;
    if (file == NULL) {
        fprintf(stderr, "usage: bounds FILE\n");
        return 2;
    }
    gsvx_message why = {"the file is truncated"};
    gsvx_options y_up = {GSVX_AXES_Y_UP, 0, 0};
    gsvx_stream *stream = NULL;
    gsvx_info info;
    gsvx_status status = gsvx_open(&y_up, &stream, &why);
    if (status == GSVX_STATUS_OK) status = read_head(file, stream, &why);
    if (status == GSVX_STATUS_OK) status = gsvx_get_info(stream, &info, &why);
    if (status == GSVX_STATUS_OK)
        printf("%llu Gaussians in %llu chunks, from %g %g %g to %g %g %g\n", (unsigned long long)info.gaussians,
               (unsigned long long)info.chunks, info.low[0], info.low[1], info.low[2], info.high[0], info.high[1],
               info.high[2]);
    else
        fprintf(stderr, "%s: %s\n", arguments[1], why.text);
    gsvx_close(stream);
    fclose(file);
    return status == GSVX_STATUS_OK ? 0 : 1;
}
