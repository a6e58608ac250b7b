/* Decodes forged streams, each behind its length on standard input, with the C interface. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <gsvx.h>

static unsigned long number, accepted, failures;
static char failed[4096] = "";

static void fail(void) {
  size_t used = strlen(failed);
  failures += 1;
  if (used + 32 < sizeof failed) snprintf(failed + used, sizeof failed - used, "%s%lu", used ? ", " : "", number);
}

/* Copies what is held; every coefficient above the first `layers` degrees must be 0. */
static void copied(struct gsvx_stream *stream, const struct gsvx_info *info, uint64_t gaussians, uint32_t layers) {
  uint32_t array;
  for (array = 0; array < 5; ++array) {
    size_t size = (size_t)gaussians * gsvx_stride(array, info->sh_degree);
    float *out = malloc(size + 1);
    if (out == NULL || gsvx_copy(stream, array, out, size, NULL) != GSVX_STATUS_OK) {
      fail();
    } else if (array == GSVX_ARRAY_SH && layers > 0) {
      size_t each = size / 4 / (gaussians ? gaussians : 1), i;
      for (i = 0; i < size / 4; ++i)
        if (i % each >= 3 * (size_t)layers * layers && out[i] != 0) {
          fail();
          break;
        }
    }
    free(out);
  }
}

static void decode(const unsigned char *bytes, size_t size) {
  struct gsvx_stream *stream = NULL;
  struct gsvx_info info;
  uint64_t chunk, gaussians = 0;
  int whole = 1;
  if (gsvx_open(NULL, &stream, NULL) != GSVX_STATUS_OK) abort();
  if (gsvx_give(stream, 0, bytes, size, NULL) == GSVX_STATUS_INTERNAL) fail();
  if (gsvx_get_info(stream, &info, NULL) == GSVX_STATUS_OK) {
    for (chunk = 0; chunk < info.chunks && chunk < 8; ++chunk) {
      struct gsvx_chunk entry;
      uint32_t layers;
      if (gsvx_get_chunk(stream, chunk, &entry, NULL) != GSVX_STATUS_OK) fail();
      /* All layers, then fewer until some can be decoded. */
      for (layers = entry.layers; layers > 0; --layers) {
        enum gsvx_status status = gsvx_decode(stream, chunk, layers, &gaussians, NULL);
        if (status == GSVX_STATUS_INTERNAL) fail();
        if (status == GSVX_STATUS_OK) {
          copied(stream, &info, gaussians, entry.exact ? 0 : layers);
          break;
        }
        whole = 0;
      }
    }
    accepted += whole;
  }
  gsvx_close(stream);
}

int main(void) {
  unsigned char length[4];
  struct rusage usage;
  for (number = 0; fread(length, 1, 4, stdin) == 4; ++number) {
    size_t size = length[0] | length[1] << 8 | length[2] << 16 | (size_t)length[3] << 24;
    unsigned char *bytes = malloc(size + 1);
    if (bytes == NULL || fread(bytes, 1, size, stdin) != size) return 1;
    decode(bytes, size);
    free(bytes);
  }
  getrusage(RUSAGE_SELF, &usage);
  printf("{\"streams\": %lu, \"accepted\": %lu, \"failed\": [%s], \"peak\": %ld}\n", number, accepted, failed,
         usage.ru_maxrss * 1024);
  return 0;
}
